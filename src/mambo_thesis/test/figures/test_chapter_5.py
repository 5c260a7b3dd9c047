"""Chapter 5 on made flights: the factor of the flow and the errors that figures tell."""

from made_flights import made, path
from mambo_thesis.figures import chapter_5
import numpy as np
import pytest


def on(monkeypatch, *flights, module=chapter_5):
    monkeypatch.setattr(module, 'seeds', lambda name: list(flights))


def by_what(result):
    return {m.what: m for m in result.measured}


@pytest.mark.parametrize(('height', 'factor'), [
    (1.5, 1.5 * 1.025), (2.5, 2.5 * 1.095), (4.0, 4.0 * 1.095), (0.2, 0.2 * 0.955)])
def test_the_factor_of_the_sensor_is_linear_between_half_and_two_and_a_half_metres(height, factor):
    assert chapter_5.sensor_factor(height) == pytest.approx(factor)


def test_positions_are_made_equal_at_6_s():
    f = made(path(lambda t: t), path(lambda t: 1.1 * t + 3.0), seconds=10.0)
    t, estimate, truth = chapter_5.equalised(f)
    assert t[0] == 6.0 and (estimate[0] == truth[0]).all()
    np.testing.assert_allclose(estimate[:, 0] - truth[:, 0], 0.1 * (t - 6.0), atol=1e-9)
    figure = chapter_5.against_optitrack(f, (0,))
    np.testing.assert_allclose(
        figure.axes[1].lines[0].get_ydata()[-1],
        np.sqrt(np.mean((0.1 * (t - 6.0))**2)), rtol=1e-6)


def test_hovering_errors_are_those_after_12_s(monkeypatch):
    def estimate(t):
        return np.where(t < 12.0, 5.0, 0.03)
    on(monkeypatch, made(path(), path(estimate, 0.04, -1.495), seconds=20.0))
    found = by_what(chapter_5.figure_5_3())
    assert found['error of the height, RMS'].low == pytest.approx(0.005)
    assert found['horizontal error over that of the height'].low == pytest.approx(0.05 / 0.005)


def test_a_wrong_amplitude_is_true_over_estimated(monkeypatch):
    expected = chapter_5.sensor_factor(1.5)
    flight = made(path(y=lambda t: expected * np.sin(t)), path(y=np.sin), seconds=40.0)
    on(monkeypatch, flight)
    found = by_what(chapter_5.figure_5_4())
    assert found['true over estimated amplitude'].low == pytest.approx(expected, rel=1e-6)
    assert found['the same, h Q(h) being expected'].holds


def test_the_accelerometer_is_calibrated_by_its_first_half_second():
    def imu(t):
        rows = np.zeros((len(t), 6))
        rows[:, 4] = 0.5 + np.where(t < 0.5, 0.0, 0.01)
        return rows
    velocity = chapter_5.velocity_of(made(path(), seconds=10.5, imu=imu), 1)
    assert velocity[99] == pytest.approx(0.0, abs=1e-12)
    assert velocity[-1] == pytest.approx(0.1, rel=1e-3)  # 10 s of 0.01 m/s^2


def test_the_best_factor_is_found_beside_an_offset():
    x = np.linspace(-1.0, 2.0, 100)
    assert chapter_5._best_factor(x, 1.5 * x + 0.3) == pytest.approx((1.5, 0.0), abs=1e-12)
    rest = np.where(np.arange(100) % 2, 0.1, -0.1)
    factor, left = chapter_5._best_factor(x, 1.5 * x + rest)
    assert factor == pytest.approx(1.5, abs=0.01) and left == pytest.approx(0.1, rel=1e-3)


def sine(height, factor):
    """Return a sine in y whose flow is the velocity over height and factor, from 6 s on."""
    return made(path(y=lambda t: np.sin(t), z=-height), path(y=lambda t: np.sin(t) / factor),
                seconds=30.0, flow=lambda t: np.stack(
                    [np.zeros_like(t), np.cos(t) / factor], axis=1))


@pytest.mark.parametrize(('figure', 'height'), [
    (chapter_5.figure_5_8, 1.5), (chapter_5.figure_5_9, 2.5)])
def test_a_constant_makes_the_integrated_flow_the_truth(monkeypatch, figure, height):
    factor = chapter_5.sensor_factor(height)
    on(monkeypatch, sine(height, factor))
    found = by_what(figure())
    assert found['best constant, h Q(h) expected'].low == pytest.approx(factor, rel=1e-2)
    assert found['the same over the height, Q'].low == pytest.approx(factor / height, rel=1e-2)
    assert found['error that is left, RMS'].high < 0.01
    on(monkeypatch, sine(height, 1.2 * factor))
    assert not by_what(figure())['best constant, h Q(h) expected'].holds


def test_estimate_and_flow_are_the_same_and_the_truth_differs_by_a_factor(monkeypatch):
    on(monkeypatch, sine(1.5, chapter_5.sensor_factor(1.5)))
    found = by_what(chapter_5.figure_5_7())
    assert all(m.holds for m in found.values()), [str(m) for m in found.values()]


def test_the_drift_of_the_velocity_is_taken_out_of_the_position():
    """A bias left by the calibration: the velocity is a line, the position nothing."""
    def imu(t):
        rows = np.zeros((len(t), 6))
        rows[:, 4] = np.where(t < 0.5, 0.0, 0.01)
        return rows
    flight = made(path(), seconds=40.0, imu=imu)
    assert abs(chapter_5.velocity_of(flight, 1)[-1]) > 0.3
    assert abs(chapter_5.position_of(flight)).max() < 0.01  # 8 m without


TURN = 2.0 * np.pi


def drifting(x, y=0.0, truth=None):
    """Return a flight whose estimate drifts by x and y a turn."""
    truth = truth or path()
    return made(truth, lambda t: truth(t) + path(
        lambda t: x * t / TURN, lambda t: y * t / TURN, 0.0)(t), seconds=40.0)


def test_a_drift_has_a_sign_and_is_by_turn():
    assert chapter_5.drifts([drifting(-0.1, 0.05)], 0)[0] == pytest.approx(-0.1, rel=1e-3)
    assert chapter_5.drifts([drifting(-0.1, 0.05)], 1)[0] == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize(('size', 'is_still'), [
    (0.019, True), (-0.019, True), (0.021, False), (-0.021, False)])
def test_one_size_parts_what_drifts_from_what_does_not(size, is_still):
    assert chapter_5.still('', [drifting(size)], 0).holds is is_still
    assert chapter_5.moving('', [drifting(size)], 0)[0].holds is (size > 0.02)


def circle(t):
    return path(np.cos, 0.0, lambda t: -1.5 - np.sin(t))(t)


def test_a_drift_is_that_of_the_factor_along_the_path():
    expected = chapter_5.predicted(made(circle, seconds=40.0), 0)
    # pi A B Q0 Q'/Q^2 of a loop of 1 m
    assert expected == pytest.approx(np.pi * 1.06 * 0.07 / 1.025**2, rel=0.02)
    assert chapter_5.predicted(made(circle, seconds=40.0), 1) == 0.0
    for factor, holds in ((1.0, True), (-1.0, False), (0.0, False), (2.0, False)):
        found = chapter_5.moving('', [drifting(factor * expected, truth=circle)], 0)
        assert all(m.holds for m in found) is holds


def test_block_diagrams_and_photographs_have_nothing_to_measure():
    for figure in (chapter_5.figure_5_1, chapter_5.figure_5_2):
        assert not figure().measured and figure().why_not
