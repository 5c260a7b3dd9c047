"""The plant against an independent integration, motor lag against its exponential, hover, drag."""

import dataclasses

from mambo_model.motion import rigid_body
from mambo_model.schema import ParameterError
from mambo_model.vehicle import motor_mixer
from mambo_model.vehicle.parameters import PRESETS, Vehicle
from mambo_sim import plant
from mambo_sim.plant import PlantParams, PlantState
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

DT = 0.005
ZERO = (0.0, 0.0, 0.0)
HOVER_PWM = (0.068 * 9.81 / 4 / 4.29e-5) ** (1 / 1.47)  # (4.5) by hand: 276.7


def airborne(nu=ZERO, q=(1.0, 0.0, 0.0, 0.0), omega=ZERO, height=20.0):
    body = rigid_body.State((0.0, 0.0, -height), nu, q, omega)
    return PlantState(body, (0.0,) * 4, ZERO)


def fly(state, pwms, vehicle, substeps=5, ground=True):
    vv = vehicle.values()
    for pwm in pwms:
        state = plant.advance(state, tuple(map(float, pwm)), DT, substeps, vv, ground)
    return state


def drag_force(vehicle, f, nu):
    k = vehicle.drag_coefficient
    factor = {
        'none': 0.0, 'per_rotor_thrust': f / 4 * k, 'total_thrust': f * k, 'force': k,
        'acceleration': vehicle.mass * k}[vehicle.drag_reading]
    return -factor * np.array([nu[0], nu[1], 0.0])


def independent_flight(vehicle, start, pwms):
    """Integrate (3.3) with motors (4.5) of first order by scipy, matrices instead of quats."""
    J = np.diag(vehicle.inertia)
    arm, d = vehicle.arm, vehicle.yaw_ratio
    places = np.array([[arm, -arm], [arm, arm], [-arm, arm], [-arm, -arm]])
    spin = np.array([-d, d, -d, d])
    lag = vehicle.motor_time_constant

    def rates(_, y, target):
        v, R, w = y[3:6], y[6:15].reshape(3, 3), y[15:18]
        T = y[18:22] if lag > 0 else target
        f = T.sum()
        torque = np.array([-(places[:, 1] * T).sum(), (places[:, 0] * T).sum(), spin @ T])
        nu = R.T @ v
        force = R @ (drag_force(vehicle, f, nu) - [0, 0, f])
        S = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        w_dot = np.linalg.solve(J, torque - np.cross(w, J @ w))
        T_dot = (target - T) / lag if lag > 0 else np.zeros(4)
        return np.r_[v, [0, 0, vehicle.gravity] + force / vehicle.mass, (R @ S).ravel(), w_dot,
                     T_dot]

    q = start.body.q
    R = Rotation.from_quat([q[1], q[2], q[3], q[0]]).as_matrix()
    y = np.r_[start.body.rho, R @ start.body.nu, R.ravel(), start.body.omega, start.thrust]
    for pwm in pwms:
        target = np.array([
            p / vehicle.linear_gain if vehicle.thrust_map == 'linear'
            else vehicle.power_a * p**vehicle.power_b for p in np.clip(pwm, 10, 500)])
        y = solve_ivp(rates, (0, DT), y, 'DOP853', args=(target,), rtol=1e-11, atol=1e-12).y[:, -1]
    return y


@pytest.mark.parametrize('vehicle', [
    Vehicle(), Vehicle(drag_reading='total_thrust'), Vehicle(drag_reading='force'),
    Vehicle(drag_reading='acceleration'), PRESETS['frictionless'], PRESETS['toolbox'],
    Vehicle(motor_time_constant=0.05)], ids=[
    'per_rotor', 'total', 'force', 'acceleration', 'no drag', 'toolbox', 'motor lag'])
def test_flight_equals_an_independent_integration(vehicle):
    rng = np.random.default_rng(4)
    start = airborne((1.5, -1.0, 0.3), (0.8, 0.2, -0.4, 0.4), (1.0, -2.0, 0.5))
    pwms = HOVER_PWM + rng.uniform(-30, 30, (100, 4))
    y = independent_flight(vehicle, start, pwms)
    body = fly(start, pwms, vehicle).body
    R = Rotation.from_quat([*body.q[1:], body.q[0]]).as_matrix()
    # fourth order at 1 ms: 1e-9; the mean thrust of a lagging motor is second order: 1e-6
    tolerance = 2e-5 if vehicle.motor_time_constant else 1e-8
    np.testing.assert_allclose(body.rho, y[:3], atol=tolerance)
    np.testing.assert_allclose(R @ body.nu, y[3:6], atol=tolerance)
    np.testing.assert_allclose(R, y[6:15].reshape(3, 3), atol=tolerance)
    np.testing.assert_allclose(body.omega, y[15:18], atol=20 * tolerance)
    assert np.linalg.norm(body.q) == pytest.approx(1.0, abs=1e-15)


