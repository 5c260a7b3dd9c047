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
    assert appendix_c.factor_at_height(flight) == pytest.approx((2.0, factor), rel=1e-3)


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
    assert found['smallest rise from one height to the next'].low > 0.0


def test_a_difference_grows_in_percent_of_the_distance(monkeypatch):
    def x(t):
        return np.where(t < 12.0, 0.0, 0.5 * (t - 12.0))
    on(monkeypatch, any=made(path(x), path(lambda t: 1.037 * x(t)), seconds=30.0))
    found = by_what(appendix_c.figure_c_2())
    assert found['growth of the x error per distance flown'].low == pytest.approx(3.7)
    assert found['residual with the best constant factor, RMS'].high < 1e-9
    assert found['modulation of the x error by the height, RMS'].high < 1e-9


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
    assert found['that change over the prediction from Q(h)'].low == pytest.approx(1.0)
    assert found['tilt of the vehicle'].high == 0.0
    assert all(m.holds for m in found.values())
    # pi A B slope / Q of a loop of 1 m
    assert found['change of the x error over a forward turn'].low == pytest.approx(
        np.pi * 1.06 * 0.07 / 1.025**2, rel=0.02)


def drifting(x, y=0.0, z=0.0, truth=None):
    """Return a flight whose estimate drifts by so many metres per turn on each axis."""
    truth = truth or path()
    return made(truth, lambda t: truth(t) + path(
        lambda t: x * t / TURN, lambda t: y * t / TURN, lambda t: z * t / TURN)(t), seconds=40.0)


def test_drift_is_measured_on_each_axis(monkeypatch):
    on(monkeypatch, any=drifting(-0.2, 0.0, 0.01))
    found = by_what(appendix_c.figure_c_4())
    assert found['drift in x per turn'].low == pytest.approx(-0.2, rel=1e-3)
    assert not found['drift in x per turn'].holds  # the other way than the slope of Q says
    assert found['drift in z per turn'].low == pytest.approx(0.01, rel=1e-3)
    on(monkeypatch, any=drifting(0.03, -0.04))
    assert by_what(appendix_c.figure_c_7())['drift in x per turn'].low == pytest.approx(
        0.03, rel=1e-3)


@pytest.mark.parametrize(('figure', 'kind'), [
    (appendix_c.figure_c_5, '5'), (appendix_c.figure_c_6, '6')])
def test_factors_are_compared_on_one_flight(monkeypatch, figure, kind):
    on(monkeypatch, any=drifting(0.2))
    others = {f'fig_c_{kind}/fitted': drifting(0.1), f'fig_c_{kind}/retuned': drifting(-0.05)}
    monkeypatch.setattr(appendix_c, '_error_with', lambda f, name: others[name].error)
    ratios = [m.low for m in figure().measured]
    assert ratios == pytest.approx(2 * [0.5, 0.25, 0.5], rel=1e-3)  # of both slopes
    assert all(m.holds for m in figure().measured)


def test_one_axis_may_become_better_and_another_worse(monkeypatch):
    on(monkeypatch, any=drifting(0.2, 0.1))
    monkeypatch.setattr(appendix_c, '_error_with', lambda f, name: drifting(0.1, 0.15).error)
    better, worse, *exponential = appendix_c.figure_c_8().measured
    assert [m.low for m in exponential] == pytest.approx([0.5, 1.5], rel=1e-3)
    assert better.low == pytest.approx(0.5, rel=1e-3) and better.holds
    assert worse.low == pytest.approx(1.5, rel=1e-3) and worse.holds


def test_an_error_with_another_estimator_is_against_the_same_truth(monkeypatch):
    flight = drifting(0.2)
    monkeypatch.setattr(appendix_c, 'load', lambda name: (name, f'scenario {name}'))
    monkeypatch.setattr(type(flight), 'estimated_by', lambda self, other: self.truth + (
        1.0 if other == 'scenario fig_c_8' else 0.0))
    assert (appendix_c._error_with(flight, 'fig_c_8') == 1.0).all()


def holds(result):
    return [m.holds for m in result.measured]


def hand_circle(gain=1.0, tilt=0.0):
    """Return a circle by hand whose error is gain times the prediction from Q(h)."""
    def x(t):
        return np.cos(t - 8.0)

    def z(t):
        return -1.5 - np.sin(t - 8.0)

    def estimate(t):
        ratio = 1.06 / (0.92 - 0.07 * z(t)) - 1.0
        return x(t) + gain * np.cumsum(np.insert(ratio[1:] * np.diff(x(t)), 0, 0.0))
    flight = made(path(x, 0.0, z), path(estimate, 0.0, z), seconds=30.0)
    flight.recording.truth[:, 7] = np.sin(np.radians(0.5 * tilt))
    return flight


@pytest.mark.parametrize(('flight', 'expected'), [
    (hand_circle(), [True, True, True, True]),
    (hand_circle(tilt=5.0), [False, True, True, True]),          # not level
    (hand_circle(gain=0.0), [True, False, False, False]),        # no error
    (hand_circle(gain=2.0), [True, True, False, True]),          # another mechanism adds to it
    (hand_circle(gain=-1.0), [True, False, False, True])])       # opposite sign
def test_each_part_of_the_claim_on_the_hand_circle_can_fail(monkeypatch, flight, expected):
    on(monkeypatch, any=flight)
    assert holds(appendix_c.figure_c_1()) == expected


