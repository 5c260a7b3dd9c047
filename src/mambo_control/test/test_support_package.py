"""The support package's controller: signs, numbers by hand, and what the thesis says of it."""

import math

from mambo_control import safety, support_package
from mambo_control.controllers import answer as guarded
from mambo_control.support_package import Memory, ToolboxControllerParams
from mambo_model.aerodynamics import lumped_drag
from mambo_model.compiled import jit
from mambo_model.motion import rigid_body
from mambo_model.motion.flatness import from_flat_output
from mambo_model.motion.quaternion import from_euler, rotate_inverse, to_euler
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import (
    flat_output, FlightPlanParams, GROUND, LANDED, LANDING, TAKEOFF, TRACK)
from mambo_model.schema import ParameterError
from mambo_model.vehicle.motor_mixer import mix, thrust_from_pwm
from mambo_model.vehicle.parameters import preset, Vehicle
import numpy as np
import pytest

ZERO, UPRIGHT = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
DT = 0.005
PARAMS = ToolboxControllerParams()
GAINS = PARAMS.values()
MAMBO = preset('toolbox').values()
WEIGHT = 0.063 * 9.81


def reference(rho=(0.0, 0.0, -1.5), v=ZERO, a=ZERO, vv=MAMBO, **changes):
    ref = from_flat_output(rho, v, a, ZERO, ZERO, vv.mass, vv.inertia, vv.gravity)
    return ref._replace(**changes)


def still(**changes):
    return State((0.0, 0.0, -1.5), ZERO, UPRIGHT, ZERO)._replace(**changes)


def answer(state, ref=None, memory=None, phase=TRACK, gains=GAINS, vv=MAMBO):
    memory = memory or support_package.initial(GAINS)
    return guarded(memory, state, ref or reference(), phase, DT, gains, vv)


@pytest.mark.parametrize(('vehicle', 'pwm'), [
    (preset('toolbox'), 236.5), (Vehicle(), 276.7), (Vehicle(thrust_map='linear'), 255.3)])
def test_hover_needs_the_believed_weight_and_no_torque(vehicle, pwm):
    memory, command = answer(still(), vv=vehicle.values())
    assert command.pwm == pytest.approx((pwm,) * 4, abs=0.05)
    assert command.thrust == pytest.approx(vehicle.mass * 9.81)
    assert command.torque == ZERO and not any(command.saturated)
    assert (command.shutdown, command.reason, memory) == (
        False, safety.REASON_NONE, support_package.initial(GAINS))


@pytest.mark.parametrize(('state', 'more', 'less'), [
    (still(rho=(0.0, -0.1, -1.5)), (0, 3), (1, 2)),  # target to the right: left motors
    (still(rho=(-0.1, 0.0, -1.5)), (2, 3), (0, 1)),  # target ahead: rear motors
    (still(nu=(0.3, 0.0, 0.0)), (0, 1), (2, 3)),  # flying forward: front motors
    (still(nu=(0.0, 0.3, 0.0)), (1, 2), (0, 3)),  # flying right: right motors
    (still(q=from_euler(0.1, 0.0, 0.0)), (1, 2), (0, 3)),  # rolled right: right motors
    (still(q=from_euler(0.0, 0.1, 0.0)), (2, 3), (0, 1)),  # nose up: rear motors
    (still(q=from_euler(0.0, 0.0, 0.1)), (0, 2), (1, 3)),  # yawed right: 1 and 3 push it left
    (still(omega=(1.0, 0.0, 0.0)), (1, 2), (0, 3)),
    (still(omega=(0.0, 1.0, 0.0)), (2, 3), (0, 1)),
    (still(omega=(0.0, 0.0, 1.0)), (0, 2), (1, 3))])
def test_which_motors_push(state, more, less):
    pwm = answer(state)[1].pwm
    assert min(pwm[i] for i in more) > max(pwm[i] for i in less)


def test_thrust_is_weight_plus_proportional_and_damping():
    low, sinking = answer(still(rho=(0.0, 0.0, -1.4))), answer(still(nu=(0.0, 0.0, 0.2)))
    assert low[1].thrust == pytest.approx(WEIGHT + 0.8 * 0.1)
    assert sinking[1].thrust == pytest.approx(WEIGHT + 0.3 * 0.2)


