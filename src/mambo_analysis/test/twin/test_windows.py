"""The true model predicts the flight; what it lacks is seen, and the second before makes it up."""

from flown import flight, TRUE
from mambo_analysis.twin.windows import past_mean, predict, starts
import numpy as np
import pytest


def test_the_true_model_is_right_to_two_millimetres():
    found = predict(flight(noise=0.0), TRUE)
    assert found.mae.max() < 2e-3  # steps of 10 ms, in which it trembles
    assert found.constant_mae[:2] == pytest.approx([0.08, 0.08], abs=0.01)  # 1 m/s^2 for 0.5 s
    assert found.ratio < 0.02


def test_a_missing_drag_is_seen():
    without = TRUE._replace(drag=(0.0, 0.0, 0.25))
    # 0.4 1/s times 0.64 m/s in the mean, for half a second: 0.5 * 0.25 * 0.255 m
    assert predict(flight(noise=0.0), without, past=0.0).mae[0] == pytest.approx(0.031, abs=0.004)


def test_the_second_before_makes_up_for_what_is_constant():
    weak = TRUE._replace(thrust=0.97 * TRUE.thrust)
    plain = predict(flight(noise=0.0), weak, past=0.0)
    assert plain.model[:, 2].mean() == pytest.approx(-0.5 * 0.25 * 0.03 * 9.8, rel=0.05)
    assert predict(flight(noise=0.0), weak).mae[2] < 0.1 * plain.mae[2]


def test_longer_windows_are_worse():
    without = TRUE._replace(drag=(0.0, 0.0, 0.0))
    short, long = (predict(flight(noise=0.0), without, horizon) for horizon in (0.25, 1.0))
    assert np.all(long.mae[:2] > 3.0 * short.mae[:2])


def test_a_window_needs_its_second_before_and_its_half_second_after():
    one = flight(noise=0.0)
    assert len(predict(one, TRUE, past=1.0).model) == len(np.arange(100, 1500 - 50, 10))
    assert len(predict(one, TRUE, past=0.0).model) == len(np.arange(0, 1500 - 50, 10))
    assert len(predict(one, TRUE, horizon=1.0, past=0.0).model) == len(np.arange(0, 1400, 10))


def test_a_tilted_thrust_is_seen_sideways():
    """0.05 m/s^2 along x of a body at yaw 0 are 6 mm after half a second."""
    straight = TRUE._replace(tilt=(0.0, -0.03))
    found = predict(flight(noise=0.0), straight, past=0.0)
    assert found.model[:, 0].mean() == pytest.approx(-0.5 * 0.25 * 0.05, rel=0.1)
    assert abs(found.model[:, 1].mean()) < 1e-3


def test_windows_begin_after_their_past_and_end_in_the_air():
    one = flight(noise=0.0)._replace(air=slice(200, 600))
    rows = starts(one, 0.5, 1.0)
    assert rows[0] == 300 and rows[-1] < 550 and set(np.diff(rows)) == {10}
    assert len(starts(one, 0.5, 0.0)) == len(rows) + 10
    assert not len(starts(one, 0.5, 4.0))


def test_the_mean_of_the_past_is_that_of_the_rows_before():
    values = np.random.default_rng(2).normal(size=(400, 3))
    values[:20] = np.nan  # before the first past: not looked at
    rows = np.array([130, 131, 399])
    found = past_mean(values, rows, 1.0)
    wanted = [values[row - 100:row].mean(axis=0) for row in rows]
    assert np.allclose(found, wanted)
    assert not past_mean(values, rows, 0.0).any()
    assert past_mean(values, rows[:0], 1.0).shape == (0, 3)
