"""
Doubts about a drone's own estimate and its optical flow: what of them shows another motion.

What public logs with an onboard estimate show, five of a Crazyflie where nothing else is said:

* The position moves as the velocity says: the path of the one is 0.6 to 1.3 times that of the
  other. Over 0.5 s, displacement and velocity of an axis have a correlation of 0.9 or more in
  three of them, of -0.1 to 0.5 along x and y of the other two; those of two axes 0.6 at most.
* What a short flight shows is judged by the standard error of its correlation, that of Fisher's z
  for as many pieces as are independent (:func:`mambo_signals.metrics.independent`). Of 1548 parts
  of 3, 5 and 8 s and whole flights of 86 recordings none gets a line that way.
* The flow, averaged over 0.1 s, has a correlation of 0.37 to 0.95 with the velocity over the
  height less the turning, of 0.34 at most with the other axis.
"""

from __future__ import annotations

from collections.abc import Sequence

from mambo_signals.gyro_check import differs
from mambo_signals.metrics import independent
import numpy as np
from numpy.typing import NDArray

from . import plausible, world_twist

Floats = NDArray[np.float64]
UNIT = 5.0  # [-] between the path of the position and that of the velocity
LEAST_PATH = 0.5  # [m] that tells a unit
PIECE = 0.5  # [s] over which displacements are compared
MOST_PIECES = 100_000  # of a flight, 14 hours
GAP = 0.15  # [s] within a piece, at most: of 10 Hz too, if its times are uneven
FASTEST = 3.0  # [m/s] of a piece; more is a jump of the estimate
AVERAGE = 0.1  # [s] over which the flow is averaged
LOWEST = 0.2  # [m] at which the flow counts
LEAST_ROWS = 20  # of pieces and averages; of pieces only where the motion is small
FEWEST = 4  # pieces: a correlation of three has no standard error
CERTAIN = 2.5  # standard errors of a correlation from 0, of the axis that is shown
SURE = 0.9  # correlation of a velocity that tells its scale
ALONG = 0.95  # cosine between displacements and velocities of a whole flight, that tells it
SCALE = 1.25  # [-] of it: seven flights of NanoBench 0.88 to 1.02
LEAST_MOTION = 0.02
"""Standard deviation of a displacement that tells a scale [m], and of few that tell an axis: parts
of smaller ones follow the drift of another axis by chance."""


def own_velocity(
    t: Floats, position: Floats, velocity: Floats, names: Sequence[str], rates: Sequence[str],
) -> list[str]:
    """
    Return a line about each axis of an estimate whose velocity is not that of its position.

    Parameters
    ----------
    t : (n,) s, ascending
    position, velocity : (n, 3) m, m/s
        In the same inertial axes.
    names, rates
        Of the axes of position and velocity.

    """
    if len(t) < 3:
        return []
    lines = []
    moved = np.abs(np.diff(position, axis=0)).sum(axis=1)
    fast = np.abs(velocity[1:]).sum(axis=1) * np.diff(t)
    path, flown = (float(np.sum(x[x <= np.percentile(x, 90.0)])) for x in (moved, fast))
    if max(path, flown) > LEAST_PATH and not flown / UNIT < path < flown * UNIT:
        lines.append(f'the position moves {path:.3g} m where the velocity says {flown:.3g} m: '
                     f'check the units of {names[0]} and {rates[0]}')
    if t[-1] - t[0] > MOST_PIECES * PIECE:  # a jump of the clock
        return lines
    integral = np.cumsum(velocity * np.gradient(t)[:, None], axis=0)
    edges = np.arange(t[0], t[-1], PIECE)
    own, seen = (world_twist.pieces(edges, t, x) for x in (integral, position))
    gaps = np.concatenate([[0], np.cumsum(np.diff(t) > GAP)])
    first, last = np.searchsorted(t, edges[:-1], 'right') - 1, np.searchsorted(t, edges[1:])
    whole = gaps[first] == gaps[last]
    steady = whole & (np.linalg.norm(seen, axis=1) < FASTEST * PIECE)
    own, seen = own[steady], seen[steady]
    if len(own) < FEWEST:
        return lines
    moving = np.minimum(own.std(axis=0), seen.std(axis=0)) >= LEAST_MOTION
    turned = _turned(own, seen, [f'{name} shows the motion of {{}}' for name in rates], names,
                     moving | (len(own) >= LEAST_ROWS))
    return lines + (turned or _scaled(own, seen, rates, names)) or _ratio(own, seen)