def test_error_falls_with_the_fourth_power_of_the_step():
    rng = np.random.default_rng(5)
    start = airborne((1.5, -1.0, 0.3), (0.8, 0.2, -0.4, 0.4), (6.0, -8.0, 3.0))
    pwms = HOVER_PWM + rng.uniform(-80, 80, (40, 4))
    exact = np.array(fly(start, pwms, Vehicle(), 50).body.rho)
    errors = [np.linalg.norm(fly(start, pwms, Vehicle(), n).body.rho - exact) for n in (1, 2, 4)]
    assert 12 < errors[0] / errors[1] < 20  # 16 for order 4
    assert 12 < errors[1] / errors[2] < 20


def test_hovers_for_seconds_at_the_exact_command():
    state = fly(airborne(height=1.5), [[HOVER_PWM] * 4] * 2000, Vehicle())
    # rounding of the thrust is 1e-15 of the weight: 0.5 * 1e-14 m/s^2 * (10 s)^2
    np.testing.assert_allclose(state.body.rho, [0, 0, -1.5], atol=1e-11)
    assert state.body.q == (1.0, 0.0, 0.0, 0.0)


def test_falls_freely_with_motors_stopped():
    state = fly(airborne(height=20.0), [[0] * 4] * 200, Vehicle())
    assert state.body.rho[2] == pytest.approx(-20.0 + 0.5 * 9.81, abs=1e-12)
    assert plant.specific_force(state, Vehicle().values(), True) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize('pwm, effective', [
    (1.0, 10.0), (10.0, 10.0), (500.0, 500.0), (900.0, 500.0), (0.0, 0.0), (-5.0, 0.0),
    (float('nan'), 0.0)])
def test_command_is_cut_to_the_limits_and_zero_stops(pwm, effective):
    thrust = fly(airborne(), [[pwm, 300.0, 300.0, 300.0]], Vehicle()).thrust
    assert thrust[0] == pytest.approx(4.29e-5 * effective**1.47, rel=1e-14)
    assert thrust[1] == pytest.approx(4.29e-5 * 300**1.47, rel=1e-14)


def test_each_motor_has_its_own_corner():
    expected = {0: (1, 1, -1), 1: (-1, 1, 1), 2: (-1, -1, -1), 3: (1, -1, 1)}  # roll, pitch, yaw
    for motor, signs in expected.items():
        pwm = [HOVER_PWM] * 4
        pwm[motor] += 20.0
        omega = fly(airborne(), [pwm], Vehicle()).body.omega
        assert tuple(np.sign(omega)) == signs


def test_motor_lag_follows_the_exponential():
    lag = 0.04
    vehicle = Vehicle(motor_time_constant=lag)
    state, full = airborne(), 4.29e-5 * 300**1.47
    for k in range(1, 60):
        state = fly(state, [[300.0] * 4], vehicle)
        expected = full * (1 - np.exp(-k * DT / lag))
        np.testing.assert_allclose(state.thrust, expected, rtol=1e-12)  # exact but for rounding


def test_impulse_of_a_lagging_motor_is_exact():
    lag, n = 0.04, 20
    state = fly(airborne(), [[300.0] * 4] * n, Vehicle(motor_time_constant=lag))
    T, full = n * DT, 4 * 4.29e-5 * 300**1.47
    impulse = full * (T - lag * (1 - np.exp(-T / lag)))
    assert state.body.nu[2] == pytest.approx(9.81 * T - impulse / 0.068, abs=1e-12)


def test_stopped_motors_lose_their_thrust():
    vehicle = Vehicle(motor_time_constant=0.03)
    state = fly(airborne(), [[300.0] * 4] * 100, vehicle)
    faded = fly(state, [[0.0] * 4] * 12, vehicle)
    np.testing.assert_allclose(faded.thrust, np.array(state.thrust) * np.exp(-2.0), rtol=1e-12)
    assert fly(state, [[0.0] * 4], Vehicle()).thrust == (0.0,) * 4  # at once without lag


