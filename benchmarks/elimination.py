"""
Where the time of a control step goes: the closed loop with one part at a time left out.

A part that is left out answers from a tape of the same flight, so that all the others work on
exactly what they work on in the whole flight; what is saved is what the part costs.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_control import failsafe
from mambo_estimation import filters
from mambo_flight import closed_loop
from mambo_flight.scenario import Scenario
from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import reference_step
from mambo_sim import simulator
from mambo_sim.parameters import STEP_NS
from mambo_sim.plant import PlantState
from mambo_sim.sensors import optitrack
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PARTS = ('plant', 'sensors', 'motion capture', 'estimator', 'reference', 'controller', 'recording')
PLANT, SENSORS, MOCAP, ESTIMATOR, REFERENCE, CONTROLLER, RECORDING = (
    1 << i for i in range(len(PARTS)))
ALL = (1 << len(PARTS)) - 1


class Tape(NamedTuple):
    """What every part answered, row k at control step k."""

    plant: Array      # (n, 20) body, thrust, jolt
    samples: Array    # (n, 11) gyro, accel, sonar, flow (2), quality, pressure
    estimate: Array   # (n, 18) state and its spread
    reference: Array  # (n, 33) with the phase
    command: Array    # (n, 5) PWM, shutdown


class FlightMemory(NamedTuple):
    """Everything that the flight remembers from step to step."""

    state: simulator.SimulatorState
    mocap: optitrack.OptitrackMemory
    before: State
    memory: filters.Memory
    control: failsafe.Memory


class Generators(NamedTuple):
    """Generators of the flight."""

    sensors: simulator.Generators
    mocap: np.random.Generator


def begin(flight: Scenario) -> tuple[FlightMemory, Generators]:
    """Return memories and generators at the start of a flight."""
    sim = flight.sim_node.simulator
    state = simulator.initial_state(sim)
    return FlightMemory(
        state, optitrack.START, state.plant.body,
        filters.initial(flight.estimator_node.filter.values()),
        failsafe.initial(flight.controller_node.law)), Generators(
        simulator.generators(sim.seed),
        simulator.generators(flight.optitrack_node.seed)[simulator.OPTITRACK])


def tape(steps: int) -> Tape:
    """Return an empty tape."""
    return Tape(*(np.zeros((steps, width)) for width in (20, 11, 18, 33, 5)))


@jit
def _put(row, start, values):
    """Write a tuple into a row; return where the next one begins."""
    for i in range(len(values)):
        row[start + i] = values[i]
    return start + len(values)


@jit
def _three(row, i):
    return (row[i], row[i + 1], row[i + 2])


@jit
def _four(row, i):
    return (row[i], row[i + 1], row[i + 2], row[i + 3])


@jit
def _state(row):
    return State(_three(row, 0), _three(row, 3), _four(row, 6), _three(row, 10))


@jit
def _put_state(row, s):
    return _put(row, _put(row, _put(row, _put(row, 0, s.rho), s.nu), s.q), s.omega)


@jit
def _reference(row):
    return Reference(
        _three(row, 0), _three(row, 3), _three(row, 6), _three(row, 9), _three(row, 12),
        _four(row, 15), _three(row, 19), _three(row, 22), row[25], _three(row, 26))


@jit
def _put_reference(row, ref):
    at = _put(row, _put(row, 0, ref.rho), ref.v)
    at = _put(row, _put(row, _put(row, at, ref.a), ref.j), ref.s)
    at = _put(row, _put(row, _put(row, at, ref.q), ref.omega), ref.omega_dot)
    row[at] = ref.f
    _put(row, at + 1, ref.tau)


@jit
def _readings_of(row):
    return closed_loop.SensorReadings(
        _three(row, 0), _three(row, 3), row[6], (row[7], row[8]), int(row[9]), row[10])


@jit
def _put_readings(row, h):
    at = _put(row, _put(row, 0, h.gyro), h.accel)
    row[at] = h.sonar
    _put(row, at + 1, h.flow)
    row[at + 3], row[at + 4] = h.flow_quality, h.pressure


@jit
def _played(state, row):
    """Return the simulator with its vehicle as on the tape."""
    plant = PlantState(
        _state(row), _four(row, 13), _three(row, 17), state.plant.lost, state.plant.charge)
    return simulator.SimulatorState(
        plant, state.imu, state.optical_flow, state.barometer, state.faults, state.wind)


@jit
def _record(tape, k, truth, readings, estimated, spread, ref, phase, pwm, shutdown):
    """Write what every part answered."""
    row = tape.plant[k]
    _put(row, _put(row, _put_state(row, truth.body), truth.thrust), truth.jolt)
    _put_readings(tape.samples[k], readings)
    _put(tape.estimate[k], _put_state(tape.estimate[k], estimated), spread)
    _put_reference(tape.reference[k], ref)
    tape.reference[k, 32], tape.command[k, 4] = phase, shutdown
    _put(tape.command[k], 0, pwm)


@jit
def fly(mind, chance, p, tape, start, stop, parts):
    """
    Fly control steps ``start`` up to ``stop``; a part whose bit is not set plays its tape.

    Returns the memories at the end, for the next piece, and a sum that needs every answer.
    """
    state, mocap, before, memory, control = mind
    total = 0.0
    for k in range(start, stop):
        t = k * STEP_NS
        if not parts & PLANT:
            state = _played(state, tape.plant[k])
        body = state.plant.body
        if parts & SENSORS:
            state, samples = simulator.sense(state, k, chance.sensors, p.simulator)
            readings = closed_loop.delivered_readings(samples, p)
        else:
            readings = _readings_of(tape.samples[k])
        t_before = t - STEP_NS if k else t
        if parts & MOCAP:
            mocap, seen = optitrack.step(
                mocap, t_before, before, t, body, chance.mocap, p.optitrack, None)
            total += seen.pose.rho[0]
        before = body
        estimated, spread = body, failsafe.EXACT
        if parts & ESTIMATOR:
            memory, estimate = filters.step(
                memory, (t - t_before) * 1e-9, readings.gyro, readings.accel, readings.sonar,
                readings.flow, readings.flow_quality, readings.pressure, p.estimator)
            estimated, spread = estimate.state, failsafe.spread_of(
                estimate.pose_covariance, estimate.twist_covariance)
        else:
            row = tape.estimate[k]
            estimated, spread = _state(row), failsafe.Spread(
                row[13], row[14], row[15], row[16], row[17])
        vehicle = p.reference_vehicle
        if parts & REFERENCE:
            ref, phase = reference_step(
                t * 1e-9, p.plan, vehicle.mass, vehicle.inertia, vehicle.gravity)
        else:
            ref, phase = _reference(tape.reference[k]), int(tape.reference[k, 32])
        if parts & CONTROLLER:
            control, command = failsafe.step(
                control, estimated, spread, ref, phase, p.period, p.gains, p.failsafe,
                p.controller_vehicle)
            pwm, shutdown = command.pwm, command.shutdown
        else:
            row = tape.command[k]
            pwm, shutdown = _four(row, 0), row[4] > 0.0
        if parts & RECORDING:
            _record(
                tape, k, state.plant, readings, estimated, spread, ref, phase, pwm, shutdown)
        total += pwm[0] + readings.gyro[0] + estimated.rho[0] + ref.rho[0]
        if parts & PLANT:
            state = simulator.advance(state, pwm, shutdown, p.simulator)
    return FlightMemory(state, mocap, before, memory, control), total
