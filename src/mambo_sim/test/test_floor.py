"""The floor: carries without jitter, stops what lands, lets go, is not felt in the air."""

from mambo_model.motion import rigid_body
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import plant
from mambo_sim.plant import PlantParams, PlantState
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

DT = 0.005
ZERO = (0.0, 0.0, 0.0)
VV = Vehicle().values()
HOVER_PWM = (0.068 * 9.81 / 4 / 4.29e-5) ** (1 / 1.47)


def at(rho=ZERO, v=ZERO, euler=ZERO, omega=ZERO):
    """Return a state from inertial velocity and roll, pitch, yaw."""
    R = Rotation.from_euler('ZYX', euler[::-1])
    x, y, z, w = R.as_quat().tolist()
    nu = tuple(R.inv().apply(v).tolist())
    return PlantState(rigid_body.State(rho, nu, (w, x, y, z), omega), (0.0,) * 4, ZERO)


def step(state, pwm=0.0, ground=True, substeps=5):
    pwm = tuple(map(float, pwm)) if np.ndim(pwm) else (float(pwm),) * 4
    return plant.advance(state, pwm, DT, substeps, VV, ground)


def run(state, pwm=0.0, n=200, **kwargs):
    for _ in range(n):
        state = step(state, pwm, **kwargs)
    return state


def tilt(q):
    return np.arccos(np.clip(1 - 2 * (q[1]**2 + q[2]**2), -1, 1))


@pytest.mark.parametrize('pwm', [
    0.0, 10.0, 270.0, HOVER_PWM - 1e-6, (200.0, 250.0, 200.0, 250.0),
    (250.0, 250.0, 200.0, 200.0)])
def test_rests_without_moving_a_bit_while_thrust_is_below_weight(pwm):
    start = plant.initial(PlantParams(initial_euler=(0.0, 0.0, 0.7)))
    end = run(start, pwm, 1000)
    assert end.body == start.body and end.jolt == ZERO


def test_accelerometer_at_rest_feels_the_floor():
    for pwm in (0.0, 270.0):
        state = run(plant.initial(PlantParams()), pwm, 3)
        felt = plant.specific_force(state, VV, True)
        assert felt == pytest.approx((0.0, 0.0, -9.81), abs=1e-14)  # rounding of f/m


def test_takes_off_when_thrust_exceeds_weight():
    pwm = (1.2 * 0.068 * 9.81 / 4 / 4.29e-5) ** (1 / 1.47)
    state = run(plant.initial(PlantParams()), pwm, 100)
    assert state.body.rho[2] == pytest.approx(-0.5 * 0.2 * 9.81 * 0.5**2, abs=1e-12)


def test_landing_stops_the_fall_at_once_and_friction_the_slide():
    state, last = at((0.0, 0.0, -0.02), (1.0, -0.5, 1.0)), None
    while state.body.rho[2] < 0.0:
        last, state = state, step(state)
    assert last.body.rho[2] < 0.0
    assert Rotation.identity().apply(state.body.nu)[2] == pytest.approx(0.0, abs=1e-12)
    end = run(state, n=100)
    assert end.body.nu == ZERO and end.body.omega == ZERO
    assert end.body.rho[2] == 0.0
    # friction takes 0.6 of the fall (1.18 m/s at impact) from 1.118 m/s, then 0.6 g: 1.5 cm more
    along = np.array([1.0, -0.5]) / np.hypot(1.0, 0.5)
    left = np.hypot(1.0, 0.5) - 0.6 * np.sqrt(1.0 + 2 * 9.81 * 0.02)
    air = (np.sqrt(1 + 2 * 9.81 * 0.02) - 1) / 9.81 * np.hypot(1.0, 0.5)
    expected = (air + left**2 / (2 * 0.6 * 9.81)) * along
    np.testing.assert_allclose(end.body.rho[:2], expected, atol=2e-3)  # 1 ms of 1.1 m/s


