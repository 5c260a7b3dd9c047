"""
Steps of a tracked position that stay: a marker that slipped, or a tracker that was set anew.

Between two frames a vehicle moves about as far as between those beside them. A position that is
off once goes back at the next frame; after a slip all later ones are off. A drone whose motors
stop falls, and stays on the floor: what the velocity of the step before and an acceleration of g
explain is no slip, which is 1 mm at 100 Hz and 0.1 m at 10 Hz. Attitudes are not judged: a bump at
take-off turns a small vehicle as far from one frame to the next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BESIDE = 5    # frames on each side that say how far is usual
LEAST = 0.02  # m; in some 130 real takes there is no step as long that stays
FAR = 10.0    # times the usual scatter of the steps beside
STAYS = 0.7   # share of the step between positions BESIDE frames before and after
FALL = 1.1 * 9.81  # m/s^2; a tenth more than g, for times and positions that are not exact
CLOSE = 1.5   # median periods between frames that count as neighbours


def steps(times: Floats, position: Floats) -> list[tuple[float, float]]:
    """
    Return time [s] and length [m] of each step of a position that stands out and stays.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m

    """
    moves, periods = np.diff(position, axis=0), np.diff(times)
    if len(moves) <= 2 * BESIDE:
        return []
    near = periods < CLOSE * float(np.median(periods))
    out = []
    for k in np.flatnonzero(np.linalg.norm(moves, axis=1) > LEAST):
        around = np.r_[k - BESIDE:k, k + 1:k + 1 + BESIDE]
        if around[0] < 0 or around[-1] >= len(moves) or not (near[k] and near[around].all()):
            continue
        if np.linalg.norm(moves[k] - moves[k - 1]) < FALL * periods[k] ** 2:
            continue
        usual = np.median(moves[around], axis=0)
        scatter = float(np.median(np.linalg.norm(moves[around] - usual, axis=1)))
        excess = moves[k] - usual
        length = float(np.linalg.norm(excess))
        if length < max(LEAST, FAR * scatter):
            continue
        both = (moves[k:k + 1 + BESIDE], moves[k - BESIDE:k + 1])  # later and earlier positions
        if all((part.sum(axis=0) - (1 + BESIDE) * usual) @ excess > STAYS * length ** 2
               for part in both):
            out.append((float(times[k + 1]), length))
    return out


def describe(name: str, times: Floats, position: Floats) -> list[str]:
    """Return a line on the longest step of :func:`steps`, none without; ``name`` of the topic."""
    found = steps(times, position)
    if not found:
        return []
    at, length = max(found, key=lambda one: one[1])
    return [f'{name}: the position moves by {length:.3f} m from one frame to the next at t = '
            f'{at:.2f} s and stays there: did a marker slip, was the tracker set anew, or did it '
            'repeat its last pose before? Cut the recording there']
