"""
What in an imported bag contradicts itself: :func:`doubts`.

A table or a foreign bag is taken as its mapping says. Its topics are of one flight, so they must
agree: times, turning, gravity, heights, paths. Each contradiction is one line; nothing is changed.
Of eight logs of a Crazyflie, seven flights of one under Vicon (NanoBench) and twelve of a Rolling
Spider three get a line: one whose own estimate is wrong by a factor of 3.9, one on its side, and
one whose logging was interrupted.
"""

from __future__ import annotations

from collections import Counter
from itertools import chain, combinations
from pathlib import Path

from mambo_bags.reader import Bag, BagError, read_bag
from mambo_signals import gyro_check, height_check, motion
from mambo_signals.motion import Motion
from mambo_signals.resample import interpolate, longest_step, runs
from mambo_signals.time_offset import AlignError, RANGE_LATE, time_offset, unclipped_ranges
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import (
    held_rows, motion_doubts, plausible, powertrain, slips, stopped, tilts, turned)
from ..common import NAMESPACE
from .stopped import CLIMB, OWN, REACH, STOPPED, TRACKED

Floats = NDArray[np.float64]
Beside = tuple[Floats, Floats]  # ranges, (n,) m, and the drone's own positions then, (n, 3) m
GRAVITY = 9.81  # [m/s^2]
FORCE = (5.0, 15.0)  # [m/s^2] median length of the specific force, in any attitude
TILTED = 0.5  # [rad] of its mean in the world from the vertical; accelerometers are mounted level
SHOWN = 0.2  # [-] of it that a range shows at least
FARTHEST = 5.0  # [m] median distance of drone and reference
LONGEST_PAUSE = 600.0  # [s] between two messages
ENOUGH = 0.005  # [s] between samples of a turning
LATE = 0.1  # [s] between gyro and attitude
FALLS = -0.4  # correlation of range and own height; -0.14 at least in twelve real flights
RISES = 0.4  # correlation of pressure and height; 0.13 at most in twelve real flights
FAST_SPEED = 0.2  # [m/s] of an estimate whose position cannot stand
FAST = ('imu/data_raw', 'motor_pwm', TRACKED, OWN)
AT_FLOOR, BELOW = 0.05, -0.2
"""Largest 95th percentile and median of heights below the floor [m]. Diverged estimates of real
flights reach -1.3 m, but with 0.1 m or more for a twentieth of the time."""
PAUSE, PERIOD = 1.0, 0.1  # [s] of a topic with that period, at most
COVERED = 0.75  # [-] of the time of a recording, at least, that a fast topic covers


def imported(path: Path, from_floor: bool = False) -> list[str]:
    """
    Return the doubts about a bag that was just imported.

    Parameters
    ----------
    path
        Of the bag.
    from_floor
        Whether the drone's own height is 0 where it took off.

    """
    bag = read_bag(path, namespace=NAMESPACE)
    return doubts(bag) + (_below_floor(bag) if from_floor else [])


def _below_floor(bag: Bag) -> list[str]:
    """Return a line about an estimate whose height is negative throughout."""
    if OWN not in bag or len(bag[OWN]) < 2:
        return []
    height = bag[OWN].position[:, 2]
    height = height[np.isfinite(height)]
    if not len(height) or np.percentile(height, 95.0) > AT_FLOOR or np.median(height) > BELOW:
        return []
    return [f'{OWN}: its height is negative throughout, down to {height.min():.2f} m, and 0 is '
            'where it took off: check the sign of its z and of its vertical velocity']


def doubts(bag: Bag) -> list[str]:
    """Return a line about each contradiction between the topics of an imported bag."""
    with np.errstate(all='ignore'):  # of numbers that are absurd, which are told by what is left
        return _doubts(bag)


