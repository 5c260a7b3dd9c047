"""
Vehicle and sensors in one compiled step: measure, command, advance.

A tick is a control step of 5 ms. At each tick, exactly once and in this order: :func:`sense` reads
all sensors at the time ``tick * 5 ms``, then :func:`advance` applies the motor command up to the
next tick. The motion capture is fed by the truth: see :mod:`mambo_sim.sensors.optitrack`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import PlanValues
from mambo_model.motion.vector import Vec3
from mambo_model.schema import flag, group, quantity
from mambo_model.values import derived, Parameters, values_type
from mambo_model.vehicle.motor_mixer import Four, mix
from mambo_model.vehicle.parameters import OptionValues, Vehicle
import numpy as np
from numpy.random import Generator

from . import faults, hand, plant, wind
from .sensors import barometer, imu, optical_flow, sonar
from .sensors.sampling import STEP

Generators = tuple[
    Generator, Generator, Generator, Generator, Generator, Generator, Generator]
IMU, SONAR, FLOW, BAROMETER, OPTITRACK, FAULTS, WIND = range(7)  # order of the generators


class SimulatorState(NamedTuple):
    """State of the simulator."""

    plant: plant.PlantState  # vehicle and motors
    imu: imu.ImuMemory       # biases and vibration
    optical_flow: optical_flow.FlowMemory  # recent heights and rates
    barometer: barometer.BarometerMemory  # offset
    faults: faults.FaultMemory | None = None  # None: none
    wind: wind.WindMemory | None = None  # None: still air


class Deliveries(NamedTuple):
    """Delivery of each sample to the estimator, ``faults.DELIVERY_*``."""

    imu: int  # of gyro and accelerometer
    sonar: int  # of the range
    flow: int  # of the flow
    barometer: int  # of the pressure


class Samples(NamedTuple):
    """Readings of the sensors at a tick; NaN for a sensor without a new value."""

    gyro: Vec3                 # (3,) rad/s, body FRD
    accel: Vec3                # (3,) m/s^2, body FRD, specific force
    sonar_new: bool            # there is a range
    sonar: float               # m, slant range
    flow_new: bool             # there is flow
    flow: optical_flow.Vec2    # (2,) rad/s, body x forward and y right, the vehicle's sign
    flow_quality: int          # 0 ... 255; 0: do not use
    baro_new: bool             # there is a pressure
    pressure: float            # Pa
    deliveries: Deliveries     # of the messages


IN_TIME = Deliveries(
    faults.DELIVERY_SENT, faults.DELIVERY_SENT, faults.DELIVERY_SENT, faults.DELIVERY_SENT)


@dataclass(frozen=True)
class SimulatorParams(Parameters):
    """The true vehicle, its sensors, and the seed of all random numbers."""

    vehicle: Vehicle = group(Vehicle)
    plant: plant.PlantParams = group(plant.PlantParams)
    imu: imu.ImuParams = group(imu.ImuParams)
    sonar: sonar.SonarParams = group(sonar.SonarParams)
    optical_flow: optical_flow.OpticalFlowParams = group(optical_flow.OpticalFlowParams)
    barometer: barometer.BarometerParams = group(barometer.BarometerParams)
    faults: faults.FaultsParams = group(faults.FaultsParams)
    seed: int = quantity(0, '1', 0, 2**31 - 1, 'design choice')
    hand: hand.HandParams = group(hand.HandParams)
    wind: wind.WindParams = group(wind.WindParams)
    noise: bool = flag(True, 'design choice: false switches every random part off')

    @derived('')
    def options(self) -> OptionValues | None:
        """Options of the vehicle; None: none acts."""
        return self.vehicle.options()


SimulatorValues = values_type(SimulatorParams, without=('seed',))


def initial_state(params: SimulatorParams) -> SimulatorState:
    """Return the state at tick 0: vehicle at rest, sensors not yet read."""
    return SimulatorState(
        plant.initial(params.plant), imu.START, optical_flow.START, barometer.START,
        None if params.faults.values() is None else faults.START, wind.initial(params.wind))


def generators(seed: int) -> Generators:
    """
    Return one generator for each sensor, the faults and the wind: IMU, SONAR, ..., WIND.

    They are stateful: make new ones for each flight.
    """
    return tuple(
        Generator(np.random.PCG64(child)) for child in np.random.SeedSequence(seed).spawn(7))


@jit
def _motion(
    truth: plant.PlantState, t: float, path: PlanValues | None, air: Vec3 | None,
    values: SimulatorValues,
) -> tuple[plant.PlantState, Vec3]:
    """Return the plant, where a hand has it if one carries it, and its specific force."""
    vv = values.vehicle
    if path is None:
        return truth, plant.specific_force(truth, vv, values.plant.ground, values.options, air)
    body, force = hand.carry(t, path, vv.gravity)
    stopped = (0.0, 0.0, 0.0, 0.0)
    return plant.PlantState(body, stopped, (0.0, 0.0, 0.0), truth.lost, truth.charge), force


@jit
def body_at(body: State, tick: int, path: PlanValues | None, gravity: float) -> State:
    """Return the state of a vehicle's body at a tick, where a hand has it if one carries it."""
    if path is None:
        return body
    carried, _ = hand.carry(tick * STEP, path, gravity)
    return carried


