"""What a course asks of a vehicle, against statics, dynamics and the battery; stretching."""

import dataclasses
import math

from hypothesis import given, strategies as st
from mambo_control.commanded.demand import TILT_MARGIN
from mambo_flight.course import feasibility as fe, minimum_snap as ms
from mambo_model.errors import InputError, JobError
from mambo_model.motion.polynomial import connect, Course, state_at, stretched
from mambo_model.vehicle.battery import supply
from mambo_model.vehicle.motor_mixer import pwm_from_thrust, thrust_from_pwm
from mambo_model.vehicle.parameters import preset, Vehicle
from mambo_model.vehicle.vehicle_options import BatteryParams
import numpy as np
import pytest
from scipy.optimize import fsolve

VEHICLE, FREE = Vehicle(), preset('frictionless')
COLUMN = {name: i for i, name in enumerate(fe.QUANTITIES)}
QUICK = ms.minimum(ms.from_points(  # 6 m in 1.4 s each way: too fast
    np.array([0.0, 1.4, 2.8]), np.array([[0.0, 0, -1.5], [6.0, 0, -1.5], [0.0, 0, -1.5]])))


def moving(v=(0.0, 0.0, 0.0), a=(0.0, 0.0, 0.0), yaw=(0.0, 0.0, 0.0), duration=1.0):
    """Return one piece from a height of 1.5 m with a velocity, an acceleration and a yaw."""
    c = np.zeros((1, 4, 8))
    c[0, :3, 0], c[0, :3, 1], c[0, :3, 2] = (0.0, 0.0, -1.5), v, np.multiply(0.5, a)
    c[0, 3, :3] = yaw[0], yaw[1], 0.5 * yaw[2]
    return Course(np.array([duration]), c)


def parabolas(jump):
    """Return two pieces along x whose acceleration jumps by so much, in m/s^2, at 1 s."""
    a, c = 0.5 * jump, np.zeros((2, 4, 8))
    c[:, 2, 0] = -1.5
    c[0, 0, 2], c[1, 0, :3] = 0.5 * a, (0.5 * a, a, -0.5 * a)
    return Course(np.ones(2), c)


def row(course, vehicle, t=0.0):
    times, columns = fe.demand(course, vehicle)
    return dict(zip(fe.QUANTITIES, columns[np.searchsorted(times, t)].tolist(), strict=True))


def test_hovering_takes_the_weight():
    found = row(moving(), VEHICLE)
    weight = VEHICLE.mass * VEHICLE.gravity
    assert found['thrust'] == pytest.approx(weight, rel=1e-14)
    for motor in range(1, 5):
        assert found[f'PWM of motor {motor}'] == pytest.approx(
            pwm_from_thrust(0.25 * weight, VEHICLE.values()), rel=1e-12)
    assert (found['height'], found['speed'], found['tilt']) == (1.5, 0.0, 0.0)
    assert (found['body rate'], found['battery']) == (0.0, 100.0)


def test_acceleration_tilts_by_the_angle_of_the_force():
    found = row(moving(a=(3.0, 4.0, 0.0)), FREE)
    assert found['tilt'] == pytest.approx(math.degrees(math.atan2(5.0, 9.81)), rel=1e-12)
    assert found['thrust'] == pytest.approx(FREE.mass * math.hypot(5.0, 9.81), rel=1e-12)
    assert found['acceleration'] == 5.0


@pytest.mark.parametrize('v', [0.5, 2.0, 6.0, 15.0, 40.0])
def test_steady_flight_balances_drag(v):
    """Against the static balance, solved for tilt and thrust: drag holds a part of the weight."""
    k, weight = 0.25 * VEHICLE.drag_coefficient, VEHICLE.mass * VEHICLE.gravity

    def balance(x):
        tilt, f = x
        drag = k * f * v * math.cos(tilt)  # along the body's x axis
        return (f * math.sin(tilt) - drag * math.cos(tilt),
                f * math.cos(tilt) + drag * math.sin(tilt) - weight)
    tilt, f = fsolve(balance, (0.1, weight), xtol=1e-12)
    found = row(moving(v=(v, 0.0, 0.0)), VEHICLE)
    assert found['tilt'] == pytest.approx(math.degrees(tilt), rel=1e-8)
    assert found['thrust'] == pytest.approx(f, rel=1e-8) and f < weight
    assert tilt > 0.0 and row(moving(v=(v, 0.0, 0.0)), FREE)['tilt'] == 0.0


