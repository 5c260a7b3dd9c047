"""
The vehicle, its sensors and the time of the graph.

``sim_node`` publishes ``/clock`` and every sensor, and advances the vehicle by one control step
of 5 ms with the motor command that answers the step. In lockstep it waits for that command as
long as it takes; in real time it paces the steps to the wall clock and keeps the last command
when none has come, until its watchdog stops the motors.
"""

from __future__ import annotations

import time

from mambo_model.compiled import Held, hold, jit
from mambo_ros import diagnostics, intake, links, messages, node, topics

from . import simulator
from .delays import Delays
from .faults import FaultParams, Outbox
from .parameters import SimNodeParams, STEP_NS

LARGEST_PWM = 65_535.0  # of any vehicle; the limits of this one are its motors' own
_STILL = (0.0,) * 4  # PWM
_ASK_AGAIN = 5.0  # s of wall time after which a waiting simulator says what it waits for


def _check_pwm(command: tuple) -> str:
    """Return why a decoded motor command cannot be used, empty if it can, as any shutdown."""
    _, pwm, shutdown = command
    if shutdown:
        return ''
    within = 0.0 <= min(pwm) and max(pwm) <= LARGEST_PWM
    return intake.finite(pwm) or ('' if within else intake.OUT_OF_LIMITS)


@jit
def _sense(held, tick):
    """Read all sensors; return what they say and the true state."""
    held.memory, samples = simulator.sense(held.memory, tick, held.rng, held.values)
    return samples, held.memory.plant.body


@jit
def _advance(held, pwm, shutdown):
    """Advance the vehicle by one tick."""
    held.memory = simulator.advance(held.memory, pwm, shutdown, held.values)


class SimNode(node.MamboNode[SimNodeParams]):
    """
    Simulated Mambo.

    Publishes ``/clock``, ``imu/data_raw``, ``sonar/range``, ``optical_flow``,
    ``barometer/pressure``, ``sensor_tick``, ``ground_truth/odom`` and ``/diagnostics``;
    subscribes ``motor_pwm``.
    """

    def __init__(self, **kwargs) -> None:
        super().__init__('sim_node', SimNodeParams, **kwargs)
        p = self.params.simulator
        self._gyro_variance = tuple(sigma ** 2 for sigma in p.imu.gyro_noise)
        self._accel_variance = tuple(sigma ** 2 for sigma in p.imu.accel_noise)
        self._tick = 0
        self._pwm, self._shutdown, self._answered = _STILL, False, -1
        self._heard = time.monotonic()  # s of wall time
        self.sensed = 0.0  # s of wall time, of the newest IMU sample
        self.delays = Delays()  # from IMU sample to motor command
        self.missed = 0
        self.starved = -1  # ns, when the watchdog stopped the motors; -1: it has not
        self._starved_after = 0.0  # s of wall time without a motor command
        self._say_clock = self.say(topics.CLOCK)
        f = p.faults
        self._imu = self._outbox(topics.IMU, f.imu)
        self._sonar = self._outbox(topics.SONAR, f.sonar)
        self._flow = self._outbox(topics.OPTICAL_FLOW, f.optical_flow)
        self._barometer = self._outbox(topics.BAROMETER, f.barometer)
        self._truth = self.say(topics.GROUND_TRUTH)
        self._watermark = self.say(topics.SENSOR_TICK)
        self._diagnostics = self.say(topics.DIAGNOSTICS)
        self.commands = self.accept(
            topics.MOTOR_PWM, messages.decode_motor_pwm, self._on_pwm, now=self._time,
            check=_check_pwm)
        self.links = links.Links(self, self.params.wait_for)
        self._held = self._begin()
        _sense(self._held, 0)  # have the compiled steps in memory before time starts
        _advance(self._held, self._pwm, self._shutdown)
        self._held = self._begin()

    def _outbox(self, topic: topics.Topic, fault: FaultParams) -> Outbox:
        return Outbox(self.say(topic), fault.values().delay)

    def _begin(self) -> Held:
        """Return the simulator at its start."""
        p = self.params.simulator
        return hold(simulator.initial_state(p), simulator.generators(p.seed), p.values())

    def _on_pwm(self, t: int, pwm: tuple, shutdown: bool) -> None:
        self._answered, self._pwm, self._shutdown = t, _STILL if shutdown else pwm, shutdown
        self._heard = time.monotonic()
        if t == self.t:
            self.delays.add(self._heard - self.sensed)

    def _time(self) -> int:
        return self.t

    @property
    def t(self) -> int:
        """Return the flight time of the current step in ns."""
        return self._tick * STEP_NS

    @property
    def answered(self) -> bool:
        """Return whether the motor command of the current step has come."""
        return self._answered >= self.t

    def sense(self) -> None:
        """Publish the clock, every sensor that is due, the watermark and the truth."""
        t = self.t
        s, body = _sense(self._held, self._tick)
        p = self.params.simulator
        self._say_clock(messages.clock(t))
        streams = (self._imu, self._sonar, self._flow, self._barometer)
        for stream in streams:
            stream.catch_up(self._tick)
        self.sensed = time.monotonic()
        self._imu.put(self._tick, messages.imu(
            t, s.gyro, s.accel, self._gyro_variance, self._accel_variance), s.fates.imu)
        if s.sonar_new:
            self._sonar.put(self._tick, messages.sonar(
                t, s.sonar, p.sonar.min_range, p.sonar.max_range, 2.0 * p.sonar.max_tilt),
                s.fates.sonar)
        if s.flow_new:
            self._flow.put(
                self._tick, messages.optical_flow(t, s.flow, s.flow_quality), s.fates.flow)
        if s.baro_new:
            self._barometer.put(
                self._tick, messages.pressure(t, s.pressure, p.barometer.noise ** 2),
                s.fates.barometer)
        self._watermark(messages.sensor_tick(t, *(stream.count for stream in streams)))
        self._truth(messages.ground_truth(t, body))
        if t % 1_000_000_000 == 0:
            self._report(t)

    def _starve(self, seconds: float) -> None:
        """Stop the motors for good after so many s of wall time without a motor command."""
        if self.starved < 0:
            self.starved, self._starved_after = self.t, seconds

    def _report(self, t: int) -> None:
        level, line = diagnostics.OK, 'flying'
        if self.missed:
            level, line = diagnostics.WARN, f'{self.missed} steps without their motor command'
        if self.starved >= 0:
            level, line = diagnostics.ERROR, (
                f'motors stopped at t = {self.starved * 1e-9:.3f} s: no motor command for '
                f'{self._starved_after:g} s')
        numbers = {'mode': self.params.mode, 'steps': self._tick, 'missed': self.missed}
        if self.params.mode == 'realtime':  # a wall time has no place in a repeatable flight
            numbers |= {f'IMU to motor command, {name} [ms]': value
                        for name, value in self.delays.values().items()}
        self._diagnostics(diagnostics.report(t, self.get_name(), level, line, numbers))

    def watch(self, now: float) -> None:
        """
        Stop the motors for good when they turn and no command has come for too long.

        Parameters
        ----------
        now : s
            Wall time, of ``time.monotonic``.

        """
        limit, silent = self.params.motor_timeout, now - self._heard
        turning = not self._shutdown and any(x > 0.0 for x in self._pwm)
        if self.starved < 0 and turning and 0.0 < limit < silent:
            self._starve(limit)
            self.get_logger().error(
                f'no motor_pwm for {limit:g} s: motors stopped at t = {self.t * 1e-9:.3f} s')
            self._report(self.t)

    def start(self) -> None:
        """Begin to wait for motor commands."""
        self._heard = time.monotonic()

    def is_deserted(self, now: float) -> bool:
        """Return whether no motor command came for the patience, at a wall time in s."""
        return now - self._heard > self.params.patience

    def give_up(self) -> None:
        """Stop the motors for good: the command of this step has not come."""
        self._starve(self.params.patience)
        refused = ', '.join(
            f'{count} {reason}' for reason, count in sorted(self.commands.refused.items()))
        self.get_logger().error(
            f'no motor_pwm for t = {self.t * 1e-9:.3f} s within {self.params.patience:g} s: '
            f"motors stopped{f'; refused: {refused}' if refused else ''}")
        self._report(self.t)

    def advance(self) -> None:
        """Move the vehicle to the next step with the newest motor command."""
        stop = self._shutdown or self.starved >= 0
        _advance(self._held, self._pwm, stop)
        self._tick += 1


