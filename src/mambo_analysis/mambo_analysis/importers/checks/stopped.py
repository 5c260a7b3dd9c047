"""
Sensors that stop while a vehicle moves on: :func:`describe`.

A sensor that stopped repeats one value to the bit; an importer that keeps new values alone has no
message of it any more. So does one that has nothing to tell: at rest, a sonar on the floor or out
of reach, a flow or a pressure whose steps are coarser than the motion. Hence a sensor is named
only where the motion capture, or else the drone's own estimate, moves by what it must show.
"""

from __future__ import annotations

from collections.abc import Callable

from mambo_bags.reader import Bag
from mambo_signals import height_check
from mambo_signals.derivative import local_fit, POSITION
from mambo_signals.motion import Motion
from mambo_signals.resample import constant_runs
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
TRACKED, OWN = 'optitrack/pose', 'onboard/odom'
STOPPED = 1.0  # [s] with the same numbers of inertial sensors or an estimate
QUIET = 2.0  # [s] likewise of slower sensors; up to 0.8 s in 27 real flights, while they move
MOVED = 0.1  # [m] of another motion meanwhile
TIMES = 10.0  # [-] of what an axis usually repeats (99 %), at least, that one which stopped does
LEAST_RUNS = 20  # other values of an axis, from which that is known
CLIMB = 0.3  # [m] of the height that a range must show
REACH = 0.98  # [-] of the largest range, beyond which it may be the end of the reach
NEW_ALONE = tuple(f'mambo_analysis.import_{log}' for log in ('minidrone', 'crazyflie'))
"""Importers that keep new values alone."""
FASTER = 0.2  # [m/s] change of a velocity that a flow must show
STEPS = 2.0  # [-] steps of a sensor's resolution that a motion makes for a change to be seen
PASCALS = 11.8  # [Pa/m] of the pressure over height, at sea level
EVEN = 0.05  # [s] step of velocities
AFTER = (0, 1)  # from the sample after a run to its last one


def describe(bag: Bag, motions: dict[str, Motion]) -> list[str]:
    """
    Return a line about each sensor, and the estimate, that stopped while the vehicle moves.

    Parameters
    ----------
    bag
        With the topics of an import.
    motions
        Of ``TRACKED`` and ``OWN``, those that the bag has; nothing can be said without.

    """
    moving = motions.get(TRACKED, motions.get(OWN))
    if moving is None:
        return []
    out = _estimate(motions[OWN], moving) if OWN in motions and moving.name != OWN else []
    if 'imu/data_raw' in bag:
        out += _inertial(bag, moving)
    for topic, fields, must_show in (
            ('sonar/range', ('range',), _range), ('optical_flow', ('rate_x', 'rate_y'), _flow),
            ('barometer/pressure', ('fluid_pressure',), _pressure)):
        if topic in bag and len(bag[topic]) > 1:
            out += _slow(bag, topic, fields, must_show, moving)
    return out


def _ordered(stamps: Ints, values: Floats) -> tuple[Ints, Floats]:
    """Return samples, (n,) ns and (n, k), by their stamps, one of each."""
    stamps, first = np.unique(stamps, return_index=True)
    return stamps, values[first]


def _inside(moving: Motion, begin: int, end: int) -> NDArray[np.bool_]:
    return (moving.stamps > begin) & (moving.stamps < end)


def _moves(moving: Motion, begin: int, end: int) -> bool:
    """Return whether a vehicle moves by more than ``MOVED`` between two stamps [ns]."""
    inside = _inside(moving, begin, end)
    return bool(inside.any()) and float(np.ptp(moving.position[inside], axis=0).max()) > MOVED


def _line(topic: str, what: str, begin: int, end: int, moving: Motion, why: str) -> list[str]:
    return [f'{topic}: {what} from {begin * 1e-9:.2f} to {end * 1e-9:.2f} s, while {moving.name} '
            f'moves: {why}']


def _fast(topic: str, what: str, stamps: Ints, values: Floats, moving: Motion,
          times: float = 0.0) -> list[str]:
    """
    Return a line about the first run of equal values in which the vehicle moves.

    Parameters
    ----------
    topic, what
        What repeats them.
    stamps, values : (n,) ns, (n, k)
        Columns without any number are left out.
    moving
    times
        Of the usual length of a run, that it lasts at least; 0: of any length.

    """
    stamps, values = _ordered(stamps, values)
    known = np.isfinite(values).any(axis=0)
    if not known.any() or len(stamps) < 2:
        return []
    runs = stamps[constant_runs(values[:, known]) - AFTER]
    length = np.diff(runs)[:, 0]
    for k in np.flatnonzero(length >= STOPPED * 1e9).tolist():
        others = np.delete(length, k)
        if times and (len(others) < LEAST_RUNS
                      or length[k] < times * np.percentile(others, 99.0)):
            continue
        begin, end = runs[k].tolist()
        if _moves(moving, begin, end):
            return _line(topic, f'{what} repeats one value', begin, end, moving,
                         'it had stopped' + ', or was simulated without noise' * bool(times))
    return []


