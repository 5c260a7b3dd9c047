r"""
The default estimator of the support package for Parrot minidrones: the thesis's baseline (5.1).

Each step, in this order (Figure 5.1):

* calibration: the mean of the first samples is the bias, gravity of a level floor aside;
* attitude: the gyro integrated as Euler angles, drawn to the direction of the specific force
  while this is as long as gravity (complementary filter);
* altitude: the vertical acceleration integrated twice, corrected by the sonar with the constant
  gain of a Kalman filter;
* body velocity: likewise, corrected by the optical flow, **which is taken for a velocity in m/s**
  although it is a velocity divided by the height; below 0.4 m the accelerometer alone;
* position: the velocity integrated.

Structure and constants are those of code generated from the package in 2018 (gain of
flow to velocity: 1 for the Mambo). It differs from the thesis in one point, followed here: below
0.4 m that code integrates nothing, the thesis's (sec. 5.2) the accelerometer. Left out: the
factory scale of the inertial sensors, a filter on the yaw rate and the limit of the angular
acceleration for flow.

Everything is NED and FRD. Bad samples are counted and not used; the estimate is never NaN. The
package has no covariance of the position: all of them are published as zero, unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import asin, atan, cos, sin, sin_cos
from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.quaternion import from_euler, rotate, to_matrix
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters, values_type

from . import health
from .blocks import Matrix3, Vec2
from .estimate import count_broken, Estimate, STATUS_ALIGNING, status_of, UNKNOWN
from .health import Limits, observe_all, Sensors
from .measurements.imu import is_within

__all__ = ['initial', 'Memory', 'step', 'ToolboxEstimatorParams', 'ToolboxValues']

_PACKAGE = 'support package'
_KALMAN = 'support package: gain of a Kalman filter with '


def _low_pass(taps: int, cutoff: float) -> tuple[float, ...]:
    """Return a windowed low-pass filter (Hamming), sum 1; cutoff in units of half the rate."""
    middle = 0.5 * (taps - 1)
    out = []
    for k in range(taps):
        x = math.pi * cutoff * (k - middle)
        window = 0.54 - 0.46 * cos(2.0 * math.pi * k / (taps - 1))
        out.append(window * (sin(x) / x if x else 1.0))
    return tuple(tap / math.fsum(out) for tap in out)


# Of the accelerometer: support package, a low pass of order 5 with cutoff 0.1.
TAPS: tuple[float, float, float, float, float, float] = _low_pass(6, 0.1)
Window = tuple[Vec3, Vec3, Vec3, Vec3, Vec3, Vec3]

NOSE_UP = 0.05  # cosine of the pitch at which the Euler rates are held finite


@dataclass(frozen=True)
class ToolboxEstimatorParams(Parameters):
    """Parameters of the package's estimator; gains are those of a step of 5 ms."""

    gravity: float = quantity(9.81, 'm/s^2', 9.7, 9.9, _PACKAGE)
    calibration_samples: int = quantity(
        100, '-', 0, 1000000, 'thesis sec. 5.3.1: mean of the first ones; 0.5 s at 200 Hz')
    gyro_range: float = quantity(35.0, 'rad/s', 1.0, 1e3, 'no reading beyond: 2000 deg/s')
    accel_range: float = quantity(160.0, 'm/s^2', 20.0, 1e4, 'no reading beyond: 16 g')
    max_gap: float = quantity(
        1.0, 's', 0.01, 100.0, 'a longer interval is integrated only so far, and counted')
    hold: float = quantity(
        0.1, 's', 0.0, 10.0, 'range and flow are used again in each step until the next one, as '
        'in the support package, but not for longer (judgement)')
    max_sonar_age: float = quantity(
        1.0, 's', 0.01, 1e4, 'without a used range for longer the status is dead reckoning')
    max_flow_age: float = quantity(
        0.5, 's', 0.01, 1e4, 'without used flow for longer the status is dead reckoning')
    attitude_weight: float = quantity(
        0.001, '-', 0.0, 1.0, 'support package: of the accelerometer in one step')
    attitude_tolerance: float = quantity(
        0.002, '-', 0.0, 1.0, 'support package: the specific force is so near gravity, relative')
    height_gain: float = quantity(
        0.026241, '-', 0.0, 1.0, _KALMAN + 'Q = 0.0005 m^2/s^2 per step, R = 0.1 m^2')
    climb_gain: float = quantity(0.069777, '1/s', 0.0, 100.0, 'the same')
    sonar_min: float = quantity(0.44, 'm', 0.0, 5.0, 'support package: not used below')
    sonar_max: float = quantity(10.0, 'm', 0.0, 100.0, 'not used above: no sonar sees so far')
    sonar_gate: float = quantity(
        0.3, 'm', 0.01, 100.0, 'support package: a range farther from the estimate is unused ...')
    sonar_far: float = quantity(
        0.4, 'm', 0.0, 100.0, 'support package: ... unless the smoothed range is so far from it')
    pressure_far: float = quantity(
        0.8, 'm', 0.0, 100.0, 'support package: ... and the smoothed height by pressure so far')
    smoothing: float = quantity(
        0.16, 's', 1e-3, 10.0, 'of these two: 1 Hz; of order 3 in the support package')
    metre_per_pascal: float = quantity(0.0832, 'm/Pa', 0.0, 1.0, _PACKAGE)
    flow_to_velocity: float = quantity(
        1.0, 'm', -100.0, 100.0, 'support package, Mambo: m/s per rad/s, at any height')
    flow_gain: float = quantity(
        0.125466, '-', 0.0, 1.0, _KALMAN + 'Q = 0.09 m^2/s^2 per step, R = 5 m^2/s^2')
    flow_min_height: float = quantity(0.4, 'm', 0.0, 10.0, 'not used below, thesis sec. 5.2')
    flow_min_quality: int = quantity(1, '-', 0, 255, 'not used below; 0: no texture')
    flow_gate: float = quantity(
        5.0, 'm/s', 0.01, 1e3, 'support package: not used if farther from the estimate')
    flow_max_tilt: float = quantity(
        0.6, 'rad', 0.0, 3.2, 'support package: not used at more roll or pitch ...')
    flow_max_rate: float = quantity(
        7.0, 'rad/s', 0.0, 1e3, 'support package: ... or faster roll or pitch ...')
    flow_calm_rate: float = quantity(
        0.5, 'rad/s', 0.0, 1e3, 'support package: ... unless roll and pitch are so slow')
    acceleration_gain: float = quantity(
        0.2, '-', 0.0, 1.0, 'support package: share of the horizontal acceleration integrated')
    low_acceleration_gain: float = quantity(
        1.0, '-', 0.0, 1.0, 'the same where the height is too low for flow: thesis sec. 5.2, '
        'integrated simply; 0 in the support package of 2018')
    min_pressure: float = quantity(3e4, 'Pa', 1e3, 2e5, 'no reading below')
    max_pressure: float = quantity(1.2e5, 'Pa', 1e3, 2e5, 'no reading above')
    max_imu_age: float = quantity(
        0.1, 's', 0.005, 1e4, 'unhealthy without a used inertial sample for longer')
    max_barometer_age: float = quantity(
        1.0, 's', 0.01, 1e4, 'unhealthy without plausible pressure for longer')

    @derived('s', 'max_imu_age', 'max_barometer_age')
    def limits(self) -> Limits:
        """How old the last sample that was used may be."""
        return health.limits(self)


