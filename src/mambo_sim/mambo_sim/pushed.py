"""
The simulator's steps for a vehicle that something pushes along b3 during a control step.

The push is constant over the step. Half of its change of velocity comes before the step of the
vehicle and half after it, which is exact for the motion along a constant push; the accelerometer
feels it.
"""

from __future__ import annotations

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.motor_mixer import Four
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .plant import PlantState
from .sensors.sampling import STEP
from .simulator import advance, Samples, sense, SimulatorState, SimulatorValues

COLUMNS = 7  # of a row of :func:`observe`


@jit
def observe(state: PlantState, row: NDArray[np.float64]) -> None:
    """Store in a row: position (3) m, b3 (3), both inertial NED, and thrust in N."""
    q = state.body.q
    for i in range(3):
        row[i] = state.body.rho[i]
    row[3] = 2.0 * (q[1] * q[3] + q[0] * q[2])
    row[4] = 2.0 * (q[2] * q[3] - q[0] * q[1])
    row[5] = q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3]
    row[6] = state.thrust[0] + state.thrust[1] + state.thrust[2] + state.thrust[3]


@jit
def _with_plant(state: SimulatorState, plant: PlantState) -> SimulatorState:
    """Return a simulator with another state of its vehicle."""
    return SimulatorState(
        plant, state.imu, state.optical_flow, state.barometer, state.faults, state.wind)


@jit
def _kicked(p: PlantState, change: float) -> PlantState:
    """Return the vehicle with a change of velocity along b3, m/s."""
    b = p.body
    nu = (b.nu[0], b.nu[1], b.nu[2] + change)
    return PlantState(State(b.rho, nu, b.q, b.omega), p.thrust, p.jolt, p.lost, p.charge)


@jit
def sense_pushed(
    state: SimulatorState, tick: int, rngs: tuple[Generator, ...], values: SimulatorValues,
    push: float,
) -> tuple[SimulatorState, Samples]:
    """Read all sensors as ``simulator.sense`` of a vehicle with a push of so many N along b3."""
    p = state.plant
    jolt = (p.jolt[0], p.jolt[1], p.jolt[2] + push / values.vehicle.mass)
    felt = PlantState(p.body, p.thrust, jolt, p.lost, p.charge)
    after, samples = sense(_with_plant(state, felt), tick, rngs, values)
    q = after.plant
    kept = PlantState(q.body, q.thrust, p.jolt, q.lost, q.charge)
    return _with_plant(after, kept), samples


@jit
def advance_pushed(
    state: SimulatorState, pwm: Four, shutdown: bool, values: SimulatorValues, push: float,
) -> SimulatorState:
    """Advance by one tick as ``simulator.advance``, with a push of so many N along b3."""
    half = 0.5 * STEP * push / values.vehicle.mass
    moved = advance(
        _with_plant(state, _kicked(state.plant, half)), pwm, shutdown, values)
    return _with_plant(moved, _kicked(moved.plant, half))


@jit_inside
def sense_as(state, tick, rngs, values, push):
    """Read all sensors; push: N along b3, or None for a vehicle that nothing pushes."""
    if push is None:
        return sense(state, tick, rngs, values)
    return sense_pushed(state, tick, rngs, values, push)


@jit_inside
def advance_as(state, pwm, shutdown, values, push):
    """Advance by one tick; push: N along b3, or None for a vehicle that nothing pushes."""
    if push is None:
        return advance(state, pwm, shutdown, values)
    return advance_pushed(state, pwm, shutdown, values, push)


@jit
def sense_held(held, tick, push):
    """Read all sensors of a held simulator; return the samples and the true state."""
    held.memory, samples = sense_as(held.memory, tick, held.rng, held.values, push)
    return samples, held.memory.plant.body


@jit
def advance_held(held, pwm, shutdown, push):
    """Advance the vehicle of a held simulator by one tick."""
    held.memory = advance_as(held.memory, pwm, shutdown, held.values, push)


@jit
def observe_held(held, row):
    """Store what others see of a held simulator's vehicle, as :func:`observe`."""
    observe(held.memory.plant, row)
