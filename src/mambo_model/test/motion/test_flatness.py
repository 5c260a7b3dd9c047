"""Feasibility (3.14) of every reference by central differences, and its published demands."""

import math

from mambo_model.motion import flatness, quaternion
from mambo_model.motion.trajectory import flat_output, FlightPlanParams, reference_at, TRAJECTORIES
from mambo_model.vehicle.motor_mixer import pwm_from_thrust
from mambo_model.vehicle.parameters import preset
import numpy as np
import pytest

VEHICLE = preset('identified')
MASS, INERTIA, GRAVITY = VEHICLE.mass, VEHICLE.inertia, VEHICLE.gravity
LANDING = 12.0
# every part of a flight, none of them within a step of a seam; LANDING + 6 s is the end
TIMES = np.arange(0.5137, LANDING + 7.0, 0.2311).tolist()
H = 2e-5  # s: h^2/6 times a third derivative below 100, and 1e-16/h


def least_rotation(plan):
    def at(t):
        return flatness.from_flat_output(*flat_output(t, plan)[:5], MASS, INERTIA, GRAVITY)
    return at


def moving_yaw(plan):
    def at(t):
        psi = 0.3 * t + 0.7 * math.sin(0.9 * t)
        return flatness.from_flat_output_yaw(
            *flat_output(t, plan)[:5], psi, 0.3 + 0.63 * math.cos(0.9 * t),
            -0.567 * math.sin(0.9 * t), MASS, INERTIA, GRAVITY)
    return at


def residuals(at, t):
    """Return the largest violation of (3.14a)-(3.14d), in m/s, m/s^2, 1/s and rad/s^2."""
    before, ref, after = at(t - H), at(t), at(t + H)

    def rate(of):
        return np.subtract(of(after), of(before)) / (2.0 * H)

    nu, J, w = np.array(flatness.body_velocity(ref)), np.array(INERTIA), np.array(ref.omega)
    down = quaternion.rotate_inverse(ref.q, (0.0, 0.0, GRAVITY))
    thrust = np.array([0.0, 0.0, ref.f / MASS])
    q_dot = quaternion.multiply(ref.q, (0.0, *ref.omega))
    omega_dot = (np.cross(J * w, w) + ref.tau) / J
    return [float(np.abs(r).max()) for r in (
        rate(lambda r: r.rho) - quaternion.rotate(ref.q, tuple(nu.tolist())),
        rate(flatness.body_velocity) + np.cross(w, nu) - down + thrust,
        rate(lambda r: r.q) - 0.5 * np.array(q_dot),
        rate(lambda r: r.omega) - omega_dot,
        np.subtract(ref.omega_dot, omega_dot))]


@pytest.mark.parametrize('attitude', [least_rotation, moving_yaw])
@pytest.mark.parametrize('takeoff', ['smooth', 'none'])
@pytest.mark.parametrize('trajectory', TRAJECTORIES)
def test_reference_satisfies_the_dynamics(trajectory, takeoff, attitude):
    plan = FlightPlanParams(trajectory=trajectory, takeoff=takeoff, landing_time=LANDING).values()
    worst = np.max([residuals(attitude(plan), t) for t in TIMES], axis=0)
    assert (worst < 1e-6).all(), worst


def test_turning_round_on_a_loop_satisfies_the_dynamics():
    plan = FlightPlanParams(trajectory='hand_loop', takeoff='none').values()
    times = np.arange(plan.turn_time - 1.3, plan.turn_time + 1.3, 0.0437).tolist()
    worst = np.max([residuals(least_rotation(plan), t) for t in times], axis=0)
    assert (worst < 1e-6).all(), worst


@pytest.mark.parametrize('trajectory', TRAJECTORIES)
def test_thrust_and_weight_make_the_acceleration(trajectory):
    plan = FlightPlanParams(trajectory=trajectory).values()
    for t in TIMES:
        for ref in (least_rotation(plan)(t), moving_yaw(plan)(t)):
            axis = np.array(quaternion.to_matrix(ref.q))[:, 2]
            np.testing.assert_allclose(
                [0.0, 0.0, GRAVITY] - ref.f / MASS * axis, ref.a, rtol=0.0, atol=1e-13)
            assert quaternion.norm(ref.q) == pytest.approx(1.0, abs=5e-16)


def test_yaw_mode_flies_the_prescribed_yaw():
    plan = FlightPlanParams(trajectory='circle_fast').values()
    for t in TIMES:
        yaw = quaternion.to_euler(moving_yaw(plan)(t).q)[2]
        turns = (yaw - 0.3 * t - 0.7 * math.sin(0.9 * t)) / (2.0 * math.pi)
        assert turns == pytest.approx(round(turns), abs=1e-14)


