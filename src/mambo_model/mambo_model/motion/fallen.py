"""Whether a vehicle lay on the floor in its flight, below a reference in the air."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .rigid_body import LIFTED
from .trajectory import LANDING, TAKEOFF, TRACK

ABOVE = 0.3  # m, height of a reference that a vehicle on the floor does not follow (judgement)
LONG = 0.3  # s, so long a vehicle follows no reference that leaps up; sound flights: 0.1 s at most


def fallen(
    t: NDArray[np.float64], height: NDArray[np.float64], wanted: NDArray[np.float64],
    phase: NDArray[np.int64],
) -> str:
    """
    Return why a flight was not flown as asked, or an empty string.

    The reason is that the vehicle fell to the floor, or rose late or never.

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
    down = np.isin(phase, (TAKEOFF, TRACK, LANDING)) & (wanted > ABOVE) & (height <= LIFTED)
    edges = np.flatnonzero(np.diff(down, prepend=False, append=False)).reshape(-1, 2)
    begin, end = t[edges[:, 0]], t[edges[:, 1] - 1]
    if not (end - begin >= LONG).any():
        return ''
    k = int(np.argmax(end - begin))
    below = wanted[edges[k, 0]:edges[k, 1]].max()
    rose = 'the vehicle was' if (height > LIFTED).any() else 'the vehicle never took off:'
    return (f'{rose} on the floor from {begin[k]:.2f} to {end[k]:.2f} s, up to {below:.2f} m '
            'below its reference')
