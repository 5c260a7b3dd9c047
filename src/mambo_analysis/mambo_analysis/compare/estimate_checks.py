"""
What contradicts an estimate that need not have diverged: sensors, biases and motion capture.

A filter that refuses a wrong sensor, or takes its error for a bias, goes on smoothly. Its own
covariance does not show that. Each finding is one line that names what, when and how much.
"""

from __future__ import annotations

from mambo_bags import playback
from mambo_bags.reader import Bag
from mambo_estimation import gate, health
from mambo_ros import topics
from mambo_signals import (
    derivative, gyro_check, height_check, motion, resample, stamps, time_offset)
import numpy as np
from numpy.typing import NDArray

from . import pair
from ..importers.checks import bag_doubts

Floats = NDArray[np.float64]
UNUSED_TIME = 3.0  # s: unhealthy after 1 s without a used sample, and recovery takes as long again
ALIGNING = 0  # EstimatorState.STATUS_ALIGNING
SENSORS = playback.SENSORS[1:]  # all but the inertial one
FAULTS = {health.NOT_FINITE: 'not finite', health.IMPLAUSIBLE: 'refused', health.STUCK: 'stuck'}
WINDOW = 5.0  # s, several times the recovery time of a gate
SHARE = 0.5 * (1.0 + gate.MAJORITY)
"""Refused at this share, samples win the vote of the gate. Outliers are fewer: 0.53 at most in
5 s of the public flights. That they are still refused after several recoveries is no outlier."""
LEAST_SAMPLES = 20  # in a window, for a share of them to mean something
LARGEST_ACCEL_BIAS = 2.0  # m/s^2; MPU-6050: 80 mg offset, 60 mg by temperature, 3 % of 1 g: 1.7
LARGEST_GYRO_BIAS = 0.7   # rad/s; MPU-6050: 20 deg/s offset and 20 deg/s by temperature
LARGEST_RATE = 35.0  # rad/s; MPU-6050: 2000 deg/s. Samples beyond it are damaged
DEAD_TIME = 1.0  # s, in which an axis repeats one number while other axes change
LEAST_CHANGES = 20  # of an axis in that time, for it to be alive
FAR = 0.5      # m from the motion capture; a smaller distance is in the table of errors
SIGMAS = 6.0   # standard deviations that the estimate states: 1 in 10^7 at most by chance


def _longest(t: Floats, inside: NDArray[np.bool_]) -> tuple[float, float]:
    """Return begin and end of the run of True that lasts longest, s; twice 0 if there is none."""
    return max(((float(t[first]), float(t[end - 1])) for first, end in resample.runs(inside)),
               key=lambda run: run[1] - run[0], default=(0.0, 0.0))


def unused(t: Floats, states: NDArray[np.integer]) -> list[str]:
    """
    Return the sensors that gave samples of which none was used for ``UNUSED_TIME``.

    Parameters
    ----------
    t : (n,) s
        Ascending.
    states : (n, 5)
        Health of each sensor, in the order of ``health.NAMES``.

    """
    out = []
    for name, state in zip(health.NAMES, states.T, strict=True):
        begin, end = _longest(t, np.isin(state, list(FAULTS)))
        if end - begin >= UNUSED_TIME:
            fault = FAULTS[int(state[np.searchsorted(t, end)])]
            out.append(f'{name} {fault} from {begin:.2f} to {end:.2f} s')
    return out


def refused(name: str, t: Floats, ratio: Floats) -> list[str]:
    """
    Return a line if most samples over ``WINDOW`` were beyond the gate.

    Parameters
    ----------
    name
        Of the sensor.
    t : (n,) s
        Ascending.
    ratio : (n,)
        Test ratios, refused above 1; NaN without a sample.

    """
    seen = np.isfinite(ratio)
    if seen.sum() < LEAST_SAMPLES:
        return []
    t, beyond = t[seen], np.concatenate(([0], np.cumsum(ratio[seen] > 1.0)))
    begin, end = np.arange(len(t)), np.searchsorted(t, t + WINDOW, 'right')
    whole = (end - begin >= LEAST_SAMPLES) & (t + WINDOW <= t[-1])
    share = np.where(whole, (beyond[end] - beyond[begin]) / np.maximum(end - begin, 1), 0.0)
    if not (share >= SHARE).any():
        return []
    k = int(share.argmax())
    return [f'{share[k]:.0%} of the {name} samples refused from {t[k]:.2f} to '
            f'{t[k] + WINDOW:.2f} s: it contradicts the other sensors']


