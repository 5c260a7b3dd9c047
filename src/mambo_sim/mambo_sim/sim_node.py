"""
ROS node of the simulator: vehicle, sensors and the clock of the graph.

``sim_node`` publishes ``/clock`` and every sensor, and advances the vehicle by one control step
of 5 ms with the motor command that answers the step. In lockstep it waits for that command as
long as it takes; in real time it paces the steps to the wall clock and keeps the last command
when none has come, until its watchdog stops the motors.
"""

from __future__ import annotations

import math
import time

from mambo_model.compiled import Held, hold, set_values
from mambo_ros import diagnostics, input_guard, messages, node, process, topics
from mambo_ros.commands import services, table
from mambo_ros.graph import links
from mambo_ros.loop import Loop

from . import lockstep, pushed, simulator
from .delays import Delays
from .faults import Outbox
from .parameters import SimNodeParams, STEP_NS

_STILL = (0.0,) * 4  # PWM


def _begin(params: SimNodeParams) -> Held:
    """Return the simulator at its start."""
    p = params.simulator
    return hold(simulator.initial_state(p), simulator.generators(p.seed), p.values())


class SimNode(node.MamboNode[SimNodeParams]):
    """
    Simulated Mambo: advances the vehicle by one step of 5 ms with each motor command.

    In lockstep it waits for the command; in real time it keeps pace with the wall clock.
    """

    publishes = (
        topics.CLOCK, topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER,
        topics.SENSOR_TICK, topics.GROUND_TRUTH, topics.DIAGNOSTICS)
    subscribes = (topics.MOTOR_PWM,)
    serves = (table.PAUSE, table.STEP)
    example = '--ros-args -p mode:=realtime -p duration:=40.0'

    def __init__(self, **kwargs) -> None:
        super().__init__('sim_node', SimNodeParams, **kwargs)
        self._tick, self._sensed_t, self.missed, self.late = 0, -STEP_NS, 0, 0
        self._pwm, self._shutdown, self._answered = _STILL, False, -1
        self._last_command = time.monotonic()  # s of wall time
        self._limit, self.drones = lockstep.Limit(self), (self,)  # those that it steps
        self.sensed, self.delays = 0.0, Delays()  # s, newest IMU sample; from it to the command
        self.starved = -1  # ns, when the watchdog stopped the motors; -1: it has not
        self._starved_after = 0.0  # s of wall time without a motor command
        self._clock_output = self.advertise(topics.CLOCK)
        self._imu, self._sonar, self._flow, self._barometer = self._streams = tuple(
            Outbox(self.advertise(topic)) for topic in (
                topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER))
        self._truth, self._watermark, self._diagnostics = map(self.advertise, (
            topics.GROUND_TRUTH, topics.SENSOR_TICK, topics.DIAGNOSTICS))
        self.commands = self.accept(
            topics.MOTOR_PWM, messages.decode_motor_pwm, self._on_pwm, now=lambda: self.t,
            check=input_guard.check_pwm)
        self.links = links.Links(
            self, self.params.wait_for, self.params.wait_for_publishers)
        self.pause = lockstep.Pause(self.params.paused, self.params.duration)
        services.Services(self).offer(
            (table.PAUSE, lambda request: (True, self.pause.set(request.data))),
            (table.STEP, lambda request: self.pause.step(request.steps, self.t)))
        self.warm_up(None)
        self.allow_changes(lambda: self._sensed_t + STEP_NS)

    def renew(self) -> None:
        """Take what messages need of the parameters as they are now."""
        p, f = self.params.simulator, self.params.simulator.faults
        self._variances = tuple(tuple(sigma * sigma for sigma in noise) for noise in (
            p.imu.gyro_noise, p.imu.accel_noise))
        for stream, fault in zip(
                self._streams, (f.imu, f.sonar, f.optical_flow, f.barometer), strict=True):
            stream.delay = fault.delay_ticks()

    @staticmethod
    def compile(p: SimNodeParams, push: float | None = None) -> None:
        """Have the compiled steps in memory before time starts; push: see `sense`."""
        held = _begin(p)
        set_values(held, p.compiled())
        pushed.sense_held(held, 0, push)
        pushed.advance_held(held, _STILL, False, push)

    def warm_up(self, push: float | None) -> None:
        """Compile, and begin; push: see `sense`."""
        self.compile(self.params, push)
        self.held = _begin(self.params)

    def _on_pwm(self, t: int, pwm: tuple, shutdown: bool) -> None:
        self._answered, self._pwm, self._shutdown = t, _STILL if shutdown else pwm, shutdown
        self._last_command = time.monotonic()
        self._limit.look(t, self._pwm)
        if t == self.t and self.sensed:  # not a command from before the first sample
            self.delays.add(self._last_command - self.sensed)

    @property
    def t(self) -> int:
        """Return the flight time of the current step in ns."""
        return self._tick * STEP_NS

    @property
    def answered(self) -> bool:
        """Return whether the motor command of the current step has arrived."""
        return self._answered >= self.t

    def sense(self, push: float | None = None) -> None:
        """Publish clock, sensors, watermark and truth; push: N along b3 in this step, or None."""
        t = self._sensed_t = self.t
        if t >= self.changes.due:
            self.change(t)
        s, body = pushed.sense_held(self.held, self._tick, push)
        p = self.params.simulator
        self._clock_output(messages.clock(t))
        for stream in self._streams:
            stream.catch_up(self._tick)
        self.sensed = time.monotonic()
        self._imu.put(self._tick, messages.imu(
            t, s.gyro, s.accel, *self._variances), s.deliveries.imu)
        if s.sonar_new:
            self._sonar.put(self._tick, messages.sonar(
                t, s.sonar, p.sonar.min_range, p.sonar.max_range, 2.0 * p.sonar.max_tilt),
                s.deliveries.sonar)
        if s.flow_new:
            self._flow.put(
                self._tick, messages.optical_flow(t, s.flow, s.flow_quality), s.deliveries.flow)
        if s.baro_new:
            noise = p.barometer.noise
            self._barometer.put(self._tick, messages.pressure(
                t, s.pressure, noise * noise), s.deliveries.barometer)
        self._watermark(messages.sensor_tick(t, *(stream.count for stream in self._streams)))
        self._truth(messages.ground_truth(t, body))
        if t % 1_000_000_000 == 0:
            self._report(t)

    def _starve(self, seconds: float) -> None:
        """Stop the motors for good after so many s of wall time without a motor command."""
        if self.starved < 0:
            self.starved, self._starved_after = self.t, seconds

    def _report(self, t: int) -> None:
        level, line = lockstep.status(self.missed, self.starved, self._starved_after)
        self._diagnostics(diagnostics.report(
            t, self.get_name(), diagnostics.LEVELS[level], line,
            lockstep.numbers(self.params.mode, self._tick, self.missed, self.delays)))

    def watch(self, now: float, speed: float) -> None:
        """Stop motors that turn and lack commands, for good; now: s of time.monotonic."""
        limit = self.params.motor_timeout / min(speed, 1.0)  # of flight time in slow motion
        turning = not self._shutdown and any(x > 0.0 for x in self._pwm)
        if self.starved < 0 and turning and 0.0 < limit < now - self._last_command:
            self._starve(limit)
            self.get_logger().error(
                f'no motor_pwm for {limit:g} s: motors stopped at t = {self.t * 1e-9:.3f} s')
            self._report(self.t)

    def start(self, away: float = math.inf) -> None:
        """Start to wait for motor commands, or wait for so many s of wall time more."""
        self._last_command = min(self._last_command + away, time.monotonic())

    def is_deserted(self, now: float) -> bool:
        """Return whether no motor command came for the patience, at a wall time in s."""
        return now - self._last_command > self.params.patience

    def give_up(self) -> None:
        """Stop the motors for good, because the command of this step is missing."""
        self._starve(self.params.patience)
        refused = ', '.join(f'{n} {reason}' for reason, n in sorted(self.commands.refused.items()))
        self.get_logger().error(
            f'no motor_pwm for t = {self.t * 1e-9:.3f} s within {self.params.patience:g} s: '
            f"motors stopped{f'; refused: {refused}' if refused else ''}")
        self._report(self.t)

    def advance(self, push: float | None = None, stop: bool = False) -> None:
        """Move the vehicle to the next step with the newest motor command, or stopped motors."""
        stop = stop or self._shutdown or self.starved >= 0
        pushed.advance_held(self.held, self._pwm, stop, push)
        self._tick += 1


def fly(sim: SimNode, loop: Loop) -> int:
    """Run the simulation to its end or until stopped; return the exit code."""
    if not sim.links.wait(loop, sim.params.start_patience):
        return 0 if loop.stopping else 1
    if not sim.links.alone(topics.CLOCK):
        return 1
    return lockstep.run(sim, loop)


def main(args=None) -> None:
    """Entry point ``sim_node``."""
    process.main(SimNode, args, fly)
