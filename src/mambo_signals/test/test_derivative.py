"""Derivatives against closed forms and scipy, with the noise that least squares have."""

from mambo_signals.derivative import ATTITUDE, body_rates, local_fit, POSITION, SPARSE
import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation
from synthetic import loop

LOST = (8.0, 10.0)  # s, a gap of 2 s


@pytest.mark.parametrize('jitter', [0.0, 0.003])
def test_the_derivative_is_that_of_the_motion_and_stops_at_a_gap(jitter):
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 15.0, 0.01) + jitter * rng.uniform(size=1500)
    keep = (t < LOST[0]) | (t > LOST[1])
    at = np.arange(4.5, 14.5, 0.02)
    value, slope = local_fit(t[keep], loop(t[keep])[0], at, 0.12)
    known = np.isfinite(slope).all(axis=1)
    assert not known[(at > 8.0) & (at < 10.0)].any()
    assert known[(at < 7.9) | (at > 10.1)].all()
    np.testing.assert_allclose(value[known], loop(at[known])[0], atol=3e-4)
    np.testing.assert_allclose(slope[known], loop(at[known])[1], atol=0.02)


def test_a_window_across_a_short_gap_has_no_derivative():
    t = np.arange(0.0, 2.0, 0.01)
    t = np.delete(t, range(100, 105))  # 60 ms, in the middle of a window of 220 ms
    _, slope = local_fit(t, t[:, None], np.array([0.5, 0.95, 1.02, 1.1, 1.5]), 0.22)
    assert np.isnan(slope[:, 0]).tolist() == [False, True, True, True, False]


@pytest.mark.parametrize(('degree', 'polynomial'), [
    (2, [3.0, -1.0, 0.5]), (3, [-2.0, 3.0, -1.0, 0.5]), (4, [1.0, -2.0, 3.0, -1.0, 0.5])])
def test_a_polynomial_of_its_degree_is_differentiated_exactly(degree, polynomial):
    t = 0.01 * np.arange(200) + np.random.default_rng(1).uniform(0.0, 0.005, 200)
    at = np.array([0.7, 1.1, 1.234])
    value, slope = local_fit(t, np.polyval(polynomial, t)[:, None], at, 0.2, degree)
    np.testing.assert_allclose(value[:, 0], np.polyval(polynomial, at), rtol=1e-9)
    np.testing.assert_allclose(slope[:, 0], np.polyval(np.polyder(polynomial), at), rtol=1e-8)


