"""
A PD controller: position error to tilt and thrust, attitude error to torque.

Fly it with ``./run --controller examples/pd_controller.py``, or in one process with
``./mambo fly fig_5_3 --controller examples/pd_controller.py -o my_bag``. Change a gain with
``--set controller_node.pd_controller.position_gain=5``.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_control.command import thrust_and_torque
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import conjugate, from_euler, multiply, rotate, to_euler
from mambo_model.schema import quantity
from mambo_model.values import Parameters

__version__ = '1.0'


@dataclass(frozen=True)
class Params(Parameters):
    """Gains; each parameter says its unit, its range and where its value comes from."""

    position_gain: float = quantity(4.0, '1/s^2', 0.0, 50.0, 'tuned in the simulator')
    velocity_gain: float = quantity(3.0, '1/s', 0.0, 50.0, 'tuned in the simulator')
    attitude_gain: float = quantity(150.0, '1/s^2', 0.0, 1e4, 'tuned in the simulator')
    rate_gain: float = quantity(20.0, '1/s', 0.0, 1e3, 'tuned in the simulator')
    largest_tilt: float = quantity(0.5, 'rad', 0.0, 1.0, 'judgement')


class Memory(NamedTuple):
    """What the controller keeps between its steps: nothing but how many there were."""

    steps: int


@jit
def initial(values):
    """Return the memory at start."""
    return Memory(0)


@jit
def step(memory, state, reference, dt, gains, vehicle):
    """
    Return the memory after this step, and the command of the motors.

    The estimate and the reference have rho (position, m) and q (attitude, body to NED);
    ``state.nu`` is the velocity in body axes, ``reference.v`` that in NED.
    """
    v = rotate(state.q, state.nu)
    ax = gains.position_gain * (reference.rho[0] - state.rho[0]) + gains.velocity_gain * (
        reference.v[0] - v[0]) + reference.a[0]
    ay = gains.position_gain * (reference.rho[1] - state.rho[1]) + gains.velocity_gain * (
        reference.v[1] - v[1]) + reference.a[1]
    az = gains.position_gain * (reference.rho[2] - state.rho[2]) + gains.velocity_gain * (
        reference.v[2] - v[2]) + reference.a[2]
    _, _, yaw = to_euler(state.q)
    ahead = math.cos(yaw) * ax + math.sin(yaw) * ay
    right = math.cos(yaw) * ay - math.sin(yaw) * ax
    limit = gains.largest_tilt
    pitch = min(max(-ahead / vehicle.gravity, -limit), limit)
    roll = min(max(right / vehicle.gravity, -limit), limit)
    _, _, heading = to_euler(reference.q)
    error = multiply(conjugate(state.q), from_euler(roll, pitch, heading))
    sign = 1.0 if error[0] >= 0.0 else -1.0
    J = vehicle.inertia
    torque = (
        J[0] * (gains.attitude_gain * 2.0 * sign * error[1] - gains.rate_gain * state.omega[0]),
        J[1] * (gains.attitude_gain * 2.0 * sign * error[2] - gains.rate_gain * state.omega[1]),
        J[2] * (gains.attitude_gain * 2.0 * sign * error[3] - gains.rate_gain * state.omega[2]))
    upright = max(rotate(state.q, (0.0, 0.0, 1.0))[2], 0.5)
    thrust = vehicle.mass * (vehicle.gravity - az) / upright
    return Memory(memory.steps + 1), thrust_and_torque(thrust, torque, state, reference, vehicle)
