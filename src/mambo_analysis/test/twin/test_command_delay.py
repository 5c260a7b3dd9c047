"""Commands stamped late or early against the gyro are told; right stamps are not."""

import functools

from flown import answered, flight
from mambo_analysis.twin import command_delay
from mambo_analysis.twin.command_delay import command_notes, correlations, delay
from mambo_analysis.twin.recorded import MIX
import numpy as np
import pytest


turned = functools.cache(answered)


def late_by(one, steps):
    """Return a flight whose commands are stamped late by so many steps."""
    return one._replace(command=np.roll(one.command, steps, axis=0))


def found(one, usual=1):
    """Return the delay of the commands of a flight, in steps."""
    return delay(*correlations(one.command @ MIX.T, one.gyro), usual)


@pytest.mark.parametrize('steps', [-12, -5, -3, 3, 5, 8, 12])
def test_late_and_early_stamps_are_found_with_their_size(steps):
    assert [found(late_by(turned(seed), steps)) for seed in (0, 1)] == [steps] * 2


@pytest.mark.parametrize('steps', [-1, 0, 1])
def test_stamps_within_a_sample_are_right(steps):
    assert found(late_by(turned(), steps)) == 0


def test_commands_of_another_flight_or_without_a_controller_show_none():
    assert found(turned()._replace(command=turned(1).command)) == 0
    assert not command_notes(flight())  # four equal motors


@pytest.mark.parametrize('order', [[1, 2, 3, 0], [2, 3, 0, 1], [3, 0, 1, 2], [1, 0, 3, 2]])
def test_motors_in_another_order_are_no_late_stamps(order):
    assert found(turned()._replace(command=turned().command[:, order])) == 0


@pytest.mark.parametrize('answer, motion', [(0, -6), (5, -1)])
def test_a_slow_motor_or_a_late_controller_is_no_wrong_stamp(answer, motion):
    middle = command_delay.LARGEST + command_delay.WIDTH
    c = np.zeros(2 * middle + 1)
    c[middle + answer:middle + answer + 3] = -0.5
    c[middle + motion - 2:middle + motion + 1] = 0.5
    assert delay(c, 0.02) == 0


def test_the_note_says_how_late_and_what_is_wrong_then():
    line, = command_notes(late_by(turned(), 5))
    assert line == (
        'flight: the stamps of motor_pwm are about 0.05 s late against those of the gyro: the '
        'vehicle turns before the command; correct them, as drag z, exponent, motor lag and '
        'inertia have their error')
    line, = command_notes(late_by(turned(), -5))
    assert 'about 0.05 s early against those of the gyro: commands answer a turn before' in line
    assert not command_notes(turned())


def test_samples_far_apart_admit_a_delay_as_long():
    assert command_notes(late_by(turned(), 3))
    assert not command_notes(late_by(turned(), 3)._replace(pace=0.03))


def test_correlations_of_right_stamps_answer_at_once_and_turn_afterwards():
    c, error = correlations(turned().command @ MIX.T, turned().gyro)
    middle = command_delay.LARGEST + command_delay.WIDTH
    assert c.shape == (2 * middle + 1,) and 0.03 < error < 0.06
    assert c[middle] < -5.0 * error
    assert c[middle - 3:middle].sum() > 5.0 * error
