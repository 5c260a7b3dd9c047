"""ROS shell of the estimator: sensor messages in, filter step, odometry out."""

from __future__ import annotations

from collections.abc import Callable

from mambo_model import slots
from mambo_model.compiled import Held, hold, jit, set_values
from mambo_model.motion.rigid_body import State
from mambo_ros import diagnostics, input_guard, messages, node, process, topics, transforms

from . import filters
from .capture import report as capture_report
from .capture.aided import Located
from .capture.frames import odom_in_map
from .capture.pose_queue import PoseQueue, SeenPose
from .estimate import diagnostic_status, Estimate, tilt_deviation
from .parameters import EstimatorNodeParams
from .synchroniser import Step, Synchroniser

_STEP, _TF_EVERY, _REPORT_EVERY = 5_000_000, 20_000_000, 1_000_000_000  # ns
_STREAMS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)
_Counts = tuple[int, ...]
_ZERO3, _ZERO36 = (0.0,) * 3, (0.0,) * 36


@jit
def _step(held, dt, gyro, accel, sonar, flow, flow_quality, pressure):
    """Take the samples of one step; return the estimate."""
    held.memory, estimate = filters.step(
        held.memory, dt, gyro, accel, sonar, flow, flow_quality, pressure, held.values)
    return estimate, filters.located(held.memory, estimate)


@jit
def _offer(held, age, rho, q):
    """Give the next step a pose."""
    held.memory = filters.offer(held.memory, age, rho, q)


