"""Predictive control: the regulator without bounds, SciPy's solution with them, a flight."""

from importlib.util import find_spec
import subprocess
import sys

from literature_truth import circle, moved, on, STILL, VV
from mambo_control.literature import predictive
from mambo_control.literature.predictive import bounds, initial, plan, PredictiveParams, step
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

DT = 0.005
GAINS = PredictiveParams().values()
FREE = PredictiveParams(jerk=1e4, tilt=1.0).values()
needs_osqp = pytest.mark.skipif(
    find_spec('osqp') is None,
    reason='OSQP is not installed: pip install -r requirements/osqp.txt')


def model(gains):
    """Return A, B, Q, r of one axis, written again."""
    h = gains.interval
    A = np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1.0]])
    return A, np.array([[h**3 / 6], [h**2 / 2], [h]]), np.diag([1.0, 0, 0]), gains.bandwidth ** -6


def solver(gains):
    return predictive._solver(predictive.programme(gains.steps, gains.interval, gains.bandwidth))


@needs_osqp
def test_without_bounds_the_first_jerk_is_that_of_the_regulator():
    A, B, Q, r = model(FREE)
    S = solve_discrete_are(A, B, Q, np.array([[r]]))
    K = np.linalg.solve(r + B.T @ S @ B, B.T @ S @ A)
    ref, rng = circle(0.7), np.random.default_rng(1)
    far = np.full(3, 1e6)
    for _ in range(5):
        e = rng.normal(size=(3, 3)) * 0.2
        jerks = plan(solver(FREE), e, ref, -far, far, FREE)
        reference = np.array(ref.j) + np.array(ref.s) * 0.5 * FREE.interval
        # 1e-5 of the jerk is what the solver is asked for
        np.testing.assert_allclose(jerks[:, 0], reference - (e @ K.T)[:, 0], atol=2e-3, rtol=1e-4)


@needs_osqp
def test_with_bounds_the_jerks_are_those_of_scipy():
    A, B, Q, r = model(GAINS)
    S = solve_discrete_are(A, B, Q, np.array([[r]]))
    ref = circle(0.7)
    e = np.array([[2.5, 0.0, 0.0], [-0.1, 0.05, 0.0], [0.5, 1.0, 0.0]])
    low, high = bounds((0.1, -0.2, 0.3), GAINS, VV)
    ours = plan(solver(GAINS), e, ref, low, high, GAINS)
    h, N = GAINS.interval, GAINS.steps
    for axis in range(3):
        j_r = ref.j[axis] + ref.s[axis] * (np.arange(N) + 0.5) * h
        a_r = ref.a[axis] + np.cumsum(j_r) * h

        def accelerations(w, axis=axis, a_r=a_r):
            return a_r + e[axis, 2] + np.cumsum(w) * h

        def cost(w, axis=axis):
            x, total = e[axis], 0.0
            for k in range(N):
                total += x @ Q @ x + r * w[k] ** 2
                x = A @ x + B[:, 0] * w[k]
            return 1e-2 * (total + x @ S @ x)  # of a size that SLSQP can differentiate
        found = minimize(
            cost, np.zeros(N), method='SLSQP', options={'maxiter': 500, 'ftol': 1e-12},
            bounds=list(zip(-GAINS.jerk - j_r, GAINS.jerk - j_r)),
            constraints=[{'type': 'ineq', 'fun': lambda w, i=axis: accelerations(w) - low[i]},
                         {'type': 'ineq', 'fun': lambda w, i=axis: high[i] - accelerations(w)}])
        assert found.success
        w = ours[axis] - j_r  # late jerks hardly matter: the cost decides, and the first one
        assert cost(w) <= found.fun * (1.0 + 1e-5)
        assert w[0] == pytest.approx(found.x[0], abs=0.05)
        assert accelerations(w).min() > low[axis] - 1e-3
        assert accelerations(w).max() < high[axis] + 1e-3
        if axis == 0:  # 2.5 m: both bounds act
            assert ours[0, 0] == pytest.approx(-GAINS.jerk, abs=0.05)
            assert accelerations(w).min() == pytest.approx(low[0], abs=1e-3)


@pytest.mark.long
@needs_osqp
def test_a_circle_with_a_push_is_followed():
    ref, memory = circle, initial(GAINS)
    state, push = on(ref(0.0)), np.array([0.5, -0.3, 0.4])
    for k in range(500):
        memory, command = step(memory, state, ref(k * DT), DT, GAINS, VV)
        state = moved(state, memory.observer.thrust, memory.observer.torque, DT, STILL,
                      lambda s: push)
    assert command.reason == 0
    np.testing.assert_allclose(memory.observer.d, push, atol=5e-3)
    assert np.linalg.norm(np.array(state.rho) - ref(500 * DT).rho) < 5e-3


@needs_osqp
def test_the_same_flight_twice_is_the_same_to_the_bit():
    def fly():
        memory, state, out = initial(GAINS), on(circle(0.0)), []
        state = state._replace(rho=(state.rho[0] + 0.7, *state.rho[1:]))
        for k in range(20):
            memory, command = step(memory, state, circle(k * DT), DT, GAINS, VV)
            out.append(command.pwm)
        return out
    assert fly() == fly()


def test_bounds_are_those_of_thrust_and_tilt():
    low, high = bounds((0.0, 0.0, 0.0), GAINS, VV)
    n = VV.gravity - np.array([low[2], high[2]])  # thrust over mass, up
    most = 4 * VV.power_a * VV.pwm_max ** VV.power_b / VV.mass
    assert np.hypot(np.hypot(high[0], high[1]), n[0]) == pytest.approx(0.9 * most)
    assert np.arctan2(high[0], VV.gravity) == pytest.approx(GAINS.tilt)
    assert n[1] == pytest.approx(0.2 * VV.gravity)


@pytest.mark.long
def test_without_the_solver_one_line_says_what_to_install():
    code = ('import sys; sys.modules["osqp"] = None\n'
            'from mambo_model.errors import InputError\n'
            'from mambo_control.literature import predictive as p\n'
            'try: p._solver(p.programme(10, 0.05, 5.0))\n'
            'except InputError as error: print(error)')
    output = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert output.stdout.count('\n') == 1
    assert 'pip install -r requirements/osqp.txt' in output.stdout
