"""What each replaceable node owes the graph: the contract of docs/how-to/your-node.md as data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

from mambo_interfaces.msg import Reference
from mambo_model.motion.height_check import ABOVE
from mambo_model.vehicle.parameters import preset
from mambo_ros import messages, topics
from mambo_ros.topics import Topic

_UNIT = 1e-3  # by which the norm of a quaternion may differ from 1
MOTORS_STOP = (Reference.PHASE_GROUND, Reference.PHASE_LANDED)
"""Phases in which no motor turns, of a reference on the floor."""
_MOTORS = preset('identified').values()


@dataclass(frozen=True)
class Contract:
    """
    The contract of one node.

    Attributes
    ----------
    node
        Its name.
    answer
        Topic that it publishes.
    inputs
        Topics that it must hear; the last one completes what it answers.
    read
        From the bytes of an answer to its stamp in ns and what is wrong with its numbers, '' if
        nothing is.
    frames
        ``frame_id`` of the header, and ``child_frame_id`` where the message has one.
    own_rate
        Whether it publishes at a rate of its own and not once for each input.

    """

    node: str
    answer: Topic
    inputs: tuple[Topic, ...]
    read: Callable[[bytes], tuple[int, str]]
    frames: tuple[str, ...]
    own_rate: bool = False


def _finite(**parts: tuple[float, ...]) -> str:
    """Return the first part that has a number that is not finite, '' if none has."""
    for name, numbers in parts.items():
        if not all(map(math.isfinite, numbers)):
            return f'{name.replace("_", " ")} = {tuple(numbers)}, wanted finite numbers'
    return ''


def _unit(q: tuple[float, ...]) -> str:
    """Return what is wrong with an attitude, '' if it is a unit quaternion."""
    norm = math.hypot(*q)
    return '' if abs(norm - 1.0) <= _UNIT else (
        f'attitude with norm {norm:.4g}, wanted a unit quaternion')


def _read_pwm(data: bytes) -> tuple[int, str]:
    t, pwm, shutdown = messages.decode_motor_pwm(data)
    low, high = _MOTORS.pwm_min, _MOTORS.pwm_max
    if shutdown or (wrong := _finite(pwm=pwm)) == '' and all(
            x == 0.0 or low <= x <= high for x in pwm):
        return t, ''
    return t, wrong or f'pwm = {pwm}, wanted 0 or {low:g} to {high:g}'


def _read_estimate(data: bytes) -> tuple[int, str]:
    t, s, variances = messages.decode_estimate(data)
    return t, _finite(position=s.rho, velocity=s.nu, attitude=s.q, body_rate=s.omega,
                      covariance=variances) or _unit(s.q)


def _read_reference(data: bytes) -> tuple[int, str]:
    t, r, phase = messages.decode_reference(data)
    wrong = _finite(position=r.rho, velocity=r.v, acceleration=r.a, jerk=r.j, snap=r.s,
                    attitude=r.q, angular_velocity=r.omega, angular_acceleration=r.omega_dot,
                    thrust=(r.f,), torque=r.tau) or _unit(r.q)
    if not wrong and not r.f > 0.0:
        wrong = f'thrust = {r.f:g} N, wanted above 0'
    if not wrong and phase > Reference.PHASE_LANDED:
        wrong = f'phase = {phase}, wanted 0 to {Reference.PHASE_LANDED}'
    if not wrong and phase in MOTORS_STOP and -r.rho[2] > ABOVE:
        wrong = (f'phase = {phase}, in which the motors stand still, at a height of '
                 f'{-r.rho[2]:.2f} m: wanted {Reference.PHASE_TAKEOFF}, {Reference.PHASE_TRACK} '
                 f'or {Reference.PHASE_LANDING} in the air')
    return t, wrong


def _read_pose(data: bytes) -> tuple[int, str]:
    t, rho, q = messages.decode_pose(data)
    return t, _finite(position=rho, attitude=q) or _unit(q)


CONTRACTS = {c.node: c for c in (
    Contract('controller', topics.MOTOR_PWM, (topics.ESTIMATE, topics.REFERENCE), _read_pwm,
             ('',)),
    Contract('estimator', topics.ESTIMATE, (topics.SENSOR_TICK,), _read_estimate,
             (messages.ODOM, messages.BASE)),
    Contract('reference', topics.REFERENCE, (topics.CLOCK,), _read_reference, (messages.ODOM,)),
    Contract('optitrack', topics.OPTITRACK, (topics.GROUND_TRUTH,), _read_pose,
             (messages.MAP,), own_rate=True))}
BY_TOPIC = {c.answer.name: c for c in CONTRACTS.values()}
