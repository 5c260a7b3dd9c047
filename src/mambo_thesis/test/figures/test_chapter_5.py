"""Chapter 5 on made flights: the factor of the flow and the errors that figures tell."""

from types import SimpleNamespace

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
    t, estimate, truth = chapter_5.aligned(f)
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
    assert found['height error, RMS'].low == pytest.approx(0.005)
    assert found['horizontal error over height error'].low == pytest.approx(0.05 / 0.005)


def test_a_wrong_amplitude_is_true_over_estimated(monkeypatch):
    expected = chapter_5.sensor_factor(1.5)
    flight = made(path(y=lambda t: expected * np.sin(t)), path(y=np.sin), seconds=40.0)
    on(monkeypatch, flight)
    found = by_what(chapter_5.figure_5_4())
    assert found['true over estimated amplitude'].low == pytest.approx(expected, rel=1e-6)
    assert found['that ratio, expected to be h Q(h)'].holds


def test_the_accelerometer_is_calibrated_by_its_first_half_second():
    def imu(t):
        rows = np.zeros((len(t), 6))
        rows[:, 4] = 0.5 + np.where(t < 0.5, 0.0, 0.01)
        return rows
    velocity = chapter_5._velocity(made(path(), seconds=10.5, imu=imu), 1)
    assert velocity[99] == pytest.approx(0.0, abs=1e-12)
    assert velocity[-1] == pytest.approx(0.1, rel=1e-3)  # 10 s of 0.01 m/s^2


def test_the_best_factor_is_found_beside_an_offset():
    x = np.linspace(-1.0, 2.0, 100)
    assert chapter_5.best_factor(x, 1.5 * x + 0.3) == pytest.approx((1.5, 0.0), abs=1e-12)
    rest = np.where(np.arange(100) % 2, 0.1, -0.1)
    factor, residual = chapter_5.best_factor(x, 1.5 * x + rest)
    assert factor == pytest.approx(1.5, abs=0.01) and residual == pytest.approx(0.1, rel=1e-3)


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
    assert found['best constant, expected to be h Q(h)'].low == pytest.approx(factor, rel=1e-2)
    assert found['that constant over the height, Q'].low == pytest.approx(
        factor / height, rel=1e-2)
    assert found['residual, RMS'].high < 0.01
    on(monkeypatch, sine(height, 1.2 * factor))
    assert not by_what(figure())['best constant, expected to be h Q(h)'].holds


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
    assert abs(chapter_5._velocity(flight, 1)[-1]) > 0.3
    assert abs(chapter_5._detrended_position(flight)).max() < 0.01  # 8 m without


TURN = 2.0 * np.pi


def drifting(x=0.0, y=0.0, z=0.0, truth=None):
    """Return a flight whose estimate drifts by so many metres per turn on each axis."""
    truth = truth or path()
    return made(truth, lambda t: truth(t) + path(
        lambda t: x * t / TURN, lambda t: y * t / TURN, lambda t: z * t / TURN)(t), seconds=40.0)


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
        assert not figure().measured and figure().remark


def holds(result):
    return [m.holds for m in result.measured]


@pytest.mark.parametrize(('estimate', 'expected'), [
    (path(0.12, 0.16, -1.495), [True, True, True]),
    (path(0.12, 0.16, -1.45), [False, True, True]),     # the height is wrong too
    (path(0.12, 0.16, -1.42), [False, False, True]),    # as wrong as x and y
    (path(0.03, 0.04, -1.495), [True, True, False]),    # centimetres, not decimetres
    (path(0.006, 0.0, -1.495), [True, False, False])])  # x and y are as good as the height
def test_hovering_fails_with_a_wrong_height_or_good_x_and_y(monkeypatch, estimate, expected):
    on(monkeypatch, made(path(), estimate, seconds=20.0))
    assert holds(chapter_5.figure_5_3()) == expected


@pytest.mark.parametrize(('factor', 'height_error', 'expected'), [
    (1.5375, 0.0, [True, True, True]), (1.5375, 0.05, [False, True, True]),
    (1.3, 0.0, [True, True, False]),   # wrong by another factor than h Q(h)
    (1.0, 0.0, [True, False, False])])
def test_a_sine_fails_with_a_wrong_height_or_another_factor(
        monkeypatch, factor, height_error, expected):
    on(monkeypatch, made(path(y=lambda t: factor * np.sin(t)),
                         path(y=np.sin, z=-1.5 + height_error), seconds=40.0))
    assert holds(chapter_5.figure_5_4()) == expected


