"""Any states of the joint filter, and differences between two, for its tests."""

from mambo_estimation.joint import state
from mambo_estimation.joint.state import Nominal
from mambo_model.motion.quaternion import conjugate, exp_map, from_euler, multiply, rotate
import numpy as np

ROWS = [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15)]


def any_state(seed=0, latency=0.0):
    """Return a state in fast flight, with every number different from zero."""
    rng = np.random.default_rng(seed)
    p = (*rng.uniform(-5, 5, 2), -rng.uniform(1.0, 2.0))
    q = from_euler(*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3, 3))
    return Nominal(
        p, tuple(rng.uniform(-2, 2, 3)), q, tuple(rng.uniform(-0.1, 0.1, 3)),
        tuple(rng.uniform(-0.3, 0.3, 3)), 1.06, 0.08, (0.05, 0.03), latency, 0.2, 0.01, 120.0)


def difference(true, believed):
    """Return the error state of a believed one, (SIZE,), by its definition alone."""
    delta = multiply(true.q, conjugate(believed.q))
    angle = 2.0 * np.array(delta[1:]) * np.sign(delta[0])  # to third order in the angle
    turned = rotate(exp_map(tuple(angle)), believed.v)
    flat = [(a - b) for a, b in zip(flatten(true)[10:], flatten(believed)[10:], strict=True)]
    return np.concatenate([
        np.subtract(true.p, believed.p), np.subtract(true.v, turned), angle, flat])


def flatten(x):
    """Return the 23 numbers of a state and one more, the quaternion having four."""
    return [*x.p, *x.v, *x.q, *x.gyro_bias, *x.accel_bias, x.scale, x.slope, *x.drag, x.latency,
            x.leak, x.range_offset, x.pressure_offset]


def derivative(function, x, size=1e-6):
    """Return d function / d error state by central differences, (m, SIZE)."""
    columns = []
    for i in range(state.SIZE):
        d = np.zeros(state.SIZE)
        d[i] = size
        high, low = function(state.inject(x, d)), function(state.inject(x, -d))
        columns.append((np.asarray(high) - np.asarray(low)) / (2.0 * size))
    return np.array(columns).T


def any_covariance(seed=0):
    """Return a positive definite matrix (SIZE, SIZE)."""
    A = np.random.default_rng(seed).standard_normal((state.SIZE, state.SIZE))
    P = 0.01 * A @ A.T + 1e-4 * np.eye(state.SIZE)
    return 0.5 * (P + P.T)
