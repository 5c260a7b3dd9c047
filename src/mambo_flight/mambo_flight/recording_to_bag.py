"""
Write a flight of the closed loop as a bag with the topics of the graph.

The messages equal those of the graph in lockstep, byte for byte (tested). They are encoded by the
same functions, which take the columns of a whole flight as well as single numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TransformStamped
from mambo_bags.writer import BagWriter, BagWriterError, Qos
from mambo_control import failsafe
from mambo_control.commanded import script
from mambo_estimation.capture import report as capture_report
from mambo_estimation.capture.frames import odom_in_map
from mambo_estimation.estimate import diagnostic_status, tilt_deviation
from mambo_estimation.health import Health
from mambo_model import frames
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_ros import cdr, diagnostics, messages, topics
from mambo_ros.commands import change_message
from mambo_ros.commands.command_message import encode
from mambo_sim.simulator import SimulatorParams
import numpy as np
from numpy.typing import NDArray
from tf2_msgs.msg import TFMessage

from . import changes
from .capture_columns import anchor_of, capture_of, COLUMNS
from .closed_loop import Recording
from .scenario import commented_yaml, Scenario
from .world import world_file

SECOND = 1_000_000_000  # ns
TF_EVERY = 20_000_000  # ns
Stream = tuple[NDArray[np.int64], list[NDArray[np.uint8]]]


def _columns(rows: NDArray, start: int = 0, count: int | None = None) -> tuple[Any, ...]:
    """Return columns of an array as a vector of arrays."""
    end = rows.shape[1] if count is None else start + count
    return tuple(rows[:, i] for i in range(start, end))


def _vectors(rows: NDArray, *counts: int) -> Iterator[Any]:
    """Yield consecutive vectors of ``counts`` columns; a single column is yielded as it is."""
    start = 0
    for count in counts:
        out = _columns(rows, start, count)
        yield out if count > 1 else out[0]
        start += count


def _state(rows: NDArray) -> State:
    return State(*_vectors(rows, 3, 3, 4, 3))


def _block(stamps: NDArray[np.int64], *blocks: NDArray[np.uint8]) -> Stream:
    """Return a stream of messages, padded with zeros to a multiple of 4 bytes as in DDS."""
    return stamps, [np.pad(rows, ((0, 0), (0, -rows.shape[1] % 4))) for rows in blocks]


def _noise(r: Recording, flight: Scenario) -> tuple[Any, ...]:
    """Return noise of gyro (3), accelerometer (3), pressure: columns if it changes in flight."""
    def of(p: SimulatorParams) -> tuple[float, ...]:
        return (*p.imu.gyro_noise, *p.imu.accel_noise, p.barometer.noise)
    out: tuple[Any, ...] = of(flight.sim_node.simulator)
    for one in changes.taken(flight, len(r.t)):
        if one.node == 'sim_node':
            out = tuple(np.where(np.arange(len(r.t)) < one.k, before, after)
                        for before, after in zip(out, of(one.params.simulator), strict=True))
    return out


def _sensors(r: Recording, flight: Scenario) -> Iterator[tuple[topics.Topic, Stream]]:
    """Yield the sensor topics of ``sim_node``."""
    p = flight.sim_node.simulator
    sigmas = _noise(r, flight)
    variances = [tuple(sigma * sigma for sigma in noise) for noise in (sigmas[:3], sigmas[3:6])]
    yield topics.IMU, _block(r.t, messages.imu(r.t, *_vectors(r.imu, 3, 3), *variances))
    echo, flow, air = (~np.isnan(x) for x in (r.inner.sonar, r.flow[:, 2], r.pressure))
    yield topics.SONAR, _block(r.t[echo], messages.sonar(
        r.t[echo], r.inner.sonar[echo], p.sonar.min_range, p.sonar.max_range,
        2.0 * p.sonar.max_tilt))
    seen = r.flow[flow]
    yield topics.OPTICAL_FLOW, _block(r.t[flow], messages.optical_flow(
        r.t[flow], (seen[:, 0], seen[:, 1]), seen[:, 2]))
    yield topics.BAROMETER, _block(r.t[air], messages.pressure(
        r.t[air], r.pressure[air], np.square(np.broadcast_to(sigmas[6], len(r.t))[air])))
    counts = (np.arange(1, len(r.t) + 1), *(np.cumsum(new) for new in (echo, flow, air)))
    yield topics.SENSOR_TICK, _block(r.t, messages.sensor_tick(r.t, *counts))


def estimate(t: NDArray[np.int64], states: NDArray, inner: Any) -> NDArray[np.uint8]:
    """Encode estimates from rows of states, with the covariances of :class:`closed_loop.Inner`."""
    return messages.estimate(
        t, _state(states), _columns(inner.pose_covariance), _columns(inner.twist_covariance))


def located(t: NDArray[np.int64], rows: NDArray, twist_covariance: NDArray) -> NDArray[np.uint8]:
    """Encode estimates in ``map`` from rows of :mod:`.capture_columns`."""
    return messages.located(
        t, _state(rows[:, :COLUMNS.covariance]),
        _columns(rows, COLUMNS.covariance, COLUMNS.anchor - COLUMNS.covariance),
        _columns(twist_covariance))


def estimator_state(
    t: NDArray[np.int64], inner: Any, dropped: tuple[Any, ...] = (0, 0, 0, 0),
) -> NDArray[np.uint8]:
    """Encode the state of an estimator, with the samples that the synchroniser dropped."""
    *before, invalid, health, age, not_finite = _vectors(
        inner.estimator, 1, 1, 1, 3, 3, 1, 2, 3, 2, 3, 1, 5, 5, 5)
    return messages.estimator_state(
        t, *before, invalid + sum(dropped), health, age, not_finite, dropped)


def _laws(r: Recording, flight: Scenario) -> Iterator[tuple[topics.Topic, Stream]]:
    """Yield the topics of estimator, reference and controller."""
    inner = r.inner
    yield topics.ESTIMATE, _block(r.t, estimate(r.t, r.estimate, inner))
    if r.located is not None:
        yield topics.LOCATED, _block(r.t, located(r.t, r.located, inner.twist_covariance))
    if flight.estimator_node.estimator != 'ground_truth':
        yield topics.ESTIMATOR_STATE, _block(r.t, estimator_state(r.t, inner))
    rho, _, q, omega = _state(r.reference)
    v, a, j, s, omega_dot, f, tau = _vectors(inner.plan, 3, 3, 3, 3, 3, 1, 3)
    yield topics.REFERENCE, _block(r.t, messages.reference(
        r.t, Reference(rho, v, a, j, s, q, omega, omega_dot, f, tau), r.phase))
    yield topics.CONTROLLER_STATE, _block(r.t, messages.controller_state(
        r.t, *_vectors(inner.controller, 3, 3, 3, 3, 3, 4, 1, 3, 1, 3, 4, 4)))
    yield topics.MOTOR_PWM, _block(
        r.t, messages.motor_pwm(r.t, _columns(r.pwm), r.stopped, r.reason))


def _tf_template(map_to_odom: bool) -> tuple[bytes, list[int], list[int]]:
    """Return a /tf message and the byte offsets of its stamps and of its pose numbers."""
    sec, nanosec, numbers = 0x51525354, 0x21222324, [1.5e300 + k * 1e299 for k in range(14)]
    children = ((messages.ODOM, messages.BASE), (messages.MAP, messages.ODOM))
    transforms = []
    for k, (parent, child) in enumerate(children[:2 if map_to_odom else 1]):
        frame = TransformStamped(child_frame_id=child)
        frame.header.frame_id = parent
        frame.header.stamp.sec, frame.header.stamp.nanosec = sec, nanosec
        where, turn = frame.transform.translation, frame.transform.rotation
        where.x, where.y, where.z, turn.x, turn.y, turn.z, turn.w = numbers[7 * k:7 * k + 7]
        transforms.append(frame)
    data = cdr.serialize(TFMessage(transforms=transforms))
    mark = np.array([sec, nanosec], dtype='<u4').tobytes()
    stamps = [at for at in range(len(data)) if data.startswith(mark, at)]
    return data, stamps, [
        data.index(np.float64(number).tobytes()) for number in numbers[:7 * len(transforms)]]


def _anchors(r: Recording, some: NDArray[np.bool_]) -> tuple[Any, ...]:
    """Return the pose of ``odom`` in ``map`` as published, seven columns."""
    if r.located is None:
        return tuple(np.full(some.sum(), x) for x in (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    poses = [odom_in_map(anchor_of(row)) for row in r.located[some]]
    return tuple(np.array(column) for column in zip(*(
        (*frames.flip_vector(pose.rho), *frames.wire_quaternion(pose.q)) for pose in poses)))


def _tf(r: Recording, map_to_odom: bool) -> Stream:
    """Return the transforms, one message every 20 ms."""
    some = r.t % TF_EVERY == 0
    t, state = r.t[some], _state(r.estimate[some])
    data, stamps, places = _tf_template(map_to_odom)
    out = np.tile(np.frombuffer(data, dtype=np.uint8), (len(t), 1))
    clock = np.stack((t // SECOND, t % SECOND), axis=1).astype('<u4').view(np.uint8)
    for at in stamps:
        out[:, at:at + 8] = clock
    poses = (*frames.flip_vector(state.rho), *frames.wire_quaternion(state.q), *_anchors(r, some))
    for at, column in zip(places, poses):
        out[:, at:at + 8] = np.ascontiguousarray(column).view(np.uint8).reshape(-1, 8)
    return _block(t, out)


def _reports(r: Recording, flight: Scenario) -> Iterator[tuple[int, bytes]]:
    """Yield (stamp, message) of the diagnostics of every node."""
    truth = flight.estimator_node.estimator == 'ground_truth'
    not_finite = np.zeros(5, dtype=int)
    stages = r.inner.health[:, 0].astype(int)
    changes = np.flatnonzero(np.diff(stages, prepend=failsafe.FLYING))
    for k in sorted({*np.flatnonzero(r.t % SECOND == 0).tolist(), *changes.tolist()}):
        t, row = int(r.t[k]), r.inner.health[k]
        stage, reason, tracked, markers, *counts, phase = map(int, row.tolist())
        at_t = [_report(
            t, 'controller_node', _level(stage), failsafe.describe(stage, reason),
            {'thrust [N]': float(r.thrust[k]), 'phase': phase, 'stage': failsafe.STAGES[stage]})]
        if t % SECOND == 0:
            at_t.append(_report(t, 'sim_node', diagnostics.OK, 'flying', {
                'mode': flight.sim_node.mode, 'steps': k, 'missed': 0}))
            at_t.append(_report(
                t, 'optitrack_node', diagnostics.OK if tracked else diagnostics.WARN,
                'tracking' if tracked else 'body lost', {
                    'visible markers': markers,
                    **dict(zip(('frames', 'lost frames', 'dropped frames'), counts))}))
            if not truth:
                row, spread = r.inner.estimator[k], r.inner.pose_covariance[k]
                tilt_std = tilt_deviation(spread.tolist())
                at_t.append(_estimator_report(
                    t, row, row[31:36].astype(int) - not_finite, tilt_std,
                    None if r.located is None else r.located[k], flight))
                not_finite = row[31:36].astype(int)
        yield from sorted(at_t)


def _changes(r: Recording, flight: Scenario) -> Iterator[tuple[int, bytes]]:
    """Yield (stamp, message) of the changes of parameters."""
    for one in changes.taken(flight, len(r.t)):
        t = int(r.t[one.k])
        yield t, change_message.encode(t, one.node, one.values)


def _report(*arguments: Any) -> tuple[int, bytes]:
    return arguments[0], diagnostics.report(*arguments)


def _level(stage: int) -> bytes:
    return {failsafe.FLYING: diagnostics.OK, failsafe.HOLDING: diagnostics.WARN}.get(
        stage, diagnostics.ERROR)


def _estimator_report(
    t: int, row: NDArray, not_finite: NDArray, tilt_std: float, seen: NDArray | None,
    flight: Scenario,
) -> tuple[int, bytes]:
    counts = tuple(row[17:21].astype(int).tolist())
    status = diagnostic_status(
        int(row[0]), float(row[1]), counts[:3], counts[3],
        Health(tuple(row[21:26].astype(int).tolist()), tuple(row[26:31].tolist()), (0,) * 5),
        tuple(not_finite.tolist()), (0,) * 4, tilt_std)
    if seen is not None:
        status = capture_report.added(
            status, capture_of(seen), flight.estimator_node.joint.pose.max_age)
    level, line, numbers = status
    return _report(t, 'estimator_node', diagnostics.LEVELS[level], line, numbers)


def _streams(r: Recording, flight: Scenario) -> Iterator[tuple[topics.Topic, Stream]]:
    """Yield every topic of the flight with its messages."""
    yield topics.CLOCK, _block(r.t, messages.clock(r.t))
    yield from _sensors(r, flight)
    yield topics.GROUND_TRUTH, _block(r.t, messages.ground_truth(r.t, _state(r.truth)))
    seen = ~np.isnan(r.pose[:, 0])
    yield topics.OPTITRACK, _block(r.pose_t[seen], messages.optitrack(
        r.pose_t[seen], *_vectors(r.pose[seen], 3, 4)))
    if flight.estimator_node.waits_for_capture:
        yield topics.CAPTURE_TICK, _block(r.t, messages.capture_tick(r.t, np.cumsum(seen)))
    yield from _laws(r, flight)
    yield topics.TF, _tf(r, flight.estimator_node.map_to_odom)
    yield topics.DIAGNOSTICS, _single(sorted((*_reports(r, flight), *_changes(r, flight))))
    commands = flight.reference_node.commands
    if commands.enabled:
        yield topics.COMMAND, _single([
            (command.t, encode(command)) for command in script.parse(commands.script)
            if command.t <= r.t[-1]])


def _single(found: list[tuple[int, bytes]]) -> Stream:
    """Return a stream of messages of different lengths, given with their stamps."""
    return _block(
        np.array([t for t, _ in found], dtype=np.int64),
        *(np.frombuffer(data, dtype=np.uint8)[None] for _, data in found))


def recorded(flight: Scenario) -> tuple[topics.Topic, ...]:
    """Return the topics in the bag of a flight."""
    return (topics.RECORDED + (topics.AIDED if flight.estimator_node.aided else ())
            + (topics.COMMANDED if flight.reference_node.commands.enabled else ()))


def check(flight: Scenario) -> None:
    """Raise :class:`BagWriterError` for a flight that :func:`write` refuses."""
    later = (one.params for one in changes.taken(flight) if one.node == 'sim_node')
    for node in (flight.sim_node, *later):
        for sensor in node.simulator.faults.present():
            kind = getattr(node.simulator.faults, sensor).kind
            raise BagWriterError(
                f'sim_node.simulator.faults.{sensor}.kind = {kind}: a bag of a flight with sensor '
                'faults needs the graph; fly it with ./run')


def write(path: Path, flight: Scenario, recording: Recording, namespace: str = topics.NAMESPACE,
          world: str = '') -> None:
    """
    Write a bag.

    Parameters
    ----------
    path
        Directory to create.
    flight
        Scenario that was flown.
    recording
        Result of :func:`closed_loop.fly` with ``inner``.
    namespace
        Namespace of the topics.
    world
        Text of the hall that several drones share, kept inside the bag.

    Raises
    ------
    mambo_bags.writer.BagWriterError
        If the bag exists or cannot be created, or for a flight with sensor faults: only the
        graph delivers messages late or twice.

    """
    check(flight)
    attachments = {'scenario.yaml': commented_yaml(flight, namespace)}
    with BagWriter(path, attachments | ({world_file.NAME: world} if world else {})) as bag:
        name = {topic: topics.full_name(topic, namespace) for topic in recorded(flight)}
        for topic in recorded(flight):
            bag.add_topic(name[topic], topic.type_name, Qos(depth=topics.QUEUE),
                          shared=topic.shared)
        bag.write_all({name[topic]: stream for topic, stream in _streams(recording, flight)
                       if len(stream[0])})
