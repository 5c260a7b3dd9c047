"""The plant with a vehicle's options against an independent integration and hand cases."""

import dataclasses
import math

from mambo_model.motion import rigid_body
from mambo_model.vehicle.parameters import preset, Vehicle
from mambo_model.vehicle.vehicle_options import (
    BatteryParams, DragParams, FadeParams, GroundEffectParams, RotorParams)
from mambo_sim import plant
from mambo_sim.plant import PlantParams, PlantState
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

DT = 0.005
ZERO = (0.0, 0.0, 0.0)
HOVER = 0.068 * 9.81 / 4.0
HOVER_PWM = (HOVER / 4.29e-5) ** (1 / 1.47)  # (4.5) by hand: 276.7
SPINS = np.array([1.0, -1.0, 1.0, -1.0])  # clockwise seen from above

EVERYTHING = Vehicle(
    motor_time_constant=0.04,
    drag=DragParams(
        blade_flapping=True, induced=True, translational=True, profile='linear', parasitic=True),
    rotor=RotorParams(torques=True), ground_effect=GroundEffectParams(enabled=True),
    fade=FadeParams(enabled=True, pwm=270.0, time_constant=0.3),
    battery=BatteryParams(enabled=True, capacity=0.01))


def at(height, nu=ZERO, q=(1.0, 0.0, 0.0, 0.0), omega=ZERO, thrust=0.0):
    body = rigid_body.State((0.0, 0.0, -height), nu, q, omega)
    return PlantState(body, (thrust,) * 4, ZERO)


def fly(state, pwms, vehicle, substeps=5, ground=True):
    vv, options = vehicle.values(), vehicle.options()
    for pwm in pwms:
        pwm = tuple(map(float, pwm))
        state = plant.advance(state, pwm, DT, substeps, vv, ground, options)
    return state


def rates(y, target, T_dot_of, vehicle):
    """Return the rates of position, velocity, R, body rate, thrusts; written out in numpy."""
    rho, v, R, w, T = y[:3], y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:22]
    l, d, p, r = vehicle.arm, vehicle.yaw_ratio, vehicle.drag, vehicle.rotor
    places = np.array([[l, -l, -0.03], [l, l, -0.03], [-l, l, -0.03], [-l, -l, -0.03]])
    z = -(rho[2] + (places @ R.T)[:, 2])
    lift = T / (1.0 - (r.radius / (4.0 * np.maximum(z, 0.5 * r.radius))) ** 2)
    nu = R.T @ v
    speed = np.sqrt(T / r.speed_coefficient)
    k = (vehicle.drag_coefficient / 4.0 + p.flapping_velocity + p.induced_coefficient
         + p.translational_coefficient + p.profile_coefficient)
    lean = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) @ w
    force = -lift.sum() * k * np.array([nu[0], nu[1], 0.0])
    force += p.flapping_rate * (lift / speed).sum() * lean
    force -= np.linalg.norm(nu) * np.array(p.parasitic_coefficient) * nu
    force[2] -= lift.sum()
    T_dot = T_dot_of(T)
    momentum = np.array([0.0, 0.0, r.inertia * SPINS @ speed])
    momentum_rate = np.array([0.0, 0.0, r.inertia * SPINS @ (
        T_dot / (2.0 * np.sqrt(r.speed_coefficient * T)))])
    torque = np.array([-(places[:, 1] * lift).sum(), (places[:, 0] * lift).sum(), -d * SPINS @ T])
    J = np.diag(vehicle.inertia)
    w_dot = np.linalg.solve(J, torque - np.cross(w, J @ w + momentum) - momentum_rate)
    S = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    gravity = np.array([0.0, 0.0, vehicle.gravity])
    return np.r_[v, gravity + R @ force / vehicle.mass, (R @ S).ravel(), w_dot, T_dot]


