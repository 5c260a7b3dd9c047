r"""
State estimator of thesis figure 5.1: attitude, altitude, horizontal velocity, position.

One :func:`step` per IMU sample, with the other sensors' samples where they are new. Three filters
in cascade, each using the result of the one before:

    gyro, specific force -> attitude -> altitude (sonar, barometer)
                                     -> velocity and position (optical flow (5.2) with C8)
    velocity by flow     -> attitude (gravity windows)

Everything is NED and FRD. A step never fails: samples that are not finite are counted and
ignored, an IMU sample that may not be integrated is replaced by the one before it with much more
noise, and implausible samples are refused by gates that can recover (:mod:`.gate`).

Covariances are in the order of ``geometry_msgs``: (x, y, z, rotation about x, y, z), row by row.
Pose: both blocks in inertial axes, the rotation being delta of ``q_true = exp(delta) q``, as
``nav_msgs/Odometry`` wants it (fixed axes of the header's frame). Twist: both blocks in body axes
(child frame). Blocks off the diagonal: position with rotation only by the yaw, which turns the
path; the filters being separate, the rest is not known and zero. Height, vertical velocity and
tilt: scaled by how well the filters' own covariances fit the innovations (:mod:`.fit`). Body rate:
uncertainty of the bias, and noise of a sample as the gyro shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.quaternion import IDENTITY, rotate, rotate_inverse, to_matrix
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, scale, sub, Vec3
from mambo_model.schema import group
from mambo_model.values import values_type

from . import alignment, altitude, attitude, gate, health, velocity
from .alignment import Alignment, AlignmentParams, AlignmentValues, FLYING, Landing
from .altitude import Altitude, AltitudeParams
from .attitude import Attitude, AttitudeParams, AttitudeValues
from .blocks import Matrix3, Vec2
from .estimate import count_broken, Estimate, status_of
from .gate import Gate
from .health import AgeParams, observe_all, Sensors
from .measurements import barometer, imu, optical_flow
from .measurements.barometer import BarometerParams
from .measurements.imu import ImuParams
from .measurements.optical_flow import FlowParams
from .measurements.samples import bridged, stuck_sensors, usable_inertial
from .measurements.sonar import SonarParams
from .velocity import Velocity, VelocityParams


@dataclass(frozen=True)
class EstimatorParams(AgeParams):
    """Parameters of the estimator: one group per filter and per sensor."""

    alignment: AlignmentParams = group(AlignmentParams)
    attitude: AttitudeParams = group(AttitudeParams)
    altitude: AltitudeParams = group(AltitudeParams)
    velocity: VelocityParams = group(VelocityParams)
    imu: ImuParams = group(ImuParams)
    sonar: SonarParams = group(SonarParams)
    optical_flow: FlowParams = group(FlowParams)
    barometer: BarometerParams = group(BarometerParams)


EstimatorValues = values_type(EstimatorParams)


class Counts(NamedTuple):
    """Unused samples and ages."""

    invalid: int       # [-] samples of any sensor that could not be read
    equal: int         # [-] rates in a row equal to the one before
    sonar_age: float   # s, since a range was used
    flow_age: float    # s, since a flow sample was used


class Gates(NamedTuple):
    """Memory of the three gates."""

    sonar: Gate  # of the range
    flow: Gate   # of the body velocity
    barometer: Gate  # of the height by pressure


class Memory(NamedTuple):
    """Memory of the estimator between steps."""

    aligning: bool       # still collecting samples at rest
    resting: bool        # on the floor: aligned and not moved since, or landed
    alignment: Alignment  # what they have shown
    landing: Landing     # whether it has come to rest again
    attitude: Attitude   # attitude filter
    altitude: Altitude   # altitude filter
    velocity: Velocity   # velocity filter
    gates: Gates         # of the measurements
    counts: Counts       # of what was not used
    gyro: Vec3           # (3,) rad/s, body FRD, the last valid sample
    accel: Vec3          # (3,) m/s^2, body FRD, the last valid sample
    force: Vec3          # (3,) m/s^2, inertial NED, the same turned at its time
    sensors: Sensors     # their health


class Results(NamedTuple):
    """Results of the measurement updates of one step."""

    sonar: altitude.Result  # of the range
    flow: velocity.Result   # of the flow
    barometer: altitude.Result  # of the pressure


NOTHING = Results(altitude.NOT_COMPARED, velocity.NOT_COMPARED, altitude.NOT_COMPARED)
ZERO: Vec3 = (0.0, 0.0, 0.0)
NONE2: Vec2 = (math.nan, math.nan)


@jit
def initial(values: EstimatorValues) -> Memory:
    """
    Return the initial memory: on the floor, level, yaw 0, with wide defaults.

    The estimator then collects samples at rest.
    """
    v = values
    tilt, bias = v.attitude.initial_tilt_std, v.attitude.initial_gyro_bias_std
    vertical, horizontal = v.altitude.initial_velocity_std, v.velocity.initial_velocity_std
    hidden = v.alignment.accel_bias_std / v.gravity
    return Memory(
        True, False, alignment.EMPTY, FLYING,
        attitude.start(
            IDENTITY, v.alignment.gyro_bias, tilt * tilt, bias * bias, hidden, v.attitude),
        altitude.start(vertical * vertical, v.altitude.initial_accel_bias_std, v.altitude),
        velocity.start(horizontal * horizontal, v.velocity.initial_accel_bias_std, v.velocity),
        Gates(gate.OPEN, gate.OPEN, gate.OPEN), Counts(0, 0, math.inf, math.inf),
        ZERO, (0.0, 0.0, -v.gravity), (0.0, 0.0, -v.gravity), health.START)


@jit
def _align(m: Memory, gyro: Vec3, accel: Vec3, dt: float, v: EstimatorValues) -> Memory:
    """Collect one valid sample at rest; start the filters when there are enough."""
    rest, verdict = alignment.collect(
        m.alignment, gyro, accel, dt, v.gravity, v.alignment)
    att, alt, vel = m.attitude, m.altitude, m.velocity
    if verdict == alignment.MOVED:
        rest = alignment.fall_back(rest, v.alignment)
    if verdict == alignment.ALIGNED:
        here = alignment.level(rest.accel, v.gravity, v.alignment)
        tilt = math.sqrt(
            v.attitude.window_accel_noise * v.attitude.window_accel_noise
            + rest.noise.accel / (3.0 * rest.count)) / v.gravity
        bias = alignment.gyro_bias_variance(rest, v.alignment)
        still = v.alignment.rest_velocity_std * v.alignment.rest_velocity_std
        att = attitude.start(here.q, rest.gyro, tilt * tilt, bias, here.tilt_std, v.attitude)
        alt = altitude.start(still, v.altitude.accel_bias_std, v.altitude)
        vel = velocity.start(still, v.velocity.accel_bias_std, v.velocity)
    return Memory(
        verdict == alignment.COLLECTING, verdict == alignment.ALIGNED, rest, FLYING, att, alt, vel,
        m.gates, m.counts, gyro, accel, rotate(att.q, sub(accel, rest.accel_bias)), m.sensors)


@jit
def _predict_attitude(
    att: Attitude, last_gyro: Vec3, gyro: Vec3, last_force: Vec3, accel: Vec3, dt: float,
    held: bool, force_held: bool, gravity: float, v: AttitudeValues,
) -> tuple[Attitude, Vec3, Vec3]:
    """
    Integrate the gyro; return also force now and mean acceleration, (3,) m/s^2, inertial NED.

    ``accel`` is as calibrated at start. The trapezoidal rule takes the mean of two samples.
    """
    rate = scale(0.5, add(last_gyro, gyro))
    att = attitude.predict(att, rate, dt, held, v)
    force = rotate(att.q, accel)
    mean = scale(0.5, add(last_force, force))
    acceleration = (mean[0], mean[1], mean[2] + gravity)
    window = attitude.NO_WINDOW
    if not (held or force_held):
        window = attitude.accumulate(att.window, acceleration, sub(rate, att.bias), dt)
    return attitude.with_window(att, window), force, acceleration


@jit
def _rest(
    m: Alignment, alt: Altitude, vel: Velocity, gyro: Vec3, accel: Vec3, dt: float,
    v: AlignmentValues,
) -> tuple[Alignment, bool, Altitude, Velocity]:
    """Hold the velocity at zero as long as the aligned vehicle has not moved."""
    m, resting = alignment.watch(m, gyro, accel, dt, v)
    if resting:
        still = v.rest_velocity_std * v.rest_velocity_std
        return m, True, altitude.hold_still(alt, still), velocity.hold_still(vel, still)
    left = v.leave_velocity_std * v.leave_velocity_std
    return m, False, altitude.widen(alt, left, 0.0), velocity.widen(vel, left)


@jit
def _use_flow(
    att: Attitude, alt: Altitude, vel: Velocity, old: Gate, flow: Vec2, quality: int, gyro: Vec3,
    v: EstimatorValues,
) -> tuple[Attitude, Velocity, Gate, velocity.Result]:
    """Use a finite flow sample for the velocity, and for the gravity window."""
    R, p = to_matrix(att.q), v.optical_flow
    if not optical_flow.is_valid(flow, alt.height, R[2][2], quality, p):
        return att, vel, gate.refuse_invalid(old), velocity.NOT_COMPARED
    nu, std = optical_flow.measured_velocity(flow, alt.height, R[2][2], sub(gyro, att.bias), p)
    vel, new, result = velocity.update_flow(
        vel, old, flow, nu, std, alt.height, alt.P.hh, -alt.velocity, R, attitude.yaw_std(att), p,
        v.velocity)
    if result.used and not (att.window.aided and att.window.time < v.attitude.window):
        att = _next_window(
            att, nu, std, -alt.velocity, R, v.gravity, p.scale_std, v.attitude)
    return att, vel, new, result


@jit
def _next_window(
    att: Attitude, nu: Vec2, std: float, v_z: float, R: Matrix3, gravity: float,
    scale_std: float, v: AttitudeValues,
) -> Attitude:
    """Start a gravity window at this velocity by flow, after ending one that flow started."""
    variance = std * std + v.window_velocity_noise * v.window_velocity_noise
    if att.window.aided:
        end = optical_flow.inertial_velocity(nu, v_z, R)
        tilt, spread = attitude.aided_tilt(att.window, end, variance, scale_std, gravity, v)
        att = attitude.update_tilt(att, tilt, spread, att.window.time, v.gate)
        R = to_matrix(att.q)
    start = optical_flow.inertial_velocity(nu, v_z, R)
    return attitude.with_window(att, attitude.restart(start, variance))


@jit
def _end_unaided(att: Attitude, resting: bool, gravity: float, v: AttitudeValues) -> Attitude:
    """End a gravity window that no flow will end: none started it, or none has come since."""
    length = v.window * (2.0 if att.window.aided else 1.0)
    if att.window.time < length:
        return att
    tilt, spread = attitude.unaided_tilt(att.window, resting, gravity, v)
    att = attitude.update_tilt(att, tilt, spread, att.window.time, v.gate)
    return attitude.with_window(att, attitude.NO_WINDOW)


@jit_inside
def _run(
    m: Memory, counts: Counts, dt: float, gyro: Vec3, accel: Vec3, held: tuple[bool, bool],
    sonar: float, flow: Vec2, quality: int, pressure: float, v: EstimatorValues,
) -> tuple[Memory, Results]:
    """Predict, with rates and forces that may be held, then use every sample there is."""
    rest, resting = m.alignment, m.resting
    calibrated = sub(accel, rest.accel_bias)
    att, force, a = _predict_attitude(
        m.attitude, m.gyro, gyro, m.force, calibrated, dt, held[0], held[1], v.gravity,
        v.attitude)
    R, yaw_std = to_matrix(att.q), attitude.yaw_std(att)
    b = m.velocity.accel_bias
    a = sub(a, rotate(att.q, (b[0], b[1], m.altitude.accel_bias)))
    alt = altitude.predict(
        m.altitude, -a[2], R[2][2], dt, held[1], v.barometer.offset_walk, v.altitude)
    alt = altitude.bounded(alt, v.altitude)
    vel = velocity.predict(m.velocity, (a[0], a[1]), R, yaw_std, dt, held[1], v.velocity)
    if resting:
        rest, resting, alt, vel = _rest(rest, alt, vel, gyro, accel, dt, v.alignment)
    sonar_gate = gate.advance(m.gates.sonar, dt)
    flow_gate = gate.advance(m.gates.flow, dt)
    barometer_gate = gate.advance(m.gates.barometer, dt)
    sonar_age, flow_age = counts.sonar_age + dt, counts.flow_age + dt
    ranged, weighed = altitude.NOT_COMPARED, altitude.NOT_COMPARED
    seen = velocity.NOT_COMPARED
    if math.isfinite(sonar):
        alt, sonar_gate, ranged = altitude.update_sonar(
            alt, sonar_gate, sonar, R[2][2], attitude.tilt_variance(att), v.sonar, v.altitude)
        sonar_age = 0.0 if ranged.used else sonar_age
    if v.barometer.enabled and math.isfinite(pressure):
        alt, barometer_gate, weighed = altitude.update_barometer(
            alt, barometer_gate, pressure, v.barometer)
    if math.isfinite(flow[0]) and math.isfinite(flow[1]):
        att, vel, flow_gate, seen = _use_flow(
            att, alt, vel, flow_gate, flow, quality, gyro, v)
        flow_age = 0.0 if seen.used else flow_age
    att = _end_unaided(att, resting, v.gravity, v.attitude)
    landing, rest, resting = alignment.land(
        m.landing, rest, resting, sonar, v.sonar.min_range, alt.height, alt.velocity, gyro, accel,
        not (held[0] or held[1]), dt, v.gravity, v.alignment)
    return Memory(
        False, resting, rest, landing, att, alt, vel, Gates(sonar_gate, flow_gate, barometer_gate),
        Counts(counts.invalid, counts.equal, sonar_age, flow_age), gyro, accel,
        force, m.sensors), Results(ranged, seen, weighed)


@jit_inside
def step(
    memory: Memory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    flow_quality: int, pressure: float, values: EstimatorValues,
) -> tuple[Memory, Estimate]:
    """
    Advance the estimator by one IMU sample.

    Parameters
    ----------
    memory
        Result of the previous call, at first :func:`initial`.
    dt : s
        Since the previous IMU sample, 0 at the first. A negative one or one that is not finite is
        counted, and the whole step ignored.
    gyro : (3,) rad/s, body FRD
        Bias included.
    accel : (3,) m/s^2, body FRD
        Specific force, bias included. Where gyro or accel is not finite, out of range, stuck or
        wild another takes its place, with much more noise.
    sonar : m
        New slant range, NaN: none. Infinite: counted as invalid.
    flow : (2,) rad/s, body FRD
        New line-of-sight rate along x and y with the sign of the vehicle's motion, NaN: none.
        Infinite, or only one of them NaN: counted as invalid.
    flow_quality : 0..255
        Of the flow, any where there is none.
    pressure : Pa
        New static pressure, NaN: none. Infinite: counted as invalid.
    values
        ``EstimatorParams.values()``.

    Returns
    -------
    memory
        To be passed to the next call.
    estimate
        At the time of the IMU sample.

    """
    v, m = values, memory
    if not 0.0 <= dt < math.inf:
        m = _with_counts(m, 1, m.counts.equal)
        return m, _estimate(m, NOTHING, v)
    sensors, equal = m.sensors, m.counts.equal + 1 if imu.is_equal(gyro, m.gyro) else 0
    stuck = stuck_sensors(
        sensors, not (m.aligning or m.resting), equal, gyro, accel, sonar, flow, pressure, v)
    usable = usable_inertial(sensors, dt, gyro, accel, stuck, v.imu)
    valid = usable[0] and usable[1]
    invalid = count_broken(sonar, flow, pressure)
    invalid += (0 if valid else 1) + (1 if dt > v.imu.max_gap else 0)
    if m.aligning:
        m = _with_counts(m, invalid, equal)
        if valid:
            m = _align(m, gyro, accel, dt, v)
        m = _with_sensors(
            m, _observe(m, NOTHING, dt, gyro, accel, sonar, flow, pressure, usable, stuck, v))
        return m, _estimate(m, NOTHING, v)
    late = dt > v.imu.max_interval
    held = (late or not usable[0], late or not valid)
    gyro_used, accel_used = bridged(
        sensors, dt, gyro, accel, usable, (m.gyro, m.accel),
        (m.attitude.bias, m.alignment.accel_bias), v.gravity, v.imu)
    counts = Counts(
        m.counts.invalid + invalid, equal, m.counts.sonar_age, m.counts.flow_age)
    m, results = _run(
        m, counts, min(dt, v.imu.max_gap), gyro_used, accel_used, held,
        math.nan if stuck[2] else sonar, NONE2 if stuck[3] else flow, flow_quality,
        math.nan if stuck[4] else pressure, v)
    m = _with_sensors(
        m, _observe(m, results, dt, gyro, accel, sonar, flow, pressure, usable, stuck, v))
    return m, _estimate(m, results, v)


@jit_inside
def _observe(
    m: Memory, results: Results, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    pressure: float, usable: tuple[bool, bool], stuck: tuple[bool, bool, bool, bool, bool],
    v: EstimatorValues,
) -> Sensors:
    """Return the memory of the sensors after a step; at rest no sample is required."""
    s, cosine, height = m.sensors, to_matrix(m.attitude.q)[2][2], m.altitude.height
    ranged, weighed = results.sonar.used, results.barometer.used
    if m.aligning:
        ranged = math.isfinite(sonar)
    if m.aligning or not v.barometer.enabled:
        weighed = barometer.is_valid(pressure, v.barometer) and not stuck[4]
    flow_in_reach = height >= v.optical_flow.min_height and cosine >= v.optical_flow.min_tilt_cos
    sonar_in_reach = height <= v.sonar.max_range * cosine and cosine >= v.sonar.min_tilt_cos
    return observe_all(
        s, dt, gyro, accel, sonar, flow, pressure,
        (usable[0], usable[1], ranged, results.flow.used, weighed), stuck,
        (sonar_in_reach, flow_in_reach and not m.aligning))


@jit
def _with_counts(m: Memory, invalid: int, equal: int) -> Memory:
    """Return the memory with more invalid samples."""
    counts = Counts(
        m.counts.invalid + invalid, equal, m.counts.sonar_age, m.counts.flow_age)
    return Memory(
        m.aligning, m.resting, m.alignment, m.landing, m.attitude, m.altitude, m.velocity,
        m.gates, counts, m.gyro, m.accel, m.force, m.sensors)


@jit
def _with_sensors(m: Memory, sensors: Sensors) -> Memory:
    return Memory(
        m.aligning, m.resting, m.alignment, m.landing, m.attitude, m.altitude, m.velocity,
        m.gates, m.counts, m.gyro, m.accel, m.force, sensors)


@jit
def _state(m: Memory) -> State:
    alt, vel, q = m.altitude, m.velocity, m.attitude.q
    omega = ZERO if m.aligning else sub(m.gyro, m.attitude.bias)
    return State(
        (vel.position[0], vel.position[1], -alt.height),
        rotate_inverse(q, (vel.velocity[0], vel.velocity[1], -alt.velocity)), q, omega)


@jit
def _pose_covariance(m: Memory, r: Matrix3, height: float) -> tuple[float, ...]:
    """
    Return the (36,) covariance of position and rotation, inertial axes, m and rad.

    That of the rotation, rad^2, and the variance of the height, m^2, are the published ones.
    """
    att, vel = m.attitude, m.velocity
    P = velocity.position_covariance(vel)
    # An error of yaw turns the path; the tilt goes with it as far as it is correlated with yaw.
    by_yaw = scale(-1.0 / attitude.yaw_std(att), r[2])
    x, y = scale(vel.yaw.p[0], by_yaw), scale(vel.yaw.p[1], by_yaw)
    return (
        P[0][0], P[0][1], 0.0, x[0], x[1], x[2], P[1][0], P[1][1], 0.0, y[0], y[1], y[2],
        0.0, 0.0, height, 0.0, 0.0, 0.0, x[0], y[0], 0.0, r[0][0], r[0][1], r[0][2],
        x[1], y[1], 0.0, r[1][0], r[1][1], r[1][2], x[2], y[2], 0.0, r[2][0], r[2][1], r[2][2])


@jit
def _twist_covariance(
    m: Memory, r: Matrix3, climb: float, v: AttitudeValues,
) -> tuple[float, ...]:
    """
    Return the (36,) covariance of velocity and angular velocity, body axes, m/s and rad/s.

    That of the rotation, rad^2, and the variance of the vertical velocity, m^2/s^2, are the
    published ones.
    """
    att = m.attitude
    C = velocity.body_velocity_covariance(m.velocity, climb, to_matrix(att.q), r)
    unknown = v.lost_rate_growth * m.sensors.gyro.age
    least, seen, w = v.rate_noise * v.rate_noise, m.sensors.gyro.noise, att.P_bb
    x, y, z = (
        w[0][0] + unknown * unknown + max(seen[0], least),
        w[1][1] + unknown * unknown + max(seen[1], least),
        w[2][2] + unknown * unknown + max(seen[2], least))
    return (
        C[0][0], C[0][1], C[0][2], 0.0, 0.0, 0.0, C[1][0], C[1][1], C[1][2], 0.0, 0.0, 0.0,
        C[2][0], C[2][1], C[2][2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, x, w[0][1],
        w[0][2], 0.0, 0.0, 0.0, w[1][0], y, w[1][2],
        0.0, 0.0, 0.0, w[2][0], w[2][1], z)


@jit
def _estimate(m: Memory, results: Results, v: EstimatorValues) -> Estimate:
    """Return the estimate."""
    alt, b = m.altitude, m.velocity.accel_bias
    accel_bias = add(m.alignment.accel_bias, (b[0], b[1], alt.accel_bias))
    r = attitude.published_covariance(m.attitude, m.counts.flow_age)
    height, climb = altitude.published_variances(alt, m.counts.sonar_age)
    return Estimate(
        _state(m), _pose_covariance(m, r, height), _twist_covariance(m, r, climb, v.attitude),
        status_of(m.aligning, m.counts.sonar_age, m.counts.flow_age, v),
        alt.height, alt.velocity, m.attitude.bias, accel_bias,
        alt.offset if alt.has_offset else math.nan, results.sonar.innovation,
        results.sonar.ratio, results.flow.innovation, results.flow.ratio,
        results.barometer.innovation, results.barometer.ratio, m.gates.sonar.refused,
        m.gates.flow.refused, m.gates.barometer.refused, m.counts.invalid,
        health.report(m.sensors, v.limits))