ToolboxValues = values_type(ToolboxEstimatorParams)


class Rest(NamedTuple):
    """Means of the calibration: what the sensors read on the floor."""

    count: int           # samples of the inertial sensors
    gyro_bias: Vec3      # (3,) rad/s, body FRD
    accel_bias: Vec3     # (3,) m/s^2, body FRD, without gravity
    pressures: int       # samples of the barometer
    pressure: float      # Pa


class Altitude(NamedTuple):
    """Vertical motion, and the newest samples of the sensors that correct it."""

    height: float        # m
    climb: float         # m/s, upward
    range: float         # m, the newest; NaN: none yet
    age: float           # s, of it
    used_age: float      # s, since a range was used
    refused: int         # ranges since start
    smooth_range: float  # m
    by_pressure: float   # m, smoothed; NaN: none yet


class Velocity(NamedTuple):
    """Horizontal motion, and the flow that corrects it."""

    nu: Vec2             # (2,) m/s, body FRD
    position: Vec2       # (2,) m, inertial NED
    flow: Vec2           # (2,) m/s, body FRD, the newest taken for a velocity; NaN: none yet
    age: float           # s, of it
    used_age: float      # s, since one was used
    refused: int         # flow samples since start


class Memory(NamedTuple):
    """Memory of the estimator between steps."""

    rest: Rest           # calibration
    gyro: Vec3           # (3,) rad/s, body FRD, last valid sample
    accel: Vec3          # (3,) m/s^2, body FRD, last valid sample
    window: Window       # last calibrated specific forces, oldest first, (3,) m/s^2 each
    euler: Vec3          # (3,) rad, roll, pitch, yaw
    altitude: Altitude   # vertical motion
    velocity: Velocity   # horizontal motion
    invalid: int         # samples of any sensor that could not be read
    sensors: Sensors     # their health


