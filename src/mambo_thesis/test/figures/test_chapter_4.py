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
    assert found['steady height error below the reference'].low == pytest.approx(short)
    assert found['largest estimated x after the step'].low == pytest.approx(1.2)
    assert found['estimated x and y minus reference, RMS'].high == pytest.approx(0.0)
    assert found['true change of x'].low == pytest.approx(wanted)
    assert all(m.holds for m in found.values())
    flight.recording.truth[:, 0] /= wanted  # the metre that was asked for
    found = by_what(chapter_4.figure_4_3())
    assert not found['true change of x'].holds
    assert not found['that change, expected to be h Q(h)'].holds


def test_the_command_that_hovers_is_the_weight_by_the_power_law_on_the_line():
    motor = 0.068 * 9.81 / 4.0                          # N
    pwm = (motor / 4.29e-5)**(1.0 / 1.47)
    assert chapter_4.HOVER_COMMAND == pytest.approx(4.0 * pwm / 1530.72681)


def test_a_drone_that_drifts_while_its_estimate_does_not(monkeypatch):
    flight = made(path(lambda t: 0.1 * t, 0.0), path(lambda t: np.cos(t - 0.6), lambda t: np.sin(
        t - 0.7)), path(np.cos, np.sin), seconds=40.0)
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [flight])
    found = by_what(chapter_4.figure_4_4())
    assert found['phase lag of x'].low == pytest.approx(np.degrees(0.6), abs=0.01)
    assert found['phase lag of y'].low == pytest.approx(np.degrees(0.7), abs=0.01)
    assert found['drift of the drone per turn'].low == pytest.approx(0.2 * np.pi, rel=1e-3)
    assert found['drift of the estimate per turn'].high < 0.01
    away = found['time until it is 2 m from its start, the net of a small hall']
    assert away.low == pytest.approx(20.0, abs=0.01)


def test_a_pendulum_and_a_bench_give_back_what_they_were_made_of():
    for figure in (chapter_4.figure_4_6, chapter_4.figure_4_8):
        found = figure().measured
        assert all(m.holds for m in found), [str(m) for m in found]


def test_motors_on_the_line_of_the_package_fail_the_claim(monkeypatch):
    """Motors on the line of the package: no power law of the thesis, no gain over the line."""
    monkeypatch.setattr(chapter_4, 'thrust_from_pwm', lambda pwm, vv: pwm / 1530.72681)
    found = by_what(chapter_4.figure_4_8())
    assert found['exponent b'].low == pytest.approx(1.0, abs=0.02)
    assert not found['exponent b'].holds
    assert not found['straight line of the package, RMS error over that of the power law'].holds


def test_photographs_have_nothing_to_measure():
    found = chapter_4.other_figures()
    assert not found.measured and found.remark == 'they show no data'


SHORT = (chapter_4.HOVER_COMMAND - 0.063 * 9.81) / 0.8  # m, height error that the claim predicts
FACTOR = chapter_4.sensor_factor(1.5)


def step_flight(error=SHORT, wobble=0.0, peak=1.2, factor=FACTOR):
    """Return a step in x with a height error, an oscillation in y, an overshoot and a factor."""
    return made(path(lambda t: np.where(t < 6.0, 0.0, factor)), path(
        lambda t: np.where(t < 12.0, peak, 1.0), lambda t: wobble * np.sin(t),
        -1.5 + error), path(1.0), seconds=30.0)


@pytest.mark.parametrize(('flight', 'expected'), [
    (step_flight(), [True, True, True, True, True]),
    (step_flight(error=0.0), [False, True, True, True, True]),   # reaches its height
    (step_flight(wobble=0.1), [True, False, True, True, True]),  # oscillates
    (step_flight(peak=2.0), [True, True, False, True, True]),    # does not look like a step
    (step_flight(peak=1.0), [True, True, False, True, True]),    # does not overshoot
    (step_flight(factor=1.3), [True, True, True, True, False]),  # moves by another factor
    (step_flight(factor=1.0), [True, True, True, False, False])])
def test_each_part_of_the_claim_on_the_step_can_fail_alone(monkeypatch, flight, expected):
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [flight])
    assert [m.holds for m in chapter_4.figure_4_3().measured] == expected


def test_one_seed_that_differs_fails_the_claim(monkeypatch):
    monkeypatch.setattr(
        chapter_4, 'seeds', lambda name: [step_flight(), step_flight(error=SHORT + 0.01)])
    first, *_ = chapter_4.figure_4_3().measured
    assert (first.low, first.high) == pytest.approx((SHORT, SHORT + 0.01))
    assert not first.holds


def circling(speed=0.1, lags=(0.6, 0.7), estimate_drift=0.0):
    """Return a circle whose vehicle drifts in x, and whose estimate lags and may drift."""
    return made(
        path(lambda t: speed * t, 0.0),
        path(lambda t: np.cos(t - lags[0]) + estimate_drift * t, lambda t: np.sin(t - lags[1])),
        path(np.cos, np.sin), seconds=40.0)


@pytest.mark.parametrize(('flight', 'expected'), [
    (circling(), [True, True, True, True, True]),
    (circling(lags=(0.3, 0.7)), [False, True, True, True, True]),
    (circling(lags=(0.6, 0.3)), [True, False, True, True, True]),
    (circling(estimate_drift=0.02), [True, True, False, True, True]),
    (circling(speed=0.07), [True, True, True, False, True]),   # 0.44 m per turn
    (circling(speed=0.0), [True, True, True, False, False])])
def test_each_part_of_the_claim_on_the_drift_can_fail(monkeypatch, flight, expected):
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [flight])
    assert [m.holds for m in chapter_4.figure_4_4().measured] == expected


def test_a_drone_that_stays_in_the_hall_never_hits_the_net(monkeypatch):
    monkeypatch.setattr(chapter_4, 'seeds', lambda name: [circling(speed=0.0)])
    *_, net = chapter_4.figure_4_4().measured
    assert net.high == float('inf') and not net.holds


def test_a_body_weighed_wrong_fails_the_claim_on_the_inertia(monkeypatch):
    right = chapter_4.fit_swing
    monkeypatch.setattr(chapter_4, 'fit_swing', lambda t, gyro, rig: right(
        t, gyro, rig._replace(mass=1.05 * rig.mass)))
    error, residual = chapter_4.figure_4_6().measured
    # J grows with the mass: 5 %, and 0.2 % of noise
    assert (error.low, error.high) == pytest.approx((5.0, 5.0), abs=0.4) and not error.holds
    assert residual.holds


def test_a_bench_with_another_coefficient_fails_the_claim(monkeypatch):
    right = chapter_4.thrust_from_pwm
    monkeypatch.setattr(
        chapter_4, 'thrust_from_pwm', lambda pwm, vv: 1.2 * right(pwm, vv))
    found = by_what(chapter_4.figure_4_8())
    assert found['exponent b'].holds and found['power law, RMS error of the logarithm'].holds
    assert found['coefficient a'].low == pytest.approx(1.2 * 4.29, rel=0.1)
    assert not found['coefficient a'].holds
