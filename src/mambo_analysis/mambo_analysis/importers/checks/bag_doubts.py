"""
What in an imported bag contradicts itself: :func:`doubts`.

A table or a foreign bag is taken as its mapping says. Its topics are of one flight, so they must
agree: times, turning, gravity, heights, paths. Each contradiction is one line; nothing is changed.
Of eight logs of a Crazyflie, seven flights of one under Vicon (NanoBench) and twelve of a Rolling
Spider one gets a line, whose own estimate is wrong by a factor of 3.9.
"""

from __future__ import annotations

from itertools import combinations

from mambo_bags.reader import Bag, BagError
from mambo_signals import gyro_check, height_check, motion
from mambo_signals.motion import Motion
from mambo_signals.resample import interpolate, longest_step
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import motion_doubts, plausible

Floats = NDArray[np.float64]
TRACKED, OWN = 'optitrack/pose', 'onboard/odom'
GRAVITY = 9.81  # [m/s^2]
FORCE = (5.0, 15.0)  # [m/s^2] median length of the specific force, in any attitude
TILTED = 0.5  # [rad] of its mean in the world from the vertical; accelerometers are mounted level
CLIMB = 0.3  # [m] of the height, between its 5 and 95 %, that a range must show
SHOWN = 0.2  # [-] of it that a range shows at least
LEAST_VOLTS = 1.0  # of a battery: one cell has 3 V or more
SHARES = 1.0  # the largest command of a mapping to shares of the full one
FARTHEST = 5.0  # [m] median distance of drone and reference
LEAST_TIME = 5.0  # [s] after which a flight has moved
LEAST_SPAN = 0.02  # [m] between 5 and 95 % of the positions of a flight; a hover has 0.05
TURNED = 0.01  # [rad] standard deviation of the tilt of a drone in the air, at least


def doubts(bag: Bag) -> list[str]:
    """Return a line about each contradiction between the topics of an imported bag."""
    motions = {}
    for name in (TRACKED, OWN):
        if name in bag and len(bag[name]) > 1:
            try:
                motions[name] = motion.read(bag, name)
            except BagError:  # fewer than two usable samples, which is said by what needs them
                pass
    out = _apart(bag)
    attitude = next((one for one in motions.values() if np.isfinite(one.quaternion).any()), None)
    if 'imu/data_raw' in bag and len(bag['imu/data_raw']) > 1:
        out += _inertial(bag, attitude)
    for one in motions.values():
        out += _still(one)
    out += [f'sonar/range: {line}: check both before you use them'
            for line in height_check.of_bag(bag)]
    out += _ranges(bag, motions)
    if OWN in motions:
        out += _onboard(bag, motions[OWN])
    if len(motions) == 2:
        out += _paths(motions[OWN], motions[TRACKED])
    return out + _single(bag)


def _apart(bag: Bag) -> list[str]:
    """Return a line about each topic that no other one, or not most of them, overlaps in time."""
    times = {name: (float(bag[name].t.min()), float(bag[name].t.max()))
             for name in map(_short, bag.topics) if name in bag and len(bag[name]) > 1}
    apart: dict[str, list[str]] = {name: [] for name in times}
    for one, other in combinations(times, 2):
        if times[one][1] < times[other][0] or times[other][1] < times[one][0]:
            apart[one].append(other)
            apart[other].append(one)
    out = []
    for name in sorted(times, key=lambda name: -len(apart[name])):
        if not apart[name]:
            continue
        other = apart[name][0]
        first, second = (f'{times[x][0]:.1f} to {times[x][1]:.1f} s' for x in (name, other))
        out.append(f'{name} ({first}) and {other} ({second}) have no time in common: check the '
                   'clock, unit and offset of each')
        for rest in apart.pop(name):  # one line for each topic that is apart
            apart[rest].remove(name)
        apart[name] = []
    return out


def _short(topic: str) -> str:
    """Return the name of a topic of an import without the namespace of the drone."""
    return topic.removeprefix('/mambo/')


def _inertial(bag: Bag, attitude: Motion | None) -> list[str]:
    """Return lines about gyro and accelerometer beside an attitude, if there is one."""
    imu = bag['imu/data_raw']
    gyro, force = imu.angular_velocity, imu.acceleration
    out = []
    known = np.isfinite(force).all(axis=1)
    if known.any():
        usual = float(np.median(np.linalg.norm(force[known], axis=1)))
        if not FORCE[0] <= usual <= FORCE[1]:
            out.append(f'imu/data_raw: the accelerometer has a median length of {usual:.3g} m/s^2 '
                       f'instead of {GRAVITY:g}: check its columns and unit')
        elif attitude is not None:
            out += _gravity(attitude.values(imu.stamp[known], attitude.quaternion), force[known],
                            attitude.name)
    if attitude is None or not np.isfinite(gyro).all(axis=1).any():
        return out
    found = gyro_check.compare(imu.t, gyro, attitude.t, attitude.quaternion)
    if axes := gyro_check.other_axes(found):
        out.append(f'imu/data_raw: {axes} of {attitude.name}: check the axes of both')
    elif (gain := gyro_check.other_unit(found)) is not None:
        out.append(f'imu/data_raw: the gyro shows the turning of {attitude.name} {gain:.3g} '
                   'times: check the units of both')
    return out