class Seen(NamedTuple):
    """Innovations of the new samples of a step; NaN: no sample."""

    sonar_innovation: float   # m
    sonar_ratio: float        # -, 1 at the gate
    flow_innovation: Vec2     # (2,) m/s
    flow_ratio: float         # -, 1 at the gate


ZERO: Vec3 = (0.0, 0.0, 0.0)
NAN2: Vec2 = (math.nan, math.nan)
NOTHING = Seen(math.nan, math.nan, NAN2, math.nan)


@jit
def initial(values: ToolboxValues) -> Memory:
    """Return the initial memory: on the floor, level, yaw 0."""
    g = (0.0, 0.0, -values.gravity)
    return Memory(
        Rest(0, ZERO, ZERO, 0, 0.0), ZERO, g, (g, g, g, g, g, g), ZERO,
        Altitude(0.0, 0.0, math.nan, math.inf, math.inf, 0, math.nan, math.nan),
        Velocity((0.0, 0.0), (0.0, 0.0), NAN2, math.inf, math.inf, 0), 0, health.START)


@jit
def _mean(mean: Vec3, x: Vec3, count: int) -> Vec3:
    """Return the mean of count samples, the last of which is x."""
    return add(mean, scale(1.0 / count, sub(x, mean)))


@jit
def _calibrate(
    r: Rest, gyro: Vec3, accel: Vec3, pressure: float, v: ToolboxValues,
) -> Rest:
    """Take one sample at rest into the means; gravity is not part of the bias."""
    n, pressures, p = r.count + 1, r.pressures, r.pressure
    if v.min_pressure <= pressure <= v.max_pressure:
        pressures += 1
        p += (pressure - p) / pressures
    force = (accel[0], accel[1], accel[2] + v.gravity)
    return Rest(
        n, _mean(r.gyro_bias, gyro, n), _mean(r.accel_bias, force, n), pressures, p)


@jit
def filtered(window: Window) -> Vec3:
    """Return the low-passed specific force of the last six, (3,) m/s^2, body FRD."""
    out = scale(TAPS[0], window[0])
    out = add(out, scale(TAPS[1], window[1]))
    out = add(out, scale(TAPS[2], window[2]))
    out = add(out, scale(TAPS[3], window[3]))
    out = add(out, scale(TAPS[4], window[4]))
    return add(out, scale(TAPS[5], window[5]))


