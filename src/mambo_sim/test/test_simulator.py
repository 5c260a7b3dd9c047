"""The whole: same bits alone and in a compiled loop, one seed one flight, sensors of the truth."""

import dataclasses
import math

from mambo_model import schema
from mambo_model.compiled import jit
from mambo_model.vehicle.parameters import Vehicle
from mambo_model.vehicle.vehicle_options import (
    BatteryParams, DragParams, FadeParams, GroundEffectParams, RotorParams)
from mambo_sim import plant, simulator
from mambo_sim.plant import PlantParams
from mambo_sim.sensors.imu import ImuParams
from mambo_sim.sensors.optical_flow import OpticalFlowParams
from mambo_sim.sensors.sonar import SonarParams
from mambo_sim.simulator import advance, generators, initial_state, sense, SimulatorParams
import numpy as np
import pytest

OPTIONS = Vehicle(
    drag_reading='none', motor_time_constant=0.05,
    drag=DragParams(
        blade_flapping=True, induced=True, translational=True, profile='blade_element',
        parasitic=True),
    rotor=RotorParams(torques=True), ground_effect=GroundEffectParams(enabled=True),
    fade=FadeParams(enabled=True, pwm=270.0), battery=BatteryParams(enabled=True))
DEFECTS = SimulatorParams(
    imu=ImuParams(drone=3, gyro_warm_up=(0.01, 0.0, -0.01), warm_up_time=1.0),
    sonar=SonarParams(
        outlier_probability=0.05, multipath_probability=0.1, dropout_probability=0.1),
    optical_flow=OpticalFlowParams(
        pause=0.115, dropout=0.1, latency=0.12, height_delay=0.05))
HOVER_PWM = (0.068 * 9.81 / 4 / 4.29e-5) ** (1 / 1.47)


def command(tick):
    """Return a command that climbs and then sways, as compiled code and Python compute it."""
    if tick < 20:
        return (0.0, 0.0, 0.0, 0.0)
    sway = 2.0 if tick % 16 < 8 else -2.0
    lift = 320.0 if tick < 100 else 277.0
    return (lift + sway, lift - sway, lift - sway, lift + sway)


compiled_command = jit(command)


@jit
def compiled_loop(state, ticks, rngs, values):
    """Run the simulator inside one compiled function, keeping every number of every tick."""
    out = np.empty((ticks, 26))
    for tick in range(ticks):
        state, s = sense(state, tick, rngs, values)
        state = advance(state, compiled_command(tick), False, values)
        b = state.plant.body
        out[tick] = np.array([
            s.gyro[0], s.gyro[1], s.gyro[2], s.accel[0], s.accel[1], s.accel[2],
            1.0 if s.sonar_new else 0.0, s.sonar, 1.0 if s.flow_new else 0.0,
            s.flow[0], s.flow[1], float(s.flow_quality), s.pressure,
            b.rho[0], b.rho[1], b.rho[2], b.nu[0], b.nu[1], b.nu[2],
            b.q[0], b.q[1], b.q[2], b.q[3], b.omega[0], b.omega[1], b.omega[2]])
    return out


def python_loop(params, ticks, seed=None, commands=command):
    state, values = initial_state(params), params.values()
    rngs = generators(params.seed if seed is None else seed)
    out = np.empty((ticks, 26))
    for tick in range(ticks):
        state, s = sense(state, tick, rngs, values)
        state = advance(state, commands(tick), False, values)
        b = state.plant.body
        out[tick] = [
            *s.gyro, *s.accel, s.sonar_new, s.sonar, s.flow_new, *s.flow, s.flow_quality,
            s.pressure, *b.rho, *b.nu, *b.q, *b.omega]
    return out


@pytest.mark.long
@pytest.mark.parametrize('params', [
    SimulatorParams(seed=3), SimulatorParams(noise=False),
    SimulatorParams(vehicle=Vehicle(motor_time_constant=0.03)), SimulatorParams(vehicle=OPTIONS),
    DEFECTS])