def independent_flight(vehicle, start, pwms):
    """Integrate everything by scipy, one held command after the other."""
    b, fade, q = vehicle.battery, vehicle.fade, start.body.q
    R = Rotation.from_quat([q[1], q[2], q[3], q[0]]).as_matrix()
    y = np.r_[start.body.rho, R @ start.body.nu, R.ravel(), start.body.omega, start.thrust]
    lost, charge = np.zeros(4), 0.0
    for pwm in pwms:
        open_v = 4.2 - charge / (3600.0 * b.capacity) * 0.8
        ideal = (y[18:22] ** 1.5).sum() / math.sqrt(
            2.0 * vehicle.air_density * math.pi * vehicle.rotor.radius**2)
        # V = V_0 - r P/V, the larger root
        voltage = np.roots([1.0, -open_v, b.resistance * ideal / b.efficiency]).max()
        target = (1.0 - lost) * vehicle.power_a * (pwm * voltage / 3.7) ** vehicle.power_b
        tau = vehicle.motor_time_constant
        y = solve_ivp(
            lambda _, y: rates(y, target, lambda T: (target - T) / tau, vehicle),  # noqa: B023
            (0.0, DT), y, 'DOP853', rtol=1e-10, atol=1e-12).y[:, -1]  # (used at once)
        charge += DT * (open_v - voltage) / b.resistance
        final = np.where(pwm > fade.pwm, fade.loss, 0.0)
        lost = final + (lost - final) * math.exp(-DT / fade.time_constant)
    return y, lost, charge


def test_flight_with_everything_equals_an_independent_integration():
    rng = np.random.default_rng(8)
    start = at(0.10, (1.5, -1.0, -0.3), (0.98, 0.1, -0.1, 0.135), (1.0, -2.0, 0.5), HOVER)
    q = np.array(start.body.q) / np.linalg.norm(start.body.q)
    start = start._replace(body=start.body._replace(q=tuple(q.tolist())))
    pwms = HOVER_PWM + rng.uniform(-25.0, 35.0, (60, 4))
    y, lost, charge = independent_flight(EVERYTHING, start, pwms)
    end = fly(start, pwms, EVERYTHING, substeps=50)
    R = Rotation.from_quat([*end.body.q[1:], end.body.q[0]]).as_matrix()
    assert end.body.rho[2] < -0.05  # it stayed in the air, near the floor
    # held mean thrust and rotor momentum are second order at 0.1 ms
    np.testing.assert_allclose(end.body.rho, y[:3], atol=2e-7)
    np.testing.assert_allclose(R @ end.body.nu, y[3:6], atol=2e-6)
    np.testing.assert_allclose(R, y[6:15].reshape(3, 3), atol=2e-6)
    np.testing.assert_allclose(end.body.omega, y[15:18], atol=2e-5)
    np.testing.assert_allclose(end.thrust, y[18:22], rtol=1e-9)
    np.testing.assert_allclose(end.lost, lost, rtol=1e-12)
    assert end.charge == pytest.approx(charge, rel=1e-9)
    assert charge > 1.0 and (lost > 0.01).all()


@pytest.mark.parametrize('group, changes', [
    ('drag', {'blade_flapping': False, 'induced': False, 'translational': False}),
    ('drag', {'profile': 'none'}), ('drag', {'parasitic': False}), ('rotor', {'torques': False}),
    ('ground_effect', {'enabled': False}), ('fade', {'enabled': False}),
    ('battery', {'enabled': False})], ids=str)
def test_each_option_matters_to_that_flight(group, changes):
    rng = np.random.default_rng(8)
    start = at(0.06, (1.5, -1.0, 0.0), omega=(1.0, -2.0, 0.5), thrust=HOVER)
    pwms = HOVER_PWM + rng.uniform(-25.0, 35.0, (60, 4))
    without = dataclasses.replace(
        EVERYTHING, **{group: dataclasses.replace(getattr(EVERYTHING, group), **changes)})
    a, b = (np.concatenate(fly(start, pwms, v).body) for v in (EVERYTHING, without))
    assert np.abs(a - b).max() > 1e-3


def test_options_that_do_not_act_change_no_bit():
    rng = np.random.default_rng(9)
    idle = Vehicle(motor_time_constant=0.03, fade=FadeParams(enabled=True, pwm=65535.0))
    plain, top = plant.initial(PlantParams()), 0.0
    same = plain
    for _ in range(300):
        pwm = tuple((HOVER_PWM + rng.uniform(-20.0, 40.0, 4)).tolist())
        plain = plant.advance(plain, pwm, DT, 5, idle.values(), True)
        same = plant.advance(same, pwm, DT, 5, idle.values(), True, idle.options())
        assert same == plain
        assert plant.specific_force(plain, idle.values(), True) == plant.specific_force(
            plain, idle.values(), True, idle.options())
        top = min(top, plain.body.rho[2])
    assert top < -0.01 and plain.body.rho[2] == 0.0  # it took off and came down


def test_vehicle_without_options_remembers_neither_fading_nor_charge():
    state = fly(at(20.0), [[400.0] * 4] * 100, Vehicle())
    assert (state.lost, state.charge) == ((0.0,) * 4, 0.0)