def biases(t: Floats, accel: Floats, gyro: Floats) -> list[str]:
    """
    Return the estimated biases that no such sensor has, if they last for ``UNUSED_TIME``.

    Parameters
    ----------
    t : (n,) s
    accel, gyro : (n, 3) m/s^2, rad/s
        Body FLU.

    """
    out = []
    for name, unit, found, largest in (('accelerometer', 'm/s^2', accel, LARGEST_ACCEL_BIAS),
                                       ('gyro', 'rad/s', gyro, LARGEST_GYRO_BIAS)):
        for axis, values in zip('xyz', found.T, strict=True):
            begin, end = _longest(t, np.abs(values) > largest)
            if end - begin >= UNUSED_TIME:
                out.append(
                    f'{name} bias of {values[np.searchsorted(t, end)]:.3g} {unit} along {axis} '
                    f'from {begin:.2f} to {end:.2f} s, beyond {largest:g}: check scale, unit and '
                    'mounting')
    return out


def dead_axes(t: Floats, gyro: Floats, accel: Floats, measured: NDArray[np.bool_]) -> list[str]:
    """
    Return the axes of the inertial sensors that repeat a number while the others change.

    A recording in which three axes or more ever repeat together has no noise: its axes rest
    where the vehicle does, or moves in a plane.

    Parameters
    ----------
    t : (n,) s
        Ascending.
    gyro, accel : (n, 3)
        Samples.
    measured : (6,)
        Axes of both that the vehicle has; an import fills the others with a number.

    """
    samples = np.hstack([gyro, accel])
    names = [f'{name} {axis}' for name in health.NAMES[:health.SONAR] for axis in 'xyz']
    changes = np.concatenate(
        (np.zeros((1, 6), int), np.cumsum(samples[1:] != samples[:-1], axis=0)))
    begin, end = np.arange(len(t)), np.searchsorted(t, t + DEAD_TIME, 'right') - 1
    moved = changes[end] - changes[begin]
    dead, alive = moved == 0, moved >= LEAST_CHANGES
    whole = t + DEAD_TIME <= t[-1]
    dead &= measured
    if (whole & (dead.sum(axis=1) >= 3)).any():
        return []
    one = whole & (alive.sum(axis=1) >= 4)
    return [f'{name} repeats {samples[k, i] + 0.0:.6g} from {t[k]:.2f} s on while others change'
            for i, name in enumerate(names)
            for k in np.flatnonzero(one & dead[:, i])[:1].tolist()]


def from_capture(bag: Bag, state: Bag) -> list[str]:
    """
    Return a line if the estimate is further from the motion capture than it states.

    Of an estimator that states no covariance (0), nothing.
    """
    if topics.OPTITRACK.name not in bag:
        return []
    ours, truth = motion.read(state, topics.ESTIMATE.name), motion.read(bag, topics.OPTITRACK.name)
    alignment = pair.replay_alignment(bag, ours, truth)
    found = pair.positions(ours if alignment is None else alignment.moved(ours), truth)
    odometry = state[topics.ESTIMATE.name]
    variance = odometry['pose.covariance'][:, [0, 7, 14]].sum(axis=1)
    sigma = np.sqrt(np.interp(found.stamps, odometry.stamp, variance))
    distance = np.linalg.norm(found.error, axis=1)
    far = np.flatnonzero((sigma > 0.0) & (distance > FAR) & (distance > SIGMAS * sigma))
    if not len(far):
        return []
    k = far[distance[far].argmax()]
    seconds = (found.stamps[k] - odometry.stamp[0]) * 1e-9
    return [f'{distance[k]:.2f} m from the motion capture at {seconds:.2f} s, where the estimate '
            f'states a standard deviation of {sigma[k]:.2g} m']