@jit
def turned(euler: Vec3, omega: Vec3, force: Vec3, dt: float, v: ToolboxValues) -> Vec3:
    """
    Return roll, pitch and yaw after a step of the complementary filter, (3,) rad.

    Parameters
    ----------
    euler : (3,) rad
        Before the step.
    omega : (3,) rad/s, body FRD
        Without bias.
    force : (3,) m/s^2, body FRD
        Specific force, filtered: at rest (sin theta, -sin phi cos theta, -cos phi cos theta) g.
    dt : s
        Length of the step.
    v
        Weight of the accelerometer, and when it counts.

    """
    phi, theta, psi = euler
    s, c = sin_cos(phi)
    s_theta, c_theta = sin_cos(theta)
    if abs(c_theta) < NOSE_UP:
        c_theta = math.copysign(NOSE_UP, c_theta)
    psi_dot = (omega[1] * s + omega[2] * c) / c_theta
    phi += dt * (omega[0] + s_theta * psi_dot)
    theta += dt * (omega[1] * c - omega[2] * s)
    psi += dt * psi_dot
    if abs(norm(force) - v.gravity) < v.attitude_tolerance * v.gravity:
        w = v.attitude_weight
        phi = (1.0 - w) * phi + w * (atan(force[1] / force[2]) if force[2] != 0.0 else 0.0)
        theta = (1.0 - w) * theta + w * asin(min(1.0, max(-1.0, force[0] / v.gravity)))
    return (phi, theta, psi)


@jit
def _smoothed(old: float, new: float, dt: float, v: ToolboxValues) -> float:
    """Return the low pass of a signal, which starts with its first value; NaN before."""
    if math.isnan(old):
        return new
    return old + min(1.0, dt / v.smoothing) * (new - old)


@jit
def _is_range(a: Altitude, height: float, v: ToolboxValues) -> bool:
    """Return whether the newest range may correct the height, m."""
    near = abs(a.range - height) <= v.sonar_gate
    lost = (abs(a.smooth_range - height) >= v.sonar_far
            and abs(a.by_pressure - height) >= v.pressure_far)
    return a.age <= v.hold and v.sonar_min < a.range <= v.sonar_max and (near or lost)


@jit
def _rise(
    a: Altitude, up: float, dt: float, sonar: float, pressure: float, rest: Rest,
    v: ToolboxValues,
) -> tuple[Altitude, float, float]:
    r"""
    Return vertical motion, innovation (m) and test ratio after a step.

    A Kalman filter of :math:`x = (h, w)` in its stationary state, P being the solution of its
    Riccati equation, so that only the gain K is left:

    .. math:: F = \begin{pmatrix} 1 & \Delta \\ 0 & 1 \end{pmatrix}, \quad H = (1, 0), \quad
              Q = \begin{pmatrix} 0 & 0 \\ 0 & q \end{pmatrix}, \quad
              K = P H^T (H P H^T + R)^{-1}

    Acceleration ``up`` in m/s^2; new range in m and pressure in Pa, NaN: none.
    """
    height, climb = a.height + dt * a.climb, a.climb + dt * up
    new = math.isfinite(sonar)
    held, age = (sonar, 0.0) if new else (a.range, a.age + dt)
    by_pressure = a.by_pressure
    if v.min_pressure <= pressure <= v.max_pressure and rest.pressures > 0:
        by_pressure = _smoothed(
            by_pressure, (rest.pressure - pressure) * v.metre_per_pascal, dt, v)
    smooth = a.smooth_range
    if not abs(held) > v.sonar_max:  # beyond any sonar's range: it would take minutes to forget
        smooth = _smoothed(smooth, held, dt, v)
    a = Altitude(height, climb, held, age, a.used_age + dt, a.refused, smooth, by_pressure)
    innovation, used_age, refused = held - height, a.used_age, a.refused
    if _is_range(a, height, v):
        height, climb = height + v.height_gain * innovation, climb + v.climb_gain * innovation
        used_age = 0.0
    elif new:
        refused += 1
    a = Altitude(
        height, climb, held, age, used_age, refused, a.smooth_range, a.by_pressure)
    if not new:
        return a, math.nan, math.nan
    ratio = innovation / v.sonar_gate
    return a, innovation, ratio * ratio