def test_thrust_on_a_bench_fades_by_seven_percent_and_recovers():
    vehicle = Vehicle(fade=FadeParams(enabled=True))
    full = 4.29e-5 * 400.0**1.47
    state = at(500.0)
    for k in range(2000):
        state = fly(state, [[400.0, 400.0, 340.0, 340.0]], vehicle)
        expected = full * (1.0 - 0.07 * (1.0 - math.exp(-DT * k / 2.0)))
        assert state.thrust[0] == state.thrust[1] == pytest.approx(expected, rel=1e-12)
        assert state.thrust[2] == pytest.approx(4.29e-5 * 340.0**1.47, rel=1e-14)
    assert state.thrust[0] == pytest.approx(0.93 * full, rel=1e-3)  # after five time constants
    rested = fly(state, [[0.0] * 4] * 2000, vehicle)
    assert rested.lost == pytest.approx([0.07 * math.exp(-5.0)] * 2 + [0.0] * 2, rel=0.01)


def test_supply_sags_with_the_load_and_with_the_charge():
    vehicle = Vehicle(battery=BatteryParams(enabled=True))
    idle = fly(at(50.0), [[HOVER_PWM] * 4], vehicle)
    # no load yet: 4.2 V on a map measured at 3.7 V
    assert idle.thrust[0] == pytest.approx(HOVER * (4.2 / 3.7) ** 1.47, rel=1e-12)
    loaded = fly(idle, [[HOVER_PWM] * 4], vehicle)
    assert HOVER < loaded.thrust[0] < idle.thrust[0]
    used = loaded._replace(charge=0.9 * 0.66 * 3600.0)
    assert fly(used, [[HOVER_PWM] * 4], vehicle).thrust[0] < 0.85 * HOVER


def test_flight_ends_with_the_charge():
    vehicle = Vehicle(battery=BatteryParams(enabled=True, capacity=0.01))
    state, ticks = at(500.0, thrust=HOVER), 0
    while state.thrust[0] > 0.0 and ticks < 10000:
        state, ticks = fly(state, [[HOVER_PWM] * 4], vehicle), ticks + 1
    assert state.charge == pytest.approx(36.0, abs=0.05)  # 10 mA h, to one step of 5 A
    assert 6.0 < ticks * DT < 10.0
    assert fly(state, [[HOVER_PWM] * 4], vehicle).charge == state.charge


def test_charge_drawn_is_the_work_over_voltage_and_efficiency():
    vehicle = Vehicle(battery=BatteryParams(enabled=True, resistance=0.0))
    state = at(500.0, thrust=HOVER)
    work = 0.0
    for _ in range(400):
        T = np.array(state.thrust)
        open_v = 4.2 - 0.8 * state.charge / (0.66 * 3600.0)
        v_i = np.sqrt(T / (2.0 * 1.184 * math.pi * 0.033**2))
        work += DT * (T @ v_i) / open_v
        state = fly(state, [[HOVER_PWM] * 4], vehicle)
    assert state.charge == pytest.approx(work / 0.2, rel=1e-10)


def test_yawing_conserves_the_angular_momentum_of_body_rotors_and_air():
    vehicle = Vehicle(motor_time_constant=0.05, rotor=RotorParams(torques=True))
    state, vv = at(50.0, thrust=HOVER), vehicle.values()
    by_air, start = 0.0, state
    for k in range(60):
        pwm = (HOVER_PWM + 30.0, HOVER_PWM, HOVER_PWM + 30.0, HOVER_PWM) if k < 30 else (
            HOVER_PWM,) * 4
        before = np.array(state.thrust)
        state = fly(state, [pwm], vehicle)
        target = 4.29e-5 * np.array(pwm) ** 1.47
        # torque of the air on the rotors, through the motors on the body: -d s T, T exponential
        mean = target + (before - target) * (1.0 - math.exp(-0.1)) / 0.1
        by_air += DT * -vv.yaw_ratio * SPINS @ mean

    def momentum(s):
        return 1.5e-4 * s.body.omega[2] + 1.36e-7 * SPINS @ np.sqrt(np.array(s.thrust) / 4.74e-8)

    assert momentum(state) - momentum(start) == pytest.approx(by_air, rel=1e-9)
    assert abs(by_air) > 1e-5


def test_rotors_that_spin_up_yaw_the_vehicle_sooner_than_the_air_does():
    lazy = Vehicle(motor_time_constant=0.03)
    quick = dataclasses.replace(lazy, rotor=RotorParams(torques=True))
    pwm = (HOVER_PWM + 20.0, HOVER_PWM - 20.0, HOVER_PWM + 20.0, HOVER_PWM - 20.0)
    slow, fast = (fly(at(50.0, thrust=HOVER), [pwm], v).body.omega[2] for v in (lazy, quick))
    assert fast < 3.0 * slow < 0.0  # clockwise rotors faster: the body turns counterclockwise


