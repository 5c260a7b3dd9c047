"""Whatever is lost: hold, land, stop; and never a motor beyond its limits."""

import math

from mambo_control import cascaded, failsafe, safety, support_package
from mambo_control.failsafe import (
    DESCENDING_BLIND, EXACT, FLYING, HOLDING, LANDING, NO_REFERENCE, NO_STATE, Spread, STOPPED)
from mambo_control.gains import CascadedParams
from mambo_control.parameters import ControllerNodeParams
from mambo_model.motion.flatness import from_flat_output, from_flat_output_yaw
from mambo_model.motion.quaternion import from_euler, rotate, rotate_inverse
from mambo_model.motion.rigid_body import rk4_step, State
from mambo_model.motion.trajectory import GROUND, LANDED, TAKEOFF, TRACK
from mambo_model.vehicle.motor_mixer import mix, thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

ZERO, DT = (0.0, 0.0, 0.0), 0.005
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
MAMBO = Vehicle().values()
LAWS = ('cascaded', 'toolbox')
HOLD = 20  # steps


def hovering(height=1.5, v=ZERO, q=UPRIGHT):
    return State((0.0, 0.0, -height), rotate_inverse(q, v), q, ZERO)


def reference(rho=(0.0, 0.0, -1.5), v=ZERO, a=ZERO):
    return from_flat_output(
        rho, v, a, ZERO, ZERO, MAMBO.mass, MAMBO.inertia, MAMBO.gravity)


class Controller:
    """The step with its memory."""

    def __init__(self, law='cascaded', **failsafe_values):
        params = ControllerNodeParams(
            controller=law, failsafe=failsafe.FailsafeParams(**failsafe_values))
        self.settings = DT, params.law.values(), params.failsafe.values(), MAMBO
        self.memory = failsafe.initial(params.law)

    def answer(self, state=None, ref=None, phase=TRACK, spread=EXACT):
        """Answer; what is not given is the hovering estimate and reference."""
        self.memory, command = failsafe.step(
            self.memory, hovering() if state is None else state, spread,
            reference() if ref is None else ref, phase, *self.settings)
        return command

    @property
    def stage(self):
        return self.memory.stage


def moved(state, command):
    """Return the state one step later of a vehicle as believed."""
    f, tau = mix(tuple(thrust_from_pwm(x, MAMBO) for x in command.pwm), MAMBO)
    return rk4_step(state, f, tau, DT, MAMBO)


@pytest.mark.parametrize(('law', 'module', 'params'), [
    ('cascaded', cascaded, CascadedParams()),
    ('toolbox', support_package, support_package.ToolboxControllerParams())])
def test_with_good_inputs_the_answer_is_that_of_the_law_alone(law, module, params):
    one, memory = Controller(law), module.initial(params.values())
    state = hovering(1.4, (0.3, -0.2, 0.1), from_euler(0.1, 0.2, 0.3))
    for _ in range(5):
        got = one.answer(state)
        memory, want = module.step(
            memory, state, reference(), DT, params.values(), MAMBO)
        assert (one.memory.control, got.pwm, got.torque) == (memory, want.pwm, want.torque)
        assert (one.stage, got.reason, got.shutdown) == (FLYING, safety.REASON_NONE, False)
        state = moved(state, got)


def test_of_the_variances_of_an_estimate_the_largest_of_a_kind_counts():
    rng = np.random.default_rng(2)
    for _ in range(20):  # any of them may be it
        pose, twist = rng.random((2, 6, 6))
        p, w = np.diag(pose), np.diag(twist)
        assert failsafe.spread_of(tuple(pose.ravel()), tuple(twist.ravel())) == (
            p[:2].max(), p[2], w[:2].max(), p[3:5].max(), w[3:].max())


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize(('lost', 'reason'), [
    ({'state': NO_STATE}, safety.REASON_ESTIMATE),
    ({'ref': NO_REFERENCE}, safety.REASON_REFERENCE),
    ({'spread': Spread(0.0, 0.0, 1.1)}, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 1.1, 0.0)}, safety.REASON_ESTIMATE),
    ({'spread': Spread(math.nan, 0.0, 0.0)}, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 0.0, 0.0, 0.3, 0.0)}, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 0.0, 0.0, 0.0, 1.1)}, safety.REASON_ESTIMATE),
    ({'phase': 5}, safety.REASON_REFERENCE)])
