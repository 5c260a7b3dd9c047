"""One step of the controller: hand cases, memory, limits, unusable input, compiled bits."""

import math
from pathlib import Path
import re

from mambo_control import safety
from mambo_control.cascaded import CascadedParams, initial, Memory
from mambo_control.command import Command
from mambo_control.controllers import answer as guarded
from mambo_control.virtual_thrust import advance
from mambo_model.compiled import jit
from mambo_model.motion.flatness import from_flat_output
from mambo_model.motion.quaternion import from_euler
from mambo_model.motion.rigid_body import rk4_step, State
from mambo_model.motion.trajectory import GROUND, LANDED, LANDING, TAKEOFF, TRACK
from mambo_model.schema import ParameterError
from mambo_model.vehicle.motor_mixer import mix, thrust_from_pwm
from mambo_model.vehicle.parameters import preset, Vehicle
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from thesis_flight import reference, setup

ZERO = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
DT = 0.005
GAINS = CascadedParams().values()
MAMBO = preset('frictionless').values()
MESSAGES = Path(__file__).parents[2] / 'mambo_interfaces' / 'msg'


def hover(vv=MAMBO, **changes):
    ref = from_flat_output(
        (0.0, 0.0, -1.5), ZERO, ZERO, ZERO, ZERO, vv.mass, vv.inertia, vv.gravity)
    return ref._replace(**changes)


def still(**changes):
    return State((0.0, 0.0, -1.5), ZERO, UPRIGHT, ZERO)._replace(**changes)


def answer(state, ref=None, memory=None, phase=TRACK, gains=GAINS, vv=MAMBO):
    return guarded(memory or initial(gains), state, ref or hover(), phase, DT, gains, vv)


@pytest.mark.parametrize(('vehicle', 'pwm'), [
    (Vehicle(), 276.7), (preset('toolbox'), 236.5), (Vehicle(thrust_map='linear'), 255.3)])
def test_hover_needs_the_weight_and_no_torque(vehicle, pwm):
    vv = vehicle.values()
    memory, command = answer(still(), hover(vv), vv=vv)
    assert command.pwm == pytest.approx((pwm,) * 4, abs=0.05)
    assert command.thrust == pytest.approx(vehicle.mass * 9.81)
    assert command.motor_thrust == pytest.approx((vehicle.mass * 9.81 / 4,) * 4)
    assert command.torque == ZERO and not any(command.saturated)
    assert (command.shutdown, command.reason, memory) == (
        False, safety.REASON_NONE, initial(GAINS))


def test_too_low_climbs_and_too_high_sinks():
    assert answer(still(rho=(0.0, 0.0, -1.0)))[1].thrust > 0.068 * 9.81
    assert answer(still(rho=(0.0, 0.0, -2.0)))[1].thrust < 0.068 * 9.81


@pytest.mark.parametrize(('state', 'more', 'less'), [
    (still(rho=(0.0, -0.1, -1.5)), (0, 3), (1, 2)),  # target to the right: left motors
    (still(rho=(-0.1, 0.0, -1.5)), (2, 3), (0, 1)),  # target ahead: rear motors
    (still(nu=(0.3, 0.0, 0.0)), (0, 1), (2, 3)),  # too fast forward: front motors
    (still(q=from_euler(0.1, 0.0, 0.0)), (1, 2), (0, 3)),  # rolled right: right motors
    (still(q=from_euler(0.0, 0.1, 0.0)), (2, 3), (0, 1)),  # nose up: rear motors
    (still(q=from_euler(0.0, 0.0, 0.1)), (0, 2), (1, 3)),  # yawed right: 1 and 3 push it left
    (still(omega=(0.0, 0.0, 1.0)), (0, 2), (1, 3))])
def test_which_motors_push(state, more, less):
    pwm = answer(state)[1].pwm
    assert min(pwm[i] for i in more) > max(pwm[i] for i in less)


