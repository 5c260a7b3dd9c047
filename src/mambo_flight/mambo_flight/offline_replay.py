"""
Offline replay: recorded sensors through the estimator in one process, no middleware.

The estimator's step is the compiled one of the node, and the samples are ordered by the same
watermark. The result therefore equals the recorded estimate to the last bit. Topics are read as
columns, the samples of all steps are found at once, and one compiled loop runs the steps. If a
sample is late, repeated or out of order, the :class:`Synchroniser` of the node finds the steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any, NamedTuple

from mambo_bags import playback
from mambo_bags.reader import Bag, BagError, Messages
from mambo_estimation import filters
from mambo_estimation.capture.pose_parameters import AidedValues
from mambo_estimation.parameters import EstimatorNodeParams
from mambo_estimation.synchroniser import Synchroniser
from mambo_model.compiled import jit
from mambo_model.frames import flip_vector
from mambo_ros import topics
import numpy as np
from numpy.typing import NDArray

from .aided_replay import Poses, poses, poses_announced
from .capture_columns import store_located, WIDTH
from .closed_loop import Recording, store_estimate, store_state

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Steps(NamedTuple):
    """Filter steps of a flight, one a row; fields and units as in ``synchroniser.Step``."""

    t: Ints  # (n,)
    dt: Floats  # (n,)
    gyro: Floats  # (n, 3)
    accel: Floats  # (n, 3)
    sonar: Floats  # (n,)
    flow: Floats  # (n, 2)
    flow_quality: Ints  # (n,)
    pressure: Floats  # (n,)
    last: NDArray[np.bool_]  # (n,)
    dropped: Ints  # (n, 4)


class Estimates(NamedTuple):
    """Estimates, one row for each message that the live estimator publishes; NED and FRD."""

    t: Ints  # (n,) ns
    state: Floats  # (n, 13) rho m, nu m/s, q w x y z, omega rad/s, as in closed_loop.Recording
    pose_covariance: Floats  # (n, 36), as in estimate.Estimate
    twist_covariance: Floats  # (n, 36), likewise
    estimator: Floats  # (n, 36), its other numbers, as in closed_loop.Inner
    dropped: Ints  # (n, 4) samples dropped so far: IMU, sonar, flow, pressure
    located: Floats | None = None  # (n, 61) in map, see capture_columns; None: without


class _Stream(NamedTuple):
    """The samples of one sensor, in the order of the bag."""

    log_time: Ints  # (n,) ns
    t: Ints  # (n,) ns, stamps
    values: tuple[NDArray, ...]  # n rows each, one array for each field of Steps


def _flipped(vectors: Floats) -> Floats:
    return np.stack(flip_vector(tuple(vectors.T)), axis=1)


def _valid_ranges(m: Messages) -> Floats:
    """Return the sonar's ranges, NaN outside the limits that each message states."""
    low, high, distance = (m[name].astype(float) for name in ('min_range', 'max_range', 'range'))
    return np.where((low <= distance) & (distance <= high), distance, np.nan)


_Decoder = Callable[[Messages], tuple[NDArray, ...]]
SENSORS: dict[topics.Topic, tuple[tuple[str, ...], _Decoder]] = {
    topics.IMU: (('gyro', 'accel'), lambda m: (
        _flipped(m['angular_velocity']), _flipped(m['linear_acceleration']))),
    topics.SONAR: (('sonar',), lambda m: (_valid_ranges(m),)),
    topics.OPTICAL_FLOW: (('flow', 'flow_quality'), lambda m: (
        np.stack([m['rate_x'], -m['rate_y']], axis=1), m['quality'])),
    topics.BAROMETER: (('pressure',), lambda m: (m['fluid_pressure'],))}
"""Fields of :class:`Steps` and how to decode them, in the order of the watermark."""


def _read(bag: Bag, topic: topics.Topic) -> Messages:
    """Return the messages of a topic; BagError if they have another type."""
    found = bag[topic.name]
    if found.type_name != topic.type_name:
        raise BagError(f'{bag.path}: {found.topic} has the type {found.type_name}, expected '
                       f'{topic.type_name}')
    return found


def _stream(bag: Bag, topic: topics.Topic) -> _Stream:
    """Return the samples of a sensor, empty without its topic; BagError as for steps."""
    fields, decode = SENSORS[topic]
    if topic.name not in bag:
        empty = _without_samples(np.empty(0, np.int64))
        return _Stream(empty.t, empty.t, tuple(getattr(empty, field) for field in fields))
    found = _read(bag, topic)
    try:
        return _Stream(found.log_time, found.stamp, decode(found))
    except KeyError as error:
        raise BagError(f'{bag.path}: {error.args[0]}') from None


