"""Appendix C on made flights: growth with the distance, the best factor over the height."""

from made_flights import made, path
from mambo_thesis.figures import appendix_c
import numpy as np
import pytest

TURN = 2.0 * np.pi


def by_what(result):
    return {m.what: m for m in result.measured}


def on(monkeypatch, **flights):
    """Let the appendix have these flights by name; one of no name for every name."""
    monkeypatch.setattr(appendix_c, 'seeds', lambda name: [
        flights.get(name.rpartition('/')[2]) or flights['any']])


@pytest.mark.parametrize('factor', [0.95, 1.06])
def test_the_best_factor_makes_flow_times_height_the_motion(factor):
    flight = made(path(y=np.sin, z=-2.0), seconds=30.0, flow=lambda t: np.stack(
        [np.zeros_like(t), np.cos(t) / 2.0 / factor], axis=1))
    assert appendix_c.best_factor(flight) == pytest.approx((2.0, factor), rel=1e-3)


def test_factors_that_rise_with_the_height_are_fitted_by_a_line(monkeypatch):
    flights = {}
    for name in appendix_c.HEIGHTS:
        height = float(name.replace('_', '.'))
        factor = 0.92 + 0.07 * height
        flights[f'height_{name}'] = made(
            path(y=np.sin, z=-height), seconds=30.0,
            flow=lambda t, s=height * factor: np.stack([np.zeros_like(t), np.cos(t) / s], axis=1))
    on(monkeypatch, **flights)
    found = by_what(appendix_c.figure_c_3())
    assert found['linear fit, slope'].low == pytest.approx(0.07, abs=0.003)
    assert found['linear fit, offset'].low == pytest.approx(0.92, abs=0.005)
    assert found['least rise from one height to the next'].low > 0.0


def test_a_difference_grows_in_percent_of_the_distance(monkeypatch):
    def x(t):
        return np.where(t < 12.0, 0.0, 0.5 * (t - 12.0))
    on(monkeypatch, any=made(path(x), path(lambda t: 1.037 * x(t)), seconds=30.0))
    found = by_what(appendix_c.figure_c_2())
    assert found['growth of the difference in x, of the distance'].low == pytest.approx(3.7)
    assert found['what the best constant factor leaves, RMS'].high < 1e-9
    assert found['modulation by the height, RMS'].high < 1e-9


@pytest.mark.parametrize(('sign', 'holds'), [(1.0, True), (-1.0, False), (0.0, False)])
def test_a_modulation_is_that_of_the_factor_with_its_sign(monkeypatch, sign, holds):
    """The ramp of 0.1 m/s, its error that of Q(h): mean growth, and sign times the rest."""
    def height(t):
        return 1.5 + np.sin(0.5 * t)

    def x(t):
        rate = 0.1 * (1.06 / (0.92 + 0.07 * height(t)) - 1.0)
        rate = 0.0037 + sign * (rate - rate.mean())
        return 0.1 * t + np.cumsum(rate) * 0.005
    truth = path(lambda t: 0.1 * t, 0.0, lambda t: -height(t))
    on(monkeypatch, any=made(truth, path(x, 0.0, lambda t: -height(t)), seconds=40.0))
    found = by_what(appendix_c.figure_c_2())
    assert found['growth of the difference in x, of the distance'].holds
    seen, = (m for what, m in found.items() if what.startswith('modulation at the rate'))
    assert seen.low == pytest.approx(sign, abs=0.05) and seen.holds is holds


def test_a_circle_carried_by_hand_gains_what_the_factor_predicts(monkeypatch):
    """The estimate is the integral of Q(1.06) / Q(h) dx along the circle."""
    def x(t):
        return np.cos(t - 8.0)

    def z(t):
        return -1.5 - np.sin(t - 8.0)
    t = np.arange(round(30.0 / 0.005)) * 0.005
    ratio = 1.06 / (0.92 - 0.07 * z(t)) - 1.0
    gained = np.cumsum(np.insert(ratio[1:] * np.diff(x(t)), 0, 0.0))
    flight = made(path(x, 0.0, z), path(lambda s: x(s) + gained, 0.0, z), seconds=30.0)
    on(monkeypatch, any=flight)
    found = by_what(appendix_c.figure_c_1())
    assert found['the same over what Q(h) predicts'].low == pytest.approx(1.0)
    assert found['tilt of the vehicle'].high == 0.0
    assert all(m.holds for m in found.values())
    # pi A B slope / Q of a loop of 1 m
    assert found['error in x gained in a forward turn'].low == pytest.approx(
        np.pi * 1.06 * 0.07 / 1.025**2, rel=0.02)


def drifting(per_turn_x, per_turn_y=0.0, per_turn_z=0.0):
    rates = [p / TURN for p in (per_turn_x, per_turn_y, per_turn_z)]
    return made(path(), path(lambda t: rates[0] * t, lambda t: rates[1] * t,
                             lambda t: -1.5 + rates[2] * t), seconds=40.0)


def test_drift_is_told_for_each_axis(monkeypatch):
    on(monkeypatch, any=drifting(-0.2, 0.0, 0.01))
    found = by_what(appendix_c.figure_c_4())
    assert found['drift in x a turn'].low == pytest.approx(-0.2, rel=1e-3)
    assert not found['drift in x a turn'].holds  # the other way than the slope of Q says
    assert found['drift in z a turn'].low == pytest.approx(0.01, rel=1e-3)
    on(monkeypatch, any=drifting(0.03, -0.04))
    assert by_what(appendix_c.figure_c_7())['drift in x a turn'].low == pytest.approx(
        0.03, rel=1e-3)


@pytest.mark.parametrize(('figure', 'kind'), [
    (appendix_c.figure_c_5, '5'), (appendix_c.figure_c_6, '6')])
def test_factors_are_compared_on_one_flight(monkeypatch, figure, kind):
    on(monkeypatch, any=drifting(0.2))
    others = {f'fig_c_{kind}/fitted': drifting(0.1), f'fig_c_{kind}/retuned': drifting(-0.05)}
    monkeypatch.setattr(appendix_c, '_with', lambda f, name: others[name].error)
    ratios = [m.low for m in figure().measured]
    assert ratios == pytest.approx(2 * [0.5, 0.25, 0.5], rel=1e-3)  # of both slopes
    assert all(m.holds for m in figure().measured)


def test_one_axis_may_become_better_and_another_worse(monkeypatch):
    on(monkeypatch, any=drifting(0.2, 0.1))
    monkeypatch.setattr(appendix_c, '_with', lambda f, name: drifting(0.1, 0.15).error)
    better, worse, *exponential = appendix_c.figure_c_8().measured
    assert [m.low for m in exponential] == pytest.approx([0.5, 1.5], rel=1e-3)
    assert better.low == pytest.approx(0.5, rel=1e-3) and better.holds
    assert worse.low == pytest.approx(1.5, rel=1e-3) and worse.holds


def test_an_error_with_another_estimator_is_against_the_same_truth(monkeypatch):
    flight = drifting(0.2)
    monkeypatch.setattr(appendix_c, 'load', lambda name: (name, f'scenario {name}'))
    monkeypatch.setattr(type(flight), 'estimated_by', lambda self, other: self.truth + (
        1.0 if other == 'scenario fig_c_8' else 0.0))
    assert (appendix_c._with(flight, 'fig_c_8') == 1.0).all()