def test_both_modes_agree_when_the_motion_stays_in_the_plane_of_the_nose():
    plan = FlightPlanParams(trajectory='vertical_circle').values()
    for t in TIMES:
        flat = flat_output(t, plan)[:5]
        one = flatness.from_flat_output(*flat, MASS, INERTIA, GRAVITY)
        two = flatness.from_flat_output_yaw(*flat, 0.0, 0.0, 0.0, MASS, INERTIA, GRAVITY)
        np.testing.assert_allclose(
            np.concatenate([one.q, one.omega, one.omega_dot]),
            np.concatenate([two.q, two.omega, two.omega_dot]), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize('seed', range(10))
def test_least_rotation_and_its_rates(seed):
    x0, x1, x2 = np.random.default_rng(seed).normal(size=(3, 3))
    x0[2] = abs(x0[2])  # a thrust axis within a right angle of vertical

    def at(t):
        x, dx, ddx = (tuple(v.tolist()) for v in (x0 + x1 * t + x2 * t * t, x1 + 2 * x2 * t,
                                                  2 * x2))
        _, *unit = flatness.direction(x, dx, ddx)
        return unit[0], *flatness.minimal_rotation(*unit)

    b, q, omega, omega_dot = at(0.0)
    h = 1e-5
    before, after = at(-h), at(h)
    np.testing.assert_allclose(quaternion.rotate(q, (0.0, 0.0, 1.0)), b, atol=5e-15)
    assert q[3] == 0.0  # the axis is horizontal: no turn beyond what is needed
    q_dot = tuple(((np.subtract(after[1], before[1])) / (2 * h)).tolist())
    # central difference, relative to rates of up to 10 rad/s and 100 rad/s^2
    np.testing.assert_allclose(
        2.0 * np.array(quaternion.multiply(quaternion.conjugate(q), q_dot)), (0.0, *omega),
        rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        np.subtract(after[2], before[2]) / (2 * h), omega_dot, rtol=1e-6, atol=1e-5)


# m = 68 g on the trajectory itself: tilt in degrees, thrust in N, PWM
@pytest.mark.parametrize(('trajectory', 'tilt', 'thrust', 'pwm'), [
    ('figure_3_3', 6.5, (0.603, 0.738), (258, 296)),
    ('circle_rising', 6.5, (0.603, 0.738), (258, 296)),
    ('circle', 5.8, (0.6705, 0.6705), (278, 278)),
    ('circle_fast', 22.2, (0.7204, 0.7204), (291, 293)),
    ('z_sine', 0.0, (0.395, 0.939), (194, 349))])
def test_published_demands_of_the_trajectories(trajectory, tilt, thrust, pwm):
    plan = FlightPlanParams(trajectory=trajectory, takeoff='none')
    refs = [reference_at(t, plan, VEHICLE)[0] for t in np.linspace(0.0, 2 * math.pi, 629).tolist()]
    tilts = [math.degrees(quaternion.angle(r.q)) for r in refs]
    f = [r.f for r in refs]
    assert max(tilts) == pytest.approx(tilt, abs=0.05)
    # printed digits, and a grid of 0.01 rad
    assert (min(f), max(f)) == pytest.approx(thrust, abs=6e-4)
    hover = [pwm_from_thrust(0.25 * x, VEHICLE.values()) for x in (min(f), max(f))]
    assert hover == pytest.approx(pwm, abs=1.5)


@pytest.mark.parametrize(('trajectory', 'yaw'), [
    ('circle', 0.148), ('figure_3_3', 0.17), ('circle_fast', 2.2)])
def test_least_rotation_hardly_yaws(trajectory, yaw):
    plan = FlightPlanParams(trajectory=trajectory, takeoff='none')
    yaws = [
        abs(quaternion.to_euler(reference_at(t, plan, VEHICLE)[0].q)[2])
        for t in np.linspace(0.0, 2 * math.pi, 629).tolist()]
    assert math.degrees(max(yaws)) == pytest.approx(yaw, rel=0.03)  # 2 digits


def test_north_acceleration_lowers_the_nose_and_east_acceleration_the_right_side():
    zero = (0.0, 0.0, 0.0)
    for mode in (
            lambda a: flatness.from_flat_output(zero, zero, a, zero, zero, MASS, INERTIA, GRAVITY),
            lambda a: flatness.from_flat_output_yaw(
                zero, zero, a, zero, zero, 0.0, 0.0, 0.0, MASS, INERTIA, GRAVITY)):
        roll, pitch, _ = quaternion.to_euler(mode((1.0, 0.0, 0.0)).q)
        assert (roll, pitch) == pytest.approx((0.0, -math.atan(1.0 / GRAVITY)))
        roll, pitch, _ = quaternion.to_euler(mode((0.0, 1.0, 0.0)).q)
        assert (roll, pitch) == pytest.approx((math.atan(1.0 / GRAVITY), 0.0))


def test_free_fall_has_no_attitude_and_says_so_with_nan():
    zero = (0.0, 0.0, 0.0)
    ref = flatness.from_flat_output(
        zero, zero, (0.0, 0.0, GRAVITY), zero, zero, MASS, INERTIA, GRAVITY)
    assert np.isnan([*ref.q[:3], *ref.omega, *ref.tau]).all()