def _ratio(own: Floats, seen: Floats) -> list[str]:
    """Return a line about displacements, (n, 3) m, of another size, also at constant speed."""
    both, sizes = float(np.sum(own * seen)), (float(np.sum(own**2)), float(np.sum(seen**2)))
    if len(own) < LEAST_ROWS or min(sizes) < LEAST_PATH**2 or (
            both < ALONG * np.sqrt(sizes[0] * sizes[1])):
        return []
    ratio = float(np.sqrt(sizes[0] / sizes[1]))
    return [] if 1.0 / SCALE < ratio < SCALE else [
        f'the velocity is {ratio:.3g} times that of the position: check the units of both']


def flow(
    t: Floats, seen: Floats, velocity: Floats, height: Floats, rates: Floats, names: Sequence[str],
) -> list[str]:
    """
    Return a line for each axis of an optical flow that shows another motion, or the opposite.

    Parameters
    ----------
    t : (n,) s, ascending
    seen : (n, 2)
        Along x and y of the body, in any unit, with what the turning adds.
    velocity : (n, 2) m/s
        Along the same axes.
    height : (n,) m
    rates : (n, 3) rad/s, body FLU
    names
        Of the two signals.

    """
    known = np.isfinite(np.column_stack([seen, velocity, height, rates])).all(axis=1)
    known[known] = height[known] > LOWEST
    t, seen, velocity, rates = (x[known] for x in (t, seen, velocity, rates))
    expected = velocity / height[known, None] + np.column_stack([-rates[:, 1], rates[:, 0]])
    _, which = np.unique(np.floor(t / AVERAGE), return_inverse=True)
    share = np.maximum(np.bincount(which), 1)[:, None]
    mean, ours = (np.column_stack([np.bincount(which, x) for x in y.T]) / share
                  for y in (seen, expected))
    return _turned(mean, ours, [f'{name} shows the motion along {{}}' for name in names],
                   ('x', 'y'), np.full(2, len(mean) >= LEAST_ROWS))


def _scaled(own: Floats, seen: Floats, rates: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return a line for each velocity whose integral, (n, 3) m, is another share of the motion."""
    if len(own) < LEAST_ROWS:
        return []
    out, alike = [], plausible.correlations(own, seen)
    for k, (rate, name) in enumerate(zip(rates, names)):
        ratio = float(own[:, k].std() / max(seen[:, k].std(), 1e-12))
        if seen[:, k].std() > LEAST_MOTION and alike[k, k] > SURE and differs(
                alike[k, k], ratio, SCALE):
            out.append(f'{rate} is {ratio:.3g} times what {name} changes by: check the units of '
                       'both')
    return out


def _turned(
    values: Floats, other: Floats, said: Sequence[str], names: Sequence[str],
    enough: NDArray[np.bool_],
) -> list[str]:
    """Return a line for each column of values, (n, k), that shows another one of the other."""
    if not enough.any():
        return []
    alike, out = plausible.correlations(values, other), []
    for k, line in enumerate(said):
        shown, most = plausible.other_axis(alike[k], k, names), int(np.abs(alike[k]).argmax())
        if shown and enough[k] and enough[most] and _certain(
                alike[k, most], independent(values[:, k], other[:, most])):
            out.append(f'{line.format(shown)} (correlation {abs(alike[k]).max():.2f}): check names'
                       ' and signs before you use them')
    return out


def _certain(r: float, count: float) -> bool:
    """Return whether a correlation of so many independent pairs is clearly not 0."""
    if count <= 3.0:
        return False
    return bool(np.arctanh(min(abs(r), 1.0 - 1e-12)) * np.sqrt(count - 3.0) >= CERTAIN)