@pytest.mark.parametrize('degree', [2, 3])
def test_on_an_even_grid_it_is_the_filter_of_savitzky_and_golay(degree):
    period, points = 0.01, 23
    t = period * np.arange(300)
    y = np.random.default_rng(2).standard_normal((300, 2))
    inside = slice(points // 2, -(points // 2))
    # the window ends halfway between samples, so that rounding lets none in or out
    value, slope = local_fit(t, y, t, period * points, degree)
    for order, ours in ((0, value), (1, slope)):
        theirs = savgol_filter(y, points, degree, deriv=order, delta=period, axis=0)
        np.testing.assert_allclose(ours[inside], theirs[inside], atol=1e-9 / period ** order)


def test_white_noise_of_the_samples_gives_the_noise_of_least_squares():
    """Variance of the slope of n even samples: 12 sigma^2 / (n (n^2 - 1) h^2), closed form."""
    period, points, sigma = 0.01, 23, 0.001
    t = period * np.arange(200_000)
    y = sigma * np.random.default_rng(3).standard_normal((len(t), 1))
    at = t[points::points][:-2]  # windows that share no sample: independent
    _, slope = local_fit(t, y, at, period * points)
    want = sigma * np.sqrt(12.0 / (points * (points ** 2 - 1))) / period
    # of 8694 slopes: the spread is known to 1 / sqrt(2 n) = 0.8 %
    assert np.std(slope) == pytest.approx(want, rel=0.03)
    assert abs(np.mean(slope)) < 4.0 * want / np.sqrt(len(at))


@pytest.mark.parametrize('frequency', [0.5, 1.0, 2.0, 4.0])
def test_a_sine_is_smoothed_as_the_closed_form_says(frequency):
    """
    A line fitted to a window of half width h keeps 3 (sin a - a cos a) / a^3 of a rate, a = w h.

    That is 1 - a^2 / 10 for small a, what a Gaussian of W / 4.47 keeps.
    """
    w, period = 2.0 * np.pi * frequency, 0.0005
    t = period * np.arange(8000)
    at = np.linspace(1.0, 3.0, 57)
    _, slope = local_fit(t, np.sin(w * t)[:, None], at, POSITION)
    a = 0.5 * w * POSITION
    kept = 3.0 * (np.sin(a) - a * np.cos(a)) / a ** 3
    # a sum of 440 samples in place of an integral
    np.testing.assert_allclose(slope[:, 0], kept * w * np.cos(w * at), atol=0.01 * w)
    gaussian = np.exp(-0.5 * (w * POSITION / 4.5) ** 2)
    assert abs(kept - gaussian) < 0.02 * a ** 4  # they part only in the next order


def test_it_does_not_shift_in_time():
    t = 0.005 * (np.arange(4000) + np.random.default_rng(4).uniform(0.0, 0.9, 4000))
    at = 2.0 + np.linspace(0.0, 14.0 * np.pi / 3.0, 3000, endpoint=False)  # seven whole periods
    _, slope = local_fit(t, np.sin(3.0 * t)[:, None], at, 0.3)
    known = np.isfinite(slope[:, 0])
    x, s, c = slope[known, 0], np.sin(3.0 * at[known]), np.cos(3.0 * at[known])
    assert known.all()
    late = np.arctan2(x @ s, x @ c) / 3.0  # s, of the phase
    assert abs(late) < 1e-4


def test_a_window_is_never_narrower_than_some_periods():
    t = 0.1 * np.arange(100)
    y = np.sin(t)[:, None]
    at = t + 0.03  # so that no sample lies on the edge of a window
    narrow, wide = (local_fit(t, y, at, window) for window in (0.0, SPARSE * 0.1))
    np.testing.assert_allclose(narrow, wide, rtol=1e-12)
    assert np.isfinite(narrow[1]).sum() > 90


def test_samples_must_lie_on_either_side():
    t = 0.01 * np.arange(100)
    at = np.array([-0.01, 0.0, 0.02, 0.06, 0.5, 0.93, 0.97, 0.99, 1.01])
    value, slope = local_fit(t, t[:, None], at, 0.2)
    known = [False, False, False, True, True, True, False, False, False]
    assert np.isfinite(slope[:, 0]).tolist() == np.isfinite(value[:, 0]).tolist() == known


@pytest.mark.parametrize('count', [0, 1, 4])
def test_a_recording_too_short_or_too_sparse_has_no_derivative(count):
    t = 0.1 * np.arange(count)
    assert np.isnan(local_fit(t, t[:, None], t, 0.1)[1]).all()
    times, rates = body_rates(t, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    assert times.shape == (0,) and rates.shape == (0, 3)


def test_many_instants_are_those_one_by_one(monkeypatch):
    t = 0.01 * np.arange(400)
    y = np.random.default_rng(5).standard_normal((400, 3))
    at = np.linspace(-0.5, 4.5, 333)
    whole = local_fit(t, y, at, 0.2)
    monkeypatch.setattr('mambo_signals.derivative._AT_ONCE', 7)
    np.testing.assert_array_equal(local_fit(t, y, at, 0.2), whole)


def test_body_rates_are_those_of_the_gyro():
    t = np.arange(0.0, 5.0, 0.01)
    spin = np.array([0.3, -0.5, 0.8])  # rad/s in the body, constant
    attitude = Rotation.from_euler('ZYX', [0.7, 0.4, -0.2]) * Rotation.from_rotvec(
        np.outer(t, spin))
    keep = (t < 2.0) | (t > 3.0)
    times, rates = body_rates(t[keep], attitude[keep].as_quat())
    assert times[0] < 0.05 and times[-1] > 4.94
    assert not ((times > 2.0) & (times < 3.0)).any()
    np.testing.assert_allclose(rates, np.tile(spin, (len(rates), 1)), atol=1e-9)


def test_body_rates_of_euler_angles_follow_their_kinematics():
    """Rates of roll, pitch and yaw to p, q, r by the textbook matrix, at other instants."""
    t = np.arange(0.0, 6.0, 0.004)
    at = np.arange(0.5, 5.5, 0.0137)

    def angles(x):
        return 0.4 * np.sin(1.7 * x), 0.3 * np.cos(2.3 * x), 0.8 * x + 0.2 * np.sin(x)

    def speeds(x):
        return 0.68 * np.cos(1.7 * x), -0.69 * np.sin(2.3 * x), 0.8 + 0.2 * np.cos(x)

    roll, pitch, yaw = angles(t)
    q = Rotation.from_euler('ZYX', np.column_stack([yaw, pitch, roll])).as_quat()
    times, rates = body_rates(t, q, at)
    np.testing.assert_array_equal(times, at)
    (phi, theta, _), (dphi, dtheta, dpsi) = angles(at), speeds(at)
    want = np.column_stack([
        dphi - dpsi * np.sin(theta),
        dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta),
        -dtheta * np.sin(phi) + dpsi * np.cos(phi) * np.cos(theta)])
    # what the window leaves out: (w W / 2)^2 / 10 of 0.8 rad/s at 2.3 rad/s is 9e-4
    assert (2.3 * ATTITUDE / 2.0) ** 2 / 10.0 * 0.8 < 1e-3
    np.testing.assert_allclose(rates, want, atol=2e-3)


def test_the_sign_of_a_quaternion_does_not_matter_to_a_body_rate():
    t = 0.01 * np.arange(300)
    q = Rotation.from_rotvec(np.outer(t, [0.0, 0.2, 1.0])).as_quat()
    flipped = q * np.where(np.random.default_rng(6).random(300) < 0.5, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(body_rates(t, flipped)[1], body_rates(t, q)[1], atol=1e-9)
