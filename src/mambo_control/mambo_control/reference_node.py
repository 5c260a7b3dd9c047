"""ROS shell of the flight plan: clock in, feasible reference (3.14) out; commands, if enabled."""

from __future__ import annotations

from typing import Any

from mambo_model.compiled import Held, hold, hold_again, jit
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flatness import Reference
from mambo_model.motion.flight_command import FlightCommand
from mambo_ros import diagnostics, input_guard, messages, node, process, topics
from mambo_ros.commands import joy_message, table
from mambo_ros.commands.command_message import encode
from mambo_ros.commands.services import seconds, Services

from .commanded import evaluation
from .commanded.commander import Commander
from .commanded.script import STEP_NS
from .commanded.streams import from_wire, Joystick, rehearse, Setpoints
from .parameters import ReferenceNodeParams

_AHEAD = 100_000_000  # ns, by which a setpoint may be ahead of the flight
_REPORT_EVERY = 200_000_000  # ns of flight time between reports of refused commands


@jit
def _step(held, t):
    """Return the reference at t in s and the phase."""
    plan, vv = held.values
    return evaluation.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity)


def _begin(p: ReferenceNodeParams) -> Held:
    """Return the plan, or the script, and the vehicle."""
    return hold(None, None, (p.flown(), p.vehicle.values()))


def _check_setpoint(setpoint: tuple) -> str:
    """Return what is wrong with the numbers of a decoded setpoint, empty if nothing."""
    ref = setpoint[1]
    return input_guard.finite(ref.rho, ref.v, ref.a, ref.j, ref.s, ref.q, ref.omega)


