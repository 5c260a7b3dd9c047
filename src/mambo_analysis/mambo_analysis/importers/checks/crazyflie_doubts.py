"""
Doubtful parts of a Crazyflie log: :func:`incomplete`, :func:`unusual`.

The log is imported as it is; each doubt is one line. What five public logs with an onboard
estimate show:

* The position moves as the velocity says: the path of the one is 0.6 to 1.3 times that of the
  other. Over 0.5 s, displacement and velocity of an axis have a correlation of 0.9 or more in
  three of them, of -0.1 to 0.5 along x and y of the other two; those of two axes 0.6 at most.
* The flow, averaged over 0.1 s, has a correlation of 0.37 to 0.95 with the velocity over the
  height less the turning, of 0.34 at most with the other axis.
* A goal is 0.1 to 0.3 m from the drone (median).
* The largest command is 65410 or more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import plausible, world_twist
from ..crazyflie_names import GOAL, GYRO, MOTORS, ODOMETRY, RATES

if TYPE_CHECKING:
    from ..crazyflie import Log

Floats = NDArray[np.float64]
TOGETHER = (
    ('imu/data_raw', RATES), ('imu/data_raw', GYRO), ('optical_flow', ('n_x', 'n_y')),
    ('motor_pwm', MOTORS), ('onboard/odom', ODOMETRY), ('onboard/reference', GOAL))
"""Topic and its signals, the first of which has the times."""
FEW = 0.1  # [-] of the samples that may be incomplete without a line
LEAST_PWM = 1000.0  # of the largest command
UNIT = 5.0  # [-] between the path of the position and that of the velocity
LEAST_PATH = 0.5  # [m] that tells a unit
APART = 5.0  # [m] median distance of drone and goal
PIECE = 0.5  # [s] over which displacements are compared
GAP = 0.1  # [s] within a piece, at most
FASTEST = 3.0  # [m/s] of a piece; more is a jump of the estimate
AVERAGE = 0.1  # [s] over which the flow is averaged
LOWEST = 0.2  # [m] at which the flow counts
LEAST_ROWS = 20  # of pieces and averages


def incomplete(log: Log) -> list[str]:
    """Return a line for each topic of whose samples many are not there in full."""
    lines = []
    for topic, names in TOGETHER:
        if names == GYRO and log.has(*RATES):
            continue  # it is not used
        if missing := [name for name in names if not log.has(name)]:
            if any(log.has(name) for name in names if name not in RATES):
                lines.append(f'{topic}: none, as the log has no values of {", ".join(missing)}')
            continue
        counts = {name: len(log.drone[name][0]) for name in names}
        most, few = (choose(counts, key=counts.get) for choose in (max, min))
        lost = counts[most] - _together(log, names)
        if lost > FEW * counts[most]:
            lines.append(f'{topic}: {lost} of {counts[most]} samples left out: some of its '
                         f'signals are missing there ({most} has {counts[most]} samples, {few} '
                         f'{counts[few]})')
    if log.has('w_x', 'a_z'):
        count = len(log.drone['w_x'][0])
        if (lost := count - _together(log, ('w_x', 'a_z'))) > FEW * count:
            lines.append(f'imu/data_raw: {lost} of {count} samples have no acceleration')
    return lines


def _together(log: Log, names: tuple[str, ...]) -> int:
    """Return at how many times of the first signal the others are there."""
    return int(np.isfinite(log.at(log.drone[names[0]][0], *names)).all(axis=1).sum())


def unusual(log: Log) -> list[str]:
    """Return a line for each signal that is in another unit, order or sign than the course's."""
    lines = []
    if log.has(*MOTORS) and (most := max(log.drone[name][1].max() for name in MOTORS)) < LEAST_PWM:
        lines.append(
            f'motor_pwm: the commands are up to {most:.4g}, not up to 65535: check their unit '
            'before you use them' if most else 'motor_pwm: the commands are 0 throughout')
    if log.has('n_x', 'n_y'):
        most = max(np.percentile(np.abs(log.drone[name][1]), 99.0) for name in ('n_x', 'n_y'))
        if not any(log.drone[name][1].any() for name in ('n_x', 'n_y')):
            lines.append('optical_flow: n_x and n_y are 0 throughout')
        elif most < 1.0:
            lines.append(f'optical_flow: n_x and n_y are up to {most:.4g}, not whole counts: '
                         'check their unit before you use them')
    if log.has(*ODOMETRY):
        t = log.drone['p_x'][0]
        state = log.at(t, *ODOMETRY)
        known = np.isfinite(state).all(axis=1)
        lines += _odometry(t[known], state[known])
        if log.has('n_x', 'n_y'):
            lines += _flow(log)
    if log.has(*GOAL, 'p_x', 'p_y', 'p_z'):
        far = np.linalg.norm(log.at(log.drone[GOAL[0]][0], *GOAL) - log.at(
            log.drone[GOAL[0]][0], 'p_x', 'p_y', 'p_z'), axis=1)
        far = far[np.isfinite(far)]
        if len(far) and (usual := float(np.median(far))) > APART:
            lines.append(f'onboard/reference: the goals are {usual:.4g} m from where the drone '
                         f'takes itself to be (median): check the unit of {", ".join(GOAL)}, and '
                         'whether its estimate has diverged')
    return lines