def ramp(growth=0.037, wave=0.0, share=1.0):
    """
    Return a ramp of 0.1 m/s whose height varies, with an error in x.

    The error grows by a share of the distance. It has a wave that the height does not explain, and
    a share of the modulation that Q(h) predicts.
    """
    def height(t):
        return 1.5 + np.sin(0.5 * t)

    def x(t):
        rate = 1.06 / (0.92 + 0.07 * height(t)) - 1.0
        rate = 0.1 * (growth + share * (rate - rate.mean()))
        return 0.1 * t + np.cumsum(rate) * 0.005 + wave * np.sin(2.0 * t)
    truth = path(lambda t: 0.1 * t, 0.0, lambda t: -height(t))
    return made(truth, path(x, 0.0, lambda t: -height(t)), seconds=40.0)


@pytest.mark.parametrize(('flight', 'expected'), [
    (ramp(), [True, True, True, True]), (ramp(0.0), [False, True, True, True]),
    (ramp(0.08), [False, True, True, True]), (ramp(wave=0.1), [True, False, False, True]),
    (ramp(share=-1.0), [True, True, True, False]), (ramp(share=0.0), [True, True, True, False])])
def test_each_part_of_the_claim_on_the_ramp_can_fail(monkeypatch, flight, expected):
    on(monkeypatch, any=flight)
    assert holds(appendix_c.figure_c_2()) == expected


def test_the_modulation_is_found_with_its_sign(monkeypatch):
    for share in (1.0, -1.0, 0.5):
        on(monkeypatch, any=ramp(share=share))
        *_, modulation = appendix_c.figure_c_2().measured
        assert modulation.low == pytest.approx(share, abs=0.05)


def over_height(monkeypatch, factor):
    """Let the sines at four heights have the factor that a function of the height gives."""
    flights = {}
    for name in appendix_c.HEIGHTS:
        height = float(name.replace('_', '.'))
        scale = height * factor(height)
        flights[f'height_{name}'] = made(
            path(y=np.sin, z=-height), seconds=30.0, flow=lambda t, s=scale: np.stack(
                [np.zeros_like(t), np.cos(t) / s], axis=1))
    on(monkeypatch, **flights)


@pytest.mark.parametrize(('factor', 'expected'), [
    (lambda h: 0.92 + 0.07 * h, [True, True, True, True]),
    (lambda h: 1.06, [False, False, False, False]),
    (lambda h: 0.82 + 0.07 * h, [True, True, False, True]),
    (lambda h: 0.92 + 0.14 * h, [True, False, True, False])])
def test_another_factor_over_the_height_fails_the_claim(monkeypatch, factor, expected):
    over_height(monkeypatch, factor)
    assert holds(appendix_c.figure_c_3())[1:] == expected[1:]


def test_a_factor_that_falls_with_the_height_fails_the_claim(monkeypatch):
    over_height(monkeypatch, lambda h: 1.2 - 0.05 * h)
    rise, *_ = appendix_c.figure_c_3().measured
    assert rise.low < 0.0 and not rise.holds


def circle(t):
    return path(np.cos, 0.0, lambda t: -1.5 - np.sin(t))(t)


PREDICTED = np.pi * 1.06 * 0.07 / 1.025**2  # m, pi A B Q0 Q'/Q^2 of a loop of 1 m


@pytest.mark.parametrize(('gain', 'z', 'expected'), [
    (1.0, 0.0, [True, True, True]), (-1.0, 0.0, [False, False, True]),
    (0.0, 0.0, [False, False, True]), (2.0, 0.0, [True, False, True]),
    (1.0, 0.05, [True, True, False])])
def test_a_vertical_circle_fails_with_another_drift_in_x_or_any_in_z(
        monkeypatch, gain, z, expected):
    on(monkeypatch, any=drifting(gain * PREDICTED, 0.0, z, truth=circle))
    assert holds(appendix_c.figure_c_4()) == expected
    assert holds(appendix_c.figure_c_7()) == expected[:2]


@pytest.mark.parametrize(('fitted', 'retuned', 'expected'), [
    (0.16, 0.1, [True, True, True]), (0.2, 0.1, [False, True, True]),
    (0.16, 0.15, [True, False, False]), (0.05, -0.1, [True, True, False])])
def test_factors_that_do_not_help_as_printed_fail_the_claim(
        monkeypatch, fitted, retuned, expected):
    on(monkeypatch, any=drifting(0.2))
    errors = {'fitted': drifting(fitted).error, 'retuned': drifting(retuned).error}
    monkeypatch.setattr(
        appendix_c, '_error_with', lambda f, name: errors[name.rpartition('/')[2]])
    assert holds(appendix_c.figure_c_6()) == 2 * expected  # the same flight with both slopes


@pytest.mark.parametrize(('after', 'expected'), [
    ((0.18, 0.15), [True, True]), ((0.25, 0.15), [False, True]), ((0.18, 0.1), [True, False])])
def test_a_factor_must_improve_x_and_worsen_y(monkeypatch, after, expected):
    on(monkeypatch, any=drifting(0.2, 0.1))
    monkeypatch.setattr(appendix_c, '_error_with', lambda f, name: drifting(*after).error)
    assert holds(appendix_c.figure_c_8()) == 2 * expected  # the same errors with both factors


def test_ratios_are_taken_seed_by_seed():
    errors = [drifting(x).error for x in (0.1, -0.3)]
    others = [drifting(x).error for x in (0.2, 0.1)]
    assert appendix_c._ratios(errors, others) == pytest.approx([0.5, 3.0], rel=1e-3)
    with pytest.raises(ValueError, match='zip'):
        appendix_c._ratios(errors[:1], others)
