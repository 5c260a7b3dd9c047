"""
Doubtful parts of a Crazyflie log: :func:`incomplete`, :func:`unusual`.

The log is imported as it is; each doubt is one line. Of five public logs with an onboard estimate
a goal is 0.1 to 0.3 m from the drone (median), and the largest command is 65410 or more. What else
they show: :mod:`.motion_doubts`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import motion_doubts, powertrain
from ..crazyflie_names import GOAL, MOTORS, ODOMETRY, RATES

if TYPE_CHECKING:
    from ..crazyflie import Log

Floats = NDArray[np.float64]
TOGETHER = (
    ('imu/data_raw', RATES), ('optical_flow', ('n_x', 'n_y')), ('motor_pwm', MOTORS),
    ('onboard/odom', ODOMETRY), ('onboard/reference', GOAL))
"""Topic and its signals, the first of which has the times."""
FEW = 0.1  # [-] of the samples that may be incomplete without a line
LEAST_PWM = 1000.0  # of the largest command
APART = 5.0  # [m] median distance of drone and goal


def incomplete(log: Log) -> list[str]:
    """Return a line for each topic of whose samples many are not there in full."""
    lines = []
    for topic, names in TOGETHER:
        if missing := [name for name in names if not log.has(name)]:
            if any(log.has(name) for name in names if name not in RATES):
                lines.append(f'{topic}: none, as the log has no values of {log.source(*missing)}')
            continue
        counts = {name: len(log.drone[name][0]) for name in names}
        most, few = (choose(counts, key=counts.get) for choose in (max, min))
        lost = counts[most] - _together(log, names)
        if lost > FEW * counts[most]:
            lines.append(f'{topic}: {lost} of {counts[most]} samples left out: some of its '
                         f'signals are missing there ({log.source(most)} has {counts[most]} '
                         f'samples, {log.source(few)} {counts[few]})')
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
    if log.has(*MOTORS):
        commands = log.at(log.drone[MOTORS[0]][0], *MOTORS)
        if (two := powertrain.doubled(commands[np.isfinite(commands).all(axis=1)])) is not None:
            lines.append(f'motor_pwm: {log.source(MOTORS[two[0]])} and '
                         f'{log.source(MOTORS[two[1]])} are the same '
                         'throughout, the others differ: check their columns')
    flow = ' and '.join(map(log.source, ('n_x', 'n_y')))
    if log.has('n_x', 'n_y'):
        most = max(np.percentile(np.abs(log.drone[name][1]), 99.0) for name in ('n_x', 'n_y'))
        if not any(log.drone[name][1].any() for name in ('n_x', 'n_y')):
            lines.append(f'optical_flow: {flow} are 0 throughout')
        elif most < 1.0:
            lines.append(f'optical_flow: {flow} are up to {most:.4g}, not whole counts: '
                         'check their unit before you use them')
    if log.has(*ODOMETRY):
        t = log.drone['p_x'][0]
        state = log.at(t, *ODOMETRY)
        known = np.isfinite(state).all(axis=1)
        velocity = Rotation.from_euler('ZYX', state[known, 3:6]).apply(state[known, 6:9])
        lines += [f'onboard/odom: {line}' for line in motion_doubts.own_velocity(
            t[known], state[known, :3], velocity, *(
                [log.source(name) for name in names] for names in (ODOMETRY[:3], ODOMETRY[6:9])))]
        if log.has('n_x', 'n_y'):
            t = log.drone['n_x'][0]
            state = log.at(t, *ODOMETRY)
            lines += [f'optical_flow: {line}' for line in motion_doubts.flow(
                t, log.at(t, 'n_x', 'n_y'), state[:, 6:8], state[:, 2], state[:, 9:],
                [log.source(name) for name in ('n_x', 'n_y')])]
    if log.has(*GOAL, 'p_x', 'p_y', 'p_z'):
        far = np.linalg.norm(log.at(log.drone[GOAL[0]][0], *GOAL) - log.at(
            log.drone[GOAL[0]][0], 'p_x', 'p_y', 'p_z'), axis=1)
        far = far[np.isfinite(far)]
        if len(far) and (usual := float(np.median(far))) > APART:
            lines.append(f'onboard/reference: the goals are {usual:.4g} m from where the drone '
                         f'takes itself to be (median): check the unit of {log.source(*GOAL)}, '
                         'and whether its estimate has diverged')
    return lines