def _doubts(bag: Bag) -> list[str]:
    motions = {}
    for name in (TRACKED, OWN):
        if name in bag and len(bag[name]) > 1:
            try:
                motions[name] = motion.read(bag, name)
            except BagError:  # fewer than two usable samples, which is said by what needs them
                pass
    out = _jumps(bag) + _apart(bag) + _pauses(bag) + _partial(bag)
    if 'imu/data_raw' in bag and len(bag['imu/data_raw']) > 1:
        out += _dead(bag) or _inertial(bag, [
            one for one in motions.values() if np.isfinite(one.quaternion).any()])
    if TRACKED in motions and (step := plausible.rounded(motions[TRACKED].position)):
        out.append(f'{TRACKED}: the positions are multiples of {step:.3g} m: velocities and drag '
                   'of such a path are not those of the vehicle; record them unrounded')
    elif TRACKED in motions:
        tracked = motions[TRACKED].t, motions[TRACKED].position
        out += slips.describe(TRACKED, *tracked) + held_rows.describe(
            TRACKED, *tracked, _once(bag))
    for name, one in motions.items():
        out += capture(one) if name == TRACKED else _still(one)
    out += stopped.describe(bag, motions)
    out += [f'sonar/range: {line}: check both before you use them'
            for line in height_check.of_bag(bag)]
    out += _ranges(bag, motions)
    ranges = height_check.beside(bag, motions[OWN]) if OWN in motions else None
    if ranges is not None and (said := _upside_down(ranges, OWN)):
        out.append(said)  # the others would blame what is right
    else:
        out += _pressure(bag, motions)
        out += _onboard(bag, motions[OWN], ranges) if OWN in motions else []
    if len(motions) == 2:
        out += _paths(motions[OWN], motions[TRACKED])
    out += powertrain.battery(bag) + powertrain.commands(bag)
    for one in motions.values():
        if said := powertrain.held(bag, one):
            out += said
            break
    return out + _single(bag)


def _once(bag: Bag) -> str:
    """Return how an importer is told to take each position of a motion capture once."""
    if bag.metadata.get('import', {}).get('importer') == 'mambo_analysis.import_table':
        return 'import it with only_changes: true for this topic in the mapping'
    return 'record each of its poses once'


def _jumps(bag: Bag) -> list[str]:
    """Return a line about each topic whose times jump by more than a pause of a flight."""
    out = []
    for topic in bag.topics:
        t = np.sort(bag[topic].t)
        if len(t) > 1 and float((steps := np.diff(t)).max()) > LONGEST_PAUSE:
            k = int(steps.argmax())
            out.append(f'{_short(topic)}: its times jump by {steps[k]:.4g} s after {t[k]:.2f} s: '
                       'check its clock, or cut the log there')
    return out


def _pauses(bag: Bag) -> list[str]:
    """Return a line about the longest pause of each fast topic within a recording."""
    out = []
    for topic in FAST:
        if topic not in bag or len(bag[topic]) < gyro_check.LEAST_SAMPLES:
            continue
        t = np.sort(bag[topic].t)
        steps = np.diff(t)
        k = int(steps.argmax())
        if PAUSE < steps[k] <= LONGEST_PAUSE and float(np.median(steps)) < PERIOD:
            out.append(f'{topic}: nothing from {t[k]:.2f} to {t[k + 1]:.2f} s: was the logging '
                       'interrupted?')
    return out


def _partial(bag: Bag) -> list[str]:
    """Return a line about each fast topic that covers clearly less time than the others."""
    spans = {topic: (float(bag[topic].t.min()), float(bag[topic].t.max())) for topic in FAST
             if topic in bag and len(bag[topic]) >= gyro_check.LEAST_SAMPLES}
    if not spans:
        return []
    begin, end = min(one[0] for one in spans.values()), max(one[1] for one in spans.values())
    if end - begin > LONGEST_PAUSE:  # is told as a jump, or is no flight
        return []
    return [f'{topic}: covers {first:.2f} to {last:.2f} s, and the recording {begin:.2f} to '
            f'{end:.2f} s: was the logging cut short?'
            for topic, (first, last) in spans.items()
            if last - first < COVERED * (end - begin)]


