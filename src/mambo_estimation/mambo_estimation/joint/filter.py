"""
One joint error-state filter: position, velocity, attitude, biases and calibration of the sensors.

One :func:`step` per inertial sample, with the other sensors' samples where they are new, as of
:func:`mambo_estimation.kalman.step`. All errors share one covariance (:mod:`.state`), so each
measurement corrects every correlated error: flow corrects the tilt, the accelerometer the scale
of the flow, and drag the accelerometer's bias.

    predict   x = f(x, gyro, accel)     P = F P F^T + Q              :mod:`.propagation`
    correct   y = z - h(x)              S = H P H^T + R              :mod:`.flow`, :mod:`.drag`,
              K = P H^T S^-1            P = P - K S K^T              :mod:`.slant_range`,
              x = x (+) K y                                          :mod:`.pressure`

A step never fails: samples that are not finite are counted and ignored, an inertial sample that
cannot be integrated is replaced by the one before it with much more noise, implausible
measurements are refused by gates that open again (:mod:`mambo_estimation.gate`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import to_matrix
from mambo_model.motion.vector import add, scale, Vec3
import numpy as np

from . import drag, lost_force
from .. import alignment, gate, health
from ..alignment import Alignment, FLYING, Landing
from ..blocks import Vec2
from ..estimate import count_broken, Estimate, status_of
from ..health import Five, observe_all, Sensors
from ..kalman import Counts, Gates
from ..measurements import barometer as pressure_model
from ..measurements import imu
from ..measurements.samples import bridged, stuck_sensors, usable_inertial
from .answer import (
    NONE2, NOT_COMPARED, NOTHING, pose_covariance, Results, state_of, twist_covariance)
from .flow import remember, RING
from .joint_parameters import JointValues
from .propagation import bridge, predict, wander
from .start import aligned, unaligned
from .state import Array, forget_heading, Nominal, VELOCITY
from .update import Noise, use_drag, use_flow, use_pressure, use_range, use_rest
from .vibration import CALM, left, shaken, variance, Vibration

ZERO: Vec3 = (0.0, 0.0, 0.0)


class Memory(NamedTuple):
    """Memory of the filter between steps."""

    aligning: bool
    resting: bool        # on the floor: aligned and not moved since, or landed
    alignment: Alignment
    landing: Landing
    x: Nominal
    P: Array             # (23, 23) covariance of the error state
    ring: Array          # (RING, 7) gyro, force and dt of the last steps
    at: int              # where the next step goes
    has_pressure: bool
    window: drag.Window
    shake: Vibration
    noise: Noise
    gates: Gates
    counts: Counts
    gyro: Vec3           # (3,) rad/s, body FRD, the last valid sample
    accel: Vec3          # (3,) m/s^2, body FRD, the last valid sample
    sensors: Sensors


@jit
def initial(v: JointValues) -> Memory:
    """
    Return the initial memory: on the floor, level, yaw 0, with wide defaults.

    The filter then collects samples at rest.
    """
    x, P = unaligned(alignment.EMPTY, v)
    sonar, flow, air = v.sonar.noise, v.optical_flow.noise, v.barometer.noise
    return Memory(
        True, False, alignment.EMPTY, FLYING, x, P, np.zeros((RING, 7)), 0, False, drag.EMPTY,
        CALM,
        Noise(sonar * sonar, flow * flow, air * air), Gates(gate.OPEN, gate.OPEN, gate.OPEN),
        Counts(0, 0, math.inf, math.inf), ZERO, (0.0, 0.0, -v.gravity), health.START)


@jit
def _align(m: Memory, gyro: Vec3, accel: Vec3, dt: float, v: JointValues) -> Memory:
    """Collect one valid sample at rest; start the filter when there are enough."""
    rest, verdict = alignment.collect(m.alignment, gyro, accel, dt, v.gravity, v.alignment)
    x, P = m.x, m.P
    if verdict == alignment.MOVED:
        rest = alignment.fall_back(rest, v.alignment)
        x, P = unaligned(rest, v)
    if verdict == alignment.ALIGNED:
        x, P = aligned(rest, v)
    return Memory(
        verdict == alignment.COLLECTING, verdict == alignment.ALIGNED, rest, FLYING, x, P, m.ring,
        m.at, m.has_pressure, m.window, m.shake, m.noise, m.gates, m.counts, gyro, accel,
        m.sensors)


@jit
def _replay(x: Nominal, P: Array, ring: Array, at: int, v: JointValues) -> Nominal:
    """
    Return the state after all steps in the ring, once motion is detected.

    Motion is detected about 0.1 s late. The state is held until then, so no motion is lost.
    """
    for k in range(RING):
        row = ring[(at + k) % RING]
        if row[6] > 0.0:
            x = predict(x, P, (row[0], row[1], row[2]), (row[3], row[4], row[5]), row[6],
                        (0.0, 0.0), v)
    return x


@jit
def _advance(
    m: Memory, P: Array, ring: Array, dt: float, gyro: Vec3, accel: Vec3,
    held: tuple[float, float], v: JointValues,
) -> tuple[Alignment, bool, Nominal, drag.Window, Vibration]:
    """
    Use one inertial sample: remain at rest, start to move, or integrate the motion.

    Rate and drag change evenly from sample to sample; the thrust, along body z, is held. Over a
    gap a controlled vehicle turns to and fro.

    Return rest, whether it goes on, state, drag and vibration; ``P`` and ``ring`` change in place.
    """
    rate = scale(0.5, add(m.gyro, gyro))
    force = (0.5 * (m.accel[0] + accel[0]), 0.5 * (m.accel[1] + accel[1]), accel[2])
    if dt > v.imu.max_interval:
        share = bridge(dt, v.motion.held_time)
        rate = add(scale(share, rate), scale(1.0 - share, m.x.gyro_bias))
    remember(ring, m.at, rate, force, dt)
    rest, resting, x, window = m.alignment, m.resting, m.x, m.window
    if resting:
        rest, resting = alignment.watch(rest, gyro, accel, dt, v.alignment)
        if not resting:
            return rest, False, _replay(x, P, ring, (m.at + 1) % RING, v), window, CALM
        wander(P, dt, v)
        return rest, True, x, window, CALM
    x = _bounded(predict(x, P, rate, force, dt, held, v), v)
    forget_heading(P)
    if held[0] > 0.0 or held[1] > 0.0 or -x.p[2] < v.drag.min_height:
        return rest, False, x, drag.EMPTY, CALM
    return (rest, False, x, drag.accumulate(window, m.x, x, force, dt),
            shaken(m.shake, x, force, dt))


@jit
def _bounded(x: Nominal, v: JointValues) -> Nominal:
    """
    Return the state limited to heights not below the floor.

    An estimate at the lowest height does not descend. The covariance is unchanged, so that the
    gates can still open.
    """
    if x.p[2] <= v.motion.floor_depth:
        return x
    return Nominal(
        (x.p[0], x.p[1], v.motion.floor_depth), (x.v[0], x.v[1], min(x.v[2], 0.0)), x.q,
        x.gyro_bias, x.accel_bias, x.scale, x.slope, x.drag, x.latency, x.leak, x.range_offset,
        x.pressure_offset)


@jit
def _run(
    m: Memory, counts: Counts, dt: float, gyro: Vec3, accel: Vec3, held: tuple[float, float],
    trusted: float, sonar: float, flow: Vec2, quality: int, pressure: float, v: JointValues,
) -> tuple[Memory, Results]:
    """
    Predict, with rates and forces that may be held, then use every sample there is.

    ``trusted`` is the variance of the velocity by wrong forces that were believed, m^2/s^2.
    """
    P, ring = m.P.copy(), m.ring.copy()
    for i in range(VELOCITY, VELOCITY + 3):
        P[i, i] += 0.0 if m.resting else trusted
    rest, resting, x, window, shake = _advance(m, P, ring, dt, gyro, accel, held, v)
    at, noise, has_pressure = (m.at + 1) % RING, m.noise, m.has_pressure
    sonar_gate = gate.advance(m.gates.sonar, dt)
    flow_gate = gate.advance(m.gates.flow, dt)
    barometer_gate = gate.advance(m.gates.barometer, dt)
    sonar_age, flow_age = counts.sonar_age + dt, counts.flow_age + dt
    ranged, seen, weighed = NOT_COMPARED, NOT_COMPARED, NOT_COMPARED
    if v.drag.enabled and window.time >= v.drag.window:
        x = use_drag(x, P, window, v)
        window = drag.EMPTY
    if math.isfinite(sonar):
        x, sonar_gate, noise, ranged = use_range(x, P, sonar_gate, sonar, noise, v)
        sonar_age = 0.0 if ranged.used else sonar_age
    if v.barometer.enabled and math.isfinite(pressure):
        x, barometer_gate, noise, weighed = use_pressure(
            x, P, barometer_gate, pressure, noise, has_pressure, v)
        has_pressure = has_pressure or pressure_model.is_valid(pressure, v.barometer)
    if math.isfinite(flow[0]) and math.isfinite(flow[1]):
        x, flow_gate, noise, seen = use_flow(
            x, P, ring, at, flow_gate, flow, quality, noise,
            variance(m.sensors.accel, dt), v)
        flow_age = 0.0 if seen.used else flow_age
    landing, rest, stands = alignment.land(
        m.landing, rest, resting, sonar, v.sonar.min_range, -x.p[2], -x.v[2], gyro, accel,
        held[0] == 0.0 and held[1] == 0.0, dt, v.gravity, v.alignment)
    if stands and not resting:
        x = use_rest(x, P, v)
        window = drag.EMPTY
    return Memory(
        False, stands, rest, landing, x, P, ring, at, has_pressure, window, shake, noise,
        Gates(sonar_gate, flow_gate, barometer_gate),
        Counts(counts.invalid, counts.equal, sonar_age, flow_age), gyro, accel,
        m.sensors), Results(ranged, seen, weighed)


@jit
def step(
    memory: Memory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    flow_quality: int, pressure: float, values: JointValues,
) -> tuple[Memory, Estimate]:
    """
    Advance the filter by one inertial sample.

    Arguments and result as of :func:`mambo_estimation.kalman.step`; ``memory`` is not changed.
    """
    v, m = values, memory
    if not 0.0 <= dt < math.inf:
        m = _with_counts(m, 1, m.counts.equal)
        return m, _estimate(m, NOTHING, 0.0, v)
    sensors, equal = m.sensors, m.counts.equal + 1 if imu.is_equal(gyro, m.gyro) else 0
    stuck = stuck_sensors(
        sensors, not (m.aligning or m.resting), equal, gyro, accel, sonar, flow, pressure, v)
    usable = usable_inertial(sensors, dt, gyro, accel, stuck, v.imu)
    valid = usable[0] and usable[1]
    invalid = count_broken(sonar, flow, pressure)
    invalid += (0 if valid else 1) + (1 if dt > v.imu.max_gap else 0)
    m = _with_counts(m, invalid, equal)
    results = NOTHING
    if m.aligning:
        if valid:
            m = _align(m, gyro, accel, dt, v)
    else:
        lost = 1.0 - bridge(dt, v.motion.held_time) if dt > v.imu.max_interval else 0.0
        gyro_used, accel_used = bridged(
            sensors, dt, gyro, accel, usable, (m.gyro, m.accel),
            (m.x.gyro_bias, m.x.accel_bias), v.gravity, v.imu)
        trusted = 0.0
        if not usable[1]:
            accel_used = lost_force.expected(
                m.x, m.accel, sensors.accel, accel, stuck[1], dt, v)
            trusted = lost_force.trusted(sensors.accel, accel, stuck[1], dt, v)
        m, results = _run(
            m, m.counts, min(dt, v.imu.max_gap), gyro_used, accel_used,
            (lost if usable[0] else 1.0, lost if usable[1] else 1.0), trusted,
            math.nan if stuck[2] else sonar,
            NONE2 if stuck[3] else flow, flow_quality, math.nan if stuck[4] else pressure, v)
    m = _with_sensors(
        m, _observe(m, results, dt, gyro, accel, sonar, flow, pressure, usable, stuck, v))
    return m, _estimate(m, results, dt, v)


@jit
def _observe(
    m: Memory, results: Results, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    pressure: float, usable: tuple[bool, bool], stuck: Five, v: JointValues,
) -> Sensors:
    """Return the memory of the sensors after a step; at rest no sample is required."""
    cosine, height = to_matrix(m.x.q)[2][2], -m.x.p[2]
    ranged, weighed = results.sonar.used, results.barometer.used
    if m.aligning:
        ranged = math.isfinite(sonar)
    if m.aligning or not v.barometer.enabled:
        weighed = pressure_model.is_valid(pressure, v.barometer) and not stuck[4]
    flow_in_reach = height >= v.optical_flow.min_height and cosine >= v.optical_flow.min_tilt_cos
    sonar_in_reach = height <= v.sonar.max_range * cosine and cosine >= v.sonar.min_tilt_cos
    return observe_all(
        m.sensors, dt, gyro, accel, sonar, flow, pressure,
        (usable[0], usable[1], ranged, results.flow.used, weighed), stuck,
        (sonar_in_reach, flow_in_reach and not m.aligning))


@jit
def _with_counts(m: Memory, invalid: int, equal: int) -> Memory:
    """Return the memory with more invalid samples."""
    counts = Counts(m.counts.invalid + invalid, equal, m.counts.sonar_age, m.counts.flow_age)
    return Memory(
        m.aligning, m.resting, m.alignment, m.landing, m.x, m.P, m.ring, m.at, m.has_pressure,
        m.window, m.shake, m.noise, m.gates, counts, m.gyro, m.accel, m.sensors)


@jit
def _with_sensors(m: Memory, sensors: Sensors) -> Memory:
    return Memory(
        m.aligning, m.resting, m.alignment, m.landing, m.x, m.P, m.ring, m.at, m.has_pressure,
        m.window, m.shake, m.noise, m.gates, m.counts, m.gyro, m.accel, sensors)


@jit
def _estimate(m: Memory, results: Results, dt: float, v: JointValues) -> Estimate:
    """Return the estimate after a step of dt, s."""
    x, ranged, seen, weighed = m.x, results.sonar, results.flow, results.barometer
    return Estimate(
        state_of(x, m.gyro, m.shake.velocity, m.aligning), pose_covariance(m.P),
        twist_covariance(m.P, x, m.sensors, left(m.shake, m.sensors.accel, dt), v.motion),
        status_of(m.aligning, m.counts.sonar_age, m.counts.flow_age, v), -x.p[2], -x.v[2],
        x.gyro_bias, x.accel_bias, x.pressure_offset if m.has_pressure else math.nan,
        ranged.innovation[0], ranged.ratio, seen.innovation, seen.ratio, weighed.innovation[0],
        weighed.ratio, m.gates.sonar.refused, m.gates.flow.refused, m.gates.barometer.refused,
        m.counts.invalid, health.report(m.sensors, v.limits))