def test_a_short_loss_is_bridged_and_says_why(law, lost, reason):
    one = Controller(law)
    one.answer()
    for _ in range(HOLD):
        command = one.answer(**lost)
        assert (one.stage, command.reason, command.shutdown) == (HOLDING, reason, False)
        # at rest above its point: the hovering command all the while
        assert command.pwm == pytest.approx((276.66,) * 4, abs=0.01)
    assert one.answer().reason == safety.REASON_NONE and one.stage == FLYING


def test_an_estimate_that_moves_and_stays_the_same_is_lost_until_it_changes():
    one, moving = Controller(), hovering(v=(0.0, 0.0, -0.01))._replace(omega=(0.0, 0.002, 0.0))
    for _ in range(5):  # the first one is new
        command = one.answer(moving)
        assert one.memory.state == moving
    predicted = moved(moving, command)
    for _ in range(HOLD - 4):
        command = one.answer(moving)
        assert (one.stage, command.reason) == (FLYING, safety.REASON_NONE)
        assert one.memory.state == predicted
        predicted = moved(predicted, command)
    for _ in range(20):
        one.answer(moving)
        assert one.stage == DESCENDING_BLIND and one.memory.reason == safety.REASON_ESTIMATE
    for k in range(HOLD + 1):  # not for a single new one
        assert one.stage == DESCENDING_BLIND
        one.answer(hovering(1.4 + 1e-6 * k))
    assert one.stage == LANDING