@jit
def _is_flow(
    flow: Vec2, nu: Vec2, age: float, height: float, euler: Vec3, omega: Vec3, v: ToolboxValues,
) -> bool:
    """Return whether the newest flow may correct the velocity; both (2,) m/s."""
    level = abs(euler[0]) <= v.flow_max_tilt and abs(euler[1]) <= v.flow_max_tilt
    slow = abs(omega[0]) <= v.flow_max_rate and abs(omega[1]) <= v.flow_max_rate
    calm = abs(omega[0]) <= v.flow_calm_rate and abs(omega[1]) <= v.flow_calm_rate
    near = abs(flow[0] - nu[0]) <= v.flow_gate and abs(flow[1] - nu[1]) <= v.flow_gate
    return age <= v.hold and height >= v.flow_min_height and near and (level and slow or calm)


@jit
def _move(
    m: Velocity, a: Altitude, euler: Vec3, omega: Vec3, R: Matrix3, force: Vec3, dt: float,
    new: Vec2, quality: int, v: ToolboxValues,
) -> tuple[Velocity, Vec2, float]:
    r"""
    Return horizontal motion, innovation (m/s) and test ratio after a step.

    A stationary Kalman filter of each component of the body velocity: F = H = 1 and
    :math:`K = P / (P + R)` with :math:`P = (q + \sqrt{q^2 + 4 q R}) / 2`.

    New flow in rad/s, NaN: none. Force: (3,) m/s^2, body FRD, whose gravity R takes out.
    """
    low = a.height < v.flow_min_height
    gain = dt * (v.low_acceleration_gain if low else v.acceleration_gain)
    nu = (m.nu[0] + gain * (force[0] + v.gravity * R[2][0]),
          m.nu[1] + gain * (force[1] + v.gravity * R[2][1]))
    is_new = math.isfinite(new[0]) and math.isfinite(new[1])
    flow, age, used_age, refused = m.flow, m.age + dt, m.used_age + dt, m.refused
    if is_new and quality >= v.flow_min_quality:
        flow, age = (v.flow_to_velocity * new[0], v.flow_to_velocity * new[1]), 0.0
    innovation, ratio = NAN2, math.nan
    if is_new:
        innovation = (v.flow_to_velocity * new[0] - nu[0], v.flow_to_velocity * new[1] - nu[1])
        share = max(abs(innovation[0]), abs(innovation[1])) / v.flow_gate
        ratio = share * share
    if _is_flow(flow, nu, age, a.height, euler, omega, v):
        nu = (nu[0] + v.flow_gain * (flow[0] - nu[0]), nu[1] + v.flow_gain * (flow[1] - nu[1]))
        used_age = 0.0
    elif is_new:
        refused += 1
    velocity = rotate_matrix(R, (nu[0], nu[1], downward(nu, a.climb, R)))
    position = (m.position[0] + dt * velocity[0], m.position[1] + dt * velocity[1])
    return Velocity(nu, position, flow, age, used_age, refused), innovation, ratio


@jit
def rotate_matrix(R: Matrix3, x: Vec3) -> Vec3:
    """Return R x, (3,)."""
    return (dot(R[0], x), dot(R[1], x), dot(R[2], x))


@jit
def downward(nu: Vec2, climb: float, R: Matrix3) -> float:
    """Return the body velocity along z that belongs to the others and the climb, m/s, FRD."""
    cosine = max(R[2][2], 0.1)  # not more than 84 degrees of tilt: stays finite
    return -(climb + R[2][0] * nu[0] + R[2][1] * nu[1]) / cosine


@jit
def _run(
    m: Memory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2, quality: int,
    pressure: float, invalid: int, v: ToolboxValues,
) -> tuple[Memory, Seen]:
    """Take one valid sample of the inertial sensors, and the others where they are new."""
    omega = sub(gyro, m.rest.gyro_bias)
    window = m.window[1:] + (sub(accel, m.rest.accel_bias),)
    force = filtered(window)
    euler = turned(m.euler, omega, force, dt, v)
    q = from_euler(euler[0], euler[1], euler[2])
    up = -(rotate(q, force)[2] + v.gravity)
    alt, sonar_innovation, sonar_ratio = _rise(
        m.altitude, up, dt, sonar, pressure, m.rest, v)
    vel, flow_innovation, flow_ratio = _move(
        m.velocity, alt, euler, omega, to_matrix(q), force, dt, flow, quality, v)
    return (
        Memory(m.rest, gyro, accel, window, euler, alt, vel, invalid, m.sensors),
        Seen(sonar_innovation, sonar_ratio, flow_innovation, flow_ratio))


