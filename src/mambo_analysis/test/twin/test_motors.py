"""Errors of everything from the motors stand beside those without a model."""

from flown import SPIN, steered, TRUE
from mambo_analysis.twin.motors import BASELINE, doubts, MotorWindows, predict_all, table
import numpy as np
import pytest


def test_the_true_model_is_far_better_than_none():
    # a torque of 0.3 rad/s^2, new every 10 ms, turns it by 6 mrad on each axis in half a second,
    # and its mean over the second before by 4 mrad
    found = predict_all(steered(shake=0.3), TRUE, SPIN)
    assert found.mae[0] < 0.003 and found.mae[1] < 0.03 and found.mae[2] < 0.015
    assert found.turned.mean() > 3.0 * found.mae[2] and found.kept.mean() > 1.5 * found.mae[2]
    assert found.constant_velocity.mean() > 3.0 * found.mae[1]


@pytest.mark.long
def test_half_the_gain_is_seen():
    half = SPIN._replace(gain=tuple(0.5 * x for x in SPIN.gain))
    one = steered()
    assert predict_all(one, TRUE, half).mae[2] > 0.05 > predict_all(one, TRUE, SPIN).mae[2]


@pytest.mark.long
def test_what_stands_without_a_model():
    one = steered()
    found = predict_all(one, TRUE, SPIN, past=0.0)
    rows = np.arange(0, len(one.t) - 50, 10)
    change = one.turn[rows].inv() * one.turn[rows + 50]
    assert found.kept == pytest.approx(change.magnitude())
    assert found.constant_velocity == pytest.approx(
        np.linalg.norm(one.velocity[rows + 50] - one.velocity[rows], axis=1))


def test_the_table_has_all_windows_and_the_baseline_at_its_horizon():
    one = MotorWindows(*(np.full(3, 0.1 * i) for i in range(7)))
    two = MotorWindows(*(np.full(1, 0.1 * i + 0.4) for i in range(7)))
    caption, head, rows = table([('one', one), ('two', two)], 0.5)
    assert caption.endswith('0.5 s') and [len(row) for row in rows] == [len(head)] * 4
    assert rows[2] == ['all windows', '0.100', '0.400', '0.200', '0.500', '0.300', '0.600',
                       '0.700', '4']
    assert [rows[3][i] for i in (1, 3, 5)] == [f'{x:.3f}' for x in BASELINE]
    assert len(table([('one', one)], 1.0)[2]) == 2


def test_an_attitude_that_is_predicted_worse_than_by_keeping_it_is_told():
    good = MotorWindows(*(np.full(3, 0.1) for _ in range(7)))
    bad = good._replace(attitude=np.full(3, 0.16))
    assert doubts([('one', good), ('two', good._replace(attitude=np.full(3, 0.11)))]) == []
    line, = doubts([('one', good), ('two', bad)])
    assert line.startswith('two: the commands predict the attitude worse than keeping it does')
