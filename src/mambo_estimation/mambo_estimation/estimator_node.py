"""ROS shell of the estimator: sensor messages in, filter step, odometry out."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import TransformStamped
from mambo_model import frames, slots
from mambo_model.compiled import Held, hold, jit
from mambo_model.motion import rigid_body
from mambo_ros import cdr, diagnostics, input_guard, messages, node, process, topics
from tf2_msgs.msg import TFMessage

from . import filters
from .estimate import diagnostic_status, Estimate, tilt_deviation
from .parameters import EstimatorNodeParams
from .synchroniser import Step, Synchroniser

_TF_EVERY = 20_000_000  # ns
_REPORT_EVERY = 1_000_000_000  # ns
_STREAMS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)
_ZERO3, _ZERO36 = (0.0,) * 3, (0.0,) * 36


def _check_truth(truth: tuple) -> str:
    """Return the reason to refuse a decoded true state; empty if it is usable."""
    return input_guard.finite(*truth[1])


def _transform(
    t: int, parent: str, child: str, state: rigid_body.State | None,
) -> TransformStamped:
    out = TransformStamped(child_frame_id=child)
    out.header.frame_id = parent
    out.header.stamp.sec, out.header.stamp.nanosec = divmod(t, 1_000_000_000)
    if state is not None:
        where, turn = out.transform.translation, out.transform.rotation
        where.x, where.y, where.z = frames.flip_vector(state.rho)
        turn.x, turn.y, turn.z, turn.w = frames.wire_quaternion(state.q)
    return out


@jit
def _step(held, dt, gyro, accel, sonar, flow, flow_quality, pressure):
    """Take the samples of one step; return the estimate."""
    held.memory, estimate = filters.step(
        held.memory, dt, gyro, accel, sonar, flow, flow_quality, pressure, held.values)
    return estimate


class EstimatorNode(node.MamboNode[EstimatorNodeParams]):
    """
    State estimator.

    Subscribes ``imu/data_raw``, ``sonar/range``, ``optical_flow``, ``barometer/pressure`` and
    ``sensor_tick`` (or ``ground_truth/odom`` alone where that is the estimator); publishes
    ``estimate/odom``, ``estimator/state``, ``/tf`` and ``/diagnostics``.
    """

    publishes = (topics.ESTIMATE, topics.ESTIMATOR_STATE, topics.TF, topics.DIAGNOSTICS)
    subscribes = (*_STREAMS, topics.SENSOR_TICK, topics.GROUND_TRUTH)
    example = '--ros-args -p estimator:=kalman -p sensor_reliability:=best_effort'

    def __init__(self, **kwargs) -> None:
        super().__init__('estimator_node', EstimatorNodeParams, **kwargs)
        p = self.params
        self._estimate = self.advertise(topics.ESTIMATE)
        self._tf = self.advertise(topics.TF)
        if p.estimator == 'ground_truth':
            self.accept(
                topics.GROUND_TRUTH, messages.decode_odometry, self._on_truth, check=_check_truth)
            return
        self._held = self._begin()
        _step(  # have the compiled step in memory before time starts
            self._held, 0.0, _ZERO3, _ZERO3, 0.0, _ZERO3[:2], 0, 0.0)
        self._held = self._begin()
        watermark = p.synchronise == 'watermark'
        self._sync = Synchroniser(watermark)
        self._next_report, self._reported = 0, (0,) * 9
        self._inner = self.advertise(topics.ESTIMATOR_STATE)
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        sync = self._sync
        self._subscribe_sensor(topics.SONAR, messages.decode_sonar, sync.add_sonar)
        self._subscribe_sensor(topics.OPTICAL_FLOW, messages.decode_optical_flow, sync.add_flow)
        self._subscribe_sensor(topics.BAROMETER, messages.decode_pressure, sync.add_pressure)
        if not watermark:  # the inertial samples are the clock
            self.accept(
                topics.IMU, messages.decode_imu, self._adder(sync.add_imu),
                reliable=self._reliable)
            return
        self._subscribe_sensor(topics.IMU, messages.decode_imu, sync.add_imu)
        # the last message of a step, which completes it
        self.accept(topics.SENSOR_TICK, messages.decode_sensor_tick, self._adder(sync.add_tick))

    def _begin(self) -> Held:
        """Return the estimator at its start."""
        values = self.params.filter.values()
        self._slot = getattr(values, 'slot', None)
        return hold(filters.initial(values), None, values)

    @property
    def _reliable(self) -> bool:
        return self.params.sensor_reliability == 'reliable'

    def _adder(self, add: Callable) -> Callable:
        """Return the callback of a sensor, which runs the steps that a message completes."""
        return lambda *sample: self._run(add(*sample))

    def _subscribe_sensor(self, topic: topics.Topic, decode: Callable, add: Callable) -> None:
        """
        Queue each message of a sensor, late and repeated ones as well, whatever it reads.

        The synchroniser sorts the samples and the filter checks their values. An unreadable
        message still counts towards a watermark that announces it.
        """
        stream = _STREAMS.index(topic)
        self.accept(
            topic, decode, self._adder(add), prompt=False, reliable=self._reliable,
            timed=False, lost=lambda: self._run(self._sync.skip(stream)))

    def _on_truth(self, t: int, state: rigid_body.State) -> None:
        self._estimate(messages.estimate(t, state, _ZERO36, _ZERO36))
        self._broadcast(t, state)

    def _run(self, steps: list[Step]) -> None:
        for s in steps:
            estimate = _step(
                self._held, s.dt, s.gyro, s.accel, s.sonar, s.flow, s.flow_quality, s.pressure)
            if self._slot is not None:
                self.fail(slots.fault(self._slot))
            if s.last:
                self._publish(s.t, estimate, s.dropped)

    def _publish(self, t: int, e: Estimate, dropped: tuple[int, ...]) -> None:
        self._estimate(messages.estimate(t, e.state, e.pose_covariance, e.twist_covariance))
        self._inner(encode_state(t, e, dropped))
        self._broadcast(t, e.state)
        if t >= self._next_report:
            self._next_report = (t // _REPORT_EVERY + 1) * _REPORT_EVERY
            self._report(t, e, dropped)

    def _report(self, t: int, e: Estimate, dropped: tuple[int, ...]) -> None:
        """Publish the status of the estimator and of each sensor on ``/diagnostics``."""
        counts = e.health.not_finite + dropped
        new = tuple(now - before for now, before in zip(counts, self._reported, strict=True))
        self._reported = counts
        level, line, numbers = diagnostic_status(
            e.status, e.height, (e.sonar_refused, e.flow_refused, e.barometer_refused),
            e.invalid_samples + sum(dropped), e.health, new[:5], new[5:],
            tilt_deviation(e.pose_covariance))
        self._diagnostics(diagnostics.report(
            t, self.get_name(), diagnostics.LEVELS[level], line, numbers))

    def _broadcast(self, t: int, state: rigid_body.State) -> None:
        if t % _TF_EVERY:
            return
        transforms = [_transform(t, messages.ODOM, messages.BASE, state)]
        if self.params.map_to_odom:
            transforms.append(_transform(t, messages.MAP, messages.ODOM, None))
        self._tf(cdr.serialize(TFMessage(transforms=transforms)))


def encode_state(t: int, e: Estimate, dropped: tuple[int, ...]) -> bytes:
    """Serialise ``EstimatorState`` of one estimate and what the synchroniser dropped."""
    return messages.estimator_state(
        t, e.status, e.height, e.vertical_velocity, e.gyro_bias, e.accel_bias,
        e.barometer_offset, (e.sonar_innovation, e.sonar_test_ratio),
        (e.flow_innovation[0], e.flow_innovation[1], e.flow_test_ratio),
        (e.barometer_innovation, e.barometer_test_ratio),
        (e.sonar_refused, e.flow_refused, e.barometer_refused), e.invalid_samples + sum(dropped),
        *e.health, dropped)


def main(args=None) -> None:
    """Entry point ``estimator_node``."""
    process.main(EstimatorNode, args)