def _wait_for_answer(sim: SimNode, loop: node.Loop) -> bool:
    """Serve the graph until the step's motor command is there (lockstep)."""
    began = said = time.monotonic()
    while not sim.answered:
        loop.once(0.02)
        now = time.monotonic()  # whatever came: what is refused may come without end
        if loop.stopping:
            return False
        if now - began > sim.params.patience and not sim.answered:
            sim.give_up()
            return False
        if now - said > _ASK_AGAIN:
            said = now
            sim.get_logger().warning(f'waiting for motor_pwm of t = {sim.t * 1e-9:.3f} s')
    return True


def _wait_for_deadline(sim: SimNode, loop: node.Loop, deadline: float) -> None:
    """
    Serve the graph until the wall clock reaches the next step (real time).

    A step that began late, as the machine was busy elsewhere, still leaves its period for the
    answer; once that has come it makes up for the delay.
    """
    overdue = max(deadline, sim.sensed + STEP_NS * 1e-9 / sim.params.speed)
    while not loop.stopping:
        left = (deadline if sim.answered else overdue) - time.monotonic()
        if left <= 0.0:
            break
        loop.once(left)
    if not sim.answered:
        loop.once(0.0)
    if not sim.answered:
        sim.missed += 1
        sim.watch(time.monotonic())


def fly(sim: SimNode, loop: node.Loop) -> int:
    """Run the simulation to its end or until stopped; return the exit code."""
    if not sim.links.wait(loop, sim.params.start_patience):
        return 0 if loop.stopping else 1
    if not sim.links.alone(topics.CLOCK):
        return 1
    p, log = sim.params, sim.get_logger()
    log.info(f'flying in {p.mode} mode')  # the first line takes ten times as long as a step
    end = round(p.duration * 1e9) if p.duration else None
    began = said = time.monotonic()
    sim.start()
    lockstep = p.mode == 'lockstep'
    while not loop.stopping:
        sim.sense()
        if lockstep:
            if not _wait_for_answer(sim, loop):
                break
        else:
            _wait_for_deadline(sim, loop, began + (sim.t + STEP_NS) * 1e-9 / p.speed)
        now = time.monotonic()
        if now - said > 1.0:
            said = now
            log.info(f't = {sim.t * 1e-9:.2f} s')
        if end is not None and (sim.t >= end or not lockstep and sim.is_deserted(now)):
            if sim.t < end:
                sim.give_up()
            break
        sim.advance()
    took = time.monotonic() - began
    log.info(f'flew {sim.t * 1e-9:.3f} s in {took:.3f} s of wall time, '
             f'{sim.missed} steps without their motor command')
    delay = ', '.join(f'{name} {value} ms' for name, value in sim.delays.values().items())
    log.info(f'IMU sample to motor command: {delay} of {sim.delays.count} steps')
    return 0 if loop.stopping or end is None or sim.t >= end else 1


def main(args=None) -> None:
    """Entry point ``sim_node``."""
    node.main(SimNode, args, fly)