def accelerating(bias, error=0.0):
    """Return a flight whose accelerometer gains a bias after 0.5 s, with an error in y."""
    def imu(t):
        rows = np.zeros((len(t), 6))
        rows[:, 4] = np.where(t < 0.5, 0.0, bias) + 0.2 * np.sin(0.7 * t)
        rows[:100, 4] = 0.0
        return rows
    flight = made(path(), path(y=error), seconds=40.0, imu=imu)
    # 0.14 m/s^2 of noise, averaged over 100 samples at rest, leave a bias of 0.014 m/s^2
    flight.scenario = SimpleNamespace(sim_node=SimpleNamespace(simulator=SimpleNamespace(
        imu=SimpleNamespace(accel_noise=(0.14, 0.14, 0.14)))))
    return flight


def double_integral(t):
    """Return the double integral of the accelerometer of accelerating(0.02), detrended."""
    return chapter_5._detrended_position(accelerating(0.02))


def oscillation(t):
    return np.sin(5.0 * t)


@pytest.mark.parametrize(('bias', 'without_noise', 'error', 'expected'), [
    (0.02, 0.01, oscillation, [True, True, True]),
    (0.06, 0.01, oscillation, [False, True, True]),   # drifts more than the calibration explains
    (0.002, 0.001, oscillation, [False, True, True]),  # drifts less
    (0.02, 0.019, oscillation, [True, False, True]),  # drifts as much without noise
    (0.02, 0.01, double_integral, [True, True, False])])  # explains the position error
def test_each_part_of_the_claim_on_the_accelerometer_can_fail(
        monkeypatch, bias, without_noise, error, expected):
    on(monkeypatch, accelerating(bias, error))
    asked = []
    monkeypatch.setattr(chapter_5, 'fly', lambda name, seed, changes: asked.append(
        (name, changes)) or accelerating(without_noise))
    assert holds(chapter_5.figure_5_5()) == expected
    assert set(asked) == {('fig_5_5', (
        ('sim_node.simulator.imu.accel_noise', (0.0, 0.0, 0.0)),))}


def ascended(gap, later=0.0):
    """Return a flight whose estimate is off the flow (0) by a gap, and later by more."""
    return made(path(), path(lambda t: np.where(t < 6.0 + TURN, gap, gap + later)),
                seconds=30.0, flow=lambda t: np.zeros((len(t), 2)))


@pytest.mark.parametrize(('bad', 'good', 'expected'), [
    (ascended(0.05), ascended(0.03), [True, True, True]),
    (ascended(0.05), ascended(0.0), [True, True, False]),
    (ascended(0.01), ascended(0.03), [False, True, True]),
    (ascended(0.05, 0.1), ascended(0.03), [True, False, True])])  # keeps leaving the flow
def test_each_part_of_the_claim_on_the_ascent_can_fail(monkeypatch, bad, good, expected):
    flights = {'fig_5_6/well_calibrated': [good], 'fig_5_6/badly_calibrated': [bad]}
    monkeypatch.setattr(chapter_5, 'seeds', flights.__getitem__)
    assert holds(chapter_5.figure_5_6()) == expected


def test_an_estimate_that_leaves_the_flow_fails_the_claim(monkeypatch):
    good = sine(1.5, chapter_5.sensor_factor(1.5))
    bad = made(path(y=np.sin), path(y=lambda t: np.sin(t) + 0.3 * np.sin(3.0 * t)), seconds=30.0,
               flow=lambda t: np.stack([np.zeros_like(t), np.cos(t)], axis=1))
    on(monkeypatch, good)
    assert holds(chapter_5.figure_5_7()) == [True, True, True]
    on(monkeypatch, bad)
    apart, factor, rest = chapter_5.figure_5_7().measured
    offset = 0.3 * np.sin(3.0 * chapter_5.ALIGN_TIME)  # of the difference where it is aligned
    assert apart.low == pytest.approx(np.hypot(0.3 / np.sqrt(2.0), offset), rel=0.05)
    assert not apart.holds
    assert not factor.holds and not rest.holds


@pytest.mark.parametrize(('flight', 'expected'), [
    (drifting(0.005, 0.005), [True, True, True]), (drifting(x=0.03), [False, False, True]),
    (drifting(y=-0.03), [False, True, False]),
    (made(path(), path(lambda t: 0.1 * np.sin(5.0 * t))), [False, True, True])])