def test_compiled_alone_equals_compiled_in_a_loop_to_the_bit(params):
    alone = python_loop(params, 600)
    inside = compiled_loop(initial_state(params), 600, generators(params.seed), params.values())
    assert alone.tobytes() == inside.tobytes()
    assert alone[-1, 15] < -0.5 and (alone[:, 11] == 255).any()  # it flew, it saw


@pytest.mark.long
def test_options_of_the_vehicle_reach_motors_and_accelerometer():
    lagging = Vehicle(motor_time_constant=OPTIONS.motor_time_constant)
    base, other = (
        python_loop(SimulatorParams(noise=False, vehicle=v), 200) for v in (lagging, OPTIONS))
    assert (other[-1, 13:20] != base[-1, 13:20]).all()
    # a cushion of air and a full battery lift off with more
    airborne = np.flatnonzero(base[:, 15] < 0.0)[0] + 1
    assert other[airborne, 5] < base[airborne, 5] - 0.5
    params = SimulatorParams(
        noise=False, vehicle=OPTIONS, imu=ImuParams(accel_resolution=0.0),
        plant=PlantParams(initial_position=(0.0, 0.0, -0.05), initial_euler=(0.3, 0.0, 0.0)))
    values, rngs, state = params.values(), generators(0), initial_state(params)
    for tick in range(30):
        state, samples = sense(state, tick, rngs, values)
        before, state = state, advance(state, (290.0,) * 4, False, values)
    felt, body = np.array(samples.accel), before.plant.body
    without = plant.specific_force(before.plant, values.vehicle, True)
    assert felt[2] < without[2] - 0.05  # ground effect on the rotors
    # parts of k_c = 0.22, of the lift; and what the hub's turning makes of the flapping discs
    speeds = np.sqrt(np.array(before.plant.thrust) / 4.74e-8)
    lean = -26.4 * body.omega[0] / speeds.mean()
    assert felt[1] == pytest.approx(felt[2] * (0.055 * body.nu[1] - lean), rel=0.01)
    assert abs(felt[1]) > 0.05


def test_one_seed_one_flight():
    first, second = (python_loop(SimulatorParams(seed=9), 200) for _ in range(2))
    assert first.tobytes() == second.tobytes()
    other = python_loop(SimulatorParams(seed=10), 200)
    assert (other[:, :6] != first[:, :6]).any(axis=0).all()
    assert (other[:, 13:] == first[:, 13:]).all()  # chance is in the sensors alone


def test_noise_of_one_sensor_does_not_depend_on_another():
    base = python_loop(SimulatorParams(), 200)
    other = python_loop(SimulatorParams(sonar=SonarParams(rate=50.0)), 200)
    assert other[:, :6].tobytes() == base[:, :6].tobytes()
    assert other[:, 8:13].tobytes() == base[:, 8:13].tobytes()


def test_rest_reads_gravity_and_the_floor():
    params = SimulatorParams(noise=False, imu=ImuParams(accel_resolution=0.0))
    state, samples = sense(initial_state(params), 0, generators(0), params.values())
    assert samples.gyro == (0.0, 0.0, 0.0)
    assert samples.accel == pytest.approx((0.0, 0.0, -9.81), abs=1e-14)
    assert samples.sonar == pytest.approx(0.4343, abs=1e-4)
    assert samples.flow_new and samples.flow_quality == 0
    assert samples.pressure == pytest.approx(101325.0, abs=0.12)


def test_free_fall_reads_nothing():
    params = SimulatorParams(
        noise=False, plant=PlantParams(initial_position=(0.0, 0.0, -50.0),
                                       initial_euler=(0.3, 0.4, 0.5)))
    values, rngs, state = params.values(), generators(0), initial_state(params)
    for tick in range(100):
        state, samples = sense(state, tick, rngs, values)
        assert samples.accel == (0.0, 0.0, 0.0)
        state = advance(state, (0.0,) * 4, False, values)
    assert state.plant.body.rho[2] == pytest.approx(-50 + 0.5 * 9.81 * 0.25, abs=1e-9)


