"""A push along b3 moves the vehicle as Newton says and is felt; no push changes no bit."""

from mambo_model.motion.rigid_body import State
from mambo_sim import pushed, simulator
from mambo_sim.plant import PlantState
from mambo_sim.simulator import SimulatorParams
import numpy as np
import pytest

PARAMS = SimulatorParams(noise=False)
VALUES = PARAMS.values()
STILL, STEP = (0.0,) * 4, 0.005


def in_air(q=(1.0, 0.0, 0.0, 0.0)):
    """Return a simulator at rest in the air, motors stopped."""
    begin = simulator.initial_state(PARAMS)
    body = State((0.0, 0.0, -50.0), (0.0,) * 3, q, (0.0,) * 3)
    return begin._replace(plant=PlantState(body, STILL, (0.0,) * 3))


def fall(push, steps=40):
    state = in_air()
    for _ in range(steps):
        state = pushed.advance_pushed(state, STILL, True, VALUES, push)
    return state.plant.body


def test_a_constant_push_is_integrated_exactly():
    force, t = 0.3, 40 * STEP
    free, driven = fall(0.0), fall(force)
    a = force / VALUES.vehicle.mass
    assert driven.nu[2] - free.nu[2] == pytest.approx(a * t, rel=1e-12)
    assert driven.rho[2] - free.rho[2] == pytest.approx(0.5 * a * t * t, rel=1e-9)


@pytest.mark.long
def test_no_push_is_the_plain_step():
    plain = simulator.advance(in_air(), STILL, True, VALUES)
    assert pushed.advance_as(in_air(), STILL, True, VALUES, None).plant == plain.plant
    _, samples = simulator.sense(in_air(), 0, simulator.generators(3), VALUES)
    _, same = pushed.sense_as(in_air(), 0, simulator.generators(3), VALUES, None)
    assert same.accel == samples.accel and same.gyro == samples.gyro


@pytest.mark.long
def test_the_accelerometer_feels_the_push_and_the_vehicle_keeps_its_jolt():
    def accel(push):
        state, samples = pushed.sense_pushed(
            in_air(), 0, simulator.generators(1), VALUES, push)
        assert state.plant.jolt == (0.0, 0.0, 0.0)
        return np.array(samples.accel)
    found = accel(0.2) - accel(0.0)
    digit = 16.0 * 9.81 / 2**15  # m/s^2: an accelerometer of 16 bits and 16 g
    np.testing.assert_allclose(found, (0.0, 0.0, 0.2 / VALUES.vehicle.mass), atol=digit)


def test_what_the_hall_sees_is_position_axis_and_thrust():
    half = np.sqrt(0.5)
    state = in_air((half, half, 0.0, 0.0))._replace()
    plant = state.plant._replace(thrust=(0.1, 0.2, 0.3, 0.4))
    row = np.zeros(pushed.COLUMNS)
    pushed.observe(plant, row)
    # rolled right by 90 deg: down through the rotors points west, -y
    np.testing.assert_allclose(row, (0.0, 0.0, -50.0, 0.0, -1.0, 0.0, 1.0), atol=1e-15)
