import math

from mambo_model import forces
from mambo_model.motion.quaternion import from_euler, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_model.vehicle import motor_mixer
from mambo_model.vehicle.parameters import Vehicle
from mambo_model.vehicle.vehicle_options import DragParams
from mambo_sim import plant, simulator, wind
from mambo_sim.plant import PlantParams
from mambo_sim.simulator import SimulatorParams
import numpy as np
import pytest

STILL = (0.0, 0.0, 0.0)
AIR = (2.0, -1.0, 0.0)  # m/s, inertial NED
MAMBO = Vehicle()
WEIGHT = MAMBO.mass * MAMBO.gravity
HOVER = motor_mixer.pwm_from_thrust(0.25 * WEIGHT, MAMBO.values())
RATE = MAMBO.gravity * MAMBO.drag_coefficient / 4.0  # 1/s, of (3.13) in hover


def drifting(yaw, seconds, **options):
    params = SimulatorParams(
        wind=wind.WindParams(velocity=AIR), noise=False, **options,
        plant=PlantParams(initial_position=(0.0, 0.0, -50.0), initial_euler=(0.0, 0.0, yaw)))
    values, rngs = params.values(), simulator.generators(1)
    state, out = simulator.initial_state(params), []
    for tick in range(round(seconds * 200)):
        state, _ = simulator.sense(state, tick, rngs, values)
        state = simulator.advance(state, (HOVER,) * 4, False, values)
        out.append(state.plant.body)
    return state, out


@pytest.mark.long
@pytest.mark.parametrize('yaw', [0.0, 1.0])
def test_a_hovering_vehicle_drifts_off_with_the_wind_as_its_drag_says(yaw):
    _, bodies = drifting(yaw, 4.0)
    t = np.arange(1, len(bodies) + 1)[:, None] * 0.005
    share = 1.0 - np.exp(-RATE * t)
    velocity = np.array([rotate(body.q, body.nu) for body in bodies])
    # RK4 at 1 kHz: (RATE h)^5 is 5e-17 a step; the rest is rounding of the motor map
    np.testing.assert_allclose(velocity, share * AIR, rtol=0, atol=1e-9)
    path = np.array([body.rho for body in bodies]) - (0.0, 0.0, -50.0)
    np.testing.assert_allclose(path, (t - share / RATE) * AIR, rtol=0, atol=1e-9)


def test_the_accelerometer_feels_the_wind():
    state = plant.PlantState(
        State((0.0, 0.0, -5.0), STILL, from_euler(0.0, 0.0, math.pi / 2), STILL),
        (0.25 * WEIGHT,) * 4, STILL)
    felt = plant.specific_force(state, MAMBO.values(), True, None, AIR)
    # heading east: the wind to the north comes from the right, that to the west from ahead
    assert felt == pytest.approx((-RATE, -2.0 * RATE, -MAMBO.gravity), abs=1e-12)


def test_every_part_of_the_drag_takes_the_velocity_through_the_air():
    options = Vehicle(drag=DragParams(
        blade_flapping=True, induced=True, translational=True, profile='blade_element',
        parasitic=True)).options()
    q = from_euler(0.2, -0.3, 1.1)
    body = State((0.0, 0.0, -3.0), (0.5, -0.2, 0.3), q, (0.1, 0.2, 0.3))
    rotors = forces.Rotors((0.16, 0.17, 0.18, 0.15), 0.0, 0.0)
    air = rotate(q, (0.3, 0.4, -0.2))
    blown = forces.forces(body, rotors, MAMBO.values(), options, False, air)
    alike = State(body.rho, (0.2, -0.6, 0.5), q, body.omega)
    assert blown.F_D == pytest.approx(
        forces.forces(alike, rotors, MAMBO.values(), options, False).F_D, abs=1e-15)


def test_gusts_have_their_standard_deviation_and_correlation_time_from_the_first_step():
    p = wind.WindParams(velocity=AIR, gust=(0.5, 1.0, 0.2), gust_time=0.1).values()
    rng, memory, gusts = np.random.default_rng(5), wind.WindMemory(STILL, STILL), []
    for tick in range(40000):  # 200 s: 2000 correlation times
        memory = wind.step(memory, tick, rng, True, p)
        gusts.append(memory.gust)
        assert memory.velocity == tuple(a + g for a, g in zip(AIR, memory.gust))
    gusts = np.array(gusts)
    # 1000 independent samples: standard deviations within 2.2 % each, tested at four of these
    np.testing.assert_allclose(gusts.std(axis=0), p.gust, rtol=0.09)
    lag = 20  # steps: one correlation time
    correlation = [np.corrcoef(gusts[lag:, i], gusts[:-lag, i])[0, 1] for i in range(3)]
    np.testing.assert_allclose(correlation, math.exp(-1.0), atol=0.12)
    first = [wind.step(memory, 0, np.random.default_rng(seed), True, p).gust
             for seed in range(1000)]
    np.testing.assert_allclose(np.std(first, axis=0), p.gust, rtol=0.09)


def test_without_noise_there_are_no_gusts_and_nothing_is_drawn():
    p = wind.WindParams(velocity=AIR, gust=(1.0, 1.0, 1.0)).values()
    rng = np.random.default_rng(1)
    memory = wind.step(wind.WindMemory(STILL, (9.0, 9.0, 9.0)), 3, rng, False, p)
    assert memory == wind.WindMemory(AIR, STILL)
    assert rng.random() == np.random.default_rng(1).random()


def test_still_air_is_no_wind_at_all():
    assert wind.WindParams().values() is None
    assert wind.WindParams(gust_time=5.0).values() is None
    assert SimulatorParams().values().wind is None
    assert simulator.initial_state(SimulatorParams()).wind is None
    assert wind.WindParams(gust=(0.0, 0.0, 0.1)).values() is not None
    with pytest.raises(ParameterError, match='gust'):
        wind.WindParams(gust=(-1.0, 0.0, 0.0))