def test_signals_belong_together():
    state = State(
        (0.2, 0.6, -2.0), (0.0, 0.7, -0.6), from_euler(0.05, -0.1, 0.04), (0.2, 0.1, -0.1))
    ref, memory = reference(0.7, setup('frictionless')), Memory((0.1, 0.2, -0.1), (0.0, 0.1, 0.3))
    _, command = answer(state, ref, memory)
    R = Rotation([*state.q[1:], state.q[0]])
    error, slip = np.subtract(ref.rho, state.rho), ref.v - R.apply(state.nu)
    np.testing.assert_allclose(command.position_error, error)
    np.testing.assert_allclose(command.velocity_error, slip, atol=1e-15)
    assert (command.integral, command.integral_rate) == memory
    wanted = np.array([0, 0, 9.81]) - ref.a + command.virtual_input
    assert command.thrust == pytest.approx(0.068 * np.linalg.norm(wanted))
    w, *v = command.attitude_desired
    desired = Rotation([*v, w])
    np.testing.assert_allclose(
        desired.apply([0, 0, 1]), wanted / np.linalg.norm(wanted), atol=1e-14)
    assert command.attitude_error == pytest.approx((desired.inv() * R).magnitude())
    assert not any(command.saturated)
    f, tau = mix(command.motor_thrust, MAMBO)
    assert f == pytest.approx(command.thrust) and tau == pytest.approx(command.torque)
    thrust = tuple(thrust_from_pwm(x, MAMBO) for x in command.pwm)
    assert thrust == pytest.approx(command.motor_thrust)


def test_believed_mass_decides_not_that_of_the_reference():
    light = hover(preset('toolbox').values())
    assert answer(still(), light)[1] == answer(still())[1]


@pytest.mark.parametrize('error', [(1.0, 0.0, -1.5), (0.01, -0.02, 0.0), (5.0, 5.0, 5.0)])
def test_memory_follows_the_integral_of_the_thesis(error):
    P, p = np.array([0.3, -0.2, 0.1]), np.array([-0.1, 0.4, 0.2])

    def rate(_, x):
        bar = error + x[:3]
        return [*x[3:], *(-0.4 * x[:3] - x[3:] + 0.4 * bar / np.sqrt(1 + bar @ bar))]

    exact = solve_ivp(rate, (0, DT), [*P, *p], 'DOP853', rtol=1e-13, atol=1e-15).y[:, -1]
    moved = advance(Memory(tuple(P), tuple(p)), error, DT, GAINS)
    np.testing.assert_allclose([*moved.P, *moved.p], exact, atol=1e-13)  # dt^5/120 = 3e-14
    far = still(rho=tuple(np.subtract((0.0, 0.0, -1.5), error)))
    after, _ = answer(far, memory=Memory(tuple(P), tuple(p)))
    np.testing.assert_allclose([*after.P, *after.p], exact, atol=1e-13)


def test_integral_stays_bounded_however_large_and_long_the_error():
    memory, largest = initial(GAINS), 0.0
    for _ in range(20000):
        memory = advance(memory, (300.0, -400.0, 0.0), DT, GAINS)
        largest = max(largest, math.hypot(*memory.P))
    assert 1.0 < largest < 1.05  # a filter of damping 0.79 overshoots by 2 %
    assert memory.P == pytest.approx((0.6, -0.8, 0.0), abs=1e-3)


@pytest.mark.parametrize('phase', [GROUND, LANDED])
def test_motors_stand_still_on_the_ground_and_the_integral_is_empty(phase):
    memory, command = answer(still(), memory=Memory((1.0, 0.0, 0.0), ZERO), phase=phase)
    assert memory == initial(GAINS)
    assert command.pwm == command.motor_thrust == (0.0,) * 4
    assert (command.shutdown, command.reason) == (False, safety.REASON_NONE)
    assert command.thrust == 0.0 and math.isnan(command.attitude_error)


@pytest.mark.parametrize('phase', [GROUND, LANDED])
def test_lying_on_its_side_or_high_up_is_no_matter_while_the_motors_stand_still(phase):
    for state in (still(q=from_euler(1.5, 0.0, 0.0)), still(rho=(0.0, 0.0, -50.0))):
        assert not answer(state, phase=phase)[1].shutdown


