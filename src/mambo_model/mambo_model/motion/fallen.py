"""Whether a vehicle ended its flight on the floor, below a reference in the air."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .rigid_body import LIFTED
from .trajectory import TAKEOFF, TRACK

ABOVE = 0.3  # m, height of a reference that a vehicle on the floor does not follow (judgement)


def fallen(
    t: NDArray[np.float64], height: NDArray[np.float64], wanted: NDArray[np.float64],
    phase: NDArray[np.int64],
) -> str:
    """
    Return why a flight was not flown to its end, or an empty string.

    The reason is that the vehicle fell to the floor and stayed there, or that it never took off.

    Parameters
    ----------
    t : (n,) s
        Flight time.
    height : (n,) m
        True height above the point of take-off.
    wanted : (n,) m
        Height of the reference at the same times.
    phase : (n,)
        Of the reference, GROUND ... LANDED of :mod:`mambo_model.motion.trajectory`.

    """
    asked = np.flatnonzero(((phase == TAKEOFF) | (phase == TRACK)) & (wanted > ABOVE))
    if not len(asked) or not height[asked[-1]] <= LIFTED:
        return ''
    last = asked[-1]
    where = f'on the floor at {t[last]:.2f} s, {wanted[last]:.2f} m below its reference'
    lifted = np.flatnonzero(height[:last] > LIFTED)
    if not len(lifted):
        return f'the vehicle never took off: {where}'
    return f'the vehicle came down at {t[lifted[-1] + 1]:.2f} s: {where}'
