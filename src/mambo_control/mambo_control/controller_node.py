"""ROS shell of the controller: estimate and reference of one stamp in, motor PWM out."""

from __future__ import annotations

from mambo_model.flatness import from_flat_output
from mambo_model.rigid_body import State
from mambo_model.trajectory import GROUND
from mambo_ros import diagnostics, messages, node, topics

from . import cascaded, latch
from .parameters import ControllerNodeParams
from .safety import REASON_NONE

_KEEP = 400  # references and estimates kept while the other one is missing, 2 s
_REPORT_EVERY = 1_000_000_000  # ns
_REASONS = ('flying', 'tilt limit', 'height limit', 'estimate unusable', 'reference unusable')


class ControllerNode(node.MamboNode[ControllerNodeParams]):
    """
    Controller.

    Subscribes ``estimate/odom`` and ``reference``; answers each pair of equal stamps with
    ``motor_pwm`` and ``controller/state``. A shutdown stays until the node is started again.
    """

    def __init__(self, **kwargs) -> None:
        super().__init__('controller_node', ControllerNodeParams, **kwargs)
        p = self.params
        self._gains, self._vehicle = p.law.values(), p.vehicle.values()
        self._memory, self._reason = latch.initial(p.law), REASON_NONE
        self._states: dict[int, State] = {}
        self._references: dict[int, tuple] = {}
        self._last = -1
        self._load()
        self._pwm = self.say(topics.MOTOR_PWM)
        self._inner = self.say(topics.CONTROLLER_STATE)
        self._diagnostics = self.say(topics.DIAGNOSTICS)
        self.hear(topics.REFERENCE, self._on_reference)
        self.hear(topics.ESTIMATE, self._on_estimate)

    def _load(self) -> None:
        """Have the compiled step in memory before time starts."""
        zero, v = (0.0, 0.0, 0.0), self._vehicle
        latch.step(
            self._memory, self._reason, State(zero, zero, (1.0, 0.0, 0.0, 0.0), zero),
            from_flat_output(zero, zero, zero, zero, zero, v.mass, v.inertia, v.gravity),
            GROUND, self.params.period, self._gains, v)

    def _on_estimate(self, data: bytes) -> None:
        t, state = messages.decode_odometry(data)
        self._pair(t, self._states, state)

    def _on_reference(self, data: bytes) -> None:
        t, reference, phase = messages.decode_reference(data)
        self._pair(t, self._references, (reference, phase))

    def _pair(self, t: int, mine: dict, value) -> None:
        """Keep a message until its partner of the same stamp is there, then answer."""
        if t <= self._last:
            return
        mine[t] = value
        if t in self._states and t in self._references:
            self._last = t
            self._answer(t, self._states[t], *self._references[t])
            for store in (self._states, self._references):
                for old in [stamp for stamp in store if stamp <= t]:
                    del store[old]
        elif len(mine) > _KEEP:
            del mine[min(mine)]

    def _answer(self, t: int, state: State, reference, phase: int) -> None:
        self._memory, self._reason, c = latch.step(
            self._memory, self._reason, state, reference, phase, self.params.period, self._gains,
            self._vehicle)
        self._pwm(messages.motor_pwm(t, c.pwm, c.shutdown, c.reason))
        self._inner(encode_state(t, c))
        if t % _REPORT_EVERY == 0:
            self._diagnostics(diagnostics.report(
                t, self.get_name(), diagnostics.ERROR if c.shutdown else diagnostics.OK,
                f'motors shut down: {_REASONS[c.reason]}' if c.shutdown else _REASONS[0],
                {'thrust [N]': c.thrust, 'phase': phase}))


def encode_state(t: int, c: cascaded.Command) -> bytes:
    """Serialise ``ControllerState`` of one command."""
    return messages.controller_state(
        t, c.position_error, c.velocity_error, c.integral, c.integral_rate, c.virtual_input,
        c.attitude_desired, c.attitude_error, c.angular_velocity_error, c.thrust, c.torque,
        c.motor_thrust, c.saturated)


def main(args=None) -> None:
    """Entry point ``controller_node``."""
    node.main(ControllerNode, args)
