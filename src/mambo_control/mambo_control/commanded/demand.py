"""
What a course demands of a vehicle by flatness (3.14), and the limits of the vehicle.

Thrust, attitude, rates and torque follow from position, yaw and their derivatives, the PWM of each
motor from the mixer (4.4) and the motor map (4.7), the charge of the battery from the power of
the rotors. Drag and its derivatives are those of (3.13), as in the controller's feedforward.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import asin
from mambo_model.compiled import jit
from mambo_model.errors import JobError
from mambo_model.motion.flatness import body_velocity, from_flat_output_yaw
from mambo_model.motion.polynomial import Array, Course, evaluate, Pieces
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import norm, sub
from mambo_model.vehicle.battery import supply
from mambo_model.vehicle.motor_mixer import allocate, pwm_from_thrust, thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from ..drag_feedforward import drag_acceleration, reference_drag_rates
from ..gains import CascadedParams

STEP = 0.005        # s, between samples: the period of the controller
PARTS = 16          # in which a piece is sampled at least: a short one would hide between steps
MOST = 2_000_000    # samples of a course at most

QUANTITIES = {  # column: unit
    'height': 'm', 'speed': 'm/s', 'acceleration': 'm/s^2', 'thrust': 'N', 'tilt': 'deg',
    'body rate': 'deg/s', 'PWM of motor 1': 'PWM', 'PWM of motor 2': 'PWM',
    'PWM of motor 3': 'PWM', 'PWM of motor 4': 'PWM', 'battery': '%'}
"""Quantities that are checked, in the order of the columns of :func:`demand`."""


class Limit(NamedTuple):
    """The range of one quantity."""

    low: float
    high: float


def told_apart(value: float, limit: float, digits: int = 3) -> str:
    """Return a number with as many digits, at least those given, as tell it from its limit."""
    while digits < 17 and f'{value:.{digits}g}' == f'{limit:.{digits}g}':
        digits += 1
    return f'{value:.{digits}g}'


class Failure(NamedTuple):
    """The first point of a course that exceeds a limit."""

    t: float        # s of the course
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        unit = QUANTITIES[self.quantity]
        side = 'below' if self.value < self.limit else 'above'
        value = told_apart(self.value, self.limit, 4)
        return (f'{self.quantity} {value} {unit} at t = {self.t:.3f} s, {side} the '
                f'limit of {self.limit:.4g} {unit}')


@jit
def _demand(t, pieces, vv, options, out):
    """Fill ``out``, (n, 11), at times ``t``, (n,) s; ``options`` is None without a battery."""
    charge = 0.0
    for k in range(len(t)):
        x, y, z, psi = evaluate(t[k], pieces)
        rho, v, a = (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
        j, s = (x[3], y[3], z[3]), (x[4], y[4], z[4])
        free = from_flat_output_yaw(
            rho, v, a, j, s, psi[0], psi[1], psi[2], vv.mass, vv.inertia, vv.gravity)
        drag = drag_acceleration(
            State(rho, body_velocity(free), free.q, free.omega), free.f, vv)
        rate, second = reference_drag_rates(free, vv)
        ref = from_flat_output_yaw(
            rho, v, sub(a, drag), sub(j, rate), sub(s, second), psi[0], psi[1], psi[2],
            vv.mass, vv.inertia, vv.gravity)
        thrust = allocate(ref.f, ref.tau, vv)
        row, share = out[k], 1.0
        row[10] = 100.0
        if options is not None:
            voltage, current = supply(charge, thrust, options)
            charge += current * (t[k] - t[k - 1] if k else 0.0)
            row[10] = 100.0 * (1.0 - charge / (3600.0 * options.battery.capacity))
            share = options.battery.reference_voltage / voltage if voltage > 0.0 else np.inf
        row[0], row[1], row[2], row[3] = -rho[2], norm(v), norm(a), ref.f
        q = ref.q
        row[4] = math.degrees(2.0 * asin(min(1.0, math.sqrt(q[1] * q[1] + q[2] * q[2]))))
        row[5] = math.degrees(norm(ref.omega))
        for i in range(4):
            row[6 + i] = share * pwm_from_thrust(thrust[i], vv)


def times(course: Course) -> Array:
    """
    Return the times at which a course is checked, (n,) s: every step, ``PARTS`` of each piece.

    Raises
    ------
    JobError
        If there are more than ``MOST``.

    """
    short = np.flatnonzero(course.duration < PARTS * STEP)
    count = math.ceil(course.total / STEP)
    if count + PARTS * len(short) > MOST:
        raise JobError(f'the course lasts {course.total:.0f} s in {len(course.duration)} pieces, '
                       f'limit {MOST * STEP:.0f} s')
    grid = np.append(np.arange(count) * STEP, course.total)
    parts = course.duration[short, None] * np.arange(PARTS) / PARTS
    return np.unique(np.append(grid, course.begin[short, None] + parts)) if len(short) else grid


def demand(course: Course, vehicle: Vehicle) -> tuple[Array, Array]:
    """
    Return what a course demands of a vehicle.

    Parameters
    ----------
    course
        In m and rad, inertial NED.
    vehicle
        If its battery is enabled, it starts fully charged.

    Returns
    -------
    t : (n,) s of the course, of :func:`times`
    columns : (n, 11) of :data:`QUANTITIES`; battery: the
        remaining charge, 100 without a battery

    Raises
    ------
    JobError
        If the course is longer than 10 000 s.

    """
    t = times(course)
    n, axes, width = course.coefficients.shape
    padded = np.zeros((n, axes, 10))
    padded[:, :, :width] = course.coefficients
    out = np.empty((len(t), len(QUANTITIES)))
    options = vehicle.options() if vehicle.battery.enabled else None
    _demand(t, Pieces(course.begin, padded), vehicle.values(), options, out)
    return t, out


def limits(vehicle: Vehicle, body_rate: float) -> dict[str, Limit]:
    """
    Return the range of each limited quantity of :data:`QUANTITIES`.

    Thrust and PWM are limits of the vehicle. Tilt and height are the default limits at which the
    controller shuts down. ``body_rate`` in rad/s is the range of the gyro.
    """
    vv, control = vehicle.values(), CascadedParams()
    pwm = Limit(vv.pwm_min, vv.pwm_max)
    out = {
        'battery': Limit(1e-9, math.inf),  # first: an empty battery needs an infinite PWM
        'height': Limit(0.0, control.height_max),
        'thrust': Limit(*(4.0 * thrust_from_pwm(x, vv) for x in pwm)),
        'tilt': Limit(-math.inf, math.degrees(control.tilt_limit)),
        'body rate': Limit(-math.inf, math.degrees(body_rate))}
    out |= {name: pwm for name in QUANTITIES if name.startswith('PWM')}
    return out


def failure(t: Array, columns: Array, ranges: Mapping[str, Limit]) -> Failure | None:
    """Return the first point of a result of :func:`demand` beyond one of ``ranges``, else None."""
    first: tuple[int, Failure] | None = None
    for name, (low, high) in ranges.items():
        values = columns[:, list(QUANTITIES).index(name)]
        wrong = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(wrong) and (first is None or wrong[0] < first[0]):
            k = int(wrong[0])
            first = k, Failure(float(t[k]), name, float(values[k]),
                               low if values[k] < low else high)
    return first[1] if first else None
