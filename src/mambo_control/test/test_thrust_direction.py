"""Desired attitude: the matrix (3.22), the rates of (3.24), exact derivatives of f_d in flight."""

from mambo_control.cascaded import CascadedParams
from mambo_control.thrust_direction import desired_attitude
from mambo_model.motion.quaternion import conjugate, multiply, to_matrix
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from thesis_flight import control, precise_flight, random_state, runge_kutta, setup, start

GAINS = CascadedParams().values()
ZERO = (0.0, 0.0, 0.0)
H = 1e-3  # s, of the differences below
# The four-point rule errs by H^4/30 times a fifth derivative. The attitude modes of 25 rad/s
# make that 25^5 (25^6 for a second derivative of f_d) times the attitude error, of order 0.1 rad
# in Fig. 3.3 and 1 rad in the random states: 3e-8 and 8e-6 at most.
NEAR, FAR = 1e-7, 1e-5


def slopes(t, y, case, *names):
    """Return d/dt of the named signals of the law along the flight through y, four-point rule."""
    at = {0: y}
    for k in (1, 2):
        at[k] = runge_kutta(t + (k - 1) * H, at[k - 1], H, case)
        at[-k] = runge_kutta(t - (k - 1) * H, at[1 - k], -H, case)
    laws = {k: control(t + k * H, at[k], case) for k in (-2, -1, 1, 2)}
    out = []
    for name in names:
        s = {k: np.array(getattr(laws[k], name)) for k in laws}
        out.append((8 * (s[1] - s[-1]) - (s[2] - s[-2])) / (12 * H))
    return out


def assert_derivatives(t, y, case, tolerance):
    """Check f_d', f_d'', omega_d and omega_d' against differences of f_d, f_d', q_d, omega_d."""
    out = control(t, y, case)
    f_1, f_2, q_1, w_1 = slopes(t, y, case, 'f_d', 'f_d_dot', 'q_d', 'omega_d')
    np.testing.assert_allclose(out.f_d_dot, f_1, atol=tolerance)
    np.testing.assert_allclose(out.f_d_ddot, f_2, atol=tolerance)
    twice = multiply(conjugate(out.q_d), tuple(2 * q_1))
    np.testing.assert_allclose(twice[1:], out.omega_d, atol=tolerance)  # (3.24) = 2 q_d* q_d'
    np.testing.assert_allclose(out.omega_d_dot, w_1, atol=tolerance)


@pytest.mark.parametrize('f_d', [
    (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.6, 0.8), (0.48, 0.64, -0.6), (-0.8, 0.6, 0.0)])
def test_desired_attitude_is_the_matrix_of_the_thesis(f_d):
    f1, f2, f3 = f_d
    q_d, _, _ = desired_attitude(f_d, ZERO, ZERO, GAINS)
    R_d = np.array([
        [1 - f1**2 / (1 + f3), -f1 * f2 / (1 + f3), f1],
        [-f1 * f2 / (1 + f3), 1 - f2**2 / (1 + f3), f2],
        [-f1, -f2, f3]])  # (3.22)
    np.testing.assert_allclose(to_matrix(q_d), R_d, atol=1e-15)
    w, *v = q_d
    np.testing.assert_allclose(Rotation([*v, w]).apply([0, 0, 1]), f_d, atol=1e-15)


@pytest.mark.long
@pytest.mark.parametrize('yaw', [0.0, 1.0])
def test_derivatives_are_exact_along_figure_3_3(yaw):
    case, times = setup(yaw_amplitude=yaw), np.linspace(0.0, 8.0, 41)
    for t, y in zip(times, precise_flight(start(), times, case), strict=True):
        assert_derivatives(t, y, case, NEAR)


@pytest.mark.parametrize('yaw', [0.0, 1.0])
@pytest.mark.parametrize('seed', range(10))
def test_derivatives_are_exact_far_from_the_reference(seed, yaw):
    rng, case = np.random.default_rng(seed), setup(yaw_amplitude=yaw)
    t = rng.uniform(0, 6)
    assert_derivatives(t, random_state(rng, case, t), case, FAR)


def test_cheaper_choices_leave_the_rates_out():
    y, full = start(), control(0.3, start(), setup())
    no_acceleration = control(0.3, y, setup(params=CascadedParams(derivatives='no_acceleration')))
    no_rates = control(0.3, y, setup(params=CascadedParams(derivatives='no_rates')))
    assert no_acceleration.omega_d == full.omega_d != ZERO
    assert no_acceleration.omega_d_dot == no_rates.omega_d == no_rates.omega_d_dot == ZERO
    assert no_rates.q_d == full.q_d and no_rates.f_d_ddot == full.f_d_ddot
