"""Dynamics (3.3) by invariants that each sign breaks, by energy, and the order of integration."""

import math

from mambo_model.aerodynamics import lumped_drag
from mambo_model.motion import rigid_body
from mambo_model.motion.quaternion import norm as quaternion_norm
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.parameters import preset
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

DRAG, FREE = preset('identified').values(), preset('frictionless').values()
NONE = (0.0, 0.0, 0.0)
TUMBLING = State(
    (0.2, -0.3, -1.5), (1.0, -2.0, 0.5),
    tuple(np.roll(Rotation.from_rotvec([0.4, -0.7, 1.1]).as_quat(), 1).tolist()), (3.0, -4.0, 5.0))


def matrix(state):
    return Rotation.from_quat(np.roll(state.q, -1)).as_matrix()


def flat(state):
    return np.concatenate(state)


def unflat(y):
    y = np.asarray(y).tolist()
    return State(tuple(y[0:3]), tuple(y[3:6]), tuple(y[6:10]), tuple(y[10:13]))


def integrate(rate, start, duration):
    """Integrate by an independent method to 1e-12."""
    return solve_ivp(
        lambda t, y: rate(t, y), (0.0, duration), start, method='DOP853',
        rtol=1e-12, atol=1e-13).y[:, -1]


def free_rate(t, y):
    return flat(rigid_body.derivative(unflat(y), 0.0, NONE, NONE, NONE, FREE))


def reversed_velocity_term(t, y):
    out, s = free_rate(t, y), unflat(y)
    out[3:6] += 2.0 * np.cross(s.omega, s.nu)
    return out


def reversed_gyroscopic_term(t, y):
    out, s = free_rate(t, y), unflat(y)
    J = np.array(FREE.inertia)
    out[10:13] -= 2.0 * np.cross(J * s.omega, s.omega) / J
    return out


def free_fall_defects(rate, duration=1.0):
    """Return the relative change of inertial velocity, angular momentum and energy."""
    def invariants(y, t):
        s = unflat(y)
        J, R = np.array(FREE.inertia), matrix(s)
        velocity = R @ s.nu - [0.0, 0.0, FREE.gravity * t]
        energy = 0.5 * FREE.mass * np.dot(s.nu, s.nu) + 0.5 * np.dot(s.omega, J * s.omega) \
            - FREE.mass * FREE.gravity * s.rho[2]
        return velocity, R @ (J * s.omega), energy

    start = flat(TUMBLING)
    before, after = invariants(start, 0.0), invariants(integrate(rate, start, duration), duration)
    return [np.linalg.norm(np.subtract(a, b)) / np.linalg.norm(b) for b, a in zip(before, after)]


def test_free_body_falls_with_g_and_keeps_its_angular_momentum():
    # integration to 1e-12 over a second of tumbling
    assert max(free_fall_defects(free_rate)) < 1e-8


@pytest.mark.parametrize(('mutant', 'broken'), [
    (reversed_velocity_term, 0), (reversed_gyroscopic_term, 1)])
def test_these_invariants_notice_reversed_signs_that_energy_does_not(mutant, broken):
    defects = free_fall_defects(mutant)
    assert defects[broken] > 0.1
    if mutant is reversed_gyroscopic_term:
        assert defects[2] < 1e-8