class EstimatorNode(node.MamboNode[EstimatorNodeParams]):
    """
    State estimator.

    Subscribes ``imu/data_raw``, ``sonar/range``, ``optical_flow``, ``barometer/pressure`` and
    ``sensor_tick`` (or ``ground_truth/odom`` alone where that is the estimator); publishes
    ``estimate/odom``, ``estimator/state``, ``/tf`` and ``/diagnostics``. With motion capture it
    subscribes ``optitrack/pose`` and ``optitrack/tick`` as well, and publishes ``estimate/map``.
    """

    publishes = (
        topics.ESTIMATE, topics.LOCATED, topics.ESTIMATOR_STATE, topics.TF, topics.DIAGNOSTICS)
    subscribes = (
        *_STREAMS, topics.SENSOR_TICK, topics.GROUND_TRUTH, topics.OPTITRACK, topics.CAPTURE_TICK)
    example = '--ros-args -p estimator:=joint -p sensor_reliability:=best_effort'

    def __init__(self, **kwargs) -> None:
        super().__init__('estimator_node', EstimatorNodeParams, **kwargs)
        self._reliable = self.params.sensor_reliability == 'reliable'
        p = self.params
        self._estimate, self._tf = map(self.advertise, (topics.ESTIMATE, topics.TF))
        if p.estimator == 'ground_truth':
            self.accept(
                topics.GROUND_TRUTH, messages.decode_odometry, self._on_truth,
                check=input_guard.check_state)
            return
        self.compile(p)
        self.held = self._begin()
        watermark = p.synchronise == 'watermark'
        sync = self._sync = Synchroniser(watermark)
        self._next_report, self._reported, self._last = 0, (0,) * 9, -_STEP
        self._inner, self._diagnostics = map(
            self.advertise, (topics.ESTIMATOR_STATE, topics.DIAGNOSTICS))
        self.allow_changes(lambda: self._last + _STEP)
        self._poses = self._subscribe_poses(watermark) if p.aided else None
        self._subscribe_sensor(topics.SONAR, messages.decode_sonar, sync.add_sonar)
        self._subscribe_sensor(topics.OPTICAL_FLOW, messages.decode_optical_flow, sync.add_flow)
        self._subscribe_sensor(topics.BAROMETER, messages.decode_pressure, sync.add_pressure)
        if not watermark:  # the inertial samples are the clock
            self.accept(topics.IMU, messages.decode_imu, self._adder(sync.add_imu),
                        reliable=self._reliable)
            return
        self._subscribe_sensor(topics.IMU, messages.decode_imu, sync.add_imu)
        # the last message of a step, which completes it
        sync.pull = self.accept(
            topics.SENSOR_TICK, messages.decode_sensor_tick, self._adder(sync.add_tick)).newest

    @staticmethod
    def compile(p: EstimatorNodeParams) -> None:
        """Have the compiled step of an estimator in memory, before time starts."""
        values = p.compiled()
        held = hold(filters.initial(values), None, values)
        if p.aided:
            _offer(held, 0.0, _ZERO3, (1.0, *_ZERO3))
        _step(held, 0.0, _ZERO3, _ZERO3, 0.0, _ZERO3[:2], 0, 0.0)
        set_values(held, values)

    def _begin(self) -> Held:
        """Return the estimator at its start."""
        values = self.params.compiled()
        self._slot = getattr(values, 'slot', None)
        return hold(filters.initial(values), None, values)

    def _adder(self, add: Callable) -> Callable:
        """Return the callback of a sensor, which runs the steps that a message completes."""
        return lambda *sample: self._run(add(*sample))

    def _subscribe_sensor(self, topic: topics.Topic, decode: Callable, add: Callable) -> None:
        """Queue each message, late, repeated or unreadable: what sorts and checks is behind."""
        stream = _STREAMS.index(topic)
        guard = self.accept(topic, decode, self._adder(add), prompt=False, reliable=self._reliable,
                            timed=False, lost=lambda: self._run(self._sync.skip(stream)))
        guard.forgotten = lambda _: self._sync.forget(stream)

    def _taker(self, add: Callable) -> Callable:
        """Return the same for a message of the motion capture."""
        return lambda *sample: self._take(add(*sample))

    def _subscribe_poses(self, watermark: bool) -> PoseQueue:
        """Subscribe to the motion capture; return what pairs its poses with the steps."""
        poses = PoseQueue(watermark)
        self._located = self.advertise(topics.LOCATED)
        self.accept(
            topics.OPTITRACK, messages.decode_pose, self._taker(poses.add_pose), prompt=False,
            reliable=self._reliable, timed=False, lost=self._taker(poses.skip))
        if watermark:
            poses.pull = self.accept(
                topics.CAPTURE_TICK, messages.decode_capture_tick,
                self._taker(poses.add_tick)).newest
        return poses

    def _on_truth(self, t: int, state: State) -> None:
        self._estimate(messages.estimate(t, state, _ZERO36, _ZERO36))
        self._broadcast(t, state)

    def _run(self, steps: list[Step]) -> None:
        poses = self._poses
        self._take([(s, None) for s in steps] if poses is None else poses.add_steps(steps))

    def _take(self, steps: list[tuple[Step, SeenPose | None]]) -> None:
        """Take steps with their poses, and publish what they say."""
        for s, pose in steps:
            self._last = s.t
            if s.t >= self.changes.due:
                self.change(s.t)
            if pose is not None:
                _offer(self.held, (s.t - pose.t) * 1e-9, pose.rho, pose.q)
            estimate, located = _step(
                self.held, s.dt, s.gyro, s.accel, s.sonar, s.flow, s.flow_quality, s.pressure)
            if self._slot is not None:
                self.fail(slots.fault(self._slot))
            if s.last:
                self._publish(s.t, estimate, located, s.dropped)

    def _publish(self, t: int, e: Estimate, located: Located | None, dropped: _Counts) -> None:
        self._estimate(messages.estimate(t, e.state, e.pose_covariance, e.twist_covariance))
        anchor = None
        if located is not None:
            self._located(messages.located(
                t, located.state, located.pose_covariance, located.twist_covariance))
            anchor = odom_in_map(located.capture.anchor)
        self._inner(messages.estimator_state(
            t, e.status, e.height, e.vertical_velocity, e.gyro_bias, e.accel_bias,
            e.barometer_offset, (e.sonar_innovation, e.sonar_test_ratio),
            (*e.flow_innovation, e.flow_test_ratio),
            (e.barometer_innovation, e.barometer_test_ratio),
            (e.sonar_refused, e.flow_refused, e.barometer_refused),
            e.invalid_samples + sum(dropped), *e.health, dropped))
        self._broadcast(t, e.state, anchor)
        if t >= self._next_report:
            self._next_report = (t // _REPORT_EVERY + 1) * _REPORT_EVERY
            self._report(t, e, located, dropped)

    def _report(self, t: int, e: Estimate, located: Located | None, dropped: _Counts) -> None:
        """Publish the status of the estimator and of each sensor on ``/diagnostics``."""
        counts = e.health.not_finite + dropped
        new = tuple(now - before for now, before in zip(counts, self._reported, strict=True))
        self._reported = counts
        level, line, numbers = diagnostic_status(
            e.status, e.height, (e.sonar_refused, e.flow_refused, e.barometer_refused),
            e.invalid_samples + sum(dropped), e.health, new[:5], new[5:],
            tilt_deviation(e.pose_covariance))
        if located is not None:
            level, line, numbers = capture_report.added(
                (level, line, numbers), located.capture, self.params.joint.pose.max_age)
        self._diagnostics(diagnostics.report(
            t, self.get_name(), diagnostics.LEVELS[level], line, numbers))

    def _broadcast(self, t: int, state: State, anchor: State | None = None) -> None:
        if t % _TF_EVERY == 0:
            self._tf(transforms.encode(t, state, anchor, self.params.map_to_odom))


def main(args=None) -> None:
    """Entry point ``estimator_node``."""
    process.main(EstimatorNode, args)
