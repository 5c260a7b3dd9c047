"""Incremental inversion: the filter, the increment of the papers, and a push that it removes."""

from literature_truth import circle, matrix, moved, on, STILL, VV, ZERO
from mambo_control.literature import geometric
from mambo_control.literature.indi import applied, IndiParams, initial, observe, step
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


@pytest.mark.long
def test_a_push_and_a_twist_are_measured_and_leave_no_error():
    push, twist = (0.8, -0.5, 1.5), (2e-4, -3e-4, 1e-4)
    memory, state, _ = fly(push, twist, count=800)
    np.testing.assert_allclose(memory.d, push, atol=1e-3)
    np.testing.assert_allclose(memory.e, np.array(twist) / VV.inertia, atol=1e-2)
    assert np.linalg.norm(np.array(state.rho) - circle(0.0, 1e-9).rho) < 1e-4  # 0.1 m without
    _, state, _ = fly(push, twist, gains=IndiParams(force_limit=0.0).values())
    assert np.linalg.norm(np.array(state.rho) - circle(0.0, 1e-9).rho) > 0.05


def farthest(believed_lag, lag, mass, seconds=6.0):
    """
    Return how far in m a vehicle with lagging motors gets from a point, in the last 2 s.

    Its mass is that many times the believed one. It starts 0.2 m beside the point.
    """
    vv, gains = VV._replace(motor_time_constant=believed_lag), IndiParams().values()
    target, left = circle(0.0, 1e-9), np.exp(-DT / lag)
    memory, state = initial(gains), on(target)
    state = state._replace(rho=tuple(np.add(state.rho, (0.2, 0.0, 0.0))))
    now, off = np.array([VV.mass * VV.gravity, 0.0, 0.0, 0.0]), []
    for _ in range(round(seconds / DT)):
        memory, command = step(memory, state, target, DT, gains, vv)
        thrust, torque = applied(command.pwm, vv)
        goal = np.array([thrust, *torque])
        mean = goal + (1.0 - left) * lag / DT * (now - goal)
        now = goal + left * (now - goal)
        state = moved(state, mean[0] / mass, mean[1:], DT, STILL, lambda s: np.zeros(3))
        off.append(np.linalg.norm(np.subtract(state.rho, target.rho)))
    return np.max(off[-round(2.0 / DT):])


@pytest.mark.long
@pytest.mark.parametrize(('lag', 'mass'), [(0.035, 0.8), (0.04, 0.8), (0.05, 0.8), (0.05, 1.2)])
def test_a_lag_that_is_believed_is_borne_with_a_wrong_mass(lag, mass):
    assert farthest(lag, lag, mass) < 0.002


@pytest.mark.long
def test_a_lag_that_nobody_tells_is_borne_to_30_ms():
    assert farthest(0.0, 0.03, 0.8) < 0.002
    assert not farthest(0.0, 0.04, 0.8) < 0.5  # what believing in it is good for


def test_what_lagging_motors_explain_is_their_mean_over_the_period():
    lag = 0.04
    vv, ref = VV._replace(motor_time_constant=lag), circle(0.3)
    first, second = on(circle(0.295)), on(ref)
    memory, one = step(initial(GAINS), first, circle(0.295), DT, GAINS, vv)
    assert memory.thrust == memory.thrust_now == applied(one.pwm, vv)[0]  # no lag at first
    second = second._replace(rho=tuple(np.add(second.rho, (0.0, 0.1, 0.3))))
    after, other = step(memory, second, ref, DT, GAINS, vv)
    thrust, torque = applied(other.pwm, vv)
    t = (np.arange(1000) + 0.5) * DT / 1000
    for began, goal, mean, end in (
            (memory.thrust_now, thrust, after.thrust, after.thrust_now),
            (np.array(memory.torque_now), np.array(torque), after.torque, after.torque_now)):
        path = goal + np.multiply.outer(np.exp(-t / lag), began - goal)
        np.testing.assert_allclose(mean, path.mean(axis=0), rtol=1e-6)
        np.testing.assert_allclose(end, goal + np.exp(-DT / lag) * (began - goal), rtol=1e-12)


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