def test_sliding_distance_is_that_of_coulomb_friction():
    end = run(at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), n=100, substeps=50)
    assert end.body.rho[0] == pytest.approx(1 / (2 * 0.6 * 9.81), abs=1e-4)  # h v / 2
    half_weight = (0.5 * 0.068 * 9.81 / 4 / 4.29e-5) ** (1 / 1.47)
    longer = run(at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), half_weight, n=200, substeps=50)
    assert longer.body.rho[0] > 1.7 / (2 * 0.6 * 9.81)  # half the grip, some drag


def test_accelerometer_feels_friction_against_the_slide():
    felt = plant.specific_force(at(ZERO, (1.0, 0.0, 0.0)), VV, True)
    assert felt == pytest.approx((-0.6 * 9.81, 0.0, -9.81), abs=1e-12)


@pytest.mark.parametrize('euler', [(0.3, 0.0, 0.0), (0.0, -0.3, 1.0), (-0.2, 0.25, -2.0)])
def test_tilted_landing_settles_level_and_keeps_its_yaw(euler):
    state, angles = at((0.0, 0.0, 0.0), ZERO, euler, (1.0, 2.0, 3.0)), []
    for _ in range(200):
        before, state = state, step(state)
        angles.append(tilt(state.body.q))
        # the gyro sees the turn that the attitude makes, half a step late
        a, b = (Rotation.from_quat([*s.body.q[1:], s.body.q[0]]) for s in (before, state))
        if 1e-3 < angles[-1]:
            turned = (a.inv() * b).as_rotvec() / DT
            np.testing.assert_allclose(turned, state.body.omega, rtol=0.1, atol=0.05)
    assert np.all(np.diff(angles) <= 0.0) and angles[-1] == 0.0
    assert state.body.omega == ZERO
    yaw = Rotation.from_quat([*state.body.q[1:], state.body.q[0]]).as_euler('ZYX')[0]
    assert yaw == pytest.approx(euler[2], abs=0.06)


def test_a_vehicle_stands_and_settles_as_the_floor_slopes():
    params = PlantParams(floor_slope=(0.02, -0.01), initial_euler=(0.0, 0.0, 0.7))
    floor = Rotation.from_euler('YX', [-0.01, 0.02])
    stands = floor * Rotation.from_euler('Z', 0.7)

    def slopes(state, n=200):
        for _ in range(n):
            state = plant.advance(
                state, (0.0,) * 4, DT, 5, VV, True, floor=params.values().floor)
        return state

    def attitude(state):
        return Rotation.from_quat([*state.body.q[1:], state.body.q[0]])

    start = plant.initial(params)
    rested = slopes(start)
    assert (attitude(start).inv() * stands).magnitude() < 1e-12
    assert (attitude(rested).inv() * stands).magnitude() < 1e-12
    assert rested.body.omega == ZERO and rested.body.rho == ZERO
    felt = plant.specific_force(rested, VV, True)
    np.testing.assert_allclose(felt, stands.inv().apply([0.0, 0.0, -9.81]), atol=1e-12)
    landed = slopes(at(ZERO, ZERO, (0.3, 0.0, 0.0)))
    down = (floor.inv() * attitude(landed)).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(down, [0.0, 0.0, 1.0], atol=1e-12)


def test_floor_is_level_unless_it_is_told_to_slope():
    assert PlantParams().values().floor is None
    assert PlantParams(ground=False, floor_slope=(0.02, 0.0)).values().floor is None


def test_vehicle_on_its_back_stays_as_it_lies():
    state = run(at((0.0, 0.0, -0.1), euler=(3.0, 0.0, 0.0), omega=(1.0, 0.0, 0.0)), n=300)
    assert state.body.omega == ZERO and state.body.nu == ZERO and tilt(state.body.q) > 2.5
    assert run(state, 400.0, 10).body.rho[2] == 0.0  # thrust presses it down


