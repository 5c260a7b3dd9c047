"""ROS shell of the controller: estimate and reference of one stamp in, motor PWM out."""

from __future__ import annotations

from mambo_model import slots
from mambo_model.compiled import Held, hold, jit, set_values
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_ros import diagnostics, input_guard, messages, node, process, topics
from mambo_ros.graph.publisher_guard import PublisherGuard
from rclpy.clock import Clock, ClockType

from . import failsafe
from .failsafe import NO_REFERENCE, NO_STATE, Spread
from .parameters import ControllerNodeParams

_REPORT_EVERY = 1_000_000_000  # ns
_LOOK_EVERY = 0.05  # s
_LEVELS = (diagnostics.OK, diagnostics.WARN, *(diagnostics.ERROR,) * 3)
_NO_ESTIMATE = (NO_STATE, failsafe.EXACT)


@jit
def _step(held, state, spread, ref, phase):
    """Answer one pair; return the command, and stage, reason and phase after it."""
    dt, gains, limits, vehicle = held.values
    held.memory, command = failsafe.step(
        held.memory, state, spread, ref, phase, dt, gains, limits, vehicle)
    return command, held.memory.stage, held.memory.reason, held.memory.phase


def _check_reference(reference: tuple) -> str:
    """Return what is wrong with the numbers of a decoded reference, empty if nothing."""
    ref = reference[1]
    return input_guard.finite(
        ref.rho, ref.v, ref.a, ref.j, ref.s, ref.q, ref.omega, ref.omega_dot, (ref.f,), ref.tau)


def _nothing(t: int) -> None:
    """Do nothing: the guard of the clock knows the time."""


