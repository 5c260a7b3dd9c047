"""Lee's controller against its equations in matrices, RotorPy's, and central differences."""

from literature_truth import circle, matrix, moved, on, random_states, STILL, VV, ZERO
from mambo_control.literature.geometric import GeometricParams, initial, law, Memory, step
from mambo_model.motion.quaternion import rotate
import numpy as np
import pytest

GAINS = GeometricParams().values()
WITHOUT = GeometricParams(rates=False).values()
E3 = np.array([0.0, 0.0, 1.0])
FLIP = np.diag([1.0, -1.0, -1.0])  # FRD to FLU, NED to north-west-up


def vee(S):
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


def lee(state, ref, gains, vv, b1d, omega_d, omega_d_dot):
    """Return f, M and R_d as the paper has them, in matrices, its rates given."""
    R, J, m, W = matrix(state.q), np.diag(vv.inertia), vv.mass, np.array(state.omega)
    e_x = np.array(state.rho) - ref.rho
    e_v = R @ state.nu - np.array(ref.v)
    A = -m * gains.k_x * e_x - m * gains.k_v * e_v - m * vv.gravity * E3 + m * np.array(ref.a)
    b3 = -A / np.linalg.norm(A)
    b2 = np.cross(b3, b1d) / np.linalg.norm(np.cross(b3, b1d))
    R_d = np.stack([np.cross(b2, b3), b2, b3], axis=1)
    e_R = 0.5 * vee(R_d.T @ R - R.T @ R_d)
    e_W = W - R.T @ R_d @ omega_d
    M = (-gains.k_R * J @ e_R - gains.k_omega * J @ e_W + np.cross(W, J @ W)
         - J @ (np.cross(W, R.T @ R_d @ omega_d) - R.T @ R_d @ omega_d_dot))
    return -A @ R @ E3, M, R_d


def rates_by_differences(state, t, h=1e-3):
    """Return rate and acceleration of R_d along a flight with the thrust of the law."""
    def attitude(at):
        s, part = state, at / 5
        for k in range(5 if at else 0):  # the thrust of the law, that in the middle of each part
            begin, middle = t + k * part, t + (k + 0.5) * part
            out = law(s, circle(begin), GAINS, STILL)
            half = moved(s, out.f, out.tau, 0.5 * part, STILL)
            out = law(half, circle(middle), GAINS, STILL)
            s = moved(s, out.f, out.tau, part, STILL)
        return matrix(law(s, circle(t + at), GAINS, STILL).q_d)
    R0, R1, Rb = attitude(0.0), attitude(h), attitude(-h)
    first = vee(R0.T @ (R1 - Rb)) / (2.0 * h)
    turning = R0.T @ (R1 - 2.0 * R0 + Rb) / h**2  # S(omega') + S(omega)^2
    return first, vee(0.5 * (turning - turning.T))


@pytest.mark.parametrize('gains', [GAINS, WITHOUT])
def test_the_law_is_that_of_the_paper_in_matrices(gains):
    ref = circle(0.7)
    b1d = np.array(rotate(ref.q, (1.0, 0.0, 0.0)))
    for state in random_states(50, ref):
        out = law(state, ref, gains, VV)
        f, M, R_d = lee(state, ref, gains, VV, b1d, np.array(out.omega_d), out.omega_d_dot)
        assert out.f == pytest.approx(f, abs=1e-12)
        np.testing.assert_allclose(matrix(out.q_d), R_d, atol=1e-12)
        np.testing.assert_allclose(out.tau, M, atol=1e-14)
        assert gains.rates or (out.omega_d, out.omega_d_dot) == (ZERO, ZERO)


def test_rates_of_the_desired_attitude_match_differences_along_the_flight():
    t = 0.7
    for state in random_states(5, circle(t), seed=4):
        out = law(state, circle(t), GAINS, STILL)
        first, second = rates_by_differences(state, t)
        # differences over 1 ms: h^2/6 and h^2/12 times derivatives of order 1e3 and 1e5
        np.testing.assert_allclose(out.omega_d, first, atol=5e-4)
        np.testing.assert_allclose(out.omega_d_dot, second, atol=0.02)


def test_on_the_reference_the_law_asks_for_what_the_reference_takes():
    for t in (0.0, 0.4, 1.9):
        ref = circle(t)
        out = law(on(ref), ref, GAINS, VV)
        assert out.f == pytest.approx(ref.f, abs=1e-12)
        np.testing.assert_allclose(out.tau, ref.tau, atol=1e-12)  # angular acceleration included


def test_thrust_and_torque_equal_those_of_rotorpy():
    control = pytest.importorskip(
        'rotorpy.controllers.quadrotor_control',
        reason='RotorPy is not installed: pip install -r benchmarks/peers.txt')
    zero = dict.fromkeys(
        ('Ixy', 'Ixz', 'Iyz', 'c_Dx', 'c_Dy', 'c_Dz', 'k_d', 'k_z', 'k_flap'), 0.0)
    l, (Ixx, Iyy, Izz) = VV.arm, VV.inertia
    peer = control.SE3Control({
        **zero, 'mass': VV.mass, 'Ixx': Ixx, 'Iyy': Iyy, 'Izz': Izz, 'num_rotors': 4,
        'rotor_pos': {f'r{i}': np.array([x, y, 0.0]) for i, (x, y) in enumerate(
            [(l, l), (l, -l), (-l, -l), (-l, l)])},
        'rotor_directions': np.array([1, -1, 1, -1]), 'rotor_speed_min': 0.0,
        'rotor_speed_max': 1e5, 'k_eta': 1.0, 'k_m': 1.0, 'tau_m': 0.0,
        'kp_att': WITHOUT.k_R, 'kd_att': WITHOUT.k_omega})
    peer.kp_pos, peer.kd_pos = np.full(3, WITHOUT.k_x), np.full(3, WITHOUT.k_v)
    ref = circle(0.7)
    level = ref._replace(q=(1.0, 0.0, 0.0, 0.0), omega=ZERO, omega_dot=ZERO)  # heading north
    worst = 0.0
    for state in random_states(50, ref, seed=2):
        ours = law(state, level, WITHOUT, VV)
        q = np.array([state.q[1], -state.q[2], -state.q[3], state.q[0]])
        theirs = peer.update(0.0, {
            'x': FLIP @ state.rho, 'v': FLIP @ matrix(state.q) @ state.nu, 'q': q,
            'w': FLIP @ state.omega}, {
            'x': FLIP @ ref.rho, 'x_dot': FLIP @ ref.v, 'x_ddot': FLIP @ ref.a,
            'yaw': 0.0, 'yaw_dot': 0.0})
        worst = max(worst, abs(theirs['cmd_thrust'] - ours.f) / ours.f)
        difference = FLIP @ theirs['cmd_moment'] - ours.tau
        worst = max(worst, np.abs(difference).max() / np.abs(ours.tau).max())
    assert worst < 1e-5, worst  # 1e-12 in fact: only rounding differs


def test_a_step_remembers_nothing_and_asks_for_the_law():
    ref = circle(0.0)
    state = next(iter(random_states(1, ref)))
    memory, command = step(initial(GAINS), state, ref, 0.005, GAINS, VV)
    out = law(state, ref, GAINS, VV)
    assert memory == Memory(0)
    assert (command.thrust, command.torque) == (out.f, out.tau)
    assert command.attitude_desired == out.q_d
