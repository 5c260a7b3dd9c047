"""What is read of the answers of each node: sound messages pass, wrong numbers do not."""

import math

from mambo_bringup.checking.contract import BY_TOPIC, CONTRACTS
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_ros import messages
import pytest

ZERO, LEVEL, Z36 = (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 36
NAN3, LONG = (math.nan, 0.0, 0.0), (1.1, 0.0, 0.0, 0.0)


def state(rho=ZERO, q=LEVEL):
    return State(rho, ZERO, q, ZERO)


def reference(f=1.0, q=LEVEL, phase=2, j=ZERO, height=0.0):
    return messages.reference(
        5, Reference((0.0, 0.0, -height), ZERO, ZERO, j, ZERO, q, ZERO, ZERO, f, ZERO), phase)


GOOD = {
    'controller': messages.motor_pwm(5, (0.0, 10.0, 500.0, 77.0), False, 0),
    'estimator': messages.estimate(5, state(), Z36, Z36), 'reference': reference(),
    'optitrack': messages.optitrack(5, ZERO, LEVEL)}


def test_every_node_has_a_contract():
    assert set(GOOD) == set(CONTRACTS) and len(BY_TOPIC) == 4


@pytest.mark.parametrize(('height', 'phase'), [
    (0.0, 0), (0.0, 4), (0.1, 4), (-1.0, 4), (1.0, 1), (1.0, 2), (1.0, 3)])
def test_a_reference_on_the_floor_or_with_a_phase_of_flight_passes(height, phase):
    assert CONTRACTS['reference'].read(reference(phase=phase, height=height)) == (5, '')


@pytest.mark.parametrize('node', GOOD)
def test_a_sound_answer_passes(node):
    assert CONTRACTS[node].read(GOOD[node]) == (5, '')


@pytest.mark.parametrize(('node', 'data', 'said'), [
    ('controller', messages.motor_pwm(5, (9.0, 0.0, 0.0, 0.0), False, 0), 'wanted 0 or 10 to 500'),
    ('controller', messages.motor_pwm(5, (501.0,) * 4, False, 0), 'wanted 0 or 10 to 500'),
    ('controller', messages.motor_pwm(5, (math.inf,) * 4, False, 0), 'wanted finite'),
    ('estimator', messages.estimate(5, state(NAN3), Z36, Z36), 'position = '),
    ('estimator', messages.estimate(5, state(q=LONG), Z36, Z36), 'norm 1.1, wanted a unit'),
    ('estimator', messages.estimate(5, state(), (math.nan,) * 36, Z36), 'covariance = '),
    ('reference', reference(f=0.0), 'thrust = 0 N'),
    ('reference', reference(phase=5), 'phase = 5'),
    *(('reference', reference(phase=phase, height=0.25),
       f'phase = {phase}, in which the motors stand still, at a height of 0.25 m: wanted 1, 2 or')
      for phase in (0, 4)),
    ('reference', reference(j=NAN3), 'jerk = '), ('reference', reference(q=LONG), 'norm 1.1'),
    ('optitrack', messages.optitrack(5, NAN3, LEVEL), 'position = '),
    ('optitrack', messages.optitrack(5, ZERO, LONG), 'norm 1.1')])
def test_numbers_that_cannot_be_used_are_named(node, data, said):
    t, wrong = CONTRACTS[node].read(data)
    assert t == 5 and said in wrong


def test_motors_that_are_shut_down_may_say_anything():
    data = messages.motor_pwm(5, (math.nan,) * 4, True, 1)
    assert CONTRACTS['controller'].read(data) == (5, '')
