"""The task of an agent: its parameters, and the channels of actions and observations."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import cos
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters, values_type
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim.parameters import STEP_NS

from ..scenario import LONGEST

STATE = ('x', 'y', 'z', 'u', 'v', 'w', 'qw', 'qx', 'qy', 'qz', 'p', 'q', 'r')
"""Columns of a state: position m, NED; velocity m/s, body; quaternion; rates rad/s, body."""

OBSERVATIONS = ('truth', 'estimate')
ACTIONS = ('pwm', 'attitude_thrust', 'setpoint')
PWM, ATTITUDE_THRUST, SETPOINT, PLAN = range(4)
"""Kinds of commands for compiled code; PLAN: the scenario's controller flies."""

_JUDGED = 'of the reward (judgement)'


class Channel(NamedTuple):
    """One number of an action or an observation."""

    name: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class TaskParams(Parameters):
    """
    Parameters of the task: handover to the agent, end of an episode, and reward.

    Rewards are per second of flight: a step of ``repeat`` control steps earns as much as
    ``repeat`` steps of one. They are computed from the true state.
    """

    handover: float = quantity(
        5.0, 's', 0.0, 600.0, 'until then the controller of the scenario flies; 5: after the '
        'take-off of every built-in trajectory')
    episode: float = quantity(
        10.0, 's', STEP_NS * 1e-9, LONGEST, 'length after the handover (judgement)')
    repeat: int = quantity(
        1, 'control steps of 5 ms', 1, 200, 'for which an action is held (judgement)')
    target_spread: float = quantity(
        0.5, 'm', 0.0, 10.0, 'hover: the target is within this of the hover point along each '
        'axis (judgement)')
    position_limit: float = quantity(
        2.0, 'm', 0.01, 100.0, 'an episode ends farther from its reference (judgement)')
    tilt_limit: float = quantity(
        1.2, 'rad', 0.01, math.pi, 'an episode ends beyond; pi: never (judgement)')
    alive: float = quantity(2.0, '1/s', -1e3, 1e3, 'reward of flying ' + _JUDGED)
    position: float = quantity(1.0, '1/(m s)', 0.0, 1e3, 'cost of distance ' + _JUDGED)
    velocity: float = quantity(0.2, '1/m', 0.0, 1e3, 'cost of relative speed ' + _JUDGED)
    yaw: float = quantity(0.1, '1/(rad s)', 0.0, 1e3, 'cost of the error of yaw ' + _JUDGED)
    rate: float = quantity(0.05, '1/rad', 0.0, 1e3, 'cost of body rate ' + _JUDGED)
    change: float = quantity(
        1.0, '1/s', 0.0, 1e4, 'cost of the mean square change of PWM in a control step, in '
        'parts of its range ' + _JUDGED)
    crash: float = quantity(5.0, '1', 0.0, 1e6, 'cost of an end by a limit ' + _JUDGED)

    @derived('-', 'tilt_limit')
    def tilt_cosine(self) -> float:
        """Cosine of the largest tilt."""
        return cos(self.tilt_limit)

    def ticks(self, seconds: float) -> int:
        """Return the number of control steps in a time in s."""
        return round(seconds * 1e9 / STEP_NS)


TaskValues = values_type(TaskParams, without=('handover', 'episode', 'repeat', 'target_spread'))

OBSERVED = (
    *(Channel(name, 'm', -1000.0, 1000.0) for name in STATE[0:3]),
    *(Channel(name, 'm/s', -100.0, 100.0) for name in STATE[3:6]),
    *(Channel(name, '1', -1.001, 1.001) for name in STATE[6:10]),
    *(Channel(name, 'rad/s', -1000.0, 1000.0) for name in STATE[10:13]),
    *(Channel(f'error_{axis}', 'm', -1000.0, 1000.0) for axis in 'xyz'),
    *(Channel(f'error_v{axis}', 'm/s', -200.0, 200.0) for axis in 'xyz'),
    *(Channel(f'reference_a{axis}', 'm/s^2', -100.0, 100.0) for axis in 'xyz'))
"""
Channels of an observation: the state, true or estimated, in the order of :data:`STATE`; reference
minus state in position and velocity, inertial NED; acceleration of the reference, inertial NED.
"""


def commanded(action: str, vehicle: Vehicle) -> tuple[Channel, ...]:
    """
    Return the channels of an action of one kind.

    Parameters
    ----------
    action
        One of :data:`ACTIONS`: ``pwm`` of the four motors; ``attitude_thrust`` for the inner loop
        (3.25)-(3.29) of the cascaded controller; ``setpoint``, which moves the reference of the
        scenario's controller, inertial NED.
    vehicle
        Vehicle model of the controller.

    """
    if action == 'pwm':
        return tuple(Channel(f'motor_{i}', 'PWM', 0.0, vehicle.pwm_max) for i in (1, 2, 3, 4))
    if action == 'setpoint':
        return tuple(Channel(f'shift_{axis}', 'm', -1.0, 1.0) for axis in 'xyz')
    return (*(Channel(name, 'rad', -1.0, 1.0) for name in ('roll', 'pitch')),
            Channel('yaw', 'rad', -math.pi, math.pi),
            Channel('thrust', 'N', 0.0, 2.0 * vehicle.mass * vehicle.gravity))