def _gravity(q: Floats, force: Floats, name: str) -> list[str]:
    """Return a line about a specific force, (n, 3), whose mean in the world is not upwards."""
    there = np.isfinite(q).all(axis=1)
    if there.sum() < gyro_check.LEAST_SAMPLES:
        return []
    mean = Rotation.from_quat(q[there]).apply(force[there]).mean(axis=0)
    tilt = float(np.arctan2(np.hypot(mean[0], mean[1]), mean[2]))
    if tilt < TILTED:
        return []
    return [f'imu/data_raw: turned by the attitude of {name}, the accelerometer points '
            f'{np.degrees(tilt):.0f} deg away from upwards in the mean: check the axes of both, '
            'and the order of the quaternion']


def _spread(values: Floats) -> float:
    """Return how far values, (n,), are apart, without the outermost tenth."""
    low, high = np.percentile(values, [5.0, 95.0])
    return float(high - low)


def _still(one: Motion) -> list[str]:
    """Return a line about positions that hardly change while the attitude does."""
    span = max(_spread(axis) for axis in one.position.T)
    known = np.isfinite(one.quaternion).all(axis=1)
    if float(np.ptp(one.t)) < LEAST_TIME or not known.any() or span >= LEAST_SPAN:
        return []
    turns = Rotation.from_quat(one.quaternion[known]).as_matrix()[:, 2]
    if np.hypot(*turns[:, :2].std(axis=0)) < TURNED:
        return []
    return [f'{one.name}: the positions stay within {span:.2g} m while the attitude changes: '
            'check their unit']


def _ranges(bag: Bag, motions: dict[str, Motion]) -> list[str]:
    """Return a line about ranges that hardly change while the vehicle climbs."""
    if 'sonar/range' not in bag or not motions:
        return []
    sonar, one = bag['sonar/range'], next(iter(motions.values()))
    ranges = np.asarray(sonar.range, float)
    height = one.values(sonar.stamp, one.position[:, 2:])[:, 0]
    both = np.isfinite(ranges) & np.isfinite(height)
    if both.sum() < height_check.LEAST_ROWS:
        return []
    climb, shown = _spread(height[both]), _spread(ranges[both])
    if climb < CLIMB or shown >= SHOWN * climb:
        return []
    return [f'sonar/range: the ranges stay within {shown:.2g} m while the height of {one.name} '
            f'changes by {climb:.2g} m: check their column and unit']


def _onboard(bag: Bag, own: Motion) -> list[str]:
    """Return lines about what the drone estimates, beside its own velocity, goal and flow."""
    names = [f'{x} of the position' for x in 'xyz']
    rates = [f'{x} of the velocity' for x in 'xyz']
    out, velocity = [], own.velocity
    if velocity is not None and (known := np.isfinite(velocity).all(axis=1)).any():
        out += [f'{OWN}: {line}' for line in motion_doubts.own_velocity(
            own.t[known], own.position[known], velocity[known], names, rates)]
    if 'onboard/reference' in bag and len(bag['onboard/reference']):
        goal = bag['onboard/reference']
        far = np.linalg.norm(goal.position - own.values(goal.stamp, own.position), axis=1)
        far = far[np.isfinite(far)]
        if len(far) and (usual := float(np.median(far))) > FARTHEST:
            out.append(f'onboard/reference: it is {usual:.4g} m from {OWN} (median): check the '
                       'units and axes of both, and whether the estimate has diverged')
    if 'optical_flow' in bag and velocity is not None and 'imu/data_raw' in bag:
        seen, imu = bag['optical_flow'], bag['imu/data_raw']
        at = np.sort(seen.stamp)
        q, moving, height = (own.values(at, x) for x in (
            own.quaternion, velocity, own.position[:, 2:]))
        turns, rate = (interpolate(at, x.stamp, y, longest_step(np.sort(x.stamp))) for x, y in (
            (imu, imu.angular_velocity), (seen, np.column_stack([seen.rate_x, seen.rate_y]))))
        there = np.isfinite(np.column_stack([q, moving])).all(axis=1)
        body = np.full((len(at), 3), np.nan)
        body[there] = Rotation.from_quat(q[there]).inv().apply(moving[there])
        out += [f'optical_flow: {line}' for line in motion_doubts.flow(
            1e-9 * at, rate, body[:, :2], height[:, 0], turns, ('rate_x', 'rate_y'))]
    return out


def _paths(own: Motion, tracked: Motion) -> list[str]:
    """Return a line about a path in the motion capture that is not the drone's own."""
    ours, theirs = plausible.common_path(own, tracked)
    said = plausible.upside_down(ours, theirs) or plausible.mirrored(
        ours[:, :2], theirs[:, :2]) or plausible.other_scale(ours[:, :2], theirs[:, :2])
    return [f'{TRACKED}: {said}: check {OWN}, too'] if said else []


def _single(bag: Bag) -> list[str]:
    """Return lines about battery and commands in other units, and topics of one message."""
    out = []
    if 'battery' in bag:
        volts = np.asarray(bag['battery'].voltage, float)
        usual = float(np.median(volts[np.isfinite(volts)])) if np.isfinite(volts).any() else 0.0
        if usual < LEAST_VOLTS:
            out.append(f'battery: it has a median of {usual:.3g} V: check its column and unit')
    if 'motor_pwm' in bag and len(bag['motor_pwm']):
        commands = np.asarray(bag['motor_pwm'].pwm, float)
        most, least = float(commands.max()), float(commands.min())
        if 0.0 < most <= SHARES:
            out.append(f'motor_pwm: the commands are up to {most:.3g}: they are shares of the '
                       'full command, not PWM')
        elif most == least:
            out.append(f'motor_pwm: the commands are {most:.4g} throughout: the motors stand, or '
                       'their commands were not recorded')
    return out + [f'{_short(topic)}: it has one message: nothing can be seen of a motion'
                  for topic in bag.topics if len(bag[_short(topic)]) == 1]
