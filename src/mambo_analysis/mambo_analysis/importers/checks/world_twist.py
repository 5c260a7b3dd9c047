"""
Whether the velocity of an odometry is in the axes of its body or in those of its poses.

``nav_msgs/Odometry`` gives the twist in ``child_frame_id``, the body. Some simulators and drivers
give it in the axes of the poses instead. The motion tells: over pieces of it, the displacement is
the integral of the velocity in the axes of the poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
PIECE = 0.2  # [s] of a displacement, at least
SAMPLES = 3  # of a piece, at least
LEAST_PIECES, MOST_PIECES = 10, 100_000
MUCH = 0.25  # [-] of the mean square of the displacements, or of the other interpretation


def axes_of(times: Floats, position: Floats, orientation: Floats, velocity: Floats) -> str:
    """
    Return ``'body'`` or ``'world'``, whose axes a velocity is in; an empty text if nothing tells.

    Parameters
    ----------
    times : (n,) s
    position : (n, 3) m
    orientation : (n, 4)
        x y z w, body to world.
    velocity : (n, 3) m/s

    """
    known = np.isfinite(np.hstack([position, orientation, velocity])).all(axis=1)
    known &= (np.abs(np.sum(orientation**2, axis=1) - 1.0) < 0.1)
    times, first = np.unique(times[known], return_index=True)
    if len(times) < 2:
        return ''
    position, orientation, velocity = (
        x[known][first] for x in (position, orientation, velocity))
    piece = max(PIECE, SAMPLES * float(np.median(np.diff(times))))
    if times[-1] - times[0] > MOST_PIECES * piece:  # a jump of the clock
        return ''
    edges = np.arange(times[0], times[-1], piece)
    if len(edges) <= LEAST_PIECES:
        return ''
    turned = Rotation.from_quat(orientation).apply(velocity)
    moved = pieces(edges, times, position)
    size = np.sum(moved**2)
    left = {axes: np.sum((moved - pieces(edges, times, _integral(times, v)))**2)
            for axes, v in (('body', turned), ('world', velocity))}
    best, other = sorted(left, key=lambda axes: left[axes])
    return best if left[best] < MUCH * min(size, left[other]) else ''


def _integral(times: Floats, velocity: Floats) -> Floats:
    """Return the integral from the first time on, (n, 3), by the trapezoidal rule."""
    half = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(times)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(half, axis=0)])


def pieces(edges: Floats, times: Floats, values: Floats) -> Floats:
    """Return the changes of values, (n, 3), between edges."""
    return np.column_stack([np.diff(np.interp(edges, times, x)) for x in values.T])