def test_takes_off_again_after_a_landing():
    landed = run(at((0.0, 0.0, -0.3), (0.4, 0.0, 0.5), (0.1, 0.1, 0.0)), n=200)
    assert landed.body.nu == ZERO
    flying = run(landed, 320.0, 100)
    assert flying.body.rho[2] < -0.2
    assert flying.body.rho[:2] == pytest.approx(landed.body.rho[:2], abs=1e-12)


def test_never_goes_through():
    rng = np.random.default_rng(0)
    state = at((0.0, 0.0, -0.5), (3.0, 2.0, 40.0), (1.0, -0.7, 0.2), (20.0, -10.0, 5.0))
    for _ in range(2000):
        state = step(state, rng.uniform(0.0, 500.0, 4))
        assert state.body.rho[2] <= 0.0 and np.isfinite(state.body.omega).all()
        assert np.linalg.norm(state.body.q) == pytest.approx(1.0, abs=1e-12)


def test_lets_go_what_moves_upward_already():
    state = run(at(ZERO, (0.0, 0.0, -1.0)), n=10)  # thrown up with motors stopped
    assert state.body.rho[2] == pytest.approx(-0.05 + 0.5 * 9.81 * 0.05**2, abs=1e-12)


def test_holds_a_lying_vehicle_against_a_push_up_to_its_grip():
    tilt = 1.2  # lies on its tail, thrust pushes it backward
    still = np.array([np.sin(tilt), 0.0, -np.cos(tilt)]) * 9.81
    for thrust in (0.0, 0.2, 0.5):
        pwm = (thrust / 4 / 4.29e-5) ** (1 / 1.47)
        state = run(at(euler=(0.0, tilt, 0.0)), pwm, 2)
        push = thrust / 0.068 * np.sin(tilt)
        grip = 0.6 * (9.81 - thrust / 0.068 * np.cos(tilt))
        slide = max(push - grip, 0.0)  # backward
        felt = plant.specific_force(state, VV, True)
        expected = still + slide * np.array([-np.cos(tilt), 0.0, -np.sin(tilt)])
        # drag on 1 cm/s of sliding: 1e-2 m/s^2
        np.testing.assert_allclose(felt, expected, atol=2e-2 if slide else 1e-12)
        assert (state.body.rho[0] < 0.0) == (slide > 0.0)


def test_is_not_felt_in_the_air():
    rng = np.random.default_rng(1)
    with_floor = without = at((0.0, 0.0, -3.0), (0.5, 0.2, 0.1), (0.1, 0.2, 0.3))
    for _ in range(100):
        pwm = HOVER_PWM + rng.uniform(-20, 20, 4)
        with_floor, without = step(with_floor, pwm), step(without, pwm, ground=False)
        assert with_floor == without
        assert plant.specific_force(with_floor, VV, True) == plant.specific_force(
            with_floor, VV, False)


def test_without_ground_it_falls_on():
    state = run(at(), n=200, ground=False)
    assert state.body.rho[2] == pytest.approx(0.5 * 9.81, abs=1e-12)
    assert plant.specific_force(state, VV, False) == ZERO


def test_accelerometer_feels_the_whole_blow_of_a_landing():
    state, felt = at((0.0, 0.0, -0.05), (0.0, 0.0, 0.5)), np.zeros(3)
    peak = 0.0
    for _ in range(200):
        state = step(state)
        force = plant.specific_force(state, VV, True)
        felt += DT * np.array(force)
        peak = max(peak, -force[2])
    # the fall ends at v; what is felt is that change and then the support, to one step of gravity
    v = np.sqrt(0.5**2 + 2 * 9.81 * 0.05)
    fall = (v - 0.5) / 9.81
    assert felt[2] == pytest.approx(-v - 9.81 * (200 * DT - fall), abs=9.81 * 2 * DT)
    assert 9.81 + 0.8 * v / 0.02 < peak < 9.81 + v / 0.02 + 0.5  # over 20 ms
