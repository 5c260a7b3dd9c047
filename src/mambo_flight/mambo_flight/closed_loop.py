"""
The whole flight in one process: the graph's compiled steps in one compiled loop, no middleware.

At each control step the sensors are read, the estimator and the flight plan are updated, the
controller computes the motor commands, and the vehicle moves. The steps, their order and all
numbers are those of the graph in lockstep, to the last bit (tested).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from mambo_control import controllers, failsafe
from mambo_control.commanded.evaluation import CommandedValues, reference_step
from mambo_estimation import filters
from mambo_estimation.estimate import Estimate
from mambo_model.compiled import hold, jit, memory_of
from mambo_model.motion.flatness import body_velocity
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import PlanValues
from mambo_model.motion.vector import Vec3
from mambo_model.vehicle.parameters import VehicleValues
from mambo_sim import pushed, simulator
from mambo_sim.faults import in_time
from mambo_sim.parameters import STEP_NS
from mambo_sim.sensors import optitrack
import numpy as np
from numpy.typing import NDArray

from . import changes
from .capture_columns import store_located, WIDTH
from .scenario import Scenario

Array = NDArray[np.float64]


class Inner(NamedTuple):
    """Further columns that only a bag needs, row k at t[k]; vectors inertial NED or body FRD."""

    sonar: Array  # (n,) m, as published, out of range too; NaN without a sample
    plan: Array  # (n, 19) of the reference: v, a, j, s, omega_dot, f, tau
    pose_covariance: Array  # (n, 36); zero for the ground truth
    twist_covariance: Array  # (n, 36)
    estimator: Array  # (n, 36) in the order of messages.estimator_state
    controller: Array  # (n, 35) in the order of messages.controller_state
    health: Array  # (n, 8) failsafe: stage, reason; motion capture: tracked, visible markers,
    # frames, lost, dropped; failsafe: phase


class Recording(NamedTuple):
    """
    One flight as arrays, inertial NED and body FRD; row k is the control step at t[k].

    A state row is rho (3) m, nu (3) m/s body, q (4) w x y z, omega (3) rad/s body.
    """

    t: NDArray[np.int64]  # (n,) ns
    truth: Array  # (n, 13)
    estimate: Array  # (n, 13)
    reference: Array  # (n, 13), with nu = q* (.) v
    phase: NDArray[np.int64]  # (n,) of the flight plan
    thrust: Array  # (n,) N, commanded (3.20)
    pwm: Array  # (n, 4)
    pose: Array  # (n, 7) Optitrack position and quaternion, NaN without a pose
    pose_t: NDArray[np.int64]  # (n,) ns, stamp of the pose
    imu: Array  # (n, 6) gyro rad/s and specific force m/s^2
    sonar: Array  # (n,) m, slant range; this and the next two are NaN without a sample
    flow: Array  # (n, 3) rad/s, body FRD; quality 0 ... 255
    pressure: Array  # (n,) Pa
    status: NDArray[np.int64]  # (n,) of the estimator; this and the next three: 0 for the truth
    health: NDArray[np.int64]  # (n, 5) of each sensor, mambo_estimation.health
    pose_variance: Array  # (n, 6) m^2 and rad^2, inertial axes, of the estimator
    twist_variance: Array  # (n, 6) m^2/s^2 and rad^2/s^2, body axes, likewise
    stopped: NDArray[np.bool_]  # (n,) motors shut down
    reason: NDArray[np.int64]  # (n,) safety.REASON_* of the command
    inner: Inner | None  # None: the loop is compiled without storing these columns
    located: Array | None = None  # (n, 61) in map, see capture_columns; None: without


class Settings(NamedTuple):
    """The constants of a flight that compiled code reads."""

    simulator: simulator.SimulatorValues  # true vehicle and sensors
    optitrack: optitrack.OptitrackValues  # motion capture
    estimator: filters.Values | None      # of the chosen estimator; None: the true state is used
    plan: PlanValues | CommandedValues    # flight plan, or the commands of the flight
    gains: controllers.Gains              # of the chosen controller
    failsafe: failsafe.FailsafeValues     # limits of the failsafe
    reference_vehicle: VehicleValues      # vehicle model of the reference
    controller_vehicle: VehicleValues     # vehicle model of the controller
    period: float                         # s, of the controller
    sonar_low: float                      # m, smallest valid range, as published
    sonar_high: float                     # m, largest valid range
    use_map: bool                         # feed the controller the estimate in map


def settings(flight: Scenario) -> Settings:
    """Return the constants of one flight of a scenario."""
    sim, estimator = flight.sim_node.simulator, flight.estimator_node
    return Settings(
        sim.values(), flight.optitrack_node.optitrack.values(),
        None if estimator.estimator == 'ground_truth' else estimator.filter.values(),
        flight.reference_node.flown(), flight.controller_node.law.values(),
        flight.controller_node.failsafe.values(),
        flight.reference_node.vehicle.values(), flight.controller_node.vehicle.values(),
        flight.controller_node.period, float(np.float32(sim.sonar.min_range)),
        float(np.float32(sim.sonar.max_range)), flight.controller_node.estimate == 'map')


def estimates(p: Settings) -> bool | None:
    """Return True, or None for a flight on the true state, for which no estimator is compiled."""
    return None if p.estimator is None else True


def fly(flight: Scenario, inner: bool = False) -> Recording:
    """
    Fly a scenario.

    Parameters
    ----------
    flight
        With a duration; mode, speed and waiting of the graph have no effect here.
    inner
        Whether to record the columns that only a bag needs.

    Returns
    -------
    recording
        One row per control step, the first at t = 0, the last at the duration.

    Raises
    ------
    ValueError
        If the scenario has no duration.

    """
    out = blank(flight, inner)
    run(flight, out)
    return out


def blank(flight: Scenario, inner: bool = False) -> Recording:
    """Return an empty recording for a scenario; see :func:`fly` for the arguments."""
    steps = step_count(flight)
    return Recording(
        np.arange(steps, dtype=np.int64) * STEP_NS, *(np.empty((steps, 13)) for _ in range(3)),
        np.empty(steps, dtype=np.int64), np.empty(steps), np.empty((steps, 4)),
        np.full((steps, 7), np.nan), np.zeros(steps, dtype=np.int64), np.empty((steps, 6)),
        np.empty(steps), np.empty((steps, 3)), np.empty(steps), np.zeros(steps, dtype=np.int64),
        np.zeros((steps, 5), dtype=np.int64), np.zeros((steps, 6)), np.zeros((steps, 6)),
        np.zeros(steps, dtype=np.bool_), np.zeros(steps, dtype=np.int64),
        _inner(steps) if inner else None,
        np.zeros((steps, WIDTH)) if flight.estimator_node.aided else None)


def recorded_bytes(flight: Scenario, inner: bool = False) -> int:
    """Return how much memory the recording of a scenario takes; see :func:`fly`."""
    def size(part: Any) -> int:
        return sum(map(size, part)) if isinstance(part, tuple) else getattr(part, 'nbytes', 0)

    step = replace(flight, sim_node=replace(flight.sim_node, duration=STEP_NS * 1e-9))
    return size(blank(step, inner)) * step_count(flight) // step_count(step)


def run(flight: Scenario, out: Recording) -> None:
    """Fly a scenario and fill a recording of :func:`blank`, one step for each row."""
    p = settings(flight)
    carry, rngs, mocap_rng = begin(flight, p)
    if not changes.changes_at_all(flight):
        fly_on(carry, 0, len(out.t), rngs, mocap_rng, p, out, None, False, None, None,
               estimates(p))
        return
    later = changes.settings_later(flight, p, len(out.t))
    held = hold(carry, None, None)
    ends = [*(k for k, _ in later), len(out.t)]
    for (first, values), end in zip([(0, p), *later], ends, strict=True):
        fly_on(
            memory_of(held), first, end, rngs, mocap_rng, values, out, None, False, None, held,
            estimates(p))


def begin(
    flight: Scenario, p: Settings,
) -> tuple[Carry, simulator.Generators, np.random.Generator]:
    """Return what a flight begins with: its carry, and the generators of sensors and cameras."""
    sim = flight.sim_node.simulator
    mocap_rng = simulator.generators(flight.optitrack_node.seed)[simulator.OPTITRACK]
    state = simulator.initial_state(sim)
    return Carry(state, optitrack.START, state.plant.body, filters.initial(p.estimator),
                 failsafe.begin(p.gains)), simulator.generators(sim.seed), mocap_rng


def step_count(flight: Scenario) -> int:
    """
    Return the number of control steps, the first at t = 0, the last at the duration.

    Raises
    ------
    ValueError
        If the scenario has no duration.

    """
    if not flight.sim_node.duration > 0.0:
        raise ValueError('the scenario has no duration: set sim_node.duration in seconds')
    return -(-round(flight.sim_node.duration * 1e9) // STEP_NS) + 1


def _inner(steps: int) -> Inner:
    return Inner(np.full(steps, np.nan), *(
        np.zeros((steps, width)) for width in (19, 36, 36, 36, 35, 8)))


@jit
def store_state(row: Array, s: State) -> None:
    """Store a state in a row of 13 numbers."""
    for i in range(3):
        row[i] = s.rho[i]
        row[3 + i] = s.nu[i]
        row[10 + i] = s.omega[i]
    for i in range(4):
        row[6 + i] = s.q[i]


class SensorReadings(NamedTuple):
    """Samples of a control step as the estimator receives them; NaN: no sample."""

    gyro: Vec3  # (3,) rad/s, body FRD
    accel: Vec3  # (3,) m/s^2, body FRD
    sonar: float  # m, slant range
    flow: tuple[float, float]  # (2,) rad/s
    flow_quality: int  # 0 ... 255
    pressure: float  # Pa


@jit
def delivered_readings(s: simulator.Samples, p: Settings) -> SensorReadings:
    """Return the samples of a control step that arrive on time and hold a value."""
    gyro, accel = s.gyro, s.accel
    if not in_time(s.deliveries.imu):
        gyro, accel = (np.nan, np.nan, np.nan), (np.nan, np.nan, np.nan)
    sonar, flow, quality, pressure = np.nan, (np.nan, np.nan), 0, np.nan
    if s.sonar_new and in_time(s.deliveries.sonar) and p.sonar_low <= s.sonar <= p.sonar_high:
        sonar = s.sonar
    if s.flow_new and in_time(s.deliveries.flow):
        flow, quality = s.flow, s.flow_quality
    if s.baro_new and in_time(s.deliveries.barometer):
        pressure = s.pressure
    return SensorReadings(gyro, accel, sonar, flow, quality, pressure)


@jit
def _store_samples(out: Recording, k: int, s: simulator.Samples, readings: SensorReadings) -> None:
    for i in range(3):
        out.imu[k, i], out.imu[k, 3 + i] = readings.gyro[i], readings.accel[i]
    out.sonar[k], out.pressure[k] = readings.sonar, readings.pressure
    out.flow[k, 0], out.flow[k, 1] = readings.flow
    out.flow[k, 2] = readings.flow_quality if s.flow_new else np.nan


@jit
def _store_health(out: Recording, k: int, e: Estimate) -> None:
    out.status[k] = e.status
    for i in range(5):
        out.health[k, i] = e.health.health[i]
    for i in range(6):
        out.pose_variance[k, i] = e.pose_covariance[7 * i]
        out.twist_variance[k, i] = e.twist_covariance[7 * i]


@jit
def _store_vector(row: Array, start: int, v: Vec3) -> int:
    """Store a vector in a row; return the index behind it."""
    row[start], row[start + 1], row[start + 2] = v
    return start + 3


@jit
def store_estimate(inner, k, e):
    """Store covariance, biases and sensor health of an estimate, for a bag."""
    if inner is None:
        return
    for i in range(36):
        inner.pose_covariance[k, i] = e.pose_covariance[i]
        inner.twist_covariance[k, i] = e.twist_covariance[i]
    row = inner.estimator[k]
    row[0], row[1], row[2] = e.status, e.height, e.vertical_velocity
    at = _store_vector(row, _store_vector(row, 3, e.gyro_bias), e.accel_bias)
    row[at], row[at + 1], row[at + 2] = (
        e.barometer_offset, e.sonar_innovation, e.sonar_test_ratio)
    row[12], row[13], row[14] = e.flow_innovation[0], e.flow_innovation[1], e.flow_test_ratio
    row[15], row[16] = e.barometer_innovation, e.barometer_test_ratio
    row[17], row[18], row[19] = e.sonar_refused, e.flow_refused, e.barometer_refused
    row[20] = e.invalid_samples
    for i in range(5):
        row[21 + i], row[26 + i] = e.health.health[i], e.health.age[i]
        row[31 + i] = e.health.not_finite[i]


@jit
def _store_inner(inner, k, s, ref, c, control, mocap):
    """Store samples, reference, command and the state of the nodes, for a bag."""
    if inner is None:
        return
    if s.sonar_new:
        inner.sonar[k] = s.sonar
    row = inner.plan[k]
    at = _store_vector(row, _store_vector(row, 0, ref.v), ref.a)
    at = _store_vector(row, _store_vector(row, at, ref.j), ref.s)
    at = _store_vector(row, at, ref.omega_dot)
    row[at] = ref.f
    _store_vector(row, at + 1, ref.tau)
    row = inner.controller[k]
    at = _store_vector(row, _store_vector(row, 0, c.position_error), c.velocity_error)
    at = _store_vector(row, _store_vector(row, at, c.integral), c.integral_rate)
    at = _store_vector(row, at, c.virtual_input)
    row[19], row[23] = c.attitude_error, c.thrust
    _store_vector(row, _store_vector(row, 20, c.angular_velocity_error) + 1, c.torque)
    for i in range(4):
        row[at + i], row[27 + i], row[31 + i] = (
            c.attitude_desired[i], c.motor_thrust[i], c.saturated[i])
    row, seen = inner.health[k], mocap.seen
    row[0], row[1], row[2] = control.stage, control.reason, mocap.track.tracked
    for i in range(len(seen)):
        row[3] += seen[i]
    row[7] = control.phase
    row[4], row[5], row[6] = mocap.counts.frames, mocap.counts.lost, mocap.counts.dropped


@jit
def _controller_input(state, spread, where, use_map):
    """Return the state and variances for the controller, in ``map`` if the scenario says so."""
    if where is None:
        return state, spread
    if use_map:
        return where.state, failsafe.spread_of(where.pose_covariance, where.twist_covariance)
    return state, spread


class Carry(NamedTuple):
    """What a flight keeps from one control step to the next; types vary with the components."""

    state: simulator.SimulatorState  # vehicle and sensors
    mocap: optitrack.OptitrackMemory  # motion capture
    before: State  # of the body at the last step
    memory: filters.Memory | None  # of the estimator
    control: failsafe.Memory  # of controller and failsafe


@jit
def fly_on(carry, first, end, rngs, mocap_rng, p, out, push, stop, view, held, estimating):
    """
    Fly from one control step until before another one, and store their rows.

    It is compiled once for each pair of estimator and controller, whose types are those of
    ``carry`` and ``p``, when the pair is first flown. Where nothing is kept the compiler leaves
    out what no row shows, and copies nothing: a step costs a tenth less.

    Parameters
    ----------
    carry : Carry
    first, end : int
        Numbers of steps.
    rngs, mocap_rng
        Generators of the sensors and of the motion capture.
    p : Settings
    out : Recording
    push : N
        What the downwash of others does to the vehicle, along b3; None: it flies alone.
    stop : bool
        Whether the motors are stopped, whatever the command.
    view : (12,)
        What the motion capture of a hall sees of it, for ``optitrack.step``; None: it is alone.
    held
        Holder of ``mambo_model.compiled.hold`` that keeps the carry; None: the flight is over.
    estimating
        Result of :func:`estimates`; None: no estimator is compiled.

    """
    last = len(out.t) - 1
    state, mocap, before, memory, control = carry
    for k in range(first, end):
        t = out.t[k]
        state, samples = pushed.sense_as(state, k, rngs, p.simulator, push)
        body = state.plant.body
        t_before = t - STEP_NS if k else t
        mocap, seen = optitrack.step(
            mocap, t_before, before, t, body, mocap_rng, p.optitrack, view)
        before = body
        readings = delivered_readings(samples, p)
        _store_samples(out, k, samples, readings)
        estimated, fed_back, spread = body, body, failsafe.EXACT
        if estimating is not None:
            if seen.new:
                memory = filters.offer(
                    memory, (t - seen.stamp) * 1e-9, seen.pose.rho, seen.pose.q)
            memory, estimate = filters.step(
                memory, (t - t_before) * 1e-9, readings.gyro, readings.accel, readings.sonar,
                readings.flow, readings.flow_quality, readings.pressure, p.estimator)
            estimated = estimate.state
            _store_health(out, k, estimate)
            store_estimate(out.inner, k, estimate)
            spread = failsafe.spread_of(estimate.pose_covariance, estimate.twist_covariance)
            where = filters.located(memory, estimate)
            store_located(out.located, k, where)
            fed_back, spread = _controller_input(estimated, spread, where, p.use_map)
        vehicle = p.reference_vehicle
        ref, phase = reference_step(
            t * 1e-9, p.plan, vehicle.mass, vehicle.inertia, vehicle.gravity)
        control, command = failsafe.step(
            control, fed_back, spread, ref, phase, p.period, p.gains, p.failsafe,
            p.controller_vehicle)
        store_state(out.truth[k], body)
        store_state(out.estimate[k], estimated)
        store_state(out.reference[k], State(ref.rho, body_velocity(ref), ref.q, ref.omega))
        _store_inner(out.inner, k, samples, ref, command, control, mocap)
        out.phase[k], out.thrust[k] = phase, command.thrust
        out.stopped[k], out.reason[k] = command.shutdown, command.reason
        for i in range(4):
            out.pwm[k, i] = command.pwm[i]
        if seen.new:
            out.pose_t[k] = seen.stamp
            for i in range(3):
                out.pose[k, i] = seen.pose.rho[i]
            for i in range(4):
                out.pose[k, 3 + i] = seen.pose.q[i]
        if k < last:
            state = pushed.advance_as(
                state, command.pwm, command.shutdown or stop, p.simulator, push)
    if held is not None:
        held.memory = Carry(state, mocap, before, memory, control)
