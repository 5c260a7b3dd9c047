"""
What a course demands of a vehicle by flatness (3.14), and the limits of the vehicle.

Thrust, attitude, rates and torque follow from position, yaw and their derivatives, the PWM of each
motor from the mixer (4.4) and the motor map (4.7), the charge of the battery from the power of
the rotors. The drag (3.13) lies across the thrust axis that it tilts itself, and grows with the
thrust: it is found by iteration, and its derivatives by differences in time.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import NamedTuple

from mambo_model.aerodynamics import lumped_drag
from mambo_model.arithmetic.trigonometry import asin
from mambo_model.compiled import jit
from mambo_model.errors import JobError
from mambo_model.motion.flatness import from_flat_output_yaw
from mambo_model.motion.polynomial import Array, Course, evaluate, jet, Pieces
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.vehicle.battery import supply
from mambo_model.vehicle.motor_mixer import allocate, pwm_from_thrust, thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle, VehicleValues
import numpy as np

from ..gains import CascadedParams

STEP = 0.005        # s, between samples: the period of the controller
PARTS = 16          # in which a piece is sampled at least: a short one would hide between steps
MOST = 2_000_000    # samples of a course at most
TILT_MARGIN = 5.0   # deg, to the tilt at which the controller stops the motors (judgement)
_APART = 1e-3       # s, between the instants of a difference
_TURNS = 200        # of the iteration of the drag; 10 m/s takes 26, 60 m/s as many as 30
_SLOWER = 50.0      # of them, after which its steps are halved
_CONVERGED = 1e-9   # m/s^2, a change by which it ends

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
def drag_acceleration(v: Vec3, a: Vec3, drag: Vec3, vv: VehicleValues) -> Vec3:
    """
    Return F_D/m of a vehicle that flies a course without error, (3,) m/s^2, inertial NED.

    It solves f b3 = m (g e3 - a) + F_D(f, b3) with F_D of (3.13); f and b3 are the thrust and its
    axis. Yaw has no effect, as the drag is the same along both horizontal axes of the body.

    Parameters
    ----------
    v, a : (3,) m/s, m/s^2, inertial NED
        Velocity and acceleration.
    drag : (3,) m/s^2, inertial NED
        A first guess, such as that of the instant before.
    vv
        Vehicle.

    """
    free = sub((0.0, 0.0, vv.gravity), a)
    for turn in range(_TURNS):
        thrust = add(free, drag)  # m/s^2
        length = norm(thrust)
        if not length > 0.0:
            break
        b3 = scale(1.0 / length, thrust)
        along = dot(b3, v)
        across = sub(v, scale(along, b3))
        speed = norm(across)
        force = lumped_drag((speed, 0.0, along), vv.mass * length, vv)
        sideways = force[0] / speed if speed > 0.0 else 0.0
        found = scale(1.0 / vv.mass, add(scale(sideways, across), scale(force[2], b3)))
        ratio = norm(found) / length  # where it is large, a full step would swing
        change = scale(1.0 / (1.0 + ratio * ratio + turn / _SLOWER), sub(found, drag))
        drag = add(drag, change)
        if norm(change) < _CONVERGED:
            break
    return drag


@jit
def _drag_after(x: float, piece: Array, guess: Vec3, vv: VehicleValues) -> Vec3:
    """Return that acceleration at a time in s since its piece, (4, 10), began."""
    forward, right, down = jet(piece[0], x), jet(piece[1], x), jet(piece[2], x)
    return drag_acceleration(
        (forward[1], right[1], down[1]), (forward[2], right[2], down[2]), guess, vv)


@jit
def _drag_rates(
    t: float, drag: Vec3, guess: Vec3, pieces: Pieces, vv: VehicleValues,
) -> tuple[Vec3, Vec3]:
    """Return its derivatives at t in s, where it is ``drag``; guess: of the first, m/s^3."""
    i = max(np.searchsorted(pieces.begin, t, side='right') - 1, 0)
    x, piece, step = t - pieces.begin[i], pieces.coefficients[i], scale(_APART, guess)
    before = _drag_after(x - _APART, piece, sub(drag, step), vv)
    after = _drag_after(x + _APART, piece, add(drag, step), vv)
    second = sub(add(before, after), scale(2.0, drag))
    return scale(0.5 / _APART, sub(after, before)), scale(1.0 / (_APART * _APART), second)


@jit
def _demand(t, pieces, vv, options, out):
    """Fill ``out``, (n, 11), at times ``t``, (n,) s; ``options`` is None without a battery."""
    charge, drag, rate = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(len(t)):
        x, y, z, psi = evaluate(t[k], pieces)
        rho, v, a = (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
        j, s = (x[3], y[3], z[3]), (x[4], y[4], z[4])
        ahead = t[k] - t[k - 1] if k else 0.0
        drag = drag_acceleration(v, a, add(drag, scale(ahead, rate)), vv)
        rate, second = _drag_rates(t[k], drag, rate, pieces, vv)
        ref = from_flat_output_yaw(
            rho, v, sub(a, drag), sub(j, rate), sub(s, second), psi[0], psi[1], psi[2],
            vv.mass, vv.inertia, vv.gravity)
        thrust = allocate(ref.f, ref.tau, vv)
        row, share = out[k], 1.0
        row[10] = 100.0
        if options is not None:
            voltage, current = supply(charge, thrust, options)
            charge += current * ahead
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
    controller shuts down, for the tilt less ``TILT_MARGIN``, as no controller is without error.
    ``body_rate`` in rad/s is the range of the gyro.
    """
    vv, control = vehicle.values(), CascadedParams()
    pwm = Limit(vv.pwm_min, vv.pwm_max)
    out = {
        'battery': Limit(1e-9, math.inf),  # first: an empty battery needs an infinite PWM
        'height': Limit(0.0, control.height_max),
        'thrust': Limit(*(4.0 * thrust_from_pwm(x, vv) for x in pwm)),
        'tilt': Limit(-math.inf, math.degrees(control.tilt_limit) - TILT_MARGIN),
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