def _estimate(own: Motion, moving: Motion) -> list[str]:
    return _fast(own.name, 'it', own.stamps, own.position, moving)


def _inertial(bag: Bag, moving: Motion) -> list[str]:
    """Return lines about the inertial samples, one of the two sensors, or an axis of one."""
    imu = bag['imu/data_raw']
    sensors = {'gyro': imu.angular_velocity, 'accelerometer': imu.acceleration}
    if said := _fast('imu/data_raw', 'it', imu.stamp, np.hstack([*sensors.values()]), moving):
        return said
    out: list[str] = []
    for name, values in sensors.items():
        said = _fast('imu/data_raw', f'its {name}', imu.stamp, values, moving)
        out += said or [line for axis, x in zip('xyz', values.T) for line in _fast(
            'imu/data_raw', f'{axis} of its {name}', imu.stamp, x[:, None], moving, TIMES)]
    return out


MustShow = Callable[[Bag, Floats, int, Motion, NDArray[np.bool_]], bool]
"""Whether values (n, k) must change after sample i of them, by a motion at stamps of a mask."""


def _slow(bag: Bag, topic: str, fields: tuple[str, ...], must_show: MustShow,
          moving: Motion) -> list[str]:
    """Return a line about the first time in which a sensor must have a new value, and has none."""
    stamps, values = _ordered(bag[topic].stamp, np.column_stack(
        [np.asarray(bag[topic][field], float) for field in fields]))
    runs = constant_runs(values) - AFTER
    begins, ends = stamps[runs].T
    if bag.metadata.get('import', {}).get('importer') in NEW_ALONE:
        ends = np.append(begins[1:], max(moving.stamps[-1], stamps[-1]))
    for k in np.flatnonzero(ends - begins >= QUIET * 1e9).tolist():
        begin, end = int(begins[k]), int(ends[k])
        inside = _inside(moving, begin, end)
        if inside.sum() > 1 and must_show(bag, values, int(runs[k, 0]), moving, inside):
            return _line(topic, 'it has no new value', begin, end, moving, 'it had stopped')
    return []


def _range(
    bag: Bag, values: Floats, k: int, moving: Motion, inside: NDArray[np.bool_],
) -> bool:
    """Return whether a height changes by more than a range can hide."""
    sonar = bag['sonar/range']
    valid = np.isfinite(values[:, 0]) & (values[:, 0] >= np.min(sonar.min_range)) & (
        values[:, 0] <= np.max(sonar.max_range))
    if not valid[k]:  # no echo
        return False
    low, high, here = np.min(sonar.min_range), values[valid].max(), float(values[k, 0])
    low = low if low > 0.0 else values[valid].min()
    height = moving.position[inside, 2]
    change = height - height[0]
    if here <= height_check.WITHIN * low:  # the floor may be anywhere between 0 and this range
        return float(change.max()) > here + MOVED
    if here >= REACH * high:  # the floor may be anywhere beyond, unless it came in reach before
        return bool(k and valid[k - 1]) and float(change.min()) < -CLIMB
    return float(np.ptp(change)) > CLIMB


def _flow(
    bag: Bag, values: Floats, k: int, moving: Motion, inside: NDArray[np.bool_],
) -> bool:
    """Return whether the horizontal velocity over the height changes by more than its steps."""
    t = moving.stamps[inside] * 1e-9
    _, v = local_fit(t, moving.position[inside, :2], np.arange(t[0], t[-1], EVEN), POSITION)
    v = v[np.isfinite(v).all(axis=1)]
    if not len(v):
        return False
    height = float(np.median(moving.position[inside, 2])) - float(np.min(moving.position[:, 2]))
    return float(np.ptp(v, axis=0).max()) > max(FASTER, STEPS * _step(values) * height)


def _pressure(
    bag: Bag, values: Floats, k: int, moving: Motion, inside: NDArray[np.bool_],
) -> bool:
    """Return whether the height changes by more than the steps of the pressure."""
    return float(np.ptp(moving.position[inside, 2])) > max(MOVED, STEPS * _step(values) / PASCALS)


def _step(values: Floats) -> float:
    """Return the smallest change of values, (n, k); 0 without one."""
    changes = np.abs(np.diff(values, axis=0))
    changes = changes[changes > 0.0]
    return float(changes.min()) if len(changes) else 0.0
