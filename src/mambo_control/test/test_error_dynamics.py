"""
The error dynamics (3.30), written out and integrated alone, against vehicle plus controller.

Nothing here uses the controller's code: quaternions, saturation, virtual input and desired
attitude are written again, in the frame of the reference, as the thesis has them.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from thesis_flight import control, precise_flight, reference, setup, start

K_P, K_p, k_p, K_nu = 0.4, 1.0, 2.6, 2.0
K = (0.9, 1.0, 1.1)
E3 = np.array([0.0, 0.0, 1.0])


def product(p, q):
    return np.array([p[0] * q[0] - p[1:] @ q[1:],
                     *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def star(q):
    return np.array([q[0], *-q[1:]])


def turn(q, v):
    return product(product(q, np.array([0.0, *v])), star(q))[1:]


def sigma(x):
    return x / np.sqrt(1 + x @ x)


def error_rate(t, x, case):
    """Return (3.30a-f) for x = P_e, p_e, rho_bar, nu_bar, q_e, omega_e."""
    P, p, rho, nu, q_e, w_e = np.split(x, [3, 6, 9, 12, 16])
    ref = reference(t, case)
    q_r, w_r, m = np.array(ref.q), np.array(ref.omega), case.plant.mass
    pull = turn(q_r, sigma(rho))
    p_rate = -K_P * P - K_p * p + K_P * pull
    u = (turn(star(q_r), K_P * P + K_p * p - K_P * pull) - k_p * sigma(rho) - K_nu * sigma(nu))
    wanted = ref.f * E3 + m * u
    f = np.linalg.norm(wanted)
    f_d = wanted / f
    q_d0 = np.array([1 + f_d[2], -f_d[1], f_d[0], 0.0])
    q_rq = product(q_d0 / np.linalg.norm(q_d0), q_e)
    rho_rate = -np.cross(w_r, rho) + nu
    nu_rate = (-np.cross(w_r, nu) - k_p * sigma(rho) - K_nu * sigma(nu)
               + f / m * turn(q_rq, E3) - f / m * turn(product(q_rq, star(q_e)), E3))
    q_rate = 0.5 * product(q_e, np.array([0.0, *w_e]))
    pullback = sum(K[i] * np.cross(np.eye(3)[i], turn(star(q_e), np.eye(3)[i]))
                   for i in range(3))
    return np.concatenate([p, p_rate, rho_rate, nu_rate, q_rate, -30 * w_e + 70 * pullback])


def errors(t, y, case):
    """Return the vector x above of a state of the full simulation."""
    ref, out = reference(t, case), control(t, y, case)
    back = star(np.array(ref.q))
    P, p = y[13:16], y[16:19]
    return np.concatenate([
        P, p, out.rho_e + turn(back, P), out.nu_e + turn(back, p), out.q_e, out.omega_e])


@pytest.mark.long
@pytest.mark.parametrize('yaw', [0.0, 1.0])
def test_error_dynamics_alone_match_vehicle_and_controller(yaw):
    case, times = setup(yaw_amplitude=yaw), np.linspace(0.0, 8.0, 81)
    full = precise_flight(start(), times, case)
    first = errors(0.0, full[0], case)
    alone = solve_ivp(
        lambda t, x: error_rate(t, x, case), (0.0, 8.0), first, 'DOP853', times, rtol=1e-12,
        atol=1e-13).y.T
    want = np.array([errors(t, y, case) for t, y in zip(times, full, strict=True)])
    # two integrations of 1e-12 each; 1e-8 asked for, 4e-11 reached by the audit
    np.testing.assert_allclose(alone, want, atol=1e-9)
    assert np.abs(want[0]).max() > 1.3  # the errors are there to begin with