def _apart(bag: Bag) -> list[str]:
    """Return a line about each topic that has no time in common with another one."""
    times = {_short(topic): (float(bag[topic].t.min()), float(bag[topic].t.max()))
             for topic in bag.topics if len(bag[topic]) > 1}
    pairs = [(one, other) for one, other in combinations(times, 2)
             if times[one][1] < times[other][0] or times[other][1] < times[one][0]]
    out = []
    while pairs:  # one line for each topic that is apart
        name = Counter(chain(*pairs)).most_common(1)[0][0]
        other = next(x for pair in pairs if name in pair for x in pair if x != name)
        first, second = (f'{times[x][0]:.1f} to {times[x][1]:.1f} s' for x in (name, other))
        out.append(f'{name} ({first}) and {other} ({second}) have no time in common: check the '
                   'clock, unit and offset of each')
        pairs = [pair for pair in pairs if name not in pair]
    return out


def _short(topic: str) -> str:
    """Return the name of a topic of an import without the namespace of the drone."""
    return topic.removeprefix(f'{NAMESPACE}/')


def _dead(bag: Bag) -> list[str]:
    """Return a line about each inertial sensor with an axis of one value throughout."""
    imu, out = bag['imu/data_raw'], []
    for name, values in (('gyro', imu.angular_velocity), ('accelerometer', imu.acceleration)):
        known = values[np.isfinite(values).all(axis=1)]
        if len(known) < gyro_check.LEAST_SAMPLES:
            continue
        if (still := np.ptp(known, axis=0) == 0.0).any():
            axis = int(np.argmax(still))
            out.append(f'imu/data_raw: the {name} shows {known[0, axis] + 0.0:.4g} along '
                       f'{"xyz"[axis]} throughout: that axis is dead, not recorded, or simulated '
                       'without noise')
    return out


def _inertial(bag: Bag, motions: list[Motion]) -> list[str]:
    """Return lines about gyro and accelerometer beside the attitudes of some motions."""
    imu = bag['imu/data_raw']
    gyro, force = imu.angular_velocity, imu.acceleration
    out = []
    known = np.isfinite(force).all(axis=1)
    if known.any():
        usual = float(np.median(np.linalg.norm(force[known], axis=1)))
        if not FORCE[0] <= usual <= FORCE[1]:
            out.append(f'imu/data_raw: the accelerometer has a median length of {usual:.3g} m/s^2 '
                       f'instead of {GRAVITY:g}: check its columns and unit')
        elif not motions and float(np.median(force[known][:, 2])) < -FORCE[0]:
            out.append('imu/data_raw: z of the accelerometer has a median of '
                       f'{float(np.median(force[known][:, 2])):.3g} m/s^2, and +9.81 is upright: '
                       'check its sign and the axes of the body')
        elif motions:
            out += _gravity(motions[0].values(imu.stamp[known], motions[0].quaternion),
                            force[known], motions[0].name)
    if not np.isfinite(gyro).all(axis=1).any():
        return out
    thin = _stride(imu.t)
    for one in motions:
        step = _stride(one.t)
        if said := _turning(gyro_check.compare(
                imu.t[::thin], gyro[::thin], one.t[::step], one.quaternion[::step]), one.name):
            out.append(f'imu/data_raw and {one.name}: {said}')
    return out


def _stride(t: Floats) -> int:
    """Return of how many samples at (n,) s one is enough to see a turning."""
    step = float(np.median(np.abs(np.diff(t)))) if len(t) > 1 else 0.0
    return max(1, int(ENOUGH / step)) if step > 0.0 else 1


def _turning(found: gyro_check.Turning | None, name: str) -> str:
    """Return in words how a gyro contradicts the attitude of a topic; empty: it does not."""
    if found is None:
        return ''
    if name != OWN:  # an estimate follows small turning less well
        try:
            gyro_check.refuse(found)
        except AlignError as error:
            return str(error)
        if turned := gyro_check.turned_body(found):
            return turned
    if axes := gyro_check.other_axes(found):
        return f'{axes} of the estimate: check the axes of both'
    if (gain := gyro_check.other_unit(found)) is not None:
        return f'the gyro shows the turning {gain:.3g} times: check the units of both'
    if abs(found.late) >= LATE:
        return (f'the attitude is {abs(found.late):.2f} s '
                f'{"late" if found.late > 0.0 else "early"} against the gyro: check the clock of '
                'both')
    return ''


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