@pytest.mark.parametrize('phase', [TAKEOFF, TRACK, LANDING])
def test_every_other_phase_flies(phase):
    assert min(answer(still(), phase=phase)[1].pwm) > 200


def test_each_motor_is_cut_on_its_own_and_says_so():
    _, command = answer(still(omega=(30.0, 0.0, 0.0)))  # a torque of 30 * 30 J
    assert command.pwm[0] == command.pwm[3] == 10.0 and command.pwm[1] == command.pwm[2] == 500.0
    assert command.saturated == (True, True, True, True)
    assert command.motor_thrust[0] < 0 and sum(command.motor_thrust) == pytest.approx(0.068 * 9.81)
    # -K_omega omega, and 7 % that turn f_d back
    assert command.torque[0] == pytest.approx(-0.69e-4 * 900, rel=0.1)
    _, command = answer(still(omega=(0.0, 0.0, 0.4)))
    assert command.saturated == (False, True, False, True)
    assert command.pwm[1] == command.pwm[3] == 10.0 and 400.0 < command.pwm[0] < 500.0


BAD = (math.nan, math.inf, -math.inf, 1e300)


def spoilt(item, bad):
    """Yield copies of a NamedTuple with each number in turn replaced."""
    for name, value in item._asdict().items():
        if isinstance(value, float):
            yield item._replace(**{name: bad})
        else:
            for i in range(len(value)):
                yield item._replace(**{name: (*value[:i], bad, *value[i + 1:])})


def assert_stopped(result, memory, reason):
    after, command = result
    assert (command.pwm, command.shutdown, command.reason) == ((0.0,) * 4, True, reason)
    assert after == memory