def test_drag_pulls_back_along_the_body_and_leaves_the_vertical_alone():
    vv = Vehicle().values()
    state = fly(airborne((1.0, -0.5, 0.7)), [[HOVER_PWM] * 4], Vehicle())
    felt = plant.specific_force(state, vv, True)
    nu = state.body.nu
    # R1: g k_c / 4 = 0.54 1/s at hover thrust
    assert felt[:2] == pytest.approx((-0.5396 * nu[0], -0.5396 * nu[1]), rel=1e-3)
    assert felt[2] == pytest.approx(-9.81, rel=1e-12)


def test_energy_is_the_work_of_thrust_and_drag():
    vehicle = Vehicle()
    vv = vehicle.values()
    rng = np.random.default_rng(6)
    state = airborne((1.0, 0.5, -0.2), omega=(0.5, 0.3, -0.4))

    def energy(s):
        b = s.body
        return (0.5 * 0.068 * np.dot(b.nu, b.nu) - 0.068 * 9.81 * b.rho[2]
                + 0.5 * np.dot(np.array(vehicle.inertia) * b.omega, b.omega))

    def power(s, thrust):
        f, tau = motor_mixer.mix(thrust, vv)
        drag = drag_force(vehicle, f, s.body.nu)
        return np.dot(drag - [0, 0, f], s.body.nu) + np.dot(tau, s.body.omega)

    start, work = energy(state), 0.0
    for pwm in HOVER_PWM + rng.uniform(-40, 40, (200, 4)):
        middle = plant.advance(state, tuple(pwm), DT / 2, 5, vv, True)
        end = fly(state, [pwm], vehicle)
        work += DT / 6 * sum(
            w * power(s, end.thrust) for w, s in ((1, state), (4, middle), (1, end)))  # Simpson
        state = end
    assert energy(state) - start == pytest.approx(work, abs=1e-7)  # of about 1 J
    assert abs(work) > 0.05


@pytest.mark.parametrize('changes, message', [
    ({'physics_rate': 1100}, 'multiple of 200 Hz'),
    ({'physics_rate': 20000}, 'outside'),
    ({'initial_position': (0.0, 0.0, 0.1)}, 'below the floor')])
def test_bad_parameters_name_themselves(changes, message):
    with pytest.raises(ParameterError, match=message):
        PlantParams(**changes)


def test_starts_where_it_is_told():
    params = PlantParams(initial_position=(1.0, 2.0, -3.0), initial_euler=(0.1, -0.2, 0.3))
    state = plant.initial(params)
    assert state.body.rho == (1.0, 2.0, -3.0)
    x, y, z, w = Rotation.from_euler('ZYX', [0.3, -0.2, 0.1]).as_quat()
    assert state.body.q == pytest.approx((w, x, y, z), abs=1e-15)
    assert PlantParams(physics_rate=10000).values().substeps == 50
    assert dataclasses.replace(params, ground=False, initial_position=(0.0, 0.0, 1.0))


def lengths(norm, gain=250.0, omega=(12.0, -16.0, 0.0), seconds=2.0):
    """Return |q|^2 of a body that tumbles, at 20 rad/s by default, after each control step."""
    params = plant.PlantParams(norm=norm, norm_gain=gain, ground=False)
    values, state = params.values(), plant.initial(params)
    spinning = state.body._replace(omega=omega, q=(1.0001, 0.0, 0.0, 0.0))
    state = state._replace(body=spinning)
    out = []
    for _ in range(round(seconds / 0.005)):
        state = plant.advance(
            state, (0.0,) * 4, 0.005, values.substeps, Vehicle().values(), values.ground, None,
            values.length_gain)
        out.append(sum(x * x for x in state.body.q))
    return np.array(out)


def test_the_length_of_the_quaternion_is_set_controlled_or_left_free():
    assert np.abs(lengths('normalise') - 1.0).max() < 1e-15
    controlled = lengths('control')
    # n - 1 shrinks as exp(-2 k t) (2.15); the method is of order 4, a few times (h w)^4 = 1.6e-7
    assert controlled[0] - 1.0 == pytest.approx(2e-4 * np.exp(-2 * 250.0 * 0.005), abs=1e-6)
    assert np.abs(controlled[-1] - 1.0) < 1e-6
    # RK4 alone keeps what it was given, but for (h w / 2)^6 / 72 a step of 1 ms
    assert lengths('free') == pytest.approx(1.0001**2, abs=1e-7)


def test_a_gain_beyond_its_limit_of_stability_is_refused():
    still = lengths('control', 1380.0, (0.0, 0.0, 0.0))
    assert np.abs(still[-1] - 1.0) < 1e-6 < np.abs(still[0] - 1.0)
    with pytest.raises(ParameterError, match=r'norm_gain = 1400 1/s is not stable: .* 1.39 times'):
        plant.PlantParams(norm='control', norm_gain=1400.0)
