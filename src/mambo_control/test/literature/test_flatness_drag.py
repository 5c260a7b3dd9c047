"""Flatness under drag: the paper's linear equations, the dynamics (3.1), a flight on it."""

from literature_truth import circle, matrix, moved, on, ZERO
from mambo_control.literature.flatness_drag import (
    advance, FlatnessDragParams, initial, reference_with_drag, step)
from mambo_control.literature.flight import hover_drag
from mambo_model.motion.flatness import from_flat_output
from mambo_model.motion.quaternion import IDENTITY
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

GAINS = FlatnessDragParams().values()
VV = Vehicle(vertical_drag_coefficient=0.1).values()
D, D_Z = hover_drag(VV)


def drag(state):
    """Return the paper's drag, -R D R^T v, with D constant."""
    R = matrix(state.q)
    return -R @ np.diag([D, D, D_Z]) @ state.nu


def test_the_coefficients_are_those_of_hover():
    # g k_c/4 and g k_z/4
    assert (D, D_Z) == (pytest.approx(9.81 * 0.055), pytest.approx(9.81 * 0.025))
    assert hover_drag(Vehicle(drag_reading='none').values()) == (0.0, 0.0)


def paper(ref, omega_z):
    """
    Return c and the rates by the paper's route, in its frame (z up, thrust along z_B).

    z_B from x_B . alpha = y_B . beta = 0; omega_x, omega_y from the derivative of the force
    equation m j = ..., without a derivative of a direction.
    """
    flip = np.diag([1.0, -1.0, -1.0])
    v, a, j = (flip @ np.array(x) for x in (ref.v, ref.a, ref.j))
    alpha = a + np.array([0.0, 0.0, VV.gravity]) + D * v
    z = alpha / np.linalg.norm(alpha)
    heading = flip @ matrix(ref.q)[:, 0]
    y = np.cross(z, heading) / np.linalg.norm(np.cross(z, heading))
    x = np.cross(y, z)
    c = z @ (a + np.array([0.0, 0.0, VV.gravity]) + D_Z * v)
    B1 = c - (D_Z - D) * (z @ v)
    omega_y = (x @ j + D * x @ a) / B1 + omega_z * (D - D) * (y @ v) / B1
    omega_x = -(y @ j + D * y @ a) / B1
    return c, np.stack([x, y, z], axis=1), omega_x, omega_y


@pytest.mark.parametrize('t', [0.0, 0.7, 2.1])
def test_thrust_attitude_and_rates_are_those_of_the_paper(t):
    ref = circle(t)
    c, q, omega, _, _ = reference_with_drag(ref, VV)
    flip = np.diag([1.0, -1.0, -1.0])
    expected, R, omega_x, omega_y = paper(ref, -omega[2])
    assert c == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(flip @ matrix(q) @ flip, R, atol=1e-12)
    assert omega[0] == pytest.approx(omega_x, abs=1e-12)
    assert -omega[1] == pytest.approx(omega_y, abs=1e-12)


def test_the_inputs_of_the_reference_fly_it_open_loop():
    h, count = 1e-3, 300
    ref = circle(0.0)
    _, q, omega, _, _ = reference_with_drag(ref, VV)
    state = State(ref.rho, tuple(matrix(q).T @ np.array(ref.v)), q, omega)
    for k in range(count):
        c, _, w, w_dot, _ = reference_with_drag(circle((k + 0.5) * h), VV)
        J = np.array(VV.inertia)
        tau = J * w_dot + np.cross(w, J * np.array(w))
        state = moved(state, VV.mass * c, tuple(tau), h, VV, drag)
    # 0.3 s of open loop: inputs held over a millisecond at their middle err by h^2
    np.testing.assert_allclose(state.rho, circle(count * h).rho, atol=1e-6)
    _, q, omega, _, _ = reference_with_drag(circle(count * h), VV)
    np.testing.assert_allclose(matrix(state.q), matrix(q), atol=1e-5)
    np.testing.assert_allclose(state.omega, omega, atol=1e-4)


