"""
Rows that hold the position before: a table, or a driver, that is faster than its motion capture.

A vehicle does not stand between two moves, and another value of a capture has other noise. At rest
in a simulation, and where positions are rounded, rows repeat others without being held. In 13
real recordings with motion capture none is held.
"""

from __future__ import annotations

from mambo_signals.resample import constant_runs
import numpy as np
from numpy.typing import NDArray

from .plausible import COARSE

Floats = NDArray[np.float64]
LONGEST_HOLD = 0.25  # s, of one position; a vehicle that is tracked at 4 Hz is not flown by it
FEWEST = 10   # rows that are told
SHARE = 0.1   # of the rows of a motion that are told, from which on the rate is wrong by a tenth


def held(times: Floats, position: Floats) -> NDArray[np.bool_]:
    """
    Return which rows hold the position before, between two moves of more than ``COARSE``, (n,).

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m

    """
    if len(times) < 3:
        return np.zeros(len(times), bool)
    runs = constant_runs(position)
    moved = np.linalg.norm(np.diff(position, axis=0), axis=1) > COARSE
    of_hold = times[runs[:, 1] - 1] - times[runs[:, 0]] < LONGEST_HOLD
    of_hold[1:] &= moved[runs[1:, 0] - 1]
    of_hold[:-1] &= moved[runs[1:, 0] - 1]
    of_hold[[0, -1]] = False  # whether it moved before and after is not known
    out = np.repeat(of_hold, np.diff(runs, axis=1)[:, 0])
    out[runs[:, 0]] = False
    return out


def describe(name: str, times: Floats, position: Floats, remedy: str) -> list[str]:
    """
    Return a line about rows that are held, none if there are few.

    Parameters
    ----------
    name
        Of the topic.
    times, position
        As for :func:`held`.
    remedy
        What to do.

    """
    count = int(held(times, position).sum())
    moves = int((np.linalg.norm(np.diff(position, axis=0), axis=1) > COARSE).sum())
    if count < FEWEST or count < SHARE * (count + moves):
        return []
    return [f'{name}: {count} of {len(times)} positions repeat the one before while the vehicle '
            f'moves, as of a table that is faster than the motion capture: {remedy}']