def thrust_with_drag(course, vehicle, t):
    """Return the thrust and its axis, (3,) N, that the force balance asks for, by a solver."""
    state = state_at(course, t)
    v, a = state[:3, 1], state[:3, 2]
    free = vehicle.mass * (np.array([0.0, 0.0, vehicle.gravity]) - a)

    def balance(thrust):
        f = np.linalg.norm(thrust)
        b3 = thrust / f
        along = (b3 @ v) * b3
        drag = -0.25 * f * (vehicle.drag_coefficient * (v - along)
                            + vehicle.vertical_drag_coefficient * along)
        return free + drag - thrust
    return fsolve(balance, free, xtol=1e-13)


@pytest.mark.parametrize('vertical', [0.0, 0.1])
def test_thrust_rates_and_torque_hold_the_drag_of_the_flown_attitude(vertical):
    """Body rate and torque by differences of the axis that a solver finds, without yaw."""
    vehicle = dataclasses.replace(VEHICLE, vertical_drag_coefficient=vertical)
    h = 1e-3
    for t in (0.3, 0.7, 1.2, 1.405, 2.1):  # at 1.4 s two pieces join
        thrusts = [thrust_with_drag(QUICK, vehicle, t + k * h) for k in range(-1, 2)]
        axes = [one / np.linalg.norm(one) for one in thrusts]
        found = row(QUICK, vehicle, t)
        assert found['thrust'] == pytest.approx(np.linalg.norm(thrusts[1]), rel=1e-7)
        rate = np.cross(axes[1], (axes[2] - axes[0]) / (2 * h))
        assert found['body rate'] == pytest.approx(
            math.degrees(np.linalg.norm(rate)), rel=1e-3, abs=0.1)
        bend = np.cross(axes[1], (axes[2] - 2 * axes[1] + axes[0]) / (h * h))
        pitch = vehicle.inertia[1] * bend[1]  # the course and its tilt are in the x-z plane
        quarters = [thrust_from_pwm(found[f'PWM of motor {k}'], vehicle.values())
                    for k in range(1, 5)]
        found = (quarters[0] + quarters[1] - quarters[2] - quarters[3]) * vehicle.arm
        assert found == pytest.approx(pitch, rel=1e-2, abs=2e-5)


def test_turning_takes_yaw_torque_from_the_mixer():
    found = row(moving(yaw=(0.3, 0.5, 4.0)), FREE)
    torque = FREE.inertia[2] * 4.0
    share = 0.25 * torque / FREE.yaw_ratio
    quarter = 0.25 * FREE.mass * FREE.gravity
    for motor, sign in zip(range(1, 5), (-1.0, 1.0, -1.0, 1.0), strict=True):
        assert found[f'PWM of motor {motor}'] == pytest.approx(
            pwm_from_thrust(quarter + sign * share, FREE.values()), rel=1e-9)
    assert found['body rate'] == pytest.approx(math.degrees(0.5), rel=1e-12)


def test_body_rates_are_those_of_the_thrust_direction_by_differences():
    h = 1e-5
    for t in (0.3, 0.7, 1.2, 2.1):
        axes = []
        for x in (t - h, t + h):
            force = np.array([0.0, 0.0, 9.81]) - state_at(QUICK, x)[:3, 2]
            axes.append(force / np.linalg.norm(force))
        rate = np.linalg.norm(axes[1] - axes[0]) / (2 * h)  # yaw stays: no turn about b3
        assert row(QUICK, FREE, t)['body rate'] == pytest.approx(math.degrees(rate), rel=1e-6)


