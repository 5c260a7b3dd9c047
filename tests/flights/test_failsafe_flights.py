"""Flights that lose their reference or their estimate end on the floor, with the motors off."""

import math

from lossy_flight import fly
from mambo_control.failsafe import (
    DESCENDING_BLIND, EXACT, FLYING, HOLDING, LANDING, NO_REFERENCE, NO_STATE, STOPPED)
from mambo_control.safety import REASON_ESTIMATE, REASON_NONE, REASON_REFERENCE
from mambo_flight import closed_loop
from mambo_flight.scenario import scenario
import numpy as np
import pytest

SECONDS = 20.0
CLIMBING, CIRCLING, SINKING = 2.5, 9.0, 15.5  # s


def lose(what, since, until=math.inf):
    """Return a function that takes one input away for a while."""
    def spoil(t, phase, state, spread, ref):
        if not since <= t < until:
            return state, spread, ref
        if what == 'reference':
            return state, spread, NO_REFERENCE
        if what == 'estimate':
            return NO_STATE, EXACT, ref
        return state, spread._replace(**{what: 1e9}), ref
    return spoil


def flight(controller='cascaded', estimator='ground_truth', believed=''):
    return scenario('circle', estimator, controller, SECONDS, 3, believed=believed)


@pytest.mark.parametrize('at', [CLIMBING, CIRCLING, SINKING])
@pytest.mark.parametrize('controller', ['cascaded', 'toolbox'])
@pytest.mark.parametrize(('what', 'stage', 'reason', 'speed'), [
    # the speed of the descent; blind it is that and what the deficit of thrust adds, from 1.5 m
    # and from higher where the vehicle was climbing
    ('reference', LANDING, REASON_REFERENCE, 0.6), ('velocity', LANDING, REASON_ESTIMATE, 0.6),
    ('height', DESCENDING_BLIND, REASON_ESTIMATE, 1.2),
    ('estimate', DESCENDING_BLIND, REASON_ESTIMATE, 1.2)])
def test_a_flight_that_loses_something_comes_down_gently(
        controller, what, stage, reason, speed, at):
    lost = fly(flight(controller), lose(what, at))
    assert set(lost.stage) == {FLYING, HOLDING, stage, STOPPED}
    assert set(lost.reason) == {REASON_NONE, reason}
    touched, tilt = lost.touch_down(at)
    assert 0.1 < touched < speed
    assert tilt < math.radians(3.0)  # blind from the circle 2.8 degrees, by the package's law
    after = lost.t >= at
    assert lost.tilt[after].max() < math.radians(15.0)  # braking at 2 m/s^2 alone is 12 degrees
    assert lost.height[-1] <= 0.0 and lost.shutdown[-1] and not lost.pwm[-1].any()
    on_floor = lost.t[np.flatnonzero(after & (lost.height <= 0.0))[0]]
    off = lost.t[np.flatnonzero(lost.shutdown)[0]]
    assert off < on_floor + 2.2  # blind it is the prediction that has to come down
    assert lost.height[np.flatnonzero(lost.shutdown)[0]] < 0.02  # it is on the floor


@pytest.mark.parametrize('at', [0.5, CLIMBING, CIRCLING, SINKING])
def test_a_flight_whose_position_alone_freezes_comes_down(at):
    last = NO_STATE

    def freeze(t, phase, state, spread, ref):
        nonlocal last
        if t < at:
            last = state
        return state._replace(rho=last.rho), spread, ref
    lost = fly(flight(estimator='joint'), freeze)
    touched, _ = lost.touch_down(max(at, 2.0))
    assert touched < 2.0  # 21 m/s from 24 m where nothing sees it
    assert lost.height.max() < 2.2  # it goes on 0.3 m until it is seen, and brakes
    assert lost.height[-1] <= 0.0 and lost.shutdown[-1]


def test_the_whole_chain_lands_blind_with_what_its_own_estimate_left():
    lost = fly(flight(estimator='kalman'), lose('estimate', CIRCLING))
    touched, tilt = lost.touch_down(CIRCLING)
    # errors of tilt and rate at the loss grow without an estimate: 0.02 rad/s are 4 degrees
    assert 0.1 < touched < 1.2 and tilt < math.radians(10.0)
    assert lost.height[-1] <= 0.0 and lost.shutdown[-1]


def test_a_wrong_belief_still_comes_down_blind():
    # the package's belief about the identified vehicle: 17 % less PWM than it takes to hover
    lost = fly(flight(believed='toolbox'), lose('estimate', CIRCLING))
    touched, tilt = lost.touch_down(CIRCLING)
    assert 0.1 < touched < 2.0 and tilt < math.radians(15.0)
    assert lost.height[-1] <= 0.0 and lost.shutdown[-1]


@pytest.mark.long
@pytest.mark.parametrize('what', ['reference', 'estimate', 'height', 'velocity'])
def test_a_loss_of_a_tenth_of_a_second_is_flown_through(what):
    whole = fly(flight())
    lost = fly(flight(), lose(what, CIRCLING, CIRCLING + 0.0951))  # 20 steps, the last one counts
    assert set(lost.stage) == {FLYING, HOLDING} and lost.reason[-1] == REASON_NONE
    # a reference that stands still for 0.1 s at 1 m/s is 0.1 m off at the end
    assert np.abs(lost.rho - whole.rho).max() < 0.06
    np.testing.assert_array_equal(lost.rho[lost.t < CIRCLING], whole.rho[whole.t < CIRCLING])


@pytest.mark.long
@pytest.mark.parametrize('choices', [
    {}, {'controller': 'toolbox', 'estimator': 'toolbox', 'believed': 'toolbox'}])
def test_without_loss_it_is_the_flight_of_the_closed_loop(choices):
    one = flight(**{'estimator': 'kalman', **choices})
    mine, whole = fly(one), closed_loop.fly(one, inner=True)
    np.testing.assert_array_equal(mine.rho, whole.truth[:, :3])
    np.testing.assert_array_equal(mine.pwm, whole.pwm)
    assert set(mine.stage) == {FLYING}
