"""The result of the flights of one controller on one course in one condition."""

from __future__ import annotations

from typing import NamedTuple

LOST = 2.0  # m, of the largest error: such a flight did not survive


class Result(NamedTuple):
    """Statistics over the draws of one controller, course, condition and state."""

    entrant: str
    course: str
    condition: str
    state: str  # that the controller got, name in comparison.STATES
    flights: int
    survived: float  # share without shutdown and without an error of LOST
    rms: float  # m, median of the flights' RMS errors
    rms_95: float  # m, 95th percentile of them
    largest: float  # m, largest error of any flight
    end: float  # m, median error at the end
    saturated: float  # mean share of the steps with a motor at a limit
    energy: float  # J, mean


def length(x: float) -> str:
    """Return a length in m as text in mm with three digits."""
    return f'{1e3 * x:.3g}' if 1e3 * x < 999.5 else f'{1e3 * x:.0f}'