def _has(bag: Bag, *wanted: topics.Topic) -> bool:
    """Return whether a bag has messages of each topic."""
    return all(topic.name in bag and len(bag[topic.name]) for topic in wanted)


def turning(bag: Bag) -> list[str]:
    """
    Return a line if the gyro and the attitude of the motion capture turn differently in flight.

    A filter whose gyro has its axes swapped need not be far off: flow and sonar hold it. What a
    vehicle that has crashed shows on the floor is no contradiction.
    """
    if not _has(bag, topics.IMU, topics.OPTITRACK):
        return []
    tracked, imu = motion.read(bag, topics.OPTITRACK.name), bag[topics.IMU.name]
    if not motion.has_attitude(tracked):
        return []
    try:
        flown = time_offset.flight_by_position(tracked.t, tracked.position)
    except time_offset.AlignError:  # it never flew
        return []
    part = slice(*np.searchsorted(tracked.t, flown.within(tracked.t[0], tracked.t[-1])))
    gyro = imu['angular_velocity']
    columns = (imu.t, np.where(np.abs(gyro) <= LARGEST_RATE, gyro, np.nan),
               tracked.t[part], tracked.quaternion[part])
    for search in (0.0, gyro_check.SEARCH):  # nearly all agree without a search
        try:
            gyro_check.refuse(gyro_check.compare(*columns, search))
        except time_offset.AlignError as error:
            found = str(error)
        else:
            return []
    return [found]


def upside_down(attitude: Floats) -> list[str]:
    """Return a line if an estimate, (n, 4) x y z w, is upside down most of the time."""
    upright = 1.0 - 2.0 * (attitude[:, 0] ** 2 + attitude[:, 1] ** 2)  # z of the body, upwards
    share = float(np.mean(upright < 0.0))
    if share <= 0.5:
        return []
    return [f'the vehicle is upside down in {share:.0%} of the steps: check the signs of the '
            'accelerometer']


def seen_flow(bag: Bag) -> list[str]:
    """Return a line for each axis of the flow that is not the motion in the motion capture."""
    if not _has(bag, topics.IMU, topics.OPTICAL_FLOW, topics.OPTITRACK):
        return []
    tracked = motion.read(bag, topics.OPTITRACK.name)
    if not motion.has_attitude(tracked) or len(tracked.t) < 3:
        return []
    _, velocity = derivative.local_fit(tracked.t, tracked.position, tracked.t, derivative.POSITION)
    return bag_doubts.flow(bag, tracked, velocity)


def contradictions(bag: Bag, state: Bag) -> list[str]:
    """
    Return what contradicts an estimate, one line each; empty if nothing does.

    Of an estimator that never aligned, only the sensors: there is no estimate.

    Parameters
    ----------
    bag
        Read with its sensors.
    state
        With ``estimate/odom`` and ``estimator/state`` of the estimator; may be the same bag.

    """
    inner = state[topics.ESTIMATOR_STATE.name]
    t = (inner.stamp - inner.stamp[0]) * 1e-9
    out = stamps.other_clock(bag, [topic.name for topic in SENSORS])
    out += unused(t, inner['health'])
    if (inner['status'] == ALIGNING).all():
        return out
    for name, field in zip(health.NAMES[health.SONAR:], ('sonar', 'flow', 'barometer'),
                           strict=True):
        out += refused(name, t, inner[f'{field}_test_ratio'])
    out += biases(t, inner['accel_bias'], inner['gyro_bias'])
    if _has(bag, topics.IMU):
        imu = bag[topics.IMU.name]
        order = np.argsort(imu.stamp, kind='stable')
        measured = np.ones(6, bool)
        measured[3:5] = 'horizontal_acceleration' not in bag.metadata.get('import', {})
        gyro, accel = (imu[name][order] for name in ('angular_velocity', 'linear_acceleration'))
        out += dead_axes((imu.stamp[order] - inner.stamp[0]) * 1e-9, gyro, accel, measured)
    out += upside_down(state[topics.ESTIMATE.name].orientation)
    return out + height_check.of_bag(bag) + turning(bag) + seen_flow(bag) + from_capture(
        bag, state)
