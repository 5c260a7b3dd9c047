"""The extended cascade: derivatives, error dynamics, exact integral, what it learns."""

from literature_truth import circle, matrix, moved, on, random_states, STILL, VV, ZERO
from mambo_control.literature.drag_estimate import believed, corrected, refined
from mambo_control.literature.extended import (
    advance, demand, ExtendedParams, initial, step)
from mambo_model.aerodynamics import lumped_drag
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest
from scipy.integrate import solve_ivp

DT = 0.005
PLAIN = ExtendedParams(estimate=False).values()
GAINS = ExtendedParams().values()


def sigma(x):
    return x / np.sqrt(1.0 + x @ x)


def test_the_virtual_input_is_that_of_the_docstring():
    ref = circle(0.4)
    P, p = (0.1, -0.2, 0.05), (0.02, 0.01, -0.03)
    for state in random_states(20, ref):
        out = demand(state, ref, P, p, PLAIN, STILL)
        rho = np.array(ref.rho) - state.rho
        nu = np.array(ref.v) - matrix(state.q) @ state.nu
        p_dot = -1.0 * np.array(p) + 0.4 * sigma(rho)
        U = -p_dot - 2.6 * sigma(rho + P) - 2.0 * sigma(nu + p)
        np.testing.assert_allclose(out.U, U, atol=1e-13)
        np.testing.assert_allclose(out.n, np.array([0, 0, 9.81]) - ref.a + U, atol=1e-13)


def demand_at(time, state, t, parts=10):
    """Return the demand after a flight of time - t from a state, its thrust applied."""
    P, p, part = (0.1, -0.2, 0.05), (0.02, 0.01, -0.03), (time - t) / parts
    for k in range(parts if time != t else 0):
        out = demand(state, circle(t + (k + 0.5) * part, vv=STILL), P, p, PLAIN, STILL)
        f = STILL.mass * float(np.linalg.norm(out.n))
        state = moved(state, f, ZERO, part, STILL)
        P = tuple(np.array(P) + part * np.array(p))
        p = tuple(np.array(p) + part * np.array(out.p_dot))
    return demand(state, circle(time, vv=STILL), P, p, PLAIN, STILL)


def test_derivatives_of_the_thrust_match_differences_along_the_flight():
    t, h = 0.4, 1e-3
    for state in random_states(5, circle(t, vv=STILL), seed=7):
        now, after, before = (demand_at(t + at, state, t) for at in (0.0, h, -h))
        # the flight is in pieces of 0.1 ms, over which the thrust is held
        np.testing.assert_allclose(
            now.n_dot, (np.array(after.n) - before.n) / (2 * h), atol=0.02)
        np.testing.assert_allclose(
            now.n_ddot, (np.array(after.n_dot) - before.n_dot) / (2 * h), atol=0.3)


@pytest.mark.parametrize('size', [0.25, 1.0, 2.0])
def test_a_constant_disturbance_leaves_no_error(size):
    # C17: the thesis's filter leaves 0.5, 32 and 435 mm. The loop (3.30) for an ideal attitude.
    d = size * np.array([0.6, -0.48, 0.64])

    def rate(t, y):
        rho, nu, P, p = y[:3], y[3:6], y[6:9], y[9:]
        state = on(circle(0.0, 1e-9))._replace(
            rho=tuple(np.array(circle(0.0, 1e-9).rho) - rho), nu=tuple(-nu))
        out = demand(state, circle(0.0, 1e-9), tuple(P), tuple(p), PLAIN, STILL)
        return np.concatenate([nu, np.array(out.U) - d, p, out.p_dot])
    end = solve_ivp(rate, (0.0, 120.0), np.zeros(12), rtol=1e-9, atol=1e-11).y[:, -1]
    assert np.linalg.norm(end[:3]) < 1e-6
    # P holds what the disturbance takes: k_p sigma(P) = d, with the sign of reference minus state
    np.testing.assert_allclose(2.6 * sigma(end[6:9]), -d, atol=1e-5)


def test_the_integral_action_follows_its_equation():
    P, p, off = (0.1, -0.2, 0.05), (0.02, 0.01, -0.03), (0.3, -0.4, 0.2)
    drive = 0.4 * sigma(np.array(off))
    exact = solve_ivp(
        lambda t, y: np.concatenate([y[3:], drive - y[3:]]), (0.0, DT), [*P, *p],
        rtol=1e-12, atol=1e-14).y[:, -1]
    # the implicit rule errs by (K_p dt)^2/2 of p and half of it times dt of P
    after = advance(P, p, off, DT, PLAIN)
    np.testing.assert_allclose(after[1], exact[3:], atol=3e-6)
    np.testing.assert_allclose(after[0], exact[:3], atol=1e-8)
    held, still = advance((1.9999, 0.0, 0.0), (0.4, 0.0, 0.0), (9.0, 0.0, 0.0), DT, PLAIN)
    assert (held[0], still) == (pytest.approx(2.0, abs=1e-9), ZERO)


def test_mass_and_drag_are_found_in_flight():
    true = Vehicle(mass=0.08, drag_coefficient=0.30, vertical_drag_coefficient=0.15).values()

    def force(s, f):
        return matrix(s.q) @ lumped_drag(s.nu, f, true) / true.mass
    estimate, rng = believed(VV), np.random.default_rng(1)
    state = on(circle(0.0))
    for k in range(600):
        ref = circle((k + 1) * DT)
        f = true.mass * 9.81 * float(rng.uniform(0.9, 1.1))
        after = moved(state, f, ZERO, DT, true, lambda s, f=f: force(s, f))
        estimate = refined(estimate, state, after, DT, f, 1e-4, 1e-4 * (DT / 3.0) ** 2, VV)
        state = on(ref)
    found = corrected(estimate, VV)
    assert found.mass == pytest.approx(0.08, rel=2e-3)
    assert found.drag_coefficient == pytest.approx(0.30, rel=0.02)
    assert found.vertical_drag_coefficient == pytest.approx(0.15, rel=0.05)


def test_what_is_believed_of_a_reading_becomes_the_same_drag():
    for reading in ('per_rotor_thrust', 'total_thrust', 'force', 'acceleration'):
        vv = Vehicle(drag_reading=reading, vertical_drag_coefficient=0.1).values()
        same = corrected(believed(vv), vv)
        weight = vv.mass * vv.gravity
        np.testing.assert_allclose(
            lumped_drag((1.0, 2.0, 3.0), weight, same), lumped_drag((1.0, 2.0, 3.0), weight, vv),
            rtol=1e-12)


@pytest.mark.long
def test_nothing_is_learnt_near_the_floor_nor_at_the_first_step():
    low = on(circle(0.0))._replace(rho=(0.0, 0.0, -0.2))
    ref = circle(0.0)
    memory, _ = step(initial(GAINS), low, ref, DT, GAINS, VV)
    assert memory.vehicle == believed(VV)
    again, _ = step(memory, low._replace(nu=(9.0, 9.0, 9.0)), ref, DT, GAINS, VV)
    assert again.vehicle == memory.vehicle
    high = low._replace(rho=(0.0, 0.0, -1.0), nu=(9.0, 9.0, 9.0))
    assert step(memory, high, ref, DT, GAINS, VV)[0].vehicle != memory.vehicle
