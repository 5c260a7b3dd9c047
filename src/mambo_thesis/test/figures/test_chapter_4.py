"""Section 4.3 on made flights and bench data: short heights, lags, drifts, inertia, thrust."""

from made_flights import made, path
from mambo_thesis.figures import chapter_4
import numpy as np
import pytest


def by_what(result):
    return {m.what: m for m in result.measured}


def test_a_height_short_of_its_reference_is_its_mean_after_12_s(monkeypatch):
    short = (chapter_4.HOVER_COMMAND - 0.063 * 9.81) / 0.8
    wanted = chapter_4.sensor_factor(1.5)
    flight = made(
        path(lambda t: np.where(t < 6.0, 0.0, wanted)),
        path(lambda t: np.where(t < 12.0, 1.2, 1.0), 0.0,
             lambda t: np.where(t < 12.0, 0.0, -1.5 + short)), path(1.0), seconds=20.0)
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [flight])
    found = by_what(chapter_4.figure_4_3())
    assert found['height short of the reference'].low == pytest.approx(short)
    assert found['largest estimated x after the step'].low == pytest.approx(1.2)
    assert found['estimated x and y about the reference, RMS'].high == pytest.approx(0.0)
    assert found['true x travelled'].low == pytest.approx(wanted)
    assert all(m.holds for m in found.values())
    flight.recording.truth[:, 0] /= wanted  # the metre that was asked for
    found = by_what(chapter_4.figure_4_3())
    assert not found['true x travelled'].holds and not found['the same, h Q(h) expected'].holds



def test_the_command_that_hovers_is_the_weight_by_the_power_law_on_the_line():
    motor = 0.068 * 9.81 / 4.0                          # N
    pwm = (motor / 4.29e-5)**(1.0 / 1.47)
    assert chapter_4.HOVER_COMMAND == pytest.approx(4.0 * pwm / 1530.72681)


def test_a_drone_that_drifts_while_its_estimate_does_not(monkeypatch):
    flight = made(path(lambda t: 0.1 * t, 0.0), path(lambda t: np.cos(t - 0.6), lambda t: np.sin(
        t - 0.7)), path(np.cos, np.sin), seconds=40.0)
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [flight])
    found = by_what(chapter_4.figure_4_4())
    assert found['lag of x'].low == pytest.approx(np.degrees(0.6), abs=0.01)
    assert found['lag of y'].low == pytest.approx(np.degrees(0.7), abs=0.01)
    assert found['drift of the drone a turn'].low == pytest.approx(0.2 * np.pi, rel=1e-3)
    assert found['drift of the estimate a turn'].high < 0.01
    away = found['2 m away from its start, the net of a small hall, after']
    assert away.low == pytest.approx(20.0, abs=0.01)


def test_a_pendulum_and_a_bench_give_back_what_they_were_made_of():
    for figure in (chapter_4.figure_4_6, chapter_4.figure_4_8):
        found = figure().measured
        assert all(m.holds for m in found), [str(m) for m in found]


def test_the_line_of_the_package_would_be_seen_if_it_fitted(monkeypatch):
    """Motors on the line of the package: no power law of the thesis, no gain over the line."""
    monkeypatch.setattr(chapter_4, 'thrust_from_pwm', lambda pwm, vv: pwm / 1530.72681)
    found = by_what(chapter_4.figure_4_8())
    assert found['exponent b'].low == pytest.approx(1.0, abs=0.02)
    assert not found['exponent b'].holds
    assert not found['line of the package off, the same over that'].holds


def test_photographs_have_nothing_to_measure():
    found = chapter_4.other_figures()
    assert not found.measured and found.why_not == 'they show no data'
