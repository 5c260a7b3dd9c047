"""
What the thesis saw, O1 to O10, against what each mechanism of the table would have shown.

With perfect tracking and without noise. A drift counts from ``DRIFT`` on, as in the figures of
chapter 5; its sign is not compared, as the thesis gives none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from mambo_model.motion.trajectory import TRAJECTORIES, Trajectory
import numpy as np

from .paths import Array, one_turn, Track, turn_of
from .table import drift, estimated, moved, Row, ROWS

DRIFT = 0.02          # m a turn, as in chapter 5
HEIGHTS = (0.75, 1.0, 1.5, 2.5)  # m, of Figure C.3
STEADY = 0.04         # m, modulation that is not visible in Figure C.2
GROWTH = 0.01         # of the distance, that is visible there: 3 cm of 3 m
HELPED = 0.3          # of the drift is left where a factor gives a good match


class Observation(NamedTuple):
    """An observation of the thesis, and the test whether a mechanism shows it."""

    name: str
    source: str
    description: str
    shown: Callable[[Row], bool]


def _drifts(row: Row, path: str) -> tuple[bool, bool]:
    """Return whether x and y drift on a path."""
    x, y = np.abs(drift(row, path)) > DRIFT
    return bool(x), bool(y)


def factors(row: Row) -> Array:
    """Return the best constant factor on a sine in y at each of HEIGHTS, (4,)."""
    out = []
    for height in HEIGHTS:
        turn = turn_of(Trajectory('sine in y', (0.0, 0.0, -height), (0.0, 1.0, 0.0)),
                       drag_rate=row.drag_rate)
        seen, true = estimated(row, turn, 1.0)[:, 1], turn.velocity[:, 1]
        out.append(float(seen @ true / (seen @ seen)))
    return np.array(out)


def ramp(row: Row, scale: float) -> tuple[float, float]:
    """Return growth over distance, and modulation in m, of the error in x on the path of C.2."""
    turn = turn_of(TRAJECTORIES['ramp'], drag_rate=row.drag_rate)
    error = estimated(row, turn, scale)[:, 0] - turn.velocity[:, 0]
    path = np.cumsum(error - error.mean()) * (turn.t[1] - turn.t[0])
    return float(error.mean() / turn.velocity[:, 0].mean()), float(np.ptp(path) / 2.0)


def tuned(turn: Track, slope: float) -> Array:
    """Return the factor 0.92 + slope h over its value at 1.5 m, (n,)."""
    return (0.92 + slope * turn.height) / (0.92 + slope * 1.5)


def corrected(row: Row, path: str, slope: float) -> Array:
    """Return the drift in a turn, (2,) m, if the estimator's factor rises with the height."""
    turn = one_turn(path, drag_rate=row.drag_rate)
    return moved(turn, estimated(row, turn, row.scale * tuned(turn, slope)))


def _retuned(row: Row) -> bool:
    """Return whether the fitted slope makes the drift of C.4 smaller, and the retuned one more."""
    before, fitted, better = abs(drift(row, 'C.4')[0]), *(
        abs(corrected(row, 'C.4', slope)[0]) for slope in (0.07, 0.10))
    return bool(before > DRIFT and better < fitted < before and better < HELPED * before)


def _opposite(row: Row) -> bool:
    """Return whether one axis of (3.31) becomes better by the retuned factor, the other worse."""
    before, after = np.abs(drift(row, 'swapped')), np.abs(corrected(row, 'swapped', 0.10))
    return bool(after[0] < before[0] and after[1] > before[1] + DRIFT)


def _steady(row: Row) -> bool:
    """Return whether the error grows on the ramp, by the row's factor or that of the sines."""
    found = [ramp(row, scale) for scale in (row.scale, float(factors(row).mean()))]
    return any(abs(growth) > GROWTH and modulation < STEADY for growth, modulation in found)


def _rising(row: Row) -> bool:
    """Return whether the best factor rises from height to height."""
    found = factors(row)
    return bool((np.diff(found) > 0.0).all() and found[-1] - found[0] > 0.03)


OBSERVATIONS = (
    Observation('O1', '(5.3)', 'level circle: no drift', lambda r: not any(_drifts(r, '(5.3)'))),
    Observation('O2', '(5.4)', 'y drifts, x does not', lambda r: _drifts(r, '(5.4)') == (0, 1)),
    Observation('O3', 'sec. 5.5', 'x and y exchanged: x drifts',
                lambda r: _drifts(r, 'swapped')[0]),
    Observation('O4', '(5.5)', 'inclined line: no drift', lambda r: not _drifts(r, '(5.5)')[0]),
    Observation('O5', '(5.6)', 'vertical circle: x drifts', lambda r: _drifts(r, '(5.6)')[0]),
    Observation('O6', 'C.1', 'carried by hand, level: x drifts',
                lambda r: _drifts(r, 'hand loop')[0]),
    Observation('O7', 'C.2', 'ramp: the difference grows steadily', _steady),
    Observation('O8', 'C.3', 'the best factor rises with the height', _rising),
    Observation('O9', 'C.4 to C.6', 'a slope of 0.07 helps, 0.10 helps better', _retuned),
    Observation('O10', 'C.7, C.8', 'with 0.10 x becomes better and y worse', _opposite),
)


def observed_by_mechanism() -> Mapping[str, dict[str, bool]]:
    """Return {row of the table: {observation: whether the mechanism shows it}}."""
    return {name: {o.name: bool(o.shown(row)) for o in OBSERVATIONS}
            for name, row in ROWS.items()}
