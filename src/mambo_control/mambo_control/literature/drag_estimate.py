r"""
Drag and thrust of the vehicle, estimated in flight from the acceleration it shows.

Recursive least squares with a random walk of the parameters (a Kalman filter with F = 1; L. Ljung,
"System identification", 2nd edition, 1999, section 11.6), on the two body axes of the drag
and on the axis of the thrust:

.. math::
    s = R^T (\dot v - g e_3), \quad
    -s_{1,2}\, m/f = \theta_3 \nu_{1,2}, \quad
    -s_3\, m/f = \theta_1 + \theta_2 \nu_3

with f the thrust of the motors within their limits and m the believed mass. :math:`\theta_1` is
the true thrust over the believed one at the believed mass, :math:`4 \theta_3/\theta_1` the k_c and
:math:`4 \theta_2/\theta_1` the k_z of (3.13). Still air is assumed: a steady wind is an
error of the velocity, which turning flight averages out.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, scale, sub
from mambo_model.vehicle.parameters import DRAG_PER_ROTOR, VehicleValues

from .flight import hover_drag

SCALE_SIGMA, DRAG_SIGMA = 0.2, 0.05  # of theta_1, and of theta_2 and theta_3 in s/m, at start
SCALE_RANGE, DRAG_RANGE = (0.5, 1.6), (0.0, 0.5)


class DragEstimate(NamedTuple):
    """Estimated parameters with their variances."""

    scale: float  # 1, theta_1
    vertical: float  # s/m, theta_2
    horizontal: float  # s/m, theta_3
    P11: float  # 1, variance of theta_1
    P12: float  # s/m, covariance of theta_1 and theta_2
    P22: float  # s^2/m^2, variance of theta_2
    P33: float  # s^2/m^2, variance of theta_3


@jit
def believed(vv: VehicleValues) -> DragEstimate:
    """Return the estimate before the flight: what is believed of the vehicle."""
    across, along = hover_drag(vv)
    variance = DRAG_SIGMA * DRAG_SIGMA
    return DragEstimate(
        1.0, along / vv.gravity, across / vv.gravity, SCALE_SIGMA * SCALE_SIGMA, 0.0, variance,
        variance)


@jit
def _cut(x: float, low: float, high: float) -> float:
    return min(max(x, low), high)


@jit
def refined(
    a: DragEstimate, before: State, after: State, dt: float, thrust: float, variance: float,
    walk: float, vv: VehicleValues,
) -> DragEstimate:
    """
    Return the estimate after one period.

    Parameters
    ----------
    a
        Before.
    before, after
        Estimates at begin and end of the period.
    dt : s
        Length of the period.
    thrust : N
        Of the motors in the period, by the believed map; above zero.
    variance : 1
        Of the measured s m/f.
    walk : 1
        Variance that each parameter gains in a period, in its unit squared.
    vv
        Believed vehicle.

    """
    change = sub(rotate(after.q, after.nu), rotate(before.q, before.nu))
    free = sub(scale(1.0 / dt, change), (0.0, 0.0, vv.gravity))
    s = add(rotate_inverse(before.q, free), rotate_inverse(after.q, free))
    y = scale(-0.5 * vv.mass / thrust, s)
    nu = scale(0.5, add(before.nu, after.nu))
    most_scale, most_drag = SCALE_SIGMA * SCALE_SIGMA, DRAG_SIGMA * DRAG_SIGMA
    P11, P22 = min(a.P11 + walk, most_scale), min(a.P22 + walk, most_drag)
    g1, g2 = P11 + a.P12 * nu[2], a.P12 + P22 * nu[2]
    S = variance + g1 + g2 * nu[2]
    off = (y[2] - a.scale - a.vertical * nu[2]) / S
    theta_1, theta_2 = a.scale + g1 * off, a.vertical + g2 * off
    theta_3, P33 = a.horizontal, min(a.P33 + walk, most_drag)
    for i in range(2):
        gain = P33 * nu[i] / (variance + P33 * nu[i] * nu[i])
        theta_3 += gain * (y[i] - theta_3 * nu[i])
        P33 *= 1.0 - gain * nu[i]
    return DragEstimate(
        _cut(theta_1, SCALE_RANGE[0], SCALE_RANGE[1]), _cut(theta_2, DRAG_RANGE[0], DRAG_RANGE[1]),
        _cut(theta_3, DRAG_RANGE[0], DRAG_RANGE[1]), P11 - g1 * g1 / S, a.P12 - g1 * g2 / S,
        P22 - g2 * g2 / S, P33)


@jit
def corrected(a: DragEstimate, vv: VehicleValues) -> VehicleValues:
    """Return the believed vehicle with mass and drag as estimated."""
    return VehicleValues(
        vv.mass / a.scale, vv.inertia, vv.gravity, vv.arm, vv.yaw_ratio, vv.thrust_map,
        vv.linear_gain, vv.power_a, vv.power_b, vv.pwm_min, vv.pwm_max, vv.motor_time_constant,
        DRAG_PER_ROTOR, 4.0 * a.horizontal / a.scale, 4.0 * a.vertical / a.scale)