class ReferenceNode(node.MamboNode[ReferenceNodeParams]):
    """
    Reference generator: subscribes ``/clock``, publishes ``reference`` with the same stamp.

    With ``commands.enabled`` the reference is made by commands: the script's, those of the
    services, of ``joy`` and of ``setpoint``. Every accepted one is published on ``command``. After
    a shutdown on ``motor_pwm`` those that come are refused.
    """

    publishes = (topics.REFERENCE, topics.COMMAND, topics.DIAGNOSTICS)
    subscribes = (topics.CLOCK, topics.JOY, topics.SETPOINT, topics.MOTOR_PWM)
    serves = table.REFERENCE
    example = '--ros-args -p plan.trajectory:=circle'

    def __init__(self, **kwargs) -> None:
        super().__init__('reference_node', ReferenceNodeParams, **kwargs)
        p = self.params
        self._vehicle = p.vehicle.values()
        self._held = _begin(p)
        self._commander: Commander | None = None
        self._dropped: list[str] = []  # commands of the script that were refused in flight
        self._reference = self.advertise(topics.REFERENCE)
        self._evaluate(0)  # have the compiled step in memory before time starts
        clock = self.accept(topics.CLOCK, messages.decode_clock, self._on_clock)
        if p.commands.enabled:
            self._open(clock)

    @staticmethod
    def compile(p: ReferenceNodeParams) -> None:
        """Have the compiled step of a flight plan in memory before time starts."""
        _step(_begin(p), 0.0)

    def _open(self, clock: input_guard.InputGuard) -> None:
        """Accept commands."""
        p, self._commander = self.params.commands, Commander(
            self.params.commands, self.params.vehicle)
        rehearse(p, self.params.vehicle)
        self._renew()
        self._command = self.advertise(topics.COMMAND)
        self._diagnostics, self._reported = self.advertise(topics.DIAGNOSTICS), 0
        joystick = Joystick(self._commander, p, self._give)
        self.accept(topics.JOY, joy_message.decode, lambda t, *sticks: joystick.take(*sticks),
                    prompt=False, reliable=False, timed=False)
        setpoints = Setpoints(self._commander, p, self._give)

        def on_setpoint(t: int, ref: Reference, _: int) -> None:
            guard.refused.update(setpoints.take(t, ref))

        guard = self.accept(topics.SETPOINT, messages.decode_reference, on_setpoint, now=clock,
                            ahead=_AHEAD, check=_check_setpoint,
                            frames=self.wire.frames(messages.ODOM))
        self.accept(topics.MOTOR_PWM, messages.decode_motor_state, self._on_pwm, prompt=False,
                    now=clock, ahead=STEP_NS)
        made = {
            table.TAKEOFF: lambda r: FlightCommand(
                0, fc.TAKEOFF, duration=seconds(r.duration), height=r.height),
            table.LAND: lambda r: FlightCommand(
                0, fc.LAND, duration=seconds(r.duration), height=r.height),
            table.GO_TO: _go_to, table.START_TRAJECTORY: _follow,
            table.STOP: lambda r: FlightCommand(0, fc.STOP)}
        Services(self).offer(*(
            (service, lambda request, make=make: self._answer(make(request)))
            for service, make in made.items()))

    def _on_pwm(self, t: int, shutdown: bool, reason: int) -> None:
        self._commander.shut_down, self._commander.failing = shutdown, reason != 0

    def _answer(self, command: FlightCommand) -> tuple[bool, str]:
        """Carry out the command of a service; return success and message of its response."""
        at = self._commander.next_step
        reason = self._give(command)
        return not reason, reason or f'from t = {at * 1e-9:.3f} s'

    def _give(self, command: FlightCommand) -> str:
        """Carry out a command at the next step; return why it is refused, empty: it is not."""
        given, reason = self._commander.give(command)
        self._publish_command(given, reason)
        return reason

    def _publish_command(self, command: FlightCommand, reason: str) -> None:
        what = f't = {command.t * 1e-9:.3f} s: {fc.NAMES[command.kind]}'
        if not reason:
            self._renew()
            self._command(encode(command))
            if command.kind not in fc.STREAMED:
                self.get_logger().info(what)
        elif command.t >= self._reported:
            self._reported = command.t + _REPORT_EVERY
            self.get_logger().warning(f'{what} refused: {reason}')
            self._diagnostics(diagnostics.report(
                command.t, f'{self.get_name()}: commands', diagnostics.WARN,
                f'{fc.NAMES[command.kind]} refused: {reason}', dict(self._commander.refused)))

    def _renew(self) -> None:
        """Let the compiled step follow the newest timeline."""
        hold_again(self._held, None, None, (
            evaluation.values(self._commander.timeline), self._vehicle))

    def _on_clock(self, t: int) -> None:
        if self._commander is not None:
            for command, reason in self._commander.advance(t):
                self._publish_command(command, reason)
                if reason:
                    self._dropped.append(
                        f'{fc.NAMES[command.kind]} at t = {command.t * 1e-9:g} s: {reason}')
        self._reference(messages.reference(t, *self._evaluate(t)))

    def finish(self) -> None:
        """Say which commands of the scenario were not carried out."""
        if count := len(self._dropped):
            self.get_logger().warning(f'{count} command{"s" * (count > 1)} of the scenario '
                                      f'refused in flight, first {self._dropped[0]}')

    def _evaluate(self, t: int) -> tuple[Reference, int]:
        return _step(self._held, t * 1e-9)


def _go_to(request: Any) -> FlightCommand:
    """Return the command of a GoTo request."""
    goal = request.goal
    position, yaw = from_wire((goal.x, goal.y, goal.z), request.yaw)
    return FlightCommand(0, fc.GO_TO, request.relative, seconds(request.duration),
                         position=position, yaw=yaw)


def _follow(request: Any) -> FlightCommand:
    """Return the command of a StartTrajectory request."""
    return FlightCommand(0, fc.FOLLOW, request.relative, seconds(request.duration),
                         timescale=request.timescale or 1.0, trajectory=request.trajectory)


def main(args=None) -> None:
    """Entry point ``reference_node``."""
    process.main(ReferenceNode, args)