class ControllerNode(node.MamboNode[ControllerNodeParams]):
    """
    Controller.

    Subscribes ``estimate/odom`` (with ``estimate: map`` ``estimate/map``), ``reference`` and
    ``/clock``, which bounds the stamps of the two; answers each pair of equal stamps with
    ``motor_pwm`` and ``controller/state``. Where one of a pair is missing and the other stream is
    ``patience`` ahead, or nobody publishes the missing stream any more, the other one is answered
    without it, as :mod:`failsafe` says; after a missing reference the newest estimate, and later
    ones at once until a reference comes. A shutdown stays until the node is started again.
    """

    publishes = (topics.MOTOR_PWM, topics.CONTROLLER_STATE, topics.DIAGNOSTICS)
    subscribes = (topics.ESTIMATE, topics.LOCATED, topics.REFERENCE, topics.CLOCK)
    example = '--ros-args -p patience:=0.1'

    def __init__(self, **kwargs) -> None:
        super().__init__('controller_node', ControllerNodeParams, **kwargs)
        p = self.params
        self.stage = failsafe.FLYING
        self._patience = round(p.patience * 1e9)
        self._estimates: dict[int, tuple[State, Spread]] = {}
        self._references: dict[int, tuple] = {}
        self._last, self._told = -1, failsafe.FLYING
        self._gone = (False, False)  # nobody publishes references, estimates any more
        self._silent = False  # a reference was overdue, and none has come since
        self.compile(p)
        self.held = self._begin()
        self._pwm = self.advertise(topics.MOTOR_PWM)
        self._inner = self.advertise(topics.CONTROLLER_STATE)
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        self.allow_changes(self._next)
        self._time = self.accept(topics.CLOCK, messages.decode_clock, _nothing, prompt=False)
        bounds = {'now': self._time, 'ahead': round(p.period * 1e9), 'tolerant': True}
        odom, here = self.wire.frames(messages.ODOM, p.estimate), self.wire.frames(p.estimate)
        self._estimate = topics.LOCATED if p.estimate == 'map' else topics.ESTIMATE
        self._pulling, self._streams = False, (
            self.accept(topics.REFERENCE, messages.decode_reference, self._on_reference,
                        check=_check_reference, frames=odom, **bounds),
            self.accept(self._estimate, messages.decode_estimate, self._on_estimate,
                        check=input_guard.check_state, frames=here, **bounds))
        for guard in self._streams:
            guard.forgotten = self._forget
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # goes on when the wall clock is set back
        self.create_timer(_LOOK_EVERY, self._look, clock=steady)

    @staticmethod
    def compile(p: ControllerNodeParams) -> None:
        """Have the compiled step of a controller in memory, before time starts."""
        values = p.compiled()
        held = hold(failsafe.begin(values[1]), None, values)
        _step(held, *_NO_ESTIMATE, NO_REFERENCE, 0)
        set_values(held, values)

    def _begin(self) -> Held:
        """Return the controller at its start."""
        values = self.params.compiled()
        gains = values[1]
        self._slot = getattr(gains, 'slot', None)
        return hold(failsafe.begin(gains), None, values)

    def _next(self) -> int:
        """Return the stamp that is answered next, ns."""
        return self._last + round(self.params.period * 1e9) if self._last >= 0 else 0

    def _on_estimate(self, t: int, state: State, variances: tuple[float, ...]) -> None:
        self._pair(t, self._estimates, (state, Spread(*variances)), self._references, 0)

    def _on_reference(self, t: int, reference: Reference, phase: int) -> None:
        self._silent &= t <= self._last - self._patience
        self._pair(t, self._references, (reference, phase), self._estimates, 1)

    def _pair(self, t: int, mine: dict, value: tuple, other: dict, which: int) -> None:
        """Keep a message until its partner, of stream ``which``, is there or overdue; answer."""
        if t <= self._last or self._is_early(t):
            return
        mine[t] = value
        if t in other:
            self._answer(t)
        else:
            self._answer_alone(mine, which, t)

    def _answer_alone(self, waiting: dict, which: int, now: int) -> None:
        """Answer what waits for stream ``which`` if that is overdue once all of it is read."""
        if self._pulling or not self._overdue(waiting, which, now):
            return
        self._pulling = True  # a node that was not run for a while finds both streams full
        self._streams[which].pull()
        self._pulling = False
        due = self._overdue(waiting, which, now)
        if due and which == 0 and not self._gone[0]:  # no law is stable if it answers so late
            self._silent, due = True, [max(waiting)]
        for stamp in due:
            self._answer(stamp)

    def _overdue(self, waiting: dict, which: int, now: int) -> list[int]:
        """Return the stamps that wait for stream ``which`` no longer, in order."""
        absent = self._gone[which] or which == 0 and self._silent
        return sorted(t for t in waiting if absent or t <= now - self._patience)

    def _is_early(self, t: int) -> bool:
        """Return whether a stamp is of no flight: somebody has a clock that has not begun."""
        return (self._time.last < 0 and t > round(self.params.period * 1e9)
                and self.count_publishers(self._time.topic) > 0)

    def _forget(self, guard: PublisherGuard) -> None:
        """Begin again if a publisher has left before the flight began."""
        if self._time.last < 0:
            self._last, self.stage, self._told = -1, failsafe.FLYING, failsafe.FLYING
            self._estimates.clear()
            self._references.clear()
            self._silent = False
            self.held = self._begin()

    def _look(self) -> None:
        """See who still publishes, and answer what waits for a stream that nobody does."""
        begun = self._last >= 0  # before that, nobody may have been found yet
        self._gone = tuple(  # by the names that they were remapped to
            begun and not self.count_publishers(self.resolve_topic_name(topic.name))
            for topic in (topics.REFERENCE, self._estimate))
        for which, waiting in enumerate((self._estimates, self._references)):
            if self._gone[which] and waiting:
                self._answer_alone(waiting, which, max(waiting))

    def _answer(self, t: int) -> None:
        """Answer a stamp with what there is of it, and forget all up to it."""
        self._last = t
        estimate = self._estimates.get(t, _NO_ESTIMATE)
        reference, phase = self._references.get(t, (NO_REFERENCE, 0))
        if t >= self.changes.due:
            self.change(t)
        c, self.stage, reason, phase = _step(self.held, *estimate, reference, phase)
        if self._slot is not None:
            self.fail(slots.fault(self._slot))
        for store in (self._estimates, self._references):
            for old in [stamp for stamp in store if stamp <= t]:
                del store[old]
        self._pwm(messages.motor_pwm(t, c.pwm, c.shutdown, c.reason))
        self._inner(messages.controller_state(
            t, c.position_error, c.velocity_error, c.integral, c.integral_rate, c.virtual_input,
            c.attitude_desired, c.attitude_error, c.angular_velocity_error, c.thrust, c.torque,
            c.motor_thrust, c.saturated))
        if t % _REPORT_EVERY == 0 or self.stage != self._told:
            self._report(t, c.thrust, reason, phase)

    def _report(self, t: int, thrust: float, reason: int, phase: int) -> None:
        stage, line = failsafe.STAGES[self.stage], failsafe.describe(self.stage, reason)
        if self.stage != self._told and self.stage > failsafe.HOLDING:
            self.get_logger().warning(f't = {t * 1e-9:.3f} s: {line}')
        self._told = self.stage
        self._diagnostics(diagnostics.report(
            t, self.get_name(), _LEVELS[self.stage], line,
            {'thrust [N]': thrust, 'phase': phase, 'stage': stage}))


def main(args=None) -> None:
    """Entry point ``controller_node``."""
    process.main(ControllerNode, args)
