"""
Optical flow: velocity from line-of-sight rate, height and a flow factor Q(h), (5.2) corrected.

equations.md, C8: with a sensor that has the sign of the vehicle's motion and contains
no rotation, ``nu_xy = Z Q flow`` with the slant distance ``Z = h / (cos phi cos theta)`` is the
velocity along body x and y. It must be rotated to the inertial frame together with nu_3.
The factor Q is constant (5.2) or a function of the height (C.2); (C.2) prints it as a function of
the flow by mistake (C5).
"""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.motion.vector import Vec3
from mambo_model.schema import choice, flag, quantity
from mambo_model.values import Parameters, values_type

from ..blocks import Matrix2, Matrix3, Vec2

FACTORS = ('constant', 'linear', 'exponential')
FACTOR_CONSTANT, FACTOR_LINEAR, FACTOR_EXPONENTIAL = range(len(FACTORS))


@dataclass(frozen=True)
class FlowParams(Parameters):
    """Optical-flow model of the velocity filter."""

    factor: str = choice('constant', FACTORS, 'Q of (5.2), or Q(h) of (C.2b), (C.2a) with C5')
    constant: float = quantity(1.06, '-', 0.1, 10.0, 'Q of (5.2), thesis sec. 5.4')
    linear_offset: float = quantity(0.92, '-', 0.0, 10.0, '(C.2b)')
    linear_slope: float = quantity(0.07, '1/m', -1.0, 1.0, '(C.2b); 0.10 after its retuning')
    exponential_offset: float = quantity(0.95, '-', 0.0, 10.0, '(C.2a)')
    exponential_gain: float = quantity(0.011, '-', -1.0, 1.0, '(C.2a); 0.02 after its retuning')
    factor_min_height: float = quantity(0.5, 'm', 0.0, 10.0, 'Q(h) is held below: not calibrated')
    factor_max_height: float = quantity(2.5, 'm', 0.0, 10.0, 'Q(h) is held above: not calibrated')
    height_scaling: bool = flag(
        True, '(5.2); false: the flow is taken as a velocity in m/s, as the support package does')
    rotation_leak: float = quantity(
        0.0, '-', -2.0, 2.0, 'part of the rotational flow in the signal, subtracted here')
    noise: float = quantity(
        0.02, 'rad/s', 1e-4, 10.0,
        'standard deviation of a sample, each axis: 0.015 in the cleanest Rolling Spider flight')
    scale_std: float = quantity(
        0.04, '-', 0.0, 1.0,
        'uncertainty of Q, constant part: 1.06 against 1.025 of (C.2b) at 1.5 m')
    slope_std: float = quantity(
        0.07, '1/m', 0.0, 1.0, 'uncertainty of dQ/dh over Q: slope of (C.2b), which (5.2) ignores')
    reference_height: float = quantity(
        1.5, 'm', 0.0, 10.0, 'where the uncertain slope leaves the factor unchanged')
    min_height: float = quantity(0.4, 'm', 0.01, 10.0, 'not used below, thesis sec. 5.2')
    max_rate: float = quantity(20.0, 'rad/s', 0.1, 1e3, 'no camera follows the ground faster')
    min_tilt_cos: float = quantity(0.7, '-', 0.1, 1.0, 'not used beyond 45 degrees of tilt')
    min_quality: int = quantity(1, '-', 0, 255, 'not used below; 0: no texture')
    gate: float = quantity(4.0, 'sigma', 1.0, 100.0, 'refuses 3e-4 of good samples (two axes)')
    recovery_time: float = quantity(
        0.5, 's', 0.0, 1e4, 'refusals that agree for so long mean that the filter is wrong')
    stuck_samples: int = quantity(
        8, '-', 0, 100000, 'so many equal rates but zero mean a dead sensor; 0: never')


FlowValues = values_type(FlowParams)


@jit
def factor_at(height: float, v: FlowValues) -> float:
    """
    Return Q, (5.2) or (C.2) as a function of the height (C5).

    Parameters
    ----------
    height : m
        Above the floor; held at the ends of the calibrated range.
    v
        Which relation, and its numbers.

    """
    h = min(max(height, v.factor_min_height), v.factor_max_height)
    if v.factor == FACTOR_LINEAR:
        return v.linear_offset + v.linear_slope * h
    if v.factor == FACTOR_EXPONENTIAL:
        return v.exponential_offset + v.exponential_gain * exp(h)
    return v.constant