def test_sensors_see_the_same_moment():
    params = SimulatorParams(
        noise=False, plant=PlantParams(initial_position=(0.0, 0.0, -1.5)),
        imu=ImuParams(accel_resolution=0.0, gyro_resolution=0.0),
        sonar=SonarParams(resolution=0.0, rate=200.0))
    values, rngs, state = params.values(), generators(0), initial_state(params)
    for tick in range(100):
        state, s = sense(state, tick, rngs, values)
        b = state.plant.body
        assert s.gyro == b.omega
        tilt = 1 - 2 * (b.q[1]**2 + b.q[2]**2)
        assert s.sonar == pytest.approx(-b.rho[2] / tilt, rel=1e-7)
        f = sum(state.plant.thrust)
        assert s.accel[2] == pytest.approx(-f / 0.068, abs=1e-12)
        assert s.accel[0] == pytest.approx(-f / 0.068 * 0.055 * b.nu[0], abs=1e-12)  # k_c / 4
        h = -b.rho[2]
        if s.baro_new:  # 12 Pa a metre, a resolution of 0.23 Pa
            assert s.pressure == pytest.approx(101325.0 - 12.01 * h, abs=0.15)
        if s.flow_new:
            assert s.flow[1] == pytest.approx(b.nu[1] * tilt / h / (0.92 + 0.07 * h), rel=1e-9)
        state = advance(state, (280.0, 275.0, 278.0, 277.0), False, values)
    assert abs(b.nu[0]) > 1e-3 and abs(b.nu[1]) > 1e-3


def test_shutdown_stops_the_motors_whatever_the_command():
    params = SimulatorParams(vehicle=Vehicle(motor_time_constant=0.02))
    values, state = params.values(), initial_state(params)
    for _ in range(100):
        state = advance(state, (300.0,) * 4, False, values)
    start = state.plant.thrust[0]
    for k in range(1, 40):
        state = advance(state, (300.0,) * 4, True, values)
        assert state.plant.thrust[0] == pytest.approx(start * math.exp(-0.25 * k), rel=1e-9)


def test_vibration_begins_with_the_motors():
    params = SimulatorParams(imu=ImuParams(accel_bias=(0.0, 0.0, 0.0)))
    record = python_loop(
        params, 800, commands=lambda k: (0.0,) * 4 if k < 400 else (HOVER_PWM,) * 4)
    rest, hover = record[10:400, 3], record[410:, 3]
    assert rest.std() == pytest.approx(0.0165, rel=0.15)
    assert hover.std() == pytest.approx(1.1, rel=0.15)


def test_rates_of_all_sensors_over_ten_seconds():
    params = SimulatorParams(plant=PlantParams(initial_position=(0.0, 0.0, -1.5)))
    record = python_loop(params, 2000, commands=lambda k: (HOVER_PWM,) * 4)
    assert record[:, 6].sum() == 250 and record[:, 8].sum() == 320
    assert np.isfinite(record[:, 12]).sum() == 700
    assert (np.isfinite(record[:, 7]) == (record[:, 6] == 1)).all()
    assert (np.isfinite(record[:, 9]) == (record[:, 8] == 1)).all()


def test_generators_are_the_children_of_one_seed_sequence():
    children = np.random.SeedSequence(42).spawn(7)
    for rng, child in zip(generators(42), children, strict=True):
        assert rng.random() == np.random.Generator(np.random.PCG64(child)).random()
    assert (simulator.OPTITRACK, simulator.FAULTS) == (4, 5)


def test_the_generator_of_faults_leaves_the_streams_of_the_sensors_as_they_were():
    alone = np.random.SeedSequence(42).spawn(5)
    for rng, child in zip(generators(42)[:5], alone, strict=True):
        assert rng.random() == np.random.Generator(np.random.PCG64(child)).random()


def test_parameters_nest_and_name_themselves():
    params = schema.build(SimulatorParams, {
        'seed': 4, 'imu.accel_noise': [0, 0, 0], 'vehicle': {'mass': 0.07}})
    assert params.seed == 4 and params.values().vehicle.mass == 0.07
    assert params.values().imu.accel_noise == (0.0, 0.0, 0.0)
    with pytest.raises(schema.ParameterError, match=r'sonar\.rate'):
        schema.build(SimulatorParams, {'sonar.rate': 500.0})
    with pytest.raises(schema.ParameterError, match='seed'):
        dataclasses.replace(params, seed=-1)
