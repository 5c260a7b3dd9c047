"""Incremental inversion: the filter, the increment of the papers, and a push that it removes."""

from literature_truth import circle, matrix, moved, on, STILL, VV, ZERO
from mambo_control.literature import geometric
from mambo_control.literature.indi import IndiParams, initial, observe, step
from mambo_control.literature.lowpass import lowpass
from mambo_model.motion.rigid_body import State
import numpy as np
import pytest
from scipy import signal

DT = 0.005
GAINS = IndiParams(rate_filter=50.0, velocity_filter=50.0).values()  # the papers'


def test_the_filter_is_scipys_of_the_same_transfer_function():
    rng = np.random.default_rng(3)
    u = rng.normal(size=(200, 3))
    w, zeta = GAINS.rate_filter, GAINS.damping
    system = signal.cont2discrete(
        signal.tf2ss([w * w], [1.0, 2 * zeta * w, w * w]), DT, 'zoh')
    y, y_dot, out = ZERO, ZERO, []
    for row in u:
        y, y_dot = lowpass(y, y_dot, tuple(row), w, zeta, DT)
        out.append(y)
    for axis in range(3):
        _, expected, _ = signal.dlsim(system, np.append(u[:, axis], 0.0))
        np.testing.assert_allclose(np.array(out)[:, axis], expected[1:, 0], atol=1e-12)


def fly(push, twist, count=400, target=None, gains=GAINS):
    """Return memory, last state and command of a flight about a fixed point or a circle."""
    at = (lambda t: circle(0.0, 1e-9)) if target is None else target
    state, memory = on(at(0.0)), initial(gains)
    for k in range(count):
        memory, command = step(memory, state, at(k * DT), DT, gains, VV)
        state = moved(state, memory.thrust, tuple(np.array(memory.torque) + twist), DT, STILL,
                      lambda s: np.array(push))
    return memory, state, command


def test_a_push_and_a_twist_are_measured_and_leave_no_error():
    push, twist = (0.8, -0.5, 1.5), (2e-4, -3e-4, 1e-4)
    memory, state, _ = fly(push, twist, count=800)
    np.testing.assert_allclose(memory.d, push, atol=1e-3)
    np.testing.assert_allclose(memory.e, np.array(twist) / VV.inertia, atol=1e-2)
    assert np.linalg.norm(np.array(state.rho) - circle(0.0, 1e-9).rho) < 1e-4  # 0.1 m without
    _, state, _ = fly(push, twist, gains=IndiParams(force_limit=0.0).values())
    assert np.linalg.norm(np.array(state.rho) - circle(0.0, 1e-9).rho) > 0.05


def test_what_the_motors_explain_is_no_disturbance():
    memory, state, _ = fly(ZERO, np.zeros(3), count=100, target=lambda t: circle(t, 2.0))
    # the thrust turns within a period: what the mean of two axes leaves
    assert np.abs(memory.d).max() < 2e-3
    assert np.abs(memory.e).max() < 0.02


def test_the_command_is_the_increment_of_the_papers():
    rng = np.random.default_rng(5)
    ref = circle(0.3)
    first, state = on(circle(0.295)), on(ref)
    state = state._replace(omega=tuple(np.array(state.omega) + rng.normal(size=3) * 0.1),
                           nu=tuple(np.array(state.nu) + rng.normal(size=3) * 0.01))
    memory, before = step(initial(GAINS), first, circle(0.295), DT, GAINS, VV)
    _, command = step(memory, state, ref, DT, GAINS, VV)
    # H of measured and of commanded, filtered one by one as in the papers
    R0, R1 = matrix(first.q), matrix(state.q)
    b3 = 0.5 * (R0 + R1)[:, 2]
    a = (R1 @ state.nu - R0 @ first.nu) / DT
    t = -memory.thrust / VV.mass * b3

    def H(u):
        y, _ = lowpass(ZERO, ZERO, tuple(u), GAINS.velocity_filter, GAINS.damping, DT)
        return np.array(y)
    g = np.array([0.0, 0.0, VV.gravity])
    e_x = np.array(state.rho) - ref.rho
    e_v = R1 @ state.nu - np.array(ref.v)
    a_c = np.array(ref.a) - GAINS.k_x * e_x - GAINS.k_v * e_v
    # g passes its filter unchanged: it has always been there
    t_c = H(t) + a_c - (H(a - g) + g)
    expected = -VV.mass * t_c @ R1[:, 2]
    assert command.thrust == pytest.approx(expected, rel=1e-12)
    direction = -t_c / np.linalg.norm(t_c)
    np.testing.assert_allclose(matrix(command.attitude_desired)[:, 2], direction, atol=1e-12)


def test_without_limits_to_learn_within_it_is_the_geometric_law():
    gains = IndiParams(force_limit=0.0, torque_limit=0.0, reach=1000.0).values()
    ref = circle(0.3)
    memory, _ = step(initial(gains), on(circle(0.29)), circle(0.29), DT, gains, VV)
    off = on(ref)._replace(rho=ZERO)
    _, ours = step(memory, off, ref, DT, gains, VV)
    plain = geometric.law(off, ref, geometric.GeometricParams(
        k_R=gains.k_R, k_omega=gains.k_omega).values(), VV)
    assert ours.thrust == pytest.approx(plain.f, rel=1e-12)
    np.testing.assert_allclose(ours.torque, plain.tau, atol=1e-14)


def test_nothing_is_observed_before_the_second_step():
    state = State(ZERO, (5.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    assert observe(initial(GAINS), (5.0, 0.0, 0.0), state, DT, GAINS, VV) == (ZERO,) * 4