def test_the_first_failure_is_named_with_its_time():
    failure = fe.check(QUICK, VEHICLE)
    times, columns = fe.demand(QUICK, VEHICLE)
    bad = np.zeros(len(times), dtype=bool)
    for name, (low, high) in fe.limits(VEHICLE).items():
        values = columns[:, COLUMN[name]]
        bad |= (values < low) | (values > high)
    assert failure.t == times[bad.argmax()] and not bad[:bad.argmax()].any()
    assert str(failure) == (
        f'{failure.quantity} {failure.value:.4g} {fe.QUANTITIES[failure.quantity]} at '
        f't = {failure.t:.3f} s, above the limit of {failure.limit:.4g} '
        f'{fe.QUANTITIES[failure.quantity]}')


@pytest.mark.parametrize(('course', 'quantity'), [
    (moving(v=(0.0, 0.0, 2.0)), 'height'), (moving(v=(0.0, 0.0, -10.0)), 'height'),
    (moving(a=(18.0, 0.0, 0.0)), 'tilt'), (moving(a=(0.0, 0.0, -20.0)), 'thrust'),
    (moving(a=(0.0, 0.0, 9.8)), 'thrust'), (moving(yaw=(0.0, 40.0, 0.0)), 'body rate'),
    (moving(yaw=(0.0, 0.0, 40.0)), 'PWM of motor 1')])
def test_every_limit_is_judged(course, quantity):
    failure = fe.check(course, FREE)
    assert failure.quantity == quantity
    low, high = fe.limits(FREE)[quantity]
    assert failure.limit in (low, high) and not low <= failure.value <= high


def test_a_course_that_is_feasible_has_no_failure_and_is_not_stretched():
    assert fe.check(stretched(QUICK, 3.0), VEHICLE) is None
    assert fe.stretch(stretched(QUICK, 3.0), VEHICLE) == 1.0


@pytest.mark.parametrize('name', ['identified', 'frictionless', 'toolbox'])
def test_the_smallest_factor_is_feasible_and_a_smaller_one_is_not(name):
    vehicle = preset(name)
    factor = fe.stretch(QUICK, vehicle)
    assert factor > 1.0 and fe.check(stretched(QUICK, factor), vehicle) is None
    assert fe.check(stretched(QUICK, factor * (1.0 - 2.0 * fe.PRECISION)), vehicle) is not None


def test_tilt_alone_is_stretched_by_the_square_root_of_the_acceleration():
    """Of level motion with a power that no motor limits: tan(tilt) g is the acceleration."""
    strong = dataclasses.replace(FREE, pwm_max=60000.0, pwm_min=0.0)
    _, columns = fe.demand(QUICK, strong)
    most = columns[:, COLUMN['acceleration']].max()
    steepest = math.radians(60.0 - TILT_MARGIN)
    assert fe.stretch(QUICK, strong) == pytest.approx(
        math.sqrt(most / (9.81 * math.tan(steepest))), rel=2.0 * fe.PRECISION)


def test_what_no_factor_makes_feasible_is_one_line():
    heavy = dataclasses.replace(VEHICLE, mass=0.2)
    with pytest.raises(JobError, match='no slower course is feasible either: thrust 1.9.*above'):
        fe.stretch(QUICK, heavy)
    with pytest.raises(JobError, match='limit 10000 s'):
        fe.demand(moving(duration=20000.0), VEHICLE)