@jit
def multiplier(height: float, tilt_cos: float, v: FlowValues) -> float:
    """
    Return the factor from flow to velocity, m: Z Q; when level the h Q of thesis sec. 5.4.

    1.59 m at 1.5 m and 2.65 m at 2.5 m with Q = 1.06. Without height scaling Q alone, the flow
    being taken as a velocity.
    """
    q = factor_at(height, v)
    return q * height / tilt_cos if v.height_scaling else q


@jit
def is_valid(flow: Vec2, height: float, tilt_cos: float, quality: int, v: FlowValues) -> bool:
    """
    Return whether a sample may be used; NaN is refused.

    Parameters
    ----------
    flow : (2,) rad/s
        As measured.
    height : m
        Filtered, above the floor.
    tilt_cos : -
        cos(phi) cos(theta).
    quality : -
        0..255 as the sensor gives it.
    v
        Limits.

    """
    return (
        abs(flow[0]) <= v.max_rate and abs(flow[1]) <= v.max_rate and height >= v.min_height
        and tilt_cos >= v.min_tilt_cos and quality >= v.min_quality)


@jit
def measured_velocity(
    flow: Vec2, height: float, tilt_cos: float, omega: Vec3, v: FlowValues,
) -> tuple[Vec2, float]:
    """
    Return the body velocity of a flow sample, (5.2) with C8.

    Parameters
    ----------
    flow : (2,) rad/s, body FRD
        Line-of-sight rate along x and y with the sign of the vehicle's motion.
    height : m
        Above the floor, valid.
    tilt_cos : -
        cos(phi) cos(theta), valid.
    omega : (3,) rad/s, body FRD
        Angular velocity without bias, of which ``rotation_leak`` is in the signal.
    v
        Factor and noise.

    Returns
    -------
    nu_xy : (2,) m/s, body FRD
    std : m/s
        Standard deviation of each from the noise of the flow alone.

    """
    m = multiplier(height, tilt_cos, v)
    x = flow[0] - v.rotation_leak * omega[1]
    y = flow[1] + v.rotation_leak * omega[0]
    return (m * x, m * y), m * v.noise


@jit
def predict(velocity: Vec3, R: Matrix3) -> tuple[Vec2, Matrix2]:
    """
    Return the expected body velocity along x and y, and its derivative.

    Parameters
    ----------
    velocity : (3,) m/s, inertial NED
    R : (3, 3)
        Body to inertial.

    Returns
    -------
    nu_xy : (2,) m/s, body FRD
        First two elements of R^T velocity.
    by_horizontal : (2, 2)
        d nu_xy / d (v_x, v_y).

    """
    M = ((R[0][0], R[1][0]), (R[0][1], R[1][1]))
    return (
        (M[0][0] * velocity[0] + M[0][1] * velocity[1] + R[2][0] * velocity[2],
         M[1][0] * velocity[0] + M[1][1] * velocity[1] + R[2][1] * velocity[2]), M)


@jit
def inertial_velocity(nu_xy: Vec2, v_z: float, R: Matrix3) -> Vec2:
    """
    Return the horizontal velocity of a flow sample, (5.2) with C8: R [nu_1 nu_2 nu_3].

    Parameters
    ----------
    nu_xy : (2,) m/s, body FRD
    v_z : m/s, inertial NED
        Downward velocity of the altitude filter, from which nu_3 follows.
    R : (3, 3)
        Body to inertial, tilted less than 90 degrees.

    Returns
    -------
    v_xy : (2,) m/s, inertial NED

    """
    nu_3 = (v_z - R[2][0] * nu_xy[0] - R[2][1] * nu_xy[1]) / R[2][2]
    return (R[0][0] * nu_xy[0] + R[0][1] * nu_xy[1] + R[0][2] * nu_3,
            R[1][0] * nu_xy[0] + R[1][1] * nu_xy[1] + R[1][2] * nu_3)