def _odometry(t: Floats, state: Floats) -> list[str]:
    """Return lines about the drone's own position and velocity, (n,) s, (n, 12)."""
    if len(t) < 3:
        return []
    lines = []
    moved = np.abs(np.diff(state[:, :3], axis=0)).sum(axis=1)
    fast = np.abs(state[1:, 6:9]).sum(axis=1) * np.diff(t)
    path, flown = (float(np.sum(x[x <= np.percentile(x, 90.0)])) for x in (moved, fast))
    if max(path, flown) > LEAST_PATH and not flown / UNIT < path < flown * UNIT:
        lines.append(f'onboard/odom: the position moves {path:.3g} m where the velocity '
                     f'says {flown:.3g} m: check the units of p_x and v_x')
    velocity = Rotation.from_euler('ZYX', state[:, 3:6]).apply(state[:, 6:9])
    integral = np.cumsum(velocity * np.gradient(t)[:, None], axis=0)
    edges = np.arange(t[0], t[-1], PIECE)
    own, seen = (world_twist.pieces(edges, t, x) for x in (integral, state[:, :3]))
    gaps = np.concatenate([[0], np.cumsum(np.diff(t) > GAP)])
    first, last = np.searchsorted(t, edges[:-1], 'right') - 1, np.searchsorted(t, edges[1:])
    whole = gaps[first] == gaps[last]
    steady = whole & (np.linalg.norm(seen, axis=1) < FASTEST * PIECE)
    return lines + _turned(own[steady], seen[steady], [
        f'onboard/odom: v_{x} shows the motion of {{}}' for x in 'xyz'],
        ('p_x', 'p_y', 'p_z'))


def _flow(log: Log) -> list[str]:
    """Return a line for each axis of the flow that shows another motion, or the opposite."""
    t = log.drone['n_x'][0]
    counts, state = log.at(t, 'n_x', 'n_y'), log.at(t, *ODOMETRY)
    known = np.isfinite(counts).all(axis=1) & np.isfinite(state).all(axis=1)
    known[known] = state[known, 2] > LOWEST
    t, counts, state = t[known], counts[known], state[known]
    turned = np.column_stack([-state[:, 10], state[:, 9]])
    expected = state[:, 6:8] / state[:, 2:3] + turned
    _, which = np.unique(np.floor(t / AVERAGE), return_inverse=True)
    share = np.maximum(np.bincount(which), 1)[:, None]
    seen, ours = (np.column_stack([np.bincount(which, x) for x in y.T]) / share
                  for y in (counts, expected))
    return _turned(seen, ours, [f'optical_flow: n_{x} shows the motion along {{}}' for x in 'xy'],
                   ('x', 'y'))


def _turned(values: Floats, other: Floats, said: list[str], names: tuple[str, ...]) -> list[str]:
    """Return a line for each column of values, (n, k), that shows another one of the other."""
    if len(values) < LEAST_ROWS:
        return []
    alike = plausible.correlations(values, other)
    return [f'{line.format(shown)} (correlation {abs(alike[k]).max():.2f}): check names and signs '
            'before you use them' for k, line in enumerate(said)
            if (shown := plausible.other_axis(alike[k], k, names))]