@jit_inside
def sense(
    state: SimulatorState, tick: int, rngs: Generators, values: SimulatorValues,
) -> tuple[SimulatorState, Samples]:
    """
    Read all sensors; to be called exactly once per tick, tick by tick from 0.

    Parameters
    ----------
    state
        Before the motor command of this tick.
    tick : 5 ms
        Number of the control step.
    rngs
        From :func:`generators`; they advance.
    values
        From :meth:`SimulatorParams.values`.

    """
    vv, noise = values.vehicle, values.noise
    blowing = wind.step(state.wind, tick, rngs[WIND], noise, values.wind)
    truth, force = _motion(
        state.plant, tick * STEP, values.hand, wind.air_velocity(blowing), values)
    body = truth.body
    f, _ = mix(truth.thrust, vv)
    imu_memory, inertial = imu.step(
        state.imu, body.omega, force, f / (vv.mass * vv.gravity), rngs[IMU], noise, values.imu)
    echo = sonar.step(tick, body, rngs[SONAR], noise, values.sonar)
    flow_memory, flow = optical_flow.step(
        state.optical_flow, tick, body, rngs[FLOW], noise, values.optical_flow)
    baro_memory, air = barometer.step(
        state.barometer, tick, -body.rho[2], rngs[BAROMETER], noise, values.barometer)
    samples = Samples(
        inertial.gyro, inertial.accel, echo.new, echo.range, flow.new, flow.rate, flow.quality,
        air.new, air.pressure, IN_TIME)
    fault_memory, samples = _apply_faults(state.faults, tick, samples, rngs[FAULTS], values.faults)
    return SimulatorState(
        truth, imu_memory, flow_memory, baro_memory, fault_memory, blowing), samples


@jit
def _apply_faults(
    memory: faults.FaultMemory | None, tick: int, s: Samples, rng: Generator,
    p: faults.FaultsValues | None,
) -> tuple[faults.FaultMemory | None, Samples]:
    """Return the samples with faults applied, and the delivery of each."""
    if p is None:
        return memory, s
    gyro, last_gyro = faults.vector(s.gyro, memory.gyro, tick, rng, p.gyro, faults.GYRO_SPAN)
    accel, last_accel = faults.vector(
        s.accel, memory.accel, tick, rng, p.accel, faults.ACCEL_SPAN)
    sonar, last_sonar = s.sonar, memory.sonar
    if s.sonar_new:
        sonar, last_sonar = faults.scalar(
            s.sonar, memory.sonar, tick, rng, p.sonar, faults.SONAR_SPAN)
        sonar = faults.narrow(sonar)
    flow, last_flow = (s.flow[0], s.flow[1], s.flow_quality), memory.flow
    if s.flow_new:
        flow, last_flow = faults.flow(flow, memory.flow, tick, rng, p.optical_flow)
    pressure, last_pressure = s.pressure, memory.pressure
    if s.baro_new:
        pressure, last_pressure = faults.scalar(
            s.pressure, memory.pressure, tick, rng, p.barometer, faults.PRESSURE_SPAN)
    held = memory.held
    imu_delivery, imu_held = faults.delivery(True, held[0], tick, rng, p.imu)
    sonar_delivery, sonar_held = faults.delivery(s.sonar_new, held[1], tick, rng, p.sonar)
    flow_delivery, flow_held = faults.delivery(s.flow_new, held[2], tick, rng, p.optical_flow)
    baro_delivery, baro_held = faults.delivery(s.baro_new, held[3], tick, rng, p.barometer)
    return faults.FaultMemory(
        last_gyro, last_accel, last_sonar, last_flow, last_pressure,
        (imu_held, sonar_held, flow_held, baro_held)), Samples(
        gyro, accel, s.sonar_new, sonar, s.flow_new, (flow[0], flow[1]), flow[2], s.baro_new,
        pressure, Deliveries(imu_delivery, sonar_delivery, flow_delivery, baro_delivery))


@jit_inside
def advance(
    state: SimulatorState, pwm: Four, shutdown: bool, values: SimulatorValues,
) -> SimulatorState:
    """
    Advance the vehicle by one tick under a held motor command.

    Parameters
    ----------
    state
        After :func:`sense` of this tick.
    pwm : (4,) PWM, motors 1 to 4
        Cut to the limits of the vehicle; 0, a negative number or NaN stops the motor.
    shutdown
        True: all motors are stopped, whatever pwm says.
    values
        From :meth:`SimulatorParams.values`.

    """
    command = (0.0, 0.0, 0.0, 0.0) if shutdown else pwm
    moved = plant.advance(
        state.plant, command, STEP, values.plant.substeps, values.vehicle, values.plant.ground,
        values.options, values.plant.length_gain, wind.air_velocity(state.wind),
        values.plant.floor)
    return SimulatorState(
        moved, state.imu, state.optical_flow, state.barometer, state.faults, state.wind)
