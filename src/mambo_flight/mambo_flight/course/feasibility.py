"""
Feasibility of a course: what it demands of the vehicle by flatness (3.14), and the limits.

Thrust, attitude, rates and torque follow from position, yaw and their derivatives, the PWM of each
motor from the mixer (4.4) and the motor map (4.7), the charge of the battery from the power of
the rotors. Drag and its derivatives are those of (3.13), as in the controller's feedforward.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_control.drag_feedforward import drag_acceleration, reference_drag_rates
from mambo_control.gains import CascadedParams
from mambo_model.compiled import jit
from mambo_model.errors import InputError, JobError
from mambo_model.motion.flatness import body_velocity, from_flat_output_yaw
from mambo_model.motion.polynomial import Array, Course, evaluate, Pieces, stretched
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import norm, sub
from mambo_model.vehicle.battery import supply
from mambo_model.vehicle.motor_mixer import allocate, pwm_from_thrust, thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim.sensors.imu import ImuParams
import numpy as np

STEP = 0.005        # s, between samples: the period of the controller
MOST = 2_000_000    # samples of a course at most
LONGEST = 100.0     # largest factor of time, tried or given by an option
PRECISION = 1e-4    # relative precision of the stretch

QUANTITIES = {  # column: unit
    'height': 'm', 'speed': 'm/s', 'acceleration': 'm/s^2', 'thrust': 'N', 'tilt': 'deg',
    'body rate': 'deg/s', 'PWM of motor 1': 'PWM', 'PWM of motor 2': 'PWM',
    'PWM of motor 3': 'PWM', 'PWM of motor 4': 'PWM', 'battery': '%'}
"""Quantities that are checked, in the order of the columns of :func:`demand`."""


class Limit(NamedTuple):
    """The range of one quantity."""

    low: float
    high: float


class Failure(NamedTuple):
    """The first point of a course that exceeds a limit."""

    t: float        # s of the course
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        unit = QUANTITIES[self.quantity]
        side = 'below' if self.value < self.limit else 'above'
        return (f'{self.quantity} {self.value:.4g} {unit} at t = {self.t:.3f} s, {side} the '
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
        row[4] = math.degrees(2.0 * math.asin(min(1.0, math.sqrt(q[1] * q[1] + q[2] * q[2]))))
        row[5] = math.degrees(norm(ref.omega))
        for i in range(4):
            row[6 + i] = share * pwm_from_thrust(thrust[i], vv)


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
    t : (n,) s of the course, every 5 ms and its end
    columns : (n, 11) of :data:`QUANTITIES`; battery: the
        remaining charge, 100 without a battery

    Raises
    ------
    JobError
        If the course is longer than 10 000 s.

    """
    count = math.ceil(course.total / STEP)
    if count > MOST:
        raise JobError(f'the course lasts {course.total:.0f} s, limit {MOST * STEP:.0f} s')
    t = np.append(np.arange(count) * STEP, course.total)
    n, axes, width = course.coefficients.shape
    padded = np.zeros((n, axes, 10))
    padded[:, :, :width] = course.coefficients
    out = np.empty((len(t), len(QUANTITIES)))
    options = vehicle.options() if vehicle.battery.enabled else None
    _demand(t, Pieces(course.begin, padded), vehicle.values(), options, out)
    return t, out


def limits(vehicle: Vehicle) -> dict[str, Limit]:
    """
    Return the range of each limited quantity of :data:`QUANTITIES`.

    Thrust and PWM are limits of the vehicle. Tilt and height are the default limits at which the
    controller shuts down. The body rate is the range of the gyro.
    """
    vv, control = vehicle.values(), CascadedParams()
    pwm = Limit(vv.pwm_min, vv.pwm_max)
    out = {
        'battery': Limit(1e-9, math.inf),  # first: an empty battery needs an infinite PWM
        'height': Limit(0.0, control.height_max),
        'thrust': Limit(*(4.0 * thrust_from_pwm(x, vv) for x in pwm)),
        'tilt': Limit(-math.inf, math.degrees(control.tilt_limit)),
        'body rate': Limit(-math.inf, math.degrees(ImuParams().gyro_range))}
    out |= {name: pwm for name in QUANTITIES if name.startswith('PWM')}
    return out


def failure(t: Array, columns: Array, vehicle: Vehicle) -> Failure | None:
    """Return the first point of a result of :func:`demand` beyond a limit, else None."""
    first: tuple[int, Failure] | None = None
    for name, (low, high) in limits(vehicle).items():
        values = columns[:, list(QUANTITIES).index(name)]
        wrong = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(wrong) and (first is None or wrong[0] < first[0]):
            k = int(wrong[0])
            first = k, Failure(float(t[k]), name, float(values[k]),
                               low if values[k] < low else high)
    return first[1] if first else None


def check(course: Course, vehicle: Vehicle) -> Failure | None:
    """Return the first point of a course that a vehicle cannot fly, else None."""
    return failure(*demand(course, vehicle), vehicle)


def factor(text: str, option: str) -> float:
    """Return the factor given by an option; InputError if it is not valid."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f'{option} {text}: write a number, or auto') from None
    if not 1.0 / LONGEST <= value <= LONGEST:
        raise InputError(f'{option} {text} must be within {1.0 / LONGEST:g} to {LONGEST:g}')
    return value


def stretch(course: Course, vehicle: Vehicle) -> float:
    """
    Return the smallest factor >= 1 by which time must be stretched to make a course feasible.

    Found by bisection to a relative precision of 1e-4; stretched by the returned factor, the
    course is feasible.

    Raises
    ------
    JobError
        If the course is not feasible at a hundred times its duration; the message says why.

    """
    if check(course, vehicle) is None:
        return 1.0
    low, high = 1.0, 2.0
    while reason := check(stretched(course, high), vehicle):
        low, high = high, 2.0 * high
        if high > LONGEST:
            raise JobError(f'no slower course is feasible either: {reason}, at {low:g} times '
                           'the duration')
    while high - low > PRECISION * low:
        middle = 0.5 * (low + high)
        if check(stretched(course, middle), vehicle) is None:
            high = middle
        else:
            low = middle
    return high