@jit_inside
def step(
    memory: Memory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    flow_quality: int, pressure: float, values: ToolboxValues,
) -> tuple[Memory, Estimate]:
    """
    Advance the estimator by one IMU sample.

    Arguments and results are those of :func:`kalman.step`. Where gyro or accel is not finite or
    out of range the previous valid sample takes its place. Covariances are zero, unknown.
    """
    v, m = values, memory
    if not 0.0 <= dt < math.inf:
        m = Memory(m.rest, m.gyro, m.accel, m.window, m.euler, m.altitude, m.velocity,
                   m.invalid + 1, m.sensors)
        return m, _estimate(m, NOTHING, v)
    usable = (is_within(gyro, v.gyro_range), is_within(accel, v.accel_range))
    valid, resting = usable[0] and usable[1], m.rest.count < v.calibration_samples
    sensors = _observe(m, dt, gyro, accel, sonar, flow, pressure, usable, resting, v)
    invalid = m.invalid + count_broken(sonar, flow, pressure)
    invalid += (0 if valid else 1) + (1 if dt > v.max_gap else 0)
    if resting:
        rest = m.rest
        if valid:
            rest = _calibrate(rest, gyro, accel, pressure, v)
        m = Memory(rest, m.gyro, m.accel, m.window, m.euler, m.altitude, m.velocity, invalid,
                   sensors)
        return m, _estimate(m, NOTHING, v)
    m = Memory(m.rest, m.gyro, m.accel, m.window, m.euler, m.altitude, m.velocity, invalid,
               sensors)
    m, seen = _run(
        m, min(dt, v.max_gap), gyro if valid else m.gyro, accel if valid else m.accel, sonar,
        flow, flow_quality, pressure, invalid, v)
    return m, _estimate(m, seen, v)


@jit
def _observe(
    m: Memory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2, pressure: float,
    usable: tuple[bool, bool], resting: bool, v: ToolboxValues,
) -> Sensors:
    """
    Return the memory of the sensors; range and flow count as used if they may be.

    Like the package, this does not detect stuck sensors.
    """
    s, a, nu = m.sensors, m.altitude, m.velocity.nu
    near = abs(sonar - a.height) <= v.sonar_gate or resting or a.height < v.sonar_min
    x, y = v.flow_to_velocity * flow[0] - nu[0], v.flow_to_velocity * flow[1] - nu[1]
    seen = abs(x) <= v.flow_gate and abs(y) <= v.flow_gate
    flow_in_reach = a.height >= v.flow_min_height and not resting
    return observe_all(
        s, dt, gyro, accel, sonar, flow, pressure,
        (usable[0], usable[1], near and 0.0 <= sonar <= v.sonar_max, seen,
         v.min_pressure <= pressure <= v.max_pressure),
        (False, False, False, False, False), (True, flow_in_reach))


@jit
def _estimate(m: Memory, seen: Seen, v: ToolboxValues) -> Estimate:
    """Return the estimate; the rate is zero until the calibration has ended."""
    q = from_euler(m.euler[0], m.euler[1], m.euler[2])
    alt, vel = m.altitude, m.velocity
    status = status_of(
        m.rest.count < v.calibration_samples, alt.used_age, vel.used_age, v)
    omega = ZERO if status == STATUS_ALIGNING else sub(m.gyro, m.rest.gyro_bias)
    state = State(
        (vel.position[0], vel.position[1], -alt.height),
        (vel.nu[0], vel.nu[1], downward(vel.nu, alt.climb, to_matrix(q))), q, omega)
    return Estimate(
        state, UNKNOWN, UNKNOWN, status, alt.height, alt.climb, m.rest.gyro_bias,
        m.rest.accel_bias, math.nan, seen.sonar_innovation, seen.sonar_ratio,
        seen.flow_innovation, seen.flow_ratio, math.nan, math.nan, alt.refused, vel.refused, 0,
        m.invalid, health.report(m.sensors, v.limits))
