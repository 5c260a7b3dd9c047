"""Integral action under a constant disturbance, and recovery from large attitude errors."""

from mambo_control.cascaded import CascadedParams
from mambo_model.vehicle.motor_mixer import allocate
import numpy as np
import pytest
from thesis_flight import control, flight, reference, setup, start

AXES = ('x', 'y', 'z')


def hovering_error(d, axis, choice):
    """Return the vehicle's offset after 40 s of hover under d m/s^2 along an axis, (3,) m."""
    push = [0.0, 0.0, 0.0]
    push[AXES.index(axis)] = d
    case = setup(
        params=CascadedParams(derivatives=choice), size=0.0, disturbance=tuple(push))
    # 5 ms: stable for the attitude modes, and the end is an equilibrium whatever the step
    y = flight(start(rho=(0.0, 0.0, -1.5)), 8000, 5e-3, case)
    return y[-1, :3] - [0.0, 0.0, -1.5], y[-1]


@pytest.mark.parametrize(('axis', 'choice'), [
    ('z', 'analytic'), ('x', 'no_rates'), ('y', 'no_rates'), ('z', 'no_rates')])
@pytest.mark.parametrize(('d', 'metres'), [
    (0.25, 0.0005), (0.5, 0.0037), (1.0, 0.0321), (1.5, 0.129), (2.0, 0.435), (-1.0, -0.0321)])
def test_remaining_error_is_that_of_the_saturation(axis, choice, d, metres):
    offset, y = hovering_error(d, axis, choice)
    i = AXES.index(axis)
    assert offset[i] == pytest.approx(metres, abs=6e-4)
    s = d / 2.6  # sigma(rho_bar), hence P_e and rho_bar - sigma(rho_bar)
    assert offset[i] == pytest.approx(s / np.sqrt(1 - s * s) - s, abs=2e-5)
    assert y[13 + i] == pytest.approx(-s, abs=2e-5)


def test_disturbance_beyond_the_position_gain_is_not_rejected():
    offset, _ = hovering_error(2.7, 'z', 'analytic')
    assert offset[2] > 2


@pytest.mark.parametrize(('d', 'metres'), [(0.5, 0.0114), (1.0, 0.1099), (1.5, 0.608)])
def test_sideways_disturbance_costs_more_with_exact_derivatives(d, metres):
    # The derivatives of f_d assume an undisturbed vehicle: they predict a velocity error that
    # grows by d, hence a turning f_d and, at rest, a lag of the attitude behind it.
    offset, _ = hovering_error(d, 'x', 'analytic')
    assert offset[0] == pytest.approx(metres, rel=5e-3)


@pytest.mark.parametrize(('degrees', 'seconds', 'farthest'), [
    (90, 6.7, 2.94), (150, 14.5, 12.06), (170, 19.7, 25.9)])
def test_recovers_from_a_large_roll(degrees, seconds, farthest):
    case, h = setup(), 2e-3
    half = np.radians(degrees) / 2
    y = flight(start(q=(np.cos(half), np.sin(half), 0.0, 0.0)), 15000, h, case)
    t = h * np.arange(15001)
    wanted = np.array([reference(at, case).rho for at in t])
    distance = np.linalg.norm(wanted - y[:, :3], axis=1)
    assert t[np.nonzero(distance >= 0.05)[0][-1] + 1] == pytest.approx(seconds, abs=0.05)
    assert distance.max() == pytest.approx(farthest, abs=0.05)
    thrust = np.array([
        allocate(law.f, law.tau, case.plant)
        for law in (control(at, state, case) for at, state in zip(t, y, strict=True))])
    assert 0.09 < thrust.min() and thrust.max() < 0.30


@pytest.mark.parametrize('seed', range(5))
def test_recovers_from_any_attitude(seed):
    q = np.random.default_rng(seed).normal(size=4)
    case = setup()
    y = flight(start(q=tuple(q / np.linalg.norm(q))), 20000, 2e-3, case)
    assert np.linalg.norm(y[-1, :3] - reference(40.0, case).rho) < 0.01
