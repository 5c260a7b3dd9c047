"""The bifilar pendulum: forces by differences of the potential, periods by integrals."""

import math

from mambo_model.vehicle import bifilar
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

MASS, GRAVITY, D, H, J = 0.068, 9.81, 0.1, 0.5, 7.75e-5
FREQUENCY = math.sqrt(MASS * GRAVITY * D * D / (4.0 * J * H))
FREE = bifilar.Swing(FREQUENCY, 0.0, 0.0, D / H)


def potential(theta):
    """Return the energy of a body on wires of length H in J: it rises as they lean."""
    return -MASS * GRAVITY * math.sqrt(H * H - 0.5 * D * D * (1.0 - math.cos(theta)))


@pytest.mark.parametrize('theta', [-2.0, -0.3, 0.0, 0.5, 1.4])
def test_the_restoring_torque_is_the_slope_of_the_potential(theta):
    step = 1e-5  # leaves 1e-10 of the slope, and rounding 1e-11 J / 1e-5
    slope = (potential(theta + step) - potential(theta - step)) / (2.0 * step)
    assert J * bifilar.acceleration(theta, 0.0, FREE) == pytest.approx(-slope, abs=1e-9)


def test_damping_is_against_the_motion_linear_and_quadratic():
    s = bifilar.Swing(FREQUENCY, 0.3, 0.2, D / H)
    assert bifilar.acceleration(0.0, 2.0, s) == pytest.approx(-0.3 * 4.0 - 0.2 * 2.0, rel=1e-15)
    assert bifilar.acceleration(0.0, -2.0, s) == pytest.approx(0.3 * 4.0 + 0.2 * 2.0, rel=1e-15)


def test_inertia_follows_from_the_frequency():
    assert bifilar.inertia(FREQUENCY, MASS, GRAVITY, D, H) == pytest.approx(J, rel=1e-14)
    # J_yy of table 4.2 on wires of half a metre: about a second a swing
    assert 2.0 * math.pi / FREQUENCY == pytest.approx(0.96, abs=0.005)


def test_the_period_is_that_of_the_energy_integral():
    top, t = 0.5, np.arange(0.0, 3.0, 0.001)
    rate = bifilar.swing(t, top, 0.0, FREE)
    rising = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))[0]
    half = t[rising] - 0.001 * rate[rising] / (rate[rising + 1] - rate[rising])

    def slowness(u):  # dt = dtheta / rate, with theta = top sin u to lift the singular end
        theta = top * math.sin(u)
        fall = 2.0 / J * (potential(top) - potential(theta))
        return top * math.cos(u) / math.sqrt(fall)
    quarter = quad(slowness, 0.0, 0.5 * math.pi - 1e-7)[0]
    assert half == pytest.approx(2.0 * quarter, rel=1e-5)  # crossing between samples of 1 ms


def test_a_damped_swing_is_that_of_another_integrator_also_on_an_uneven_grid():
    s = bifilar.Swing(FREQUENCY, 0.3, 0.08, D / H)
    t = np.cumsum(np.random.default_rng(1).uniform(0.002, 0.04, 500))
    other = solve_ivp(
        lambda _, x: [x[1], bifilar.acceleration(x[0], x[1], s)], (t[0], t[-1]), [0.5, 0.2],
        t_eval=t, rtol=1e-11, atol=1e-12)
    got = bifilar.swing(t, 0.5, 0.2, s)
    assert got[0] == 0.2
    assert np.abs(got - other.y[1]).max() < 1e-6  # rad/s, of 3: the step of 1/20 omega_0 allows


def test_a_body_on_a_horizontal_axis_is_a_pendulum_of_its_reduced_length():
    arm, J_axis = 0.17, 1.7e-5 + 0.035 * 0.17 ** 2  # parallel axes
    frequency = math.sqrt(0.035 * 9.81 * arm / J_axis)
    assert bifilar.physical_inertia(frequency, 0.035, 9.81, arm) == pytest.approx(1.7e-5, rel=1e-9)