def test_acceleration_of_a_free_tumbling_body_is_g_at_once():
    rate = rigid_body.derivative(TUMBLING, 0.0, NONE, NONE, NONE, FREE)
    R = matrix(TUMBLING)
    inertial = R @ np.cross(TUMBLING.omega, TUMBLING.nu) + R @ rate.nu
    np.testing.assert_allclose(inertial, [0.0, 0.0, FREE.gravity], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(rate.rho, R @ TUMBLING.nu, rtol=0.0, atol=1e-15)


def test_forces_and_torques_enter_with_their_signs():
    rest = State(NONE, NONE, (1.0, 0.0, 0.0, 0.0), NONE)
    hover = rigid_body.derivative(rest, FREE.mass * FREE.gravity, NONE, NONE, NONE, FREE)
    np.testing.assert_allclose(flat(hover), 0.0, atol=2e-15)
    pushed = rigid_body.derivative(
        rest, 1.0, (1e-3, 2e-3, 3e-3), (0.1, 0.2, 0.3), (1e-4, 0.0, 0.0), FREE)
    m, J = FREE.mass, FREE.inertia
    np.testing.assert_allclose(
        pushed.nu, [0.1 / m, 0.2 / m, FREE.gravity - 0.7 / m], rtol=1e-14)
    np.testing.assert_allclose(
        pushed.omega, [1.1e-3 / J[0], 2e-3 / J[1], 3e-3 / J[2]], rtol=1e-14)


def test_energy_changes_by_the_work_of_thrust_torque_and_drag():
    f, tau = 0.75, (1e-4, -2e-4, 1.5e-4)
    m, J = DRAG.mass, np.array(DRAG.inertia)

    def rate(t, y):
        s = unflat(y[:13])
        F_D = lumped_drag(s.nu, f, DRAG)
        power = -f * s.nu[2] + np.dot(tau, s.omega) + np.dot(F_D, s.nu)
        return np.append(flat(rigid_body.derivative(s, f, tau, F_D, NONE, DRAG)), power)

    def energy(y):
        s = unflat(y[:13])
        return 0.5 * m * np.dot(s.nu, s.nu) + 0.5 * np.dot(s.omega, J * s.omega) \
            - m * DRAG.gravity * s.rho[2]

    start = np.append(flat(TUMBLING), 0.0)
    end = integrate(rate, start, 2.0)
    assert abs(energy(end) - energy(start)) > 0.1  # J: there is something to account for
    assert energy(end) - energy(start) == pytest.approx(end[13], abs=1e-8)


def steps(count, duration, f, tau):
    state = TUMBLING
    for _ in range(count):
        state = rigid_body.rk4_step(state, f, tau, duration / count, DRAG)
    return state


def test_integration_converges_with_the_fourth_order_to_the_true_solution():
    f, tau, duration = 0.9, (2e-5, -3e-5, 4e-5), 0.5

    def rate(t, y):
        s = unflat(y)
        return flat(rigid_body.derivative(s, f, tau, lumped_drag(s.nu, f, DRAG), NONE, DRAG))

    true = integrate(rate, flat(TUMBLING), duration)
    errors = [np.linalg.norm(flat(steps(n, duration, f, tau)) - true) for n in (25, 50, 100, 200)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (np.abs(orders - 4.0) < 0.2).all(), orders  # asymptotic: 4 + O(h)
    assert errors[-1] < 1e-7


def test_a_step_keeps_the_quaternion_unit_and_the_thrust_held():
    state = steps(2000, 10.0, 0.7, NONE)
    assert quaternion_norm(state.q) == pytest.approx(1.0, abs=3e-16)
    assert all(map(math.isfinite, flat(state)))


def test_drag_alone_slows_a_level_flight_exponentially():
    start = State(NONE, (2.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), NONE)
    state, f = start, DRAG.mass * DRAG.gravity
    for _ in range(1000):
        state = rigid_body.rk4_step(state, f, NONE, 1e-3, DRAG)
    # exp(-g k_c / 4 t) at 1 s; Runge-Kutta error (h rate)^4
    assert state.nu[0] == pytest.approx(2.0 * math.exp(-9.81 * 0.22 / 4.0), abs=1e-12)
    assert state.rho[2] == pytest.approx(0.0, abs=1e-12)


def test_scaled_addition_is_element_by_element():
    got = rigid_body.add_scaled(TUMBLING, unflat(np.arange(1.0, 14.0)), 0.5)
    np.testing.assert_array_equal(flat(got), flat(TUMBLING) + 0.5 * np.arange(1.0, 14.0))
