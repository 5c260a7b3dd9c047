"""Figure 3.3 on made flights: when the error is small for good, and how the angle is told."""

import math

from made_flights import made, path
from mambo_thesis.figures import chapter_3
import numpy as np
import pytest


def examined(monkeypatch, error, tilt=0.0):
    flight = made(path(lambda t: -error(t)), None, path(), seconds=20.0)
    flight.recording.truth[:, 6:8] = math.cos(0.5 * tilt), math.sin(0.5 * tilt)
    monkeypatch.setattr(chapter_3, 'fly', lambda name: {'fig_3_3': flight}[name])
    return chapter_3.figure_3_3()


def test_the_error_is_below_5_cm_for_good_and_not_for_a_moment(monkeypatch):
    def error(t):  # small at 2 s, large again until 5.8 s
        return np.where((t < 2.0) | (t > 2.5) & (t < 5.8), 0.2, 0.01)
    settled, at_six, late, _ = examined(monkeypatch, error).measured
    assert settled.low == pytest.approx(5.8, abs=0.006)
    assert at_six.low == pytest.approx(10.0) and at_six.unit == 'mm'
    assert late.high == pytest.approx(10.0) and not late.holds


def test_the_largest_motor_command_is_of_all_motors(monkeypatch):
    *_, command = examined(monkeypatch, lambda t: np.exp(-t)).measured
    assert command.low == 250.0 and not command.holds


def test_position_velocity_and_attitude_are_drawn(monkeypatch):
    figure = examined(monkeypatch, lambda t: np.exp(-t), tilt=0.3).figure
    curves = {axes.get_ylabel(): axes.lines[-1].get_ydata() for axes in figure.axes}
    np.testing.assert_allclose(curves['angle to $q_r$ [rad]'], 0.3, atol=1e-9)
    np.testing.assert_allclose(curves[r'$|\nu_e|$ [m/s]'], 0.0)
    assert curves[r'$|\rho_e|$ [m]'][0] == pytest.approx(1.0)
    assert curves['$x$ [m]'][0] == pytest.approx(-1.0)


def settling(until=5.815, at_six=0.039, decay=1.0):
    """Return an error over time: large until a time, then an exponential."""
    return lambda t: np.where(t < until, 0.2, at_six * np.exp(-decay * (t - 6.0)))


def verdicts(monkeypatch, error, pwm=334.8):
    flight = made(path(lambda t: -error(t)), None, path(), seconds=20.0)
    flight.recording.pwm[100, 2] = pwm  # of one motor at one instant
    monkeypatch.setattr(chapter_3, 'fly', lambda name: flight)
    return [m.holds for m in chapter_3.figure_3_3().measured]


def test_a_flight_that_tracks_as_printed_reproduces_the_claim(monkeypatch):
    assert verdicts(monkeypatch, settling()) == [True, True, True, True]


@pytest.mark.parametrize(('error', 'pwm', 'expected'), [
    (settling(until=6.2), 334.8, [False, False, True, True]),     # settles late
    (settling(at_six=0.0405), 334.8, [True, False, True, True]),  # larger error at 6 s
    (settling(decay=0.05), 334.8, [True, True, False, True]),     # decays too slowly
    (settling(), 350.0, [True, True, True, False])])              # larger command
def test_each_part_of_the_claim_can_fail_alone(monkeypatch, error, pwm, expected):
    assert verdicts(monkeypatch, error, pwm) == expected


def test_a_drone_that_never_tracks_settles_never(monkeypatch):
    settled, *_ = examined(monkeypatch, lambda t: np.full_like(t, 0.2)).measured
    assert settled.high == math.inf and not settled.holds


def test_a_drone_that_always_tracks_settles_at_once(monkeypatch):
    settled, *_ = examined(monkeypatch, lambda t: np.zeros_like(t)).measured
    assert settled.low == 0.0 and not settled.holds  # the claim is about 5.8 s