def test_floor_carries_part_of_the_thrust_that_a_take_off_needs():
    vehicle = Vehicle(ground_effect=GroundEffectParams(enabled=True))
    gain = 1.0 / (1.0 - (0.033 / (4.0 * 0.03)) ** 2)  # rotors 3 cm above the floor
    edge = (HOVER / gain / 4.29e-5) ** (1 / 1.47)
    start = plant.initial(PlantParams())
    stays = fly(start, [[edge * (1.0 - 1e-9)] * 4] * 50, vehicle)
    assert stays.body == start.body
    felt = plant.specific_force(stays, vehicle.values(), True, vehicle.options())
    assert felt == pytest.approx((0.0, 0.0, -9.81), abs=1e-12)
    assert fly(start, [[edge * 1.001] * 4] * 50, vehicle).body.rho[2] < 0.0
    assert fly(start, [[edge * 1.001] * 4] * 50, Vehicle()).body == start.body


def test_a_cushion_of_air_bears_what_hover_thrust_alone_does_not():
    # at 99 % of the weight it sinks to where the floor gives the missing percent and bobs there
    vehicle = Vehicle(ground_effect=GroundEffectParams(enabled=True))
    pwm = (0.99 * HOVER / 4.29e-5) ** (1 / 1.47)
    balance = 0.25 * 0.033 / math.sqrt(0.01) - 0.03
    state, heights = at(balance), []
    for _ in range(2000):
        state = fly(state, [[pwm] * 4], vehicle)
        heights.append(-state.body.rho[2])
    np.testing.assert_allclose(heights, balance, atol=1e-9)
    assert fly(at(balance), [[pwm] * 4] * 400, vehicle, ground=False).body.rho[2] > -balance + 0.1


def test_terminal_speed_with_parts_is_where_they_balance_the_tilt():
    vehicle = dataclasses.replace(
        preset('frictionless'), drag=DragParams(induced=True, parasitic=True))
    tilt = 0.2
    state = at(50.0, q=(math.cos(tilt / 2), 0.0, -math.sin(tilt / 2), 0.0))
    for _ in range(8000):  # 40 s; held level and up by hand, drag along body x and z decides
        state = fly(state, [[HOVER_PWM] * 4], vehicle)
        state = state._replace(body=state.body._replace(
            rho=(0.0, 0.0, -50.0), nu=(state.body.nu[0], 0.0, 0.0), omega=ZERO))
    v = state.body.nu[0]
    # nine time constants
    assert 4.0 * HOVER * 0.0223 * v + 0.0014 * v * v == pytest.approx(
        0.068 * 9.81 * math.sin(tilt), rel=1e-5)


@pytest.mark.parametrize('name', ['crazyflie', 'rolling_spider', 'identified_markers'])
def test_every_vehicle_hovers_at_its_own_command(name):
    vehicle = preset(name)
    thrust = 0.25 * vehicle.mass * vehicle.gravity
    pwm = thrust * vehicle.linear_gain if vehicle.thrust_map == 'linear' else (
        thrust / vehicle.power_a) ** (1.0 / vehicle.power_b)
    assert 0.4 * vehicle.pwm_max < pwm < 0.6 * vehicle.pwm_max
    state = fly(at(1.5, thrust=thrust), [[pwm] * 4] * 1000, vehicle)
    np.testing.assert_allclose(state.body.rho, [0.0, 0.0, -1.5], atol=1e-10)


@pytest.mark.parametrize('lag', [0.0, 0.03])
@pytest.mark.parametrize('part', [
    {}, {'battery': BatteryParams(enabled=True)}, {'fade': FadeParams(enabled=True)}])
def test_motors_spin_alone_as_in_flight(lag, part):
    vehicle = Vehicle(motor_time_constant=lag, **part)
    vv, options = vehicle.values(), vehicle.options()
    flying = alone = plant.initial(PlantParams())
    rng = np.random.default_rng(0)
    for pwm in rng.uniform(200.0, 480.0, (400, 4)).tolist():
        flying = plant.advance(flying, tuple(pwm), DT, 5, vv, True, options)
        alone = plant.spin(alone, tuple(pwm), DT, 5, vv, options)
        assert (alone.thrust, alone.lost, alone.charge) == (
            flying.thrust, flying.lost, flying.charge)
    assert alone.body == plant.initial(PlantParams()).body