@pytest.mark.parametrize(('state', 'torque'), [
    (still(rho=(0.0, -0.5, -1.5)), (0.01 * 0.24 * 0.5, 0.0, 0.0)),
    (still(rho=(-0.5, 0.0, -1.5)), (0.0, -0.013 * 0.24 * 0.5, 0.0)),
    (still(nu=(0.0, 0.5, 0.0)), (-0.01 * 0.1 * 0.5, 0.0, 0.0)),
    (still(nu=(0.5, 0.0, 0.0)), (0.0, 0.013 * 0.1 * 0.5, 0.0)),
    (still(q=from_euler(0.1, 0.0, 0.0)), (-0.01 * 0.1, 0.0, 0.0)),
    (still(q=from_euler(0.0, 0.1, 0.0)), (0.0, -0.013 * 0.1, 0.0)),
    (still(q=from_euler(0.0, 0.0, 0.1)), (0.0, 0.0, -0.004 * 0.1)),
    (still(omega=(0.3, -0.4, 0.5)), (-0.0028 * 0.3, 0.002 * 0.4, -0.0012 * 0.5))])
def test_torque_by_hand(state, torque):
    assert answer(state)[1].torque == pytest.approx(torque, abs=1e-15)


def test_error_is_seen_from_the_nose():
    # Nose to the east, target to the north: to the left.
    east = 0.5 * math.pi
    state, ref = still(q=from_euler(0.0, 0.0, east)), reference((0.5, 0.0, -1.5))
    _, command = answer(state, ref._replace(q=from_euler(0.0, 0.0, east)))
    assert command.torque == pytest.approx((-0.01 * 0.24 * 0.5, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(('yaw', 'wanted'), [(3.1, -3.1), (-3.0, 3.0), (0.5, -0.5)])
def test_yaw_turns_the_short_way(yaw, wanted):
    ref = reference(q=from_euler(0.0, 0.0, wanted))
    _, command = answer(still(q=from_euler(0.0, 0.0, yaw)), ref)
    turn = (wanted - yaw + math.pi) % (2 * math.pi) - math.pi
    assert command.torque[2] == pytest.approx(0.004 * turn)


@pytest.mark.parametrize('yaw', [0.5 * math.pi, -0.7, 3.0])
def test_position_error_is_seen_from_the_nose_whatever_the_heading(yaw):
    q = from_euler(0.0, 0.0, yaw)
    _, command = answer(still(rho=(-0.2, 0.1, -1.5), q=q), reference(q=q))
    ahead, right, _ = rotate_inverse(q, (0.2, -0.1, 0.0))
    assert command.torque == pytest.approx(
        (0.01 * 0.24 * right, -0.013 * 0.24 * ahead, 0.0), abs=1e-15)


def test_velocity_is_damped_although_the_reference_moves_as_fast():
    v, a = (0.6, -0.4, 0.3), (0.0, 0.0, 0.3)
    moving = still(nu=v)
    _, braked = answer(moving, reference(v=v, a=a))
    _, same = answer(moving, reference())
    assert (braked.thrust, braked.torque, braked.pwm) == (same.thrust, same.torque, same.pwm)
    assert braked.thrust == pytest.approx(WEIGHT + 0.3 * 0.3)
    assert braked.torque == pytest.approx((0.01 * 0.1 * 0.4, 0.013 * 0.1 * 0.6, 0.0), abs=1e-15)
    assert braked.velocity_error == pytest.approx(ZERO, abs=1e-15)  # known, and not used


def test_in_attitude_mode_the_reference_attitude_is_followed_and_the_position_is_not():
    gains = ToolboxControllerParams(reference='attitude').values()
    ref = reference(q=from_euler(0.1, -0.2, 0.0))
    _, command = answer(still(rho=(3.0, -2.0, -1.4), nu=(0.4, 0.2, 0.0)), ref, gains=gains)
    assert command.torque == pytest.approx((0.01 * 0.1, -0.013 * 0.2, 0.0), abs=1e-15)
    assert command.thrust == pytest.approx(WEIGHT + 0.08)
    assert to_euler(command.attitude_desired) == pytest.approx((0.1, -0.2, 0.0), abs=1e-15)
    _, command = answer(still(), ref)  # in position mode its roll and pitch are not looked at
    assert command.torque == pytest.approx(ZERO, abs=1e-15)


def test_far_targets_are_not_farther_than_three_metres():
    far, there = still(rho=(-50.0, 80.0, -1.5)), still(rho=(-3.0, 3.0, -1.5))
    assert answer(far)[1].torque == answer(there)[1].torque
    nearer = answer(still(rho=(-2.9, 2.9, -1.5)))[1].torque
    assert 0 < abs(nearer[1]) < abs(answer(there)[1].torque[1])


def test_thrust_leaves_a_share_to_the_attitude():
    _, command = answer(still(rho=(0.0, 0.0, 8.0)), gains=GAINS._replace(height_min=-9.0))
    assert command.thrust == pytest.approx(1.20204, abs=1e-5)  # the package's number
    assert command.pwm == pytest.approx((460.0,) * 4) and not any(command.saturated)
    _, command = answer(still(rho=(0.0, 0.0, -8.0)))
    assert command.thrust == pytest.approx(-1.20204, abs=1e-5)
    assert command.pwm == (10.0,) * 4 and all(command.saturated)


def test_integral_action_grows_with_the_attitude_error_and_leaks():
    memory = Memory(0.3, -0.2)
    after, command = answer(still(q=from_euler(0.1, -0.2, 0.0)), memory=memory)
    assert after == pytest.approx(
        (0.3 + DT * (-0.1 - 0.001 * 0.3), -0.2 + DT * (0.2 + 0.001 * 0.2)))
    assert command.torque[:2] == pytest.approx(
        (-0.01 * 0.1 + 0.01 * 0.3, 0.013 * 0.2 - 0.01 * 0.2))
    after, _ = answer(still(q=from_euler(-0.5, 0.5, 0.0)), memory=Memory(1.9999, -1.9999))
    assert after == (2.0, -2.0)


def test_signals_belong_together():
    state = State((0.2, 0.3, -1.4), (0.1, -0.2, 0.1), from_euler(0.05, -0.1, 0.04),
                  (0.2, 0.1, -0.1))
    ref = reference((0.5, -0.1, -1.5), (0.3, 0.2, -0.1))
    _, command = answer(state, ref)
    f, tau = mix(command.motor_thrust, MAMBO)
    assert f == pytest.approx(command.thrust) and tau == pytest.approx(command.torque)
    assert tuple(thrust_from_pwm(x, MAMBO) for x in command.pwm) == pytest.approx(
        command.motor_thrust)
    assert command.position_error == pytest.approx((0.3, -0.4, -0.1))
    assert command.angular_velocity_error == state.omega
    phi, theta, psi = to_euler(command.attitude_desired)
    assert command.torque[0] == pytest.approx(0.01 * (phi - 0.05) - 0.0028 * 0.2)
    assert command.torque[1] == pytest.approx(0.013 * (theta + 0.1) - 0.002 * 0.1)
    assert command.torque[2] == pytest.approx(0.004 * (psi - 0.04) + 0.0012 * 0.1)
    assert np.isnan([command.integral, command.integral_rate, command.virtual_input]).all()


class Flown:
    """A flight of the rigid body with this controller, which sees the truth; (N,) and (N, 3)."""

    def __init__(self, trajectory, seconds, true, believed, params=PARAMS, start=None):
        plan = FlightPlanParams(trajectory=trajectory, takeoff='none').values()
        count = round(seconds / DT)
        self.t = np.arange(count) * DT
        rho = start or flat_output(0.0, plan)[0]
        rows = loop(State(rho, ZERO, UPRIGHT, ZERO), plan, params.values(), true.values(),
                    believed.values(), count)
        self.rho, self.wanted, self.thrust = rows[:, :3], rows[:, 3:6], rows[:, 6]
        self.rows = rows

    def harmonic(self, rows, rate=1.0):
        """Return the complex amplitude of each axis over the last two periods."""
        last = self.t > self.t[-1] - 4 * math.pi / rate
        basis = np.exp(-1j * rate * self.t[last])[:, None]
        return 2 * np.mean((rows[last] - rows[last].mean(axis=0)) * basis, axis=0)


@jit
def loop(state, plan, gains, true, believed, count):
    """Fly at 200 Hz, five steps of the physics in each."""
    out = np.empty((count, 13))
    memory = support_package.initial(GAINS)
    for k in range(count):
        rho, v, a, j, s, _ = flat_output(k * DT, plan)
        ref = from_flat_output(
            rho, v, a, j, s, believed.mass, believed.inertia, believed.gravity)
        memory, command = guarded(memory, state, ref, TRACK, DT, gains, believed)
        row = out[k]
        for i in range(3):
            row[i], row[3 + i] = state.rho[i], rho[i]
        row[6] = command.thrust
        row[7], row[8] = memory.roll, memory.pitch
        for i in range(4):
            row[9 + i] = command.pwm[i]
        p = command.pwm
        f, tau = mix((thrust_from_pwm(p[0], true), thrust_from_pwm(p[1], true),
                      thrust_from_pwm(p[2], true), thrust_from_pwm(p[3], true)), true)
        for _ in range(5):
            state = rigid_body.rk4_step(state, f, tau, 0.2 * DT, true)
    return out


@pytest.mark.parametrize(('believed', 'offset'), [
    # thrust that the true map gives needs the command 4 * 276.66 / 1530.73 N = 0.7229 N
    (preset('toolbox'), (0.7229 - 0.063 * 9.81) / 0.8),
    (Vehicle(mass=0.063), 0.005 * 9.81 / 0.8),
    (Vehicle(thrust_map='linear'), (0.7229 - 0.068 * 9.81) / 0.8),
    (Vehicle(), 0.0)])
def test_altitude_stays_off_by_what_map_and_mass_are_wrong(believed, offset):
    flown = Flown('hover', 15.0, Vehicle(), believed)
    assert flown.rho[-1] == pytest.approx((0.0, 0.0, -1.5 + offset), abs=5e-4)
    assert flown.thrust[-1] == pytest.approx(believed.mass * 9.81 + 0.8 * offset, abs=5e-4)
    doubled = Flown('hover', 15.0, Vehicle(), believed, ToolboxControllerParams(altitude_gain=1.6))
    assert doubled.rho[-1, 2] + 1.5 == pytest.approx(0.5 * offset, abs=5e-4)


def closed_loop(gain, damping, inertia, drag=0.0, integral=0.01, s=1j):
    """Return position over reference at s: attitude PID, gravity, position P and damping."""
    angle = (gain * s + integral) / (inertia * s**3 + damping * s**2 + gain * s + integral)
    pull = 9.81 * angle
    return 0.24 * pull / (s * (s + drag) + 0.1 * s * pull + 0.24 * pull)


@pytest.mark.parametrize('vehicle', ['frictionless', 'identified'])
def test_lag_on_the_default_circle_is_that_of_the_linear_loop(vehicle):
    true = preset(vehicle)
    flown = Flown('default_circle', 40.0, true, true)
    drag = 9.81 * 0.22 / 4 if vehicle == 'identified' else 0.0  # 1/s, thrust being the weight
    want = [closed_loop(0.013, 0.002, true.inertia[1], drag),
            closed_loop(0.01, 0.0028, true.inertia[0], drag)]
    got = flown.harmonic(flown.rho)[:2] / flown.harmonic(flown.wanted)[:2]
    # small: the thrust swings by 5 % with the vertical circle, the command is held 5 ms
    assert np.abs(got) == pytest.approx(np.abs(want), rel=0.006)
    assert np.degrees(np.angle(got)) == pytest.approx(np.degrees(np.angle(want)), abs=0.3)
    assert (np.degrees(np.angle(got)) < -25).all()
    vertical = flown.harmonic(flown.rho)[2] / flown.harmonic(flown.wanted)[2]
    want = 0.8 / (0.068 * 1j**2 + 0.3 * 1j + 0.8)
    assert (abs(vertical), np.angle(vertical)) == pytest.approx(
        (abs(want), np.angle(want)), rel=0.02)


def test_reference_velocity_in_the_damping_would_take_most_of_the_lag_away():
    # sec. 4.3: the velocity error in its place; (0.24 + 0.1 s) in the numerator
    lag = np.angle(closed_loop(0.013, 0.002, 0.775e-4))
    better = np.angle(closed_loop(0.013, 0.002, 0.775e-4) * (0.24 + 0.1j) / 0.24)
    assert math.degrees(lag) < -30 and math.degrees(better) > -10


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize('where', ['rho', 'nu', 'q', 'omega', 'reference'])
def test_unusable_input_stops_the_motors(where, value):
    state, ref = still(), reference()
    if where == 'reference':
        ref = ref._replace(rho=(0.0, value, 0.0))
    else:
        state = state._replace(**{where: (value, *getattr(state, where)[1:])})
    memory, command = answer(state, ref, Memory(0.1, 0.2))
    reason = safety.REASON_REFERENCE if where == 'reference' else safety.REASON_ESTIMATE
    assert (command.shutdown, command.reason, memory) == (True, reason, Memory(0.1, 0.2))
    assert command.pwm == (0.0,) * 4 and command.thrust == 0.0 and command.torque == ZERO


def test_largest_usable_input_gives_a_finite_command():
    state = still(rho=(1e6, -1e6, -9.0), nu=(1e6, 1e6, -1e6), omega=(1e6, 1e6, -1e6))
    _, command = answer(state, memory=Memory(2.0, -2.0))
    assert np.isfinite(command.pwm).all() and not command.shutdown
    assert set(command.pwm) <= {10.0, 500.0}


@pytest.mark.parametrize(('state', 'reason'), [
    (still(q=from_euler(1.1, 0.0, 0.0)), safety.REASON_ATTITUDE),
    (still(rho=(0.0, 0.0, 1.1)), safety.REASON_ALTITUDE),
    (still(rho=(0.0, 0.0, -10.1)), safety.REASON_ALTITUDE)])
def test_tilt_and_height_beyond_the_limits_stop_the_motors_in_flight_only(state, reason):
    for phase in (TAKEOFF, TRACK, LANDING):
        _, command = answer(state, phase=phase)
        assert (command.shutdown, command.reason) == (True, reason)
    for phase in (GROUND, LANDED):
        memory, command = answer(state, memory=Memory(1.0, 1.0), phase=phase)
        assert (command.shutdown, command.pwm) == (False, (0.0,) * 4)
        assert memory == support_package.initial(GAINS)


@pytest.mark.parametrize('dt', [0.0, -0.005, math.nan, math.inf])
def test_impossible_period_is_refused(dt):
    with pytest.raises(ValueError, match='dt of the controller'):
        guarded(
            support_package.initial(GAINS), still(), reference(), TRACK, dt, GAINS, MAMBO)


def test_one_step_has_the_same_bits_alone_and_in_a_compiled_loop():
    plan = FlightPlanParams(trajectory='default_circle', takeoff='none').values()
    true, believed = Vehicle().values(), MAMBO
    state, memory = State((0.1, 0.4, -1.3), ZERO, UPRIGHT, ZERO), support_package.initial(GAINS)
    inside = loop(state, plan, GAINS, true, believed, 400)
    for k in range(400):
        rho, v, a, j, s, _ = flat_output(k * DT, plan)
        ref = from_flat_output(
            rho, v, a, j, s, believed.mass, believed.inertia, believed.gravity)
        memory, command = guarded(memory, state, ref, TRACK, DT, GAINS, believed)
        row = [*state.rho, *rho, command.thrust, *memory, *command.pwm]
        np.testing.assert_array_equal(inside[k], row)
        f, tau = mix(tuple(thrust_from_pwm(x, true) for x in command.pwm), true)
        for _ in range(5):
            state = rigid_body.rk4_step(state, f, tau, 0.2 * DT, true)


def test_drag_slows_the_flight_as_assumed_above():
    F = lumped_drag((1.0, 0.0, 0.0), 0.068 * 9.81, Vehicle().values())
    assert F[0] / 0.068 == pytest.approx(-9.81 * 0.22 / 4)


def test_whole_numbers_as_parameters_compile_nothing_anew():
    answer(still())
    known = len(support_package.step.for_python.signatures)
    answer(still(), gains=ToolboxControllerParams(altitude_gain=1, height_max=9).values())
    assert len(support_package.step.for_python.signatures) == known


@pytest.mark.parametrize(('name', 'value'), [
    ('altitude_gain', -1.0), ('reference', 'velocity'), ('thrust_share', 1.5)])
def test_wrong_parameters_are_named(name, value):
    with pytest.raises(ParameterError, match=name):
        ToolboxControllerParams(**{name: value})