def _counted(bag: Bag) -> tuple[list[_Stream], playback.Marks]:
    """Return the streams of a bag without uncounted repeats, and its watermarks for them."""
    streams = [_stream(bag, topic) for topic in SENSORS]
    marks = playback.watermarks(bag, topics.SENSOR_TICK)
    for k, topic in enumerate(SENSORS):
        if topic.name in bag and (kept := playback.kept(bag[topic.name], marks, k)) is not None:
            streams[k] = _Stream(*(column[kept] for column in streams[k][:2]),
                                 tuple(values[kept] for values in streams[k].values))
    return streams, marks


def missing(bag: Bag) -> dict[str, tuple[int, int]]:
    """
    Return the samples that the last watermark announces and that are not in a bag.

    By topic, how many they are and of how many; only of topics that lack some.
    """
    if topics.SENSOR_TICK.name not in bag or topics.IMU.name not in bag:
        return {}
    streams, marks = _counted(bag)
    counts = {topic.name: (int(n), len(stream.t))
              for topic, stream, n in zip(SENSORS, streams, marks.due.max(axis=0), strict=True)}
    if topics.CAPTURE_TICK.name in bag:
        counts[topics.OPTITRACK.name] = poses_announced(bag)
    return {name: (n - there, n) for name, (n, there) in counts.items() if n > there}


def nothing_complete(bag: Bag) -> BagError:
    """Return the error of a bag without any step: what its watermarks announce and it lacks."""
    lost = '; '.join(f'{few} of {all_} samples of {name} that were published are not in the bag'
                     for name, (few, all_) in missing(bag).items())
    return BagError(f'{bag.path}: no step of the sensors is complete, nothing to estimate'
                    + f' ({lost})' * bool(lost))


def _ticks_from_log(streams: list[_Stream]) -> playback.Marks:
    """
    Return :class:`playback.Marks` for a bag without watermarks, e.g. of real hardware.

    Like ``replay_node``, it counts a sample at an inertial sample if it was logged before the next
    inertial sample.
    """
    imu, *aiding = streams
    new = np.flatnonzero(playback.newer(imu.t))
    nexts = new[1:]
    due = [np.append(nexts, len(imu.t))] + [
        np.append(np.searchsorted(s.log_time, imu.log_time[nexts], 'left'), len(s.t))
        for s in aiding]
    t, logged = imu.t[new], np.stack(due, axis=1)[:len(new)]
    return playback.Marks(
        t, playback.announced(t, logged, [stream.t for stream in streams]), logged,
        np.zeros(len(streams), np.int64))


def _without_samples(t: Ints) -> Steps:
    """Return one step at each stamp, all without samples."""
    n = len(t)
    return Steps(
        t, np.diff(t, prepend=t[:1]) * 1e-9, np.full((n, 3), np.nan), np.full((n, 3), np.nan),
        np.full(n, np.nan), np.full((n, 2), np.nan), np.zeros(n, np.int64), np.full(n, np.nan),
        np.ones(n, np.bool_), np.zeros((n, 4), np.int64))


def _in_order(streams: list[_Stream], t: Ints, due: Ints) -> Steps | None:
    """
    Return the steps of a flight whose samples all arrived in order, else None.

    In order means: each watermark announces at most one new sample of a sensor. The stamp of the
    sample lies after the previous watermark and not after this one; that of the inertial sample
    equals the watermark's.
    """
    if (due > [len(stream.t) for stream in streams]).any():
        return None
    out, periods = _without_samples(t), np.diff(t, prepend=-1)
    if (periods <= 0).any():
        return None
    for stream, counts, (fields, _) in zip(streams, due.T, SENSORS.values(), strict=True):
        new = np.diff(counts, prepend=0)
        if not np.isin(new, (0, 1)).all():
            return None
        rows = np.flatnonzero(new)
        samples = counts[rows] - 1
        age = t[rows] - stream.t[samples]
        if ((age < 0) | (age >= periods[rows])).any() or stream is streams[0] and age.any():
            return None
        for field, values in zip(fields, stream.values, strict=True):
            getattr(out, field)[rows] = values[samples]
    return out


def _synchronised(streams: list[_Stream], marks: playback.Marks) -> Steps:
    """Return the steps of any flight, found by the synchroniser of the node."""
    sync = Synchroniser()
    queues = [
        (add, zip(stream.t.tolist(), *(values.tolist() for values in stream.values)))
        for add, stream in zip(
            (sync.add_imu, sync.add_sonar, sync.add_flow, sync.add_pressure), streams,
            strict=True)]
    found = []
    new = np.diff(np.maximum.accumulate(marks.logged), axis=0, prepend=0)
    for stamp, counts, more in zip(marks.t.tolist(), marks.due.tolist(), new.tolist()):
        for (add, samples), count in zip(queues, more, strict=True):
            for sample in islice(samples, count):
                found += add(*sample)
        found += sync.add_tick(stamp, counts)
    for add, samples in queues:
        for sample in samples:
            found += add(*sample)
    out = _without_samples(np.array([step.t for step in found], np.int64))
    for name, column in zip(Steps._fields, zip(*found)):
        getattr(out, name)[:] = column
    return out


