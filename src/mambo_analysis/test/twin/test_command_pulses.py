"""Pulses between samples are left out of a fit; noise and what samples show are not."""

from flown import flight, steered, TRUE
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.twin import force
from mambo_analysis.twin.command_pulses import (
    pulse_notes, pulsed, refuse_pulsed, samples_apart, SETTLE)
from mambo_analysis.twin.force import fit_force
from mambo_analysis.twin.moments import fit_moments
from mambo_analysis.twin.recorded import MIX, STEP
from mambo_model.vehicle.parameters import preset
import numpy as np
import pytest

APART = 5  # rows between samples: 20 Hz
KINKS = (300, 500, 700, 1300)  # rows of samples


def thinned(one, apart=APART):
    """Return a flight of which every so manyth row was sampled, and the rest lies in between."""
    rows = np.arange(len(one.t))

    def between(x):
        return np.column_stack([np.interp(rows, rows[::apart], c[::apart]) for c in x.T])
    return one._replace(command=between(one.command), force=between(one.force),
                        gyro=between(one.gyro), pace=apart * STEP)


def kinked(one, mix=(1.0, 1.0, 1.0, 1.0), share=0.25, gain=0.0):
    """
    Return a flight with pulses of one row in its commands, with the thrust and turn they make.

    ``mix`` are the signs of the motors, ``gain`` is the roll acceleration over its difference of
    thrusts, 1/m.
    """
    pulses = np.zeros(len(one.t))
    pulses[list(KINKS)] = share * np.array([1.0, -1.0, 1.0, -1.0])
    after = one._replace(command=one.command * (1.0 + pulses[:, None] * np.array(mix)))
    more = TRUE.motor_thrust(after) - TRUE.motor_thrust(one)
    roll = np.cumsum(STEP * gain * more @ MIX[0])
    return after._replace(
        force=one.force + np.outer(more.sum(axis=1), [0.0, 0.0, 1.0]),
        gyro=one.gyro + np.outer(roll, [1.0, 0.0, 0.0]))


def unseen(one):
    """Return what leaves no row out."""
    return np.zeros(one.air.stop - one.air.start, bool)


def test_a_pulse_is_left_out_until_the_thrust_has_settled():
    out = pulsed(thinned(kinked(flight(noise=0.0))))
    edges = np.flatnonzero(np.diff(out.astype(int)))
    after = APART + round(SETTLE / STEP)
    for row, (first, last) in zip(KINKS, edges.reshape(-1, 2), strict=True):
        assert row - 3 * APART < first + 1 <= row - APART  # a neighbour may be beyond, too
        assert row + after <= last + 1 < row + after + 2 * APART


def test_smooth_and_noisy_commands_and_those_at_100_hz_are_kept_whole():
    rng, one = np.random.default_rng(0), flight(noise=0.0)
    assert not pulsed(kinked(one)).any()  # a pace that is not known is that of the grid
    assert not pulsed(kinked(one)._replace(pace=0.0101)).any()
    assert not pulsed(thinned(one)).any()
    rough = one._replace(command=one.command + rng.normal(0.0, 4000.0, one.command.shape))
    assert not pulsed(thinned(rough)).any()


@pytest.mark.parametrize('mix', [[1.0, 1.0, 1.0, 1.0], *MIX])
def test_a_pulse_in_the_sum_or_about_any_axis_is_found(mix):
    assert pulsed(thinned(kinked(flight(noise=0.0), mix)))[list(KINKS)].all()


def test_the_time_between_samples_is_in_steps_of_the_grid():
    assert [samples_apart(flight()._replace(pace=x)) for x in (
        np.nan, 0.003, 0.0101, 1 / 60, 0.05)] == [1, 0, 1, 2, 5]


def test_pulses_do_not_pass_for_drag_and_lag(monkeypatch):
    one = thinned(kinked(flight()))
    found = fit_force(one).values
    assert found['drag z'].low < 0.25 < found['drag z'].high and found['drag z'].half < 0.15
    assert found['motor lag'].low < 0.05 < found['motor lag'].high
    monkeypatch.setattr(force, 'pulsed', unseen)
    wrong = fit_force(one, blocks=0).values
    assert wrong['motor lag'].value > 0.07


def test_no_moment_is_given_where_a_controller_answers_between_samples():
    one = thinned(steered(shake=8.0), 2)
    found = fit_force(one, blocks=0)
    for moment in fit_moments(one, found, preset('crazyflie'), TRUE.lag).values():
        assert moment.value is None and moment.hidden == (
            'samples are 0.02 s apart, in which the controller answers a turn: 0.015 s at most '
            'are needed; record motor_pwm and IMU at 100 Hz')


def test_the_note_says_how_much_is_left_out_and_what_to_record():
    line, = pulse_notes(thinned(kinked(flight(noise=0.0))))
    assert line.startswith('flight: commands change within the 0.05 s between samples: ')
    assert 's of 15.0 s are left out of drag, thrust and lag' in line
    assert line.endswith('record motor_pwm and IMU at 100 Hz')
    assert not pulse_notes(thinned(flight(noise=0.0)))


def test_a_flight_of_pulses_alone_is_refused():
    one = thinned(kinked(flight(noise=0.0, seconds=15.0)))
    refuse_pulsed(one)
    with pytest.raises(IdentifyError, match=r'flight: .* 4\.\d s without it are left, 5 s are'):
        fit_force(one._replace(air=slice(250, 850)))