def capture(one: Motion) -> list[str]:
    """Return lines about tracked positions that contradict the attitudes tracked with them."""
    line = tilts.describe(one)
    return _still(one) + [f'{one.name}: {line}'] * bool(line)


def _still(one: Motion) -> list[str]:
    """Return a line about positions that hardly change while the attitude does."""
    found = plausible.still(one.t, one.position, one.quaternion)
    if found is None or not found[1]:
        return []
    return [f'{one.name}: the positions stay within {found[0]:.2g} m while the attitude changes: '
            'check their unit, unless the vehicle was held']


def _ranges(bag: Bag, motions: dict[str, Motion]) -> list[str]:
    """Return a line about ranges that hardly change while the vehicle climbs."""
    if 'sonar/range' not in bag or not motions:
        return []
    sonar, one = bag['sonar/range'], next(iter(motions.values()))
    ranges = np.asarray(sonar.range, float)
    height = one.values(sonar.stamp, one.position[:, 2:])[:, 0]
    both = np.isfinite(ranges) & np.isfinite(height)
    if both.any():  # on the floor and beyond its reach a range repeats one value
        low, high = ranges[both].min(), ranges[both].max()
        both &= (ranges > height_check.WITHIN * low) & (ranges < REACH * high)
    if both.sum() < height_check.LEAST_ROWS:
        return []
    climb, shown = plausible.spread(height[both]), plausible.spread(ranges[both])
    if climb < CLIMB or shown >= SHOWN * climb:
        return []
    return [f'sonar/range: the ranges stay within {shown:.2g} m while the height of {one.name} '
            f'changes by {climb:.2g} m: check their column and unit']


def _pressure(bag: Bag, motions: dict[str, Motion]) -> list[str]:
    """Return a line about a pressure that rises with the height."""
    if 'barometer/pressure' not in bag or not motions:
        return []
    barometer, one = bag['barometer/pressure'], next(iter(motions.values()))
    pressure = np.asarray(barometer['fluid_pressure'], float)
    height = one.values(barometer.stamp, one.position[:, 2:])[:, 0]
    both = np.isfinite(pressure) & np.isfinite(height)
    pressure, height = pressure[both], height[both]
    if len(height) < height_check.LEAST_ROWS or plausible.spread(height) < CLIMB:
        return []
    r = float(plausible.correlations(pressure[:, None], height[:, None])[0, 0])
    if r < RISES:
        return []
    return [f'barometer/pressure: the pressure rises with the height of {one.name} (correlation '
            f'{r:.2f}): check its sign and column']


def _upside_down(found: Beside, name: str) -> str:
    """Return in words that the drone's own height falls where the ranges rise; empty: no."""
    ranges, height = found[0], found[1][:, 2:]
    if len(ranges) < height_check.LEAST_ROWS:
        return ''
    if min(plausible.spread(ranges), plausible.spread(height[:, 0])) < height_check.LEAST_CHANGE:
        return ''
    r = float(plausible.correlations(ranges[:, None], height)[0, 0])
    if r > FALLS:
        return ''
    return (f'{name}: its height falls where the ranges rise (correlation {r:.2f}): check the '
            'sign of both heights, and of its vertical velocity')


def _own_height(bag: Bag, own: Motion, found: Beside | None) -> list[str]:
    """Return a line about ranges that show another height than the drone's own, or it late."""
    if found is None or len(found[0]) < height_check.LEAST_ROWS:
        return []
    ranges, position = found
    name = f'the height of {own.name}'
    if said := height_check.other_scale(ranges, position[:, 2], name):
        return [f'sonar/range: {said}']
    try:
        one = time_offset(*unclipped_ranges(bag), own.t, own.position[:, 2], swing=CLIMB,
                          limits=(-gyro_check.SEARCH, gyro_check.SEARCH))
    except AlignError:
        return []
    if one.quality < height_check.FOLLOWS or abs(one.offset) < RANGE_LATE + LATE:
        return []
    return [f'sonar/range: it is {abs(one.offset):.2f} s {"late" if one.offset > 0.0 else "early"}'
            f' against {name}: check the clock of both']