def test_a_level_circle_fails_with_a_drift_or_a_large_error(monkeypatch, flight, expected):
    on(monkeypatch, flight)
    assert holds(chapter_5.figure_5_10()) == expected


def circle_in_y(t):
    return path(0.0, np.cos, lambda t: -1.5 - np.sin(t))(t)


PREDICTED = np.pi * 1.06 * 0.07 / 1.025**2  # m, pi A B Q0 Q'/Q^2 of a loop of 1 m


def rising(x=0.0, gain=1.0, z=0.0):
    """Return the printed circle: y drifts by a gain times the prediction."""
    return drifting(x, gain * PREDICTED, z, circle_in_y)


def exchanged(gain=1.0, y=0.0):
    return drifting(gain * PREDICTED, y, 0.0, circle)


@pytest.mark.parametrize(('printed', 'swapped', 'failing'), [
    (rising(), exchanged(), set()), (rising(x=0.03), exchanged(), {2}),
    (rising(z=-0.03), exchanged(), {3}), (rising(gain=2.0), exchanged(), {1}),
    (rising(gain=-1.0), exchanged(), {0, 1}), (rising(), exchanged(gain=0.0), {5, 6}),
    (rising(), exchanged(gain=0.8), {6}), (rising(), exchanged(y=0.03), {7})])
def test_each_part_of_the_claim_on_the_rising_circle_can_fail(
        monkeypatch, printed, swapped, failing):
    """y drifts, by the prediction; x and z do not; growth; x drifts, by the prediction; y not."""
    flights = {'fig_5_11/printed': [printed], 'fig_5_11/x_and_y_exchanged': [swapped]}
    monkeypatch.setattr(chapter_5, 'seeds', flights.__getitem__)
    found = holds(chapter_5.figure_5_11())
    assert len(found) == 8 and {k for k, held in enumerate(found) if not held} == failing


def test_an_error_that_does_not_grow_fails_the_claim(monkeypatch):
    """The error is 0.8 m from 8 s on: two seconds after the alignment, and then constant."""
    step = made(circle_in_y, lambda t: circle_in_y(t) + path(
        0.0, lambda t: np.where(t < 8.0, 0.0, 0.8), 0.0)(t), seconds=40.0)
    flights = {'fig_5_11/printed': [step], 'fig_5_11/x_and_y_exchanged': [exchanged()]}
    monkeypatch.setattr(chapter_5, 'seeds', flights.__getitem__)
    growth = by_what(chapter_5.figure_5_11())[
        'growth factor of the RMS in y over the second half']
    # mean square 0.64 (1 - 2 / T), with T = 17 s and 34 s after the alignment
    assert growth.low == pytest.approx(np.sqrt((1.0 - 2.0 / 34.0) / (1.0 - 2.0 / 17.0)), rel=1e-2)
    assert not growth.holds


@pytest.mark.parametrize(('drift', 'expected'), [(0.01, True), (-0.01, True), (0.03, False)])
def test_an_inclined_line_fails_with_a_drift(monkeypatch, drift, expected):
    on(monkeypatch, drifting(drift))
    assert holds(chapter_5.figure_5_12()) == [expected]


def vertical_circle(sign):
    """Return a vertical circle of 0.5 m whose error is the closed integral of (Q0/Q - 1) dx."""
    def x(t):
        return 0.5 * np.cos(t)

    def z(t):
        return -1.5 - 0.5 * np.sin(t)

    def error(t):
        ratio = 1.06 / (0.92 - 0.07 * z(t)) - 1.0
        return sign * np.cumsum(np.insert(ratio[1:] * np.diff(x(t)), 0, 0.0))
    return made(path(x, 0.0, z), path(lambda t: x(t) + error(t), 0.0, z), seconds=40.0)


@pytest.mark.parametrize(('sign', 'expected'), [
    (1.0, [True, True]), (-1.0, [False, False]), (0.0, [False, False])])
def test_the_drift_on_a_vertical_circle_has_the_predicted_size_and_sign(
        monkeypatch, sign, expected):
    on(monkeypatch, vertical_circle(sign))
    found = chapter_5.figure_5_13().measured
    assert [m.holds for m in found] == expected
    # pi A B Q' Q0 / Q^2, to first order in the variation of Q
    assert found[0].low == pytest.approx(
        sign * np.pi * 0.25 * 0.07 * 1.06 / 1.025**2, rel=0.02)