def test_a_step_on_the_reference_asks_for_its_own_inputs():
    ref = circle(0.4)
    c, q, omega, omega_dot, _ = reference_with_drag(ref, VV)
    state = on(ref)._replace(
        q=q, nu=tuple(matrix(q).T @ np.array(ref.v)), omega=omega)
    _, command = step(initial(GAINS), state, ref, 0.005, GAINS, VV)
    J, w = np.array(VV.inertia), np.array(omega)
    assert command.thrust == pytest.approx(VV.mass * c, rel=1e-12)
    np.testing.assert_allclose(command.torque, J * omega_dot + np.cross(w, J * w), atol=1e-14)
    assert command.angular_velocity_error == pytest.approx(ZERO, abs=1e-12)


def test_an_error_is_turned_back():
    ref = circle(0.4)
    state = on(ref)
    ahead = state._replace(rho=(ref.rho[0], ref.rho[1], ref.rho[2] + 0.1))  # 0.1 m too low
    _, low = step(initial(GAINS), ahead, ref, 0.005, GAINS, VV)
    _, right = step(initial(GAINS), state, ref, 0.005, GAINS, VV)
    b33 = matrix(ref.q)[2, 2]
    assert low.thrust - right.thrust == pytest.approx(VV.mass * GAINS.k_x * 0.1 * b33, rel=1e-9)
    far = state._replace(rho=(ref.rho[0], ref.rho[1], ref.rho[2] + 3.0))
    _, cut = step(initial(GAINS), far, ref, 0.005, GAINS, VV)
    assert cut.thrust - right.thrust == pytest.approx(
        VV.mass * GAINS.k_x * GAINS.reach * b33, rel=1e-9)


def hovering(gains, seconds=10.0):
    """Return the height errors, m, of a hover with 20 % more mass than believed, 5 ms apart."""
    h, heavy = 0.005, Vehicle(mass=1.2 * VV.mass).values()
    at = (0.0, 0.0, -1.0)
    ref = from_flat_output(at, ZERO, ZERO, ZERO, ZERO, VV.mass, VV.inertia, VV.gravity)
    state, memory, errors = State(at, ZERO, IDENTITY, ZERO), initial(gains), []
    for _ in range(round(seconds / h)):
        memory, command = step(memory, state, ref, h, gains, VV)
        state = moved(state, command.thrust, command.torque, h, heavy, drag)
        errors.append(state.rho[2] - at[2])
    return np.array(errors)


@pytest.mark.long
def test_a_wrong_mass_leaves_an_error_without_integral_action_and_none_with_it():
    plain, integral = hovering(GAINS), hovering(FlatnessDragParams(k_i=20.0).values())
    # k_x e = 0.2 g, by the true mass over the believed one
    assert plain[-1] == pytest.approx(0.2 * VV.gravity / GAINS.k_x, rel=1e-3)
    assert abs(integral[-200:]).max() < 1e-5  # the slowest pair of poles decays by exp(-1.3 t)
    assert integral.max() < plain[-1]


def test_the_integral_rests_beyond_reach_and_is_limited():
    gains = FlatnessDragParams(k_i=20.0).values()
    before = (0.3, -0.2, 0.1)
    near = advance(before, (0.1, 0.0, -0.2), 0.005, gains)
    np.testing.assert_allclose(near, (0.31, -0.2, 0.08), atol=1e-15)
    assert advance(before, (gains.reach, 0.0, 0.001), 0.005, gains) == before
    full = advance((0.0, 0.0, gains.integral_limit), (0.1, 0.0, 0.3), 0.005, gains)
    assert np.linalg.norm(full) == pytest.approx(gains.integral_limit, rel=1e-12)
    assert advance(ZERO, (0.1, 0.2, 0.3), 0.005, GAINS) == ZERO  # the paper has none