def test_a_sagging_battery_takes_more_pwm_and_is_empty_in_time():
    small = dataclasses.replace(VEHICLE, battery=BatteryParams(enabled=True, capacity=0.02))
    weight = VEHICLE.mass * VEHICLE.gravity
    thrust = (0.25 * weight,) * 4
    voltage, current = supply(0.0, thrust, small.options())
    found = row(moving(), small)
    assert found['PWM of motor 1'] == pytest.approx(
        pwm_from_thrust(0.25 * weight, VEHICLE.values()) * 3.7 / voltage, rel=1e-12)
    t, charge, h = 0.0, 0.0, 1e-3  # until the PWM is at its limit or the battery is empty
    least = 3.7 * pwm_from_thrust(0.25 * weight, VEHICLE.values()) / 500.0
    while charge < 72.0 and voltage > least:
        voltage, current = supply(charge, thrust, small.options())
        charge, t = charge + h * current, t + h
    assert 1.0 < t < 60.0
    failure = fe.check(moving(duration=60.0), small)
    assert failure.quantity == 'battery' and failure.t == pytest.approx(t, abs=0.02)
    assert fe.check(moving(duration=0.9 * t), small) is None
    assert fe.check(moving(duration=60.0), VEHICLE) is None


def test_the_flight_that_is_asked_for_is_the_one_that_is_flown():
    """The thrusts asked for move a vehicle along the course: dynamics run without a controller."""
    from mambo_model.motion import rigid_body
    from mambo_model.motion.flatness import from_flat_output_yaw
    vv = FREE.values()
    start, end = np.zeros((4, 5)), np.zeros((4, 5))
    start[2, 0], end[:3, 0] = -1.5, (1.0, 0.5, -2.0)
    course = Course(np.array([2.0]), connect(start, end, 2.0)[None])

    def at(t):
        x, y, z, psi = state_at(course, t)
        return from_flat_output_yaw(
            *(tuple(map(float, one)) for one in zip(x, y, z, strict=True)),
            *map(float, psi[:3]), vv.mass, vv.inertia, vv.gravity)
    first, h = at(0.0), 1e-3
    state = rigid_body.State(first.rho, (0.0, 0.0, 0.0), first.q, (0.0, 0.0, 0.0))
    times, columns = fe.demand(course, FREE)
    for k in range(2000):
        ref = at((k + 0.5) * h)
        state = rigid_body.rk4_step(state, ref.f, ref.tau, h, vv)
        if k % 5 == 4:
            found = columns[np.searchsorted(times, (k + 1) * h - 1e-9)]
            total = sum(thrust_from_pwm(x, vv) for x in found[6:10].tolist())
            assert total == pytest.approx(at((k + 1) * h).f, rel=1e-9)
    assert state.rho == pytest.approx((1.0, 0.5, -2.0), abs=1e-4)


@given(st.floats(0.01, 100.0))
def test_a_factor_within_its_range_is_taken_as_it_is(value):
    assert fe.factor(repr(value), '--scale') == value


@pytest.mark.parametrize(('text', 'message'), [
    ('0.0099', 'must be within 0.01 to 100'), ('100.1', 'must be within 0.01 to 100'),
    ('nan', 'must be within'), ('inf', 'must be within'), ('-1', 'must be within'),
    ('fast', 'write a number, or auto'), ('', 'write a number, or auto')])
def test_a_factor_outside_of_its_range_is_one_line(text, message):
    with pytest.raises(InputError, match=f'^--stretch {text} ?.*{message}'):
        fe.factor(text, '--stretch')


def test_a_stretched_course_can_be_flown_and_a_little_less_cannot():
    found = fe.stretch(QUICK, VEHICLE)
    assert found > 1.0 and fe.check(stretched(QUICK, found), VEHICLE) is None
    assert fe.check(stretched(QUICK, found * (1.0 - 2.0 * fe.PRECISION)), VEHICLE) is not None


def test_an_acceleration_that_jumps_is_told_with_its_time():
    assert fe.odd(parabolas(6.0)) == (
        'has an acceleration that jumps by 6 m/s^2 at t = 1.000 s: no vehicle tilts at once, so '
        'it leaves the path there')
    assert not fe.odd(parabolas(1.0))
    assert not fe.odd(QUICK)  # of least snap: its acceleration is continuous