def _leaps(own: Motion) -> list[str]:
    """Return lines about an estimate whose position leaps, or stands while it has a velocity."""
    out, velocity = slips.leap(own), own.velocity
    if velocity is None or len(own.t) < 2:
        return out
    speed = np.linalg.norm(velocity, axis=1)
    stands = (np.diff(own.position, axis=0) == 0.0).all(axis=1) & np.isfinite(speed[1:])
    for first, last in runs(stands).tolist():
        t = own.t[[first, last]]
        if t[1] - t[0] > STOPPED and np.nanmedian(speed[first:last + 1]) > FAST_SPEED:
            out.append(f'{own.name}: the position stands from {t[0]:.2f} to {t[1]:.2f} s while its'
                       ' velocity does not: it had stopped')
            break
    return out


def _onboard(bag: Bag, own: Motion, ranges: Beside | None) -> list[str]:
    """Return lines about what the drone estimates, beside its sensors, velocity and goal."""
    names = [f'{x} of the position' for x in 'xyz']
    rates = [f'{x} of the velocity' for x in 'xyz']
    out, velocity = _own_height(bag, own, ranges) + _leaps(own), own.velocity
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
    if velocity is not None and all(
            name in bag and len(bag[name]) > 1 for name in ('optical_flow', 'imu/data_raw')):
        out += flow(bag, own, velocity)
    return out


def flow(bag: Bag, own: Motion, velocity: Floats) -> list[str]:
    """Return lines about an optical flow beside the velocity, (n, 3) m/s, of a motion."""
    seen, imu = bag['optical_flow'], bag['imu/data_raw']
    at = np.sort(seen.stamp)
    q, moving, height = (own.values(at, x) for x in (
        own.quaternion, velocity, own.position[:, 2:]))
    turns, rate = (interpolate(at, x.stamp, y, longest_step(np.sort(x.stamp))) for x, y in (
        (imu, imu.angular_velocity), (seen, np.column_stack([seen.rate_x, seen.rate_y]))))
    there = np.isfinite(np.column_stack([q, moving])).all(axis=1)
    body = np.full((len(at), 3), np.nan)
    body[there] = Rotation.from_quat(q[there]).inv().apply(moving[there])
    return [f'optical_flow: {line}' for line in motion_doubts.flow(
        1e-9 * at, rate, body[:, :2], height[:, 0], turns, ('rate_x', 'rate_y'))]


def _paths(own: Motion, tracked: Motion) -> list[str]:
    """Return a line about a path in the motion capture that is not the drone's own."""
    ours, theirs = plausible.common_path(own, tracked)
    if said := height_check.other_axis(ours[:, 2], theirs, f'the height of {OWN}'):
        return [f'{TRACKED}: {said}']
    flat = ours[:, :2], theirs[:, :2]
    said = plausible.upside_down(ours, theirs) or plausible.mirrored(*flat)
    if not said and (turn := turned.describe(own, tracked)):
        return [f'{TRACKED}: {turn}']
    if said := said or plausible.other_scale(*flat):
        return [f'{TRACKED}: {said}: check {OWN}, too']
    if (share := plausible.alike(*flat)) < plausible.LEAST_ALIKE:
        return [f'{OWN}: only {100.0 * share:.0f} % of its path is that of {TRACKED}, turned and '
                'scaled as it fits best: it has diverged, or is not of this flight']
    return []


def _single(bag: Bag) -> list[str]:
    """Return lines about topics of one message."""
    return [f'{_short(topic)}: it has one message: nothing can be seen of a motion'
            for topic in bag.topics if len(bag[topic]) == 1]
