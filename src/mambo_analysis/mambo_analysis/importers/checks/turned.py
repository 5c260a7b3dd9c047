"""
Whether positions of a motion capture are turned about z against its attitude: :func:`describe`.

The yaw of the tracked attitude less that of the drone's own is the turn between their frames, at
every instant: a drift of the onboard heading is in it. With it each step of the drone's own path
is turned into the frame of the motion capture. The way over ``WINDOW`` must then be the tracked
one, in the same direction; less its mean, as the path of an optical flow drifts.
"""

from __future__ import annotations

from mambo_signals.gyro_check import ASKEW
from mambo_signals.height_check import LEAST_ROWS
from mambo_signals.motion import angles, has_attitude, Motion
from mambo_signals.resample import Floats
from mambo_signals.time_offset import UNEXPLAINED
import numpy as np

from .plausible import spread

WINDOW = 1.0  # s, over which a way is taken
LEAST_TIME = 8.0  # s, that the windows cover: in less a path is easily like another one
LEAST = 0.03  # m, RMS of the ways; 0.005 to 0.011 of simulated hovers, 0.036 of a slow real flight
EXPLAINED = 0.95
"""Share of the tracked ways that the own ones explain, turned as they fit best. Of the onboard
estimates of eleven real flights it is 0.986 to 0.999, of parts of 6 to 10 s of estimates that had
diverged up to 0.946 by chance."""
SIZE = 1.5  # [-] between the ways of both; an estimate that diverges has larger ones
RIVAL = 2.0
"""Unexplained variance without a turn over that with one, at least [-]; a delay that leaves less
than so many times the least is as good."""
OTHER = 0.7
"""Correlation of the ways, turned as they fit best, below which they are of two paths. It is 0.99
or more in 11 real flights with their own capture, 0.07 to 0.37 with those of other courses."""
DELAYS = np.linspace(-0.1, 0.1, 5)  # s; filtered values are up to 0.1 s late


def _ways(own: Motion, tracked: Motion, late: float) -> tuple[Floats, Floats, float] | None:
    """
    Return the ways of the drone and of its capture, so many s late, and the drift of the heading.

    Each way is x + iy, (n,) complex m, less the mean, in the frame of the capture; the drift is
    in rad. None if they have too little time in common.
    """
    there = tracked.at(own.stamps + round(late * 1e9))
    both = np.isfinite(np.hstack([
        own.position, own.quaternion, there.position, there.quaternion])).all(axis=1)
    if both.sum() < LEAST_ROWS:
        return None
    t = own.t[both]
    begin = t[t + WINDOW <= t[-1]]
    if np.minimum(np.diff(begin), WINDOW).sum() < LEAST_TIME:  # a gap counts for one window
        return None
    apart = np.unwrap(np.radians(angles(there.quaternion[both])[:, 2]
                                 - angles(own.quaternion[both])[:, 2]))
    ours, theirs = (x[both, :2] @ (1.0, 1.0j) for x in (own.position, there.position))
    ours = np.append(0.0, np.cumsum(np.diff(ours) * np.exp(1j * apart[:-1])))
    a, b = (np.interp(begin + WINDOW, t, x) - x[:len(begin)] for x in (ours, theirs))
    return a - a.mean(), b - b.mean(), spread(apart)


def angle(own: Motion, tracked: Motion) -> float:
    """
    Return by how many rad the tracked positions are turned about z against the tracked attitude.

    0 where the path does not tell it: below ``ASKEW`` and the drift of the onboard heading, where
    an attitude is missing or the drone hardly moves, or where one of ``DELAYS`` explains it as
    well, as on a circle.

    Parameters
    ----------
    own
        As the drone estimates it, in a frame of its own.
    tracked
        By the motion capture, on the same clock.

    """
    if not (has_attitude(own) and has_attitude(tracked)):
        return 0.0
    found, drift = [], np.inf
    for late in DELAYS:
        if (ways := _ways(own, tracked, late)) is None:
            return 0.0
        a, b, spreads = ways
        sizes = [float(np.sqrt(np.mean(np.abs(x) ** 2))) for x in (a, b)]
        if min(sizes) < LEAST or max(sizes) > SIZE * min(sizes):
            return 0.0
        found.append(complex(np.mean(a.conj() * b)) / (sizes[0] * sizes[1]))
        drift = min(drift, spreads)
    r = np.array(found)
    left, turns = 1.0 - np.abs(r) ** 2 + UNEXPLAINED, np.angle(r)
    best = int(np.argmin(left))
    least = np.abs(turns[left <= RIVAL * left[best]]).min()
    straight = 1.0 - r.real.clip(0.0) ** 2 + UNEXPLAINED
    if (1.0 - left[best] < EXPLAINED or straight.min() < RIVAL * left[best]
            or least < ASKEW + drift):
        return 0.0
    return float(turns[best])


def other_path(own: Motion, tracked: Motion) -> str:
    """
    Return in words that a drone's own path is not the tracked one; empty: it is, or hardly moves.

    Neither frame, heading, size nor an even drift counts. Parameters as of :func:`angle`.
    """
    if not (has_attitude(own) and has_attitude(tracked)):
        return ''
    best = 0.0
    for late in DELAYS:
        if (ways := _ways(own, tracked, late)) is None:
            return ''
        a, b, _ = ways
        sizes = [float(np.sqrt(np.mean(np.abs(x) ** 2))) for x in (a, b)]
        if min(sizes) < LEAST:
            return ''
        best = max(best, float(np.abs(np.mean(a.conj() * b))) / (sizes[0] * sizes[1]))
    if best >= OTHER:
        return ''
    return (f'the path of {own.name} is not that of {tracked.name} (correlation of the ways over '
            f'{WINDOW:g} s {best:.2f}, turned as they fit best), or it has diverged')


def describe(own: Motion, tracked: Motion) -> str | None:
    """Return the same in words, with what to check; None where nothing is told."""
    turn = angle(own, tracked)
    return None if turn == 0.0 else (
        f'the positions of the motion capture are turned by {np.degrees(turn):+.0f} deg about z '
        "against its attitude, by the drone's own path and attitude: check their axes, how the "
        'rigid body was made, and the heading of the estimate')