@pytest.mark.parametrize('bad', BAD)
@pytest.mark.parametrize('phase', [GROUND, TRACK])
def test_unusable_numbers_stop_the_motors_and_name_the_culprit(bad, phase):
    memory = Memory((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    states, refs = list(spoilt(still(), bad)), list(spoilt(hover(), bad))
    assert (len(states), len(refs)) == (13, 29)
    for state in states:
        assert_stopped(
            answer(state, memory=memory, phase=phase), memory, safety.REASON_ESTIMATE)
    for ref in refs:
        assert_stopped(
            answer(still(), ref, memory, phase=phase), memory, safety.REASON_REFERENCE)


@pytest.mark.parametrize('q', [(0.0, 0.0, 0.0, 0.0), (1.01, 0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.4)])
def test_an_attitude_that_is_none_stops_the_motors(q):
    assert_stopped(answer(still(q=q)), initial(GAINS), safety.REASON_ESTIMATE)
    assert_stopped(answer(still(), hover(q=q)), initial(GAINS), safety.REASON_REFERENCE)


def test_an_attitude_in_single_precision_is_good_enough():
    q = tuple(float(np.float32(x)) for x in from_euler(0.1, 0.2, 0.3))
    assert not answer(still(q=q))[1].shutdown


@pytest.mark.parametrize('phase', [-1, 5, 255])
def test_an_unknown_phase_stops_the_motors(phase):
    assert_stopped(answer(still(), phase=phase), initial(GAINS), safety.REASON_REFERENCE)


@pytest.mark.parametrize('fall', [9.81, 12.0])
def test_a_reference_without_a_thrust_direction_stops_the_motors(fall):
    # 9.81: no thrust at all; 12: thrust exactly opposite to the stated attitude
    ref = hover(a=(0.0, 0.0, fall))
    assert_stopped(answer(still(), ref), initial(GAINS), safety.REASON_REFERENCE)


@pytest.mark.parametrize('angles', [
    (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, 0.8)])
def test_tilt_limit(angles):
    for degrees, stopped in ((59.9, False), (60.1, True)):
        turn = Rotation.from_rotvec(math.radians(degrees) * np.array([*angles, 0.0]))
        turn = Rotation.from_euler('z', 1.0) * turn * Rotation.from_euler('z', -2.0)
        x, y, z, w = (float(value) for value in turn.as_quat())
        _, command = answer(still(q=(w, x, y, z)))
        assert command.shutdown == stopped
        assert command.reason == (safety.REASON_ATTITUDE if stopped else safety.REASON_NONE)


def test_tilt_limit_of_half_a_turn_never_stops():
    gains = CascadedParams(tilt_limit=math.pi).values()
    for seed in range(200):
        x, y = np.random.default_rng(seed).normal(size=2)
        n = math.hypot(x, y)
        assert not answer(still(q=(0.0, x / n, y / n, 0.0)), gains=gains)[1].shutdown


@pytest.mark.parametrize(('height', 'reason'), [
    (9.9, safety.REASON_NONE), (10.1, safety.REASON_ALTITUDE), (-0.9, safety.REASON_NONE),
    (-1.1, safety.REASON_ALTITUDE)])
def test_height_limits(height, reason):
    _, command = answer(still(rho=(0.0, 0.0, -height)))
    assert (command.reason, command.shutdown) == (reason, reason != safety.REASON_NONE)


@pytest.mark.parametrize('dt', [0.0, -0.005, math.nan, math.inf])
def test_rejects_bad_dt(dt):
    with pytest.raises(ValueError, match='dt'):
        guarded(initial(GAINS), still(), hover(), TRACK, dt, GAINS, MAMBO)


@jit
def _loop(state, count, case):
    memory = initial(GAINS)
    for k in range(count):
        memory, command = guarded(
            memory, state, reference(k * 0.005, case), 2, 0.005, case.gains, case.believed)
        x = command.pwm
        f, tau = mix((thrust_from_pwm(x[0], case.plant), thrust_from_pwm(x[1], case.plant),
                      thrust_from_pwm(x[2], case.plant), thrust_from_pwm(x[3], case.plant)),
                     case.plant)
        state = rk4_step(state, f, tau, 0.005, case.plant)
    return memory, state, command


@pytest.mark.parametrize('feedforward', [False, True])
def test_compiled_loop_gives_the_bits_of_single_steps(feedforward):
    case = setup('identified', CascadedParams(drag_feedforward=feedforward))
    state = first = still(rho=(0.0, 0.0, -0.1), q=from_euler(0.3, -0.2, 0.1))
    memory, vv = initial(GAINS), case.plant
    for k in range(400):
        memory, command = guarded(
            memory, state, reference(k * 0.005, case), TRACK, 0.005, case.gains, vv)
        f, tau = mix(tuple(thrust_from_pwm(x, vv) for x in command.pwm), vv)
        state = rk4_step(state, f, tau, 0.005, vv)
    assert _loop(first, 400, case) == (memory, state, command)


def test_codes_are_those_of_the_messages():
    def constants(name, prefix):
        text = (MESSAGES / f'{name}.msg').read_text()
        return {key: int(value) for key, value in re.findall(
            rf'^uint8 ({prefix}\w+) *= *(\d+)', text, re.MULTILINE)}

    reasons = constants('MotorPwm', 'REASON_')
    assert len(reasons) == 9
    assert {name: getattr(safety, name) for name in reasons} == reasons
    phases = constants('Reference', 'PHASE_')
    assert list(phases.values()) == [GROUND, TAKEOFF, TRACK, LANDING, LANDED]


def test_command_answers_controller_state():
    lines = (MESSAGES / 'ControllerState.msg').read_text().splitlines()
    names = {line.split()[1] for line in lines if line and not line.startswith('#')}
    assert names - {'header'} <= set(Command._fields)


@pytest.mark.parametrize(('name', 'value'), [
    ('k_p', 0.0), ('K_nu', -1.0), ('k_omega', math.nan), ('tilt_limit', 4.0), ('height_max', 0.0)])
def test_out_of_range_parameter_names_itself(name, value):
    with pytest.raises(ParameterError, match=f'^{name} = '):
        CascadedParams(**{name: value})


def test_unknown_derivatives_name_the_known_ones():
    with pytest.raises(ParameterError, match='analytic, no_acceleration, no_rates'):
        CascadedParams(derivatives='filtered')
