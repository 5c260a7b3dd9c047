"""What the tests of the controllers from the literature share: states, references, matrices."""

from mambo_model.motion.flatness import from_flat_output
from mambo_model.motion.quaternion import to_matrix
from mambo_model.motion.rigid_body import derivative, State
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
from scipy.integrate import solve_ivp

VV = Vehicle().values()
STILL = Vehicle(drag_reading='none').values()
ZERO = (0.0, 0.0, 0.0)


def matrix(q):
    """Return the (3, 3) rotation matrix of a quaternion."""
    return np.array(to_matrix(tuple(q)))


def circle(t, rate=2.0, vv=VV):
    """Return the reference on a tilted circle of 1 m."""
    def jet(order):
        c = [np.cos(rate * t), -np.sin(rate * t), -np.cos(rate * t), np.sin(rate * t)][order % 4]
        s = [np.sin(rate * t), np.cos(rate * t), -np.sin(rate * t), -np.cos(rate * t)][order % 4]
        return tuple(float(x) for x in rate ** order * np.array([c, s, -0.3 * s]))
    x, y, z = jet(0)
    return from_flat_output(
        (x, y, z - 1.5), *(jet(order) for order in range(1, 5)), vv.mass, vv.inertia, vv.gravity)


def random_states(count, ref, seed=1):
    """Yield states of errors up to 1 m, 1 m/s, 60 deg, 3 rad/s about a reference."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        axis, angle = rng.normal(size=3), rng.uniform(0.0, np.pi / 3)
        axis *= np.sin(angle / 2) / np.linalg.norm(axis)
        yield State(
            tuple(np.array(ref.rho) + rng.uniform(-1, 1, 3)), tuple(rng.uniform(-1, 1, 3)),
            (float(np.cos(angle / 2)), *map(float, axis)), tuple(rng.uniform(-3, 3, 3)))


def on(ref):
    """Return the state of a vehicle on its reference."""
    R = matrix(ref.q)
    return State(ref.rho, tuple(R.T @ np.array(ref.v)), ref.q, ref.omega)


def moved(state, f, tau, dt, vv, acceleration=None):
    """Return the state after dt s of held thrust and torque, to 1e-11; adds an acceleration."""
    def rate(t, y):
        s = State(tuple(y[:3]), tuple(y[3:6]), tuple(y[6:10]), tuple(y[10:]))
        push = ZERO
        if acceleration is not None:
            push = tuple(vv.mass * (matrix(s.q).T @ acceleration(s)))
        d = derivative(s, f, tau, push, ZERO, vv)
        return np.concatenate([d.rho, d.nu, d.q, d.omega])
    y = solve_ivp(rate, (0.0, dt), np.concatenate(state), 'DOP853', rtol=1e-11,
                  atol=1e-12).y[:, -1]
    q = y[6:10] / np.linalg.norm(y[6:10])
    return State(*(tuple(map(float, part)) for part in (y[:3], y[3:6], q, y[10:])))