def steps(bag: Bag) -> Steps:
    """
    Return the filter steps of a bag that was read with its sensors.

    Raises
    ------
    mambo_bags.reader.BagError
        If it has no topic of inertial samples, or a topic has another type.

    """
    bag.messages(topics.IMU.name)
    if topics.SENSOR_TICK.name in bag:
        streams, marks = _counted(bag)
    else:
        streams = [_stream(bag, topic) for topic in SENSORS]
        marks = _ticks_from_log(streams)
    found = _in_order(streams, marks.t, marks.due)
    return _synchronised(streams, marks) if found is None else found


@jit
def _offer_pose(memory, seen, k):
    """Return the memory of an estimator after the pose of step k, if there is one."""
    if seen is None:
        return memory
    if np.isnan(seen.age[k]):
        return memory
    z = seen.pose[k]
    return filters.offer(memory, seen.age[k], (z[0], z[1], z[2]), (z[3], z[4], z[5], z[6]))


@jit
def _run(memory, values, s, seen, out, first, end, row):
    """Run an estimator over some steps and fill ``out`` from a row on; return both after it."""
    for k in range(first, end):
        g, a, f = s.gyro[k], s.accel[k], s.flow[k]
        memory = _offer_pose(memory, seen, k)
        memory, estimate = filters.step(
            memory, s.dt[k], (g[0], g[1], g[2]), (a[0], a[1], a[2]), s.sonar[k], (f[0], f[1]),
            s.flow_quality[k], s.pressure[k], values)
        if s.last[k]:
            store_state(out.state[row], estimate.state)
            store_estimate(out, row, estimate)
            store_located(out.located, row, filters.located(memory, estimate))
            row += 1
    return memory, row


def run(found: Steps, params: filters.Params, seen: Poses | None = None,
        later: Sequence[tuple[int, Any]] = ()) -> Estimates:
    """
    Run an estimator over some steps and return its estimates.

    Parameters
    ----------
    found
        Of :func:`steps`.
    params
        Parameters of the estimator; their type selects it.
    seen
        Poses of the motion capture, for an estimator that uses them.
    later
        Other values for its compiled step, each with the time in ns from which they count.

    """
    n, values = int(found.last.sum()), params.values()
    aided = isinstance(values, AidedValues)
    out = Estimates(
        found.t[found.last], *(np.empty((n, width)) for width in (13, 36, 36, 36)),
        found.dropped[found.last], np.zeros((n, WIDTH)) if aided else None)
    parts = [(0, values), *((int(np.searchsorted(found.t, t)), other) for t, other in later)]
    memory, row = filters.initial(values), 0
    for (first, own), end in zip(
            parts, (*(first for first, _ in parts[1:]), len(found.t)), strict=True):
        memory, row = _run(memory, own, found, seen if aided else None, out, first, end, row)
    return out


def estimate(bag: Bag, params: filters.Params,
             later: Sequence[tuple[int, Any]] = ()) -> Estimates:
    """
    Run an estimator over a bag; the result equals the live one to the last bit.

    Parameters
    ----------
    bag
        Read with its sensors, and with ``optitrack/pose`` and ``optitrack/tick`` for an
        estimator that uses the motion capture.
    params
        Parameters of the estimator; their type selects it.
    later
        As of :func:`run`.

    """
    found = steps(bag)
    if not isinstance(params.values(), AidedValues):
        return run(found, params, None, later)
    seen, whole = poses(bag, found.t)
    return run(Steps(*(column[:whole] for column in found)), params,
               Poses(*(column[:whole] for column in seen)), later)


def steps_of(recording: Recording) -> Steps:
    """Return the filter steps of a flight in one process."""
    found = _without_samples(recording.t)
    found.gyro[:], found.accel[:] = recording.imu[:, :3], recording.imu[:, 3:]
    found.sonar[:], found.pressure[:] = recording.sonar, recording.pressure
    found.flow[:], found.flow_quality[:] = recording.flow[:, :2], np.nan_to_num(
        recording.flow[:, 2])
    return found


def estimate_again(recording: Recording, node: EstimatorNodeParams) -> Floats:
    """
    Run another estimator over the samples of a flight; return its states, (n, 13).

    Appendix C does so with other flow factors. The flight itself stays as it was.

    Parameters
    ----------
    recording
        Of :func:`closed_loop.fly`.
    node
        The other estimator, not ``ground_truth``.

    """
    seen = None
    if node.aided:
        new = ~np.isnan(recording.pose[:, 0])
        seen = Poses(
            np.where(new, (recording.t - recording.pose_t) * 1e-9, np.nan), recording.pose)
    return run(steps_of(recording), node.filter, seen).state