def test_a_blind_descent_is_not_left_for_an_estimate_that_is_renewed_at_5_hz():
    one = Controller()
    for k in range(400):
        moving = hovering(1.5 - 0.01 * (k // 40), v=(0.0, 0.0, 0.1))
        one.answer(moving._replace(omega=(0.0, 0.002, 0.0)))
        assert one.stage == (FLYING if k <= HOLD else DESCENDING_BLIND)


@pytest.mark.parametrize('v', [(0.1, 0.0, 0.0), ZERO])
def test_position_and_velocity_that_stay_the_same_are_lost_while_the_attitude_lives(v):
    one, lost = Controller(), None
    for k in range(150):
        tilt = 0.001 * k
        state = State((0.0, 0.0, 0.0), v, from_euler(tilt, 0.0, 0.0), (0.2, 0.0, 0.0))
        one.answer(state, reference((0.0, 0.0, -0.004 * k)), phase=TAKEOFF)
        if one.stage == DESCENDING_BLIND and lost is None:
            lost = k
            assert one.memory.state.q == state.q  # the attitude is that of the estimate
    assert lost == (HOLD + 1 if any(v) else 76)  # at rest: once the reference is 0.3 m away


@pytest.mark.parametrize(('lives', 'tilts', 'height', 'grounded'), [
    (True, 0.0, 0.0, True), (False, 0.0, 0.0, False), (True, 1e-6, 0.0, False),
    (True, 0.0, 1.5, False)])
def test_of_an_estimate_at_rest_below_its_reference_only_one_that_lives_is_on_the_floor(
        lives, tilts, height, grounded):
    """One that rests high above the floor has lost its samples: the motors must not stop there."""
    one = Controller()
    for k in range(120):
        state = State((0.0, 0.0, -height), ZERO, from_euler(tilts * k, 0.0, 0.0),
                      (0.02, 1e-5 * k, 0.0))
        spread = Spread(1e-5, 1e-5, 1e-6, 1e-5, 1e-6 * (1 + k * lives))
        command = one.answer(
            state, reference((0.0, 0.0, -height - 0.00399 * k)), phase=TAKEOFF, spread=spread)
        assert (one.stage == FLYING) == (k <= 75)  # 0.3 m below the reference
        assert not (height and command.shutdown)
        if grounded and k > 75:
            assert (one.stage, command.reason) == (STOPPED, safety.REASON_GROUNDED)
            assert command.shutdown and not any(command.pwm)
        elif k > 75:  # the prediction is soon on the floor
            assert one.stage in (DESCENDING_BLIND, STOPPED)
            assert command.reason == safety.REASON_ESTIMATE


@pytest.mark.parametrize('climbs, reason', [
    (1.0, safety.REASON_GROUNDED), (-1.0, safety.REASON_ESTIMATE)])
def test_an_attitude_may_settle_after_the_position_and_the_reference_must_climb(climbs, reason):
    one = Controller()
    for k in range(90):
        command = one.answer(
            State(ZERO, ZERO, from_euler(1e-6 * min(k, 20), 0.0, 0.0), (0.02, 1e-5 * k, 0.0)),
            reference((0.0, 0.0, -0.004 * climbs * k)), phase=TAKEOFF,
            spread=Spread(1e-5, 1e-5, 1e-6, 1e-5, 1e-6 * (1 + k)))
    assert command.reason == reason


@pytest.mark.parametrize('law', LAWS)
def test_an_estimate_that_is_missing_or_unsure_on_the_floor_is_lost_and_not_grounded(law):
    for state, spread, reason in (
            (NO_STATE, EXACT, safety.REASON_ESTIMATE),
            (hovering(0.0), Spread(0.0, 1.1, 0.0), safety.REASON_ESTIMATE)):
        one = Controller(law)
        one.answer(hovering(0.0), reference(ZERO), phase=GROUND)
        for k in range(HOLD + 2):
            command = one.answer(
                state, reference((0.0, 0.0, -0.004 * k)), phase=TAKEOFF, spread=spread)
        assert (one.stage, command.reason) == (DESCENDING_BLIND, reason)


def test_a_position_that_stays_the_same_while_its_velocity_leads_away_is_lost():
    one, lost = Controller(), None
    for k in range(200):
        v = (0.0, 0.0, -0.4 - 1e-3 * (k % 2))
        one.answer(hovering(v=v)._replace(omega=(0.0, 0.002, 0.0)))
        if one.stage == DESCENDING_BLIND and lost is None:
            lost = k
    assert lost == math.ceil(failsafe.FAR / 0.4005 / DT)  # once it should be 0.3 m away


@pytest.mark.parametrize('changed', [
    lambda k: {'omega': ZERO, 'nu': (0.05, 0.0, 0.0)},  # on the floor, without noise
    lambda k: {'nu': ZERO},
    lambda k: {'rho': (0.0, 0.0, -1.5 - 1e-15 * k)},
    lambda k: {'omega': (1e-9 * k, 0.002, 0.0), 'nu': ZERO},
    lambda k: {  # its position is rounded
        'nu': (0.1 + 1e-9 * k, 0.0, 0.0), 'rho': (0.05 * (k // 100), 0.0, -1.5)},
    lambda k: {'nu': (0.1 * (-1) ** (k // 200), 0.0, 1e-9 * k)},  # to and fro, less than 0.3 m
    lambda k: {'rho': (0.0, 0.0, -1.5 - 0.001 * (k // 20))}])  # at 10 Hz
def test_an_estimate_that_rests_or_changes_is_followed(changed):
    one, moving = Controller(), hovering(v=(0.1, 0.0, 0.0))._replace(omega=(0.0, 0.002, 0.0))
    for k in range(1000):
        one.answer(moving._replace(**changed(k)))
        assert one.stage == FLYING


def test_an_estimate_that_froze_before_the_take_off_is_lost_in_it():
    one, frozen = Controller(), hovering(0.0)._replace(omega=(0.0, 2e-5, 0.0))
    for _ in range(50):
        one.answer(frozen, reference(ZERO), phase=GROUND)
    for k in range(100):
        one.answer(frozen, reference((0.0, 0.0, -0.004 * k)), phase=TAKEOFF)
        assert (one.stage == FLYING) == (k < HOLD)
        assert one.stage in (FLYING, DESCENDING_BLIND, STOPPED)
    for _ in range(50):
        command = one.answer(frozen, reference((0.0, 0.0, -0.4)), phase=TAKEOFF)
    assert (one.stage, command.reason) == (STOPPED, safety.REASON_ESTIMATE)


def test_without_noise_an_estimate_may_stay_the_same_under_a_reference_that_climbs():
    one = Controller()  # as of a vehicle that is too heavy
    for k in range(300):
        one.answer(hovering(0.0), reference((0.0, 0.0, -0.004 * k)), phase=TAKEOFF)
        assert one.stage == FLYING


@pytest.mark.parametrize('phase', [GROUND, LANDED])
def test_on_the_ground_an_estimate_may_stay_the_same(phase):
    one = Controller()
    for _ in range(50):
        one.answer(hovering(0.0, v=(0.0, 0.0, -0.01))._replace(omega=(0.0, 0.1, 0.0)), phase=phase)
    assert one.stage == FLYING


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize(('lost', 'stage', 'reason'), [
    ({'state': NO_STATE}, DESCENDING_BLIND, safety.REASON_ESTIMATE),
    ({'ref': NO_REFERENCE}, LANDING, safety.REASON_REFERENCE),
    ({'state': NO_STATE, 'ref': NO_REFERENCE}, DESCENDING_BLIND, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 0.0, 1.1)}, LANDING, safety.REASON_ESTIMATE),
    ({'spread': Spread(1e7, 0.0, 0.0)}, LANDING, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 1.1, 0.0)}, DESCENDING_BLIND, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 0.0, 0.0, 0.3, 0.0)}, DESCENDING_BLIND, safety.REASON_ESTIMATE),
    ({'spread': Spread(0.0, 0.0, 0.0, 0.0, 1.1)}, DESCENDING_BLIND, safety.REASON_ESTIMATE)])
def test_a_longer_loss_lands_and_a_return_of_the_reference_does_not_end_that(
        law, lost, stage, reason):
    one = Controller(law)
    one.answer()
    for _ in range(HOLD + 2):
        command = one.answer(**lost)
    assert (one.stage, command.reason, command.shutdown) == (stage, reason, False)
    for _ in range(HOLD):
        command = one.answer()
    assert (one.stage, command.reason) == (LANDING, reason)


def test_a_landing_without_estimate_goes_on_blind_and_sees_again():
    one = Controller()
    one.answer()
    for _ in range(HOLD + 2):
        one.answer(ref=NO_REFERENCE)
    for _ in range(HOLD - 1):
        assert one.answer(state=NO_STATE).reason == safety.REASON_REFERENCE
    assert one.stage == LANDING
    for _ in range(3):
        command = one.answer(state=NO_STATE)
    assert (one.stage, command.reason) == (DESCENDING_BLIND, safety.REASON_ESTIMATE)
    one.answer()
    assert one.stage == LANDING


@pytest.mark.parametrize('phase', [GROUND, LANDED])
@pytest.mark.parametrize('lost', [{'state': NO_STATE}, {'ref': NO_REFERENCE}])
def test_on_the_ground_a_loss_shuts_down(phase, lost):
    one = Controller()
    one.answer(hovering(0.0), phase=phase)
    for _ in range(HOLD + 2):
        command = one.answer(**{'state': hovering(0.0), 'phase': phase, **lost})
        assert command.pwm == (0.0,) * 4
    assert one.stage == STOPPED and command.shutdown
    for _ in range(3):  # and stays so
        command = one.answer()
        assert command.shutdown and command.pwm == (0.0,) * 4


def test_a_plan_that_has_landed_does_not_end_a_blind_descent():
    one = Controller()
    one.answer()
    for _ in range(HOLD + 2):
        one.answer(spread=Spread(0.0, 9.0, 0.0))
    one.answer(phase=LANDED, spread=Spread(0.0, 9.0, 0.0))
    assert one.stage == DESCENDING_BLIND


def test_on_the_ground_variances_do_not_count():
    one = Controller()
    for _ in range(2 * HOLD):
        one.answer(hovering(0.0), phase=GROUND, spread=Spread(1e9, 1e9, 1e9))
    assert one.stage == FLYING


def test_nothing_at_all_ever_is_a_shutdown_and_not_a_flight():
    one = Controller()
    for _ in range(HOLD + 2):
        command = one.answer(NO_STATE, NO_REFERENCE)
        assert command.pwm == (0.0,) * 4
    assert command.shutdown and command.reason == safety.REASON_ESTIMATE


@pytest.mark.parametrize('law', LAWS)
def test_prediction_of_a_vehicle_as_believed_is_its_flight(law):
    one, state = Controller(law), hovering(1.2, (0.5, -0.4, 0.2), from_euler(0.2, -0.1, 0.3))
    command = one.answer(state)
    for _ in range(HOLD - 1):
        state = moved(state, command)
        command = one.answer(state=NO_STATE)
        assert one.memory.state == state  # the same step with the same numbers


def test_each_part_that_is_known_takes_the_place_of_the_predicted_one():
    q = from_euler(0.1, 0.2, 0.3)
    ahead = State((1.0, 2.0, -3.0), (0.1, 0.2, 0.3), from_euler(-0.3, 0.1, 0.0), (1.0, 1.0, 1.0))
    seen = State((-7.0, -8.0, -9.0), (4.0, 5.0, 6.0), q, (0.5, 0.6, 0.7))
    old, new = rotate(ahead.q, ahead.nu), rotate(q, seen.nu)
    for horizontal in (False, True):
        for vertical in (False, True):
            got = failsafe.completed(seen, failsafe.Known(True, vertical, horizontal), ahead)
            v = rotate(got.q, got.nu)
            xy, z = (seen, new) if horizontal else (ahead, old), (
                (seen, new) if vertical else (ahead, old))
            assert got.rho == (*xy[0].rho[:2], z[0].rho[2])
            np.testing.assert_allclose(v, (*xy[1][:2], z[1][2]), atol=1e-14)  # rounding
            assert (got.q, got.omega) == (q, seen.omega)
    assert failsafe.completed(seen, failsafe.Known(False, False, False), ahead) == ahead


def test_a_descent_begins_as_the_vehicle_moves_and_is_smooth():
    p = failsafe.FailsafeParams().values()
    start = failsafe.Descent((1.0, 2.0, -3.0), (1.0, -0.5, -0.8), 0.4, 0.0, 0.0)
    times = np.arange(0.0, 4.0, 1e-4)
    rows = [failsafe.descent_reference(start._replace(time=t), p, MAMBO) for t in times]
    rho, v, a, j, s = (
        np.array([getattr(row, name) for row in rows]) for name in ('rho', 'v', 'a', 'j', 's'))
    assert (rows[0].rho, rows[0].v) == (start.rho, start.v)
    for item, rate in ((rho, v), (v, a), (a, j), (j, s)):
        # central differences of step h miss by h^2/6 of the third derivative
        np.testing.assert_allclose(np.gradient(item, 1e-4, axis=0)[1:-1], rate[1:-1], atol=1e-4)
    assert np.linalg.norm(a, axis=1).max() == pytest.approx(p.deceleration, rel=1e-3)
    np.testing.assert_array_equal(v[-1], (0.0, 0.0, p.descent_speed))
    twin = from_flat_output_yaw(
        *(tuple(x[5000]) for x in (rho, v, a, j, s)), 0.4, 0.0, 0.0, MAMBO.mass, MAMBO.inertia,
        MAMBO.gravity)
    assert rows[5000] == twin


def landed(one, state, floor=0.0, **lost):
    """Fly a vehicle as believed to its floor and on; return seconds until the motors stop."""
    for k in range(4000):
        command = one.answer(**{'state': state, **lost})
        if command.shutdown:
            return k * DT, state, command
        state = moved(state, command)
        if state.rho[2] >= floor:
            state = State((*state.rho[:2], floor), ZERO, UPRIGHT, ZERO)
    raise AssertionError('never stopped')


@pytest.mark.parametrize('law', LAWS)
def test_a_landing_ends_on_the_floor_soon_after_touching_it(law):
    one = Controller(law)
    one.answer()
    for _ in range(HOLD + 1):
        one.answer(ref=NO_REFERENCE)
    seconds, state, command = landed(one, hovering(), ref=NO_REFERENCE)
    assert (state.rho[2], command.reason) == (0.0, safety.REASON_REFERENCE)
    # 1.5 m at 0.5 m/s, half of the blend of 0.615 s more, then 0.1 s to be sure; the package's
    # law is 0.19 m or 0.4 s behind
    assert 3.3 < seconds < 4.2


def test_a_landing_ends_when_its_reference_is_deep_in_the_floor_whatever_the_estimate_says():
    one, steps = Controller(), 0
    one.answer()
    while not one.answer(ref=NO_REFERENCE).shutdown:
        steps += 1
    # 2 m at 0.5 m/s, after 0.1 s to hold and half a blend
    assert steps * DT == pytest.approx(0.1 + 0.307 + 4.0, abs=0.02)


@pytest.mark.parametrize('law', LAWS)
def test_blind_the_vehicle_is_on_the_floor_before_the_prediction_is(law):
    one, state, seconds = Controller(law), hovering(), None
    command, speed = one.answer(state), None
    for k in range(2000):
        if command.shutdown:
            break
        state = moved(state, command)
        if state.rho[2] >= 0.0 and speed is None:
            speed, seconds = rotate(state.q, state.nu)[2], k * DT
        command = one.answer(state=NO_STATE)
    assert command.reason == safety.REASON_ESTIMATE and command.shutdown
    assert seconds < k * DT  # on the floor, then off
    # sqrt(v^2 + 2 d g h), v = 0.5 m/s, d = 0.02, h = 1.5 m and 0.15 m to take up the speed; the
    # package's law is 0.2 m behind
    assert 0.5 < speed < {'cascaded': 0.95, 'toolbox': 1.0}[law]


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('share', [0.85, 1.18])
def test_blind_the_vehicle_weighs_what_the_flight_has_shown(law, share):
    one, true = Controller(law), MAMBO._replace(mass=share * MAMBO.mass)
    state, speeds = hovering(), []
    for k in range(4000):
        lost = k >= 2000  # after 10 s: the integral action has settled, the averages too
        command = one.answer(NO_STATE if lost else state)
        if lost and state.rho[2] >= 0.0:
            speeds.append(rotate(state.q, state.nu)[2])
            break
        assert not command.shutdown
        f, tau = mix(tuple(thrust_from_pwm(x, MAMBO) for x in command.pwm), MAMBO)
        state = rk4_step(state, f, tau, DT, true)
    assert one.memory.shown.lift / one.memory.shown.pull == pytest.approx(true.mass, rel=2e-3)
    # 18 % more weight than believed would end at 2.3 m/s; less weight would not come down
    assert 0.5 < speeds[0] < 1.4


def test_weight_is_not_mistaken_for_acceleration():
    one, state = Controller(), hovering(2.0)
    for _ in range(60):  # 0.3 s of climbing ever faster
        command = one.answer(state, reference((0.0, 0.0, -3.0)))
        state = moved(state, command)
    assert rotate(state.q, state.nu)[2] < -0.4
    lift, pull = one.memory.shown
    # the acceleration of a step is felt in the next one, and of the first step none is known
    assert lift / pull == pytest.approx(MAMBO.mass, rel=0.02)


def test_the_vertical_part_of_the_thrust_is_what_carries_the_weight():
    one = Controller()
    command = one.answer(hovering(2.0)._replace(q=from_euler(0.3, -0.2, 1.0)))
    share = DT / (failsafe.SHOWN_TIME + DT)  # of one step in the average
    upright = math.cos(0.3) * math.cos(-0.2)
    assert one.memory.shown.lift == pytest.approx(share * command.thrust * upright, rel=1e-12)


def test_what_is_seen_on_the_floor_or_garbled_shows_no_weight():
    p = failsafe.FailsafeParams(thrust_deficit=0.0).values()
    assert failsafe.lighter(failsafe.Shown(0.0, 0.0), p, MAMBO) == MAMBO
    for pull in (-1e9, 0.0, 1e-9, 1e9):
        for lift in (-1e9, 0.0, 1e9):
            mass = failsafe.lighter(failsafe.Shown(lift, pull), p, MAMBO).mass
            assert 0.5 * MAMBO.mass <= mass <= 1.5 * MAMBO.mass
    one = Controller()
    for _ in range(10):
        one.answer(hovering(0.4))
    assert one.memory.shown == (0.0, 0.0)


def test_blind_the_attitude_is_brought_level_by_the_prediction():
    one, q = Controller(), from_euler(0.3, -0.4, 0.5)
    state = State((0.0, 0.0, -1.5), (1.0, 0.5, 0.0), q, (1.0, -1.0, 0.2))
    command = one.answer(state)
    for _ in range(400):
        state = moved(state, command)
        command = one.answer(state=NO_STATE)
    down = rotate(state.q, (0.0, 0.0, 1.0))[2]
    assert math.degrees(math.acos(down)) < 3.0  # it was 29 degrees; braking is over
    assert np.linalg.norm(state.omega) < 0.1


@pytest.mark.parametrize('at_once', [
    {'state': hovering(q=from_euler(1.1, 0.0, 0.0))}, {'state': hovering(10.1)}])
def test_limits_of_tilt_and_height_stop_at_once_and_for_good(at_once):
    one = Controller()
    one.answer()
    assert one.answer(**at_once).shutdown and one.stage == STOPPED
    assert one.answer().shutdown


@pytest.mark.parametrize('odd', [
    hovering()._replace(omega=(0.0, 26.0, 0.0)), hovering(v=(0.0, 6.1, 0.0)),
    hovering(q=from_euler(0.0, 0.0, 1.6))])
def test_a_crash_is_what_stays_far_from_what_is_asked_for(odd):
    one = Controller()
    one.answer()
    states = [odd._replace(rho=(0.001 * k, 0.0, -1.5)) for k in range(52)]
    for state in states[:49]:
        assert not one.answer(state).shutdown
    one.answer()
    for state in states[:49]:  # counted from anew
        assert not one.answer(state).shutdown
    for state in states[49:]:
        command = one.answer(state)
    assert command.shutdown and command.reason == safety.REASON_CRASH


def test_a_reference_without_thrust_is_lost_too():
    one = Controller()
    one.answer()
    for a in (9.81, 12.0):
        assert one.answer(ref=reference()._replace(a=(0.0, 0.0, a))).reason == (
            safety.REASON_REFERENCE)
        assert one.stage == HOLDING


@pytest.mark.parametrize('followed', [True, False])
def test_a_vehicle_whose_law_cannot_follow_lands(followed):
    one = Controller()
    one.answer()
    if not followed:  # 1.5 m too high with nearly no thrust to give up: it would have to turn over
        one.answer(hovering(3.0), reference(a=(0.0, 0.0, 9.6)))
    command = one.answer(hovering(3.0), reference())
    assert one.stage == (FLYING if followed else LANDING)
    assert command.reason == (safety.REASON_NONE if followed else safety.REASON_REFERENCE)
    assert min(command.pwm) > MAMBO.pwm_min


@pytest.mark.parametrize('dt', [0.0, -0.005, math.nan, math.inf])
def test_impossible_period_is_refused(dt):
    one = Controller()
    one.settings = (dt, *one.settings[1:])
    with pytest.raises(ValueError, match='dt of the controller'):
        one.answer()


GARBAGE = (math.nan, math.inf, -math.inf, 0.0, 1e6, -1e6, 1e300, 1e-300)


def spoilt(rng, item):
    """Return a NamedTuple with some numbers replaced by garbage, of all magnitudes."""
    fields = []
    for value in item:
        numbers = [value] if isinstance(value, float) else list(value)
        for i in range(len(numbers)):
            if rng.random() < 0.05:
                numbers[i] = (
                    GARBAGE[rng.integers(len(GARBAGE))] if rng.random() < 0.5
                    else float(rng.normal() * 10.0 ** rng.uniform(-3, 7)))
        fields.append(numbers[0] if isinstance(value, float) else tuple(numbers))
    return type(item)(*fields)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('seed', range(5))
def test_whatever_comes_in_each_motor_gets_0_or_a_pwm_within_its_limits(law, seed):
    rng, stages = np.random.default_rng(seed), set()
    for _ in range(60):
        one = Controller(law, hold=float(rng.choice([0.0, 0.02, 1.0])), crash_time=10.0)
        state = hovering(float(rng.uniform(0.0, 5.0)))
        for _ in range(60):
            kind, given, ref = rng.integers(4), state, reference(
                tuple(rng.normal(size=3)), tuple(rng.normal(size=3)), tuple(rng.normal(size=3)))
            if kind == 1:
                given = spoilt(rng, state)
            elif kind == 2:
                ref = spoilt(rng, ref)
            elif kind == 3:
                given, ref = NO_STATE, NO_REFERENCE
            spread = spoilt(rng, Spread(0.01, 0.01, 0.01))
            phase = int(rng.choice([TAKEOFF, TRACK, TRACK, TRACK, 3, GROUND, LANDED, 7]))
            command = one.answer(given, ref, phase, spread)
            stages.add(one.stage)
            assert all(x == 0.0 or MAMBO.pwm_min <= x <= MAMBO.pwm_max for x in command.pwm)
            assert not command.shutdown or command.pwm == (0.0,) * 4
            if one.stage == STOPPED:
                break
            state = moved(state, command)
    assert stages == {FLYING, HOLDING, LANDING, DESCENDING_BLIND, STOPPED}


@pytest.mark.parametrize(('name', 'value'), [
    ('hold', -0.1), ('descent_speed', 0.0), ('thrust_deficit', 0.6), ('height_std', math.nan)])
def test_out_of_range_parameter_names_itself(name, value):
    with pytest.raises(ValueError, match=name):
        failsafe.FailsafeParams(**{name: value})


@pytest.mark.parametrize('law', LAWS)
def test_nothing_takes_off_whose_tilt_is_not_known_and_it_says_why(law):
    unknown = Spread(0.0, 0.0, 0.0, 0.1 ** 2, 0.0)  # of an alignment that failed
    one = Controller(law)
    assert not one.answer(hovering(0.0), phase=GROUND, spread=unknown).shutdown
    command = one.answer(hovering(0.0), phase=TAKEOFF, spread=unknown)
    assert (command.shutdown, command.reason) == (True, safety.REASON_ALIGNMENT)
    assert command.pwm == (0.0,) * 4
    assert failsafe.describe(one.stage, command.reason) == (
        'motors shut down: estimator not aligned: let the vehicle rest, start again')
    # no way out, and none that only began after take-off
    assert one.answer(hovering(0.0), phase=TAKEOFF).shutdown
    flying = Controller(law)
    flying.answer(hovering(0.0), phase=GROUND)
    flying.answer(hovering(0.0), phase=TAKEOFF)
    assert not flying.answer(hovering(0.1), phase=TAKEOFF, spread=unknown).shutdown
