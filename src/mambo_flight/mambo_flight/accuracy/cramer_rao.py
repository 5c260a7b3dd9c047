r"""
Posterior Cramer-Rao bound of a flight: the best covariance that any estimator can reach.

For Gaussian noise the bound is the covariance of the linearised problem, with every Jacobian taken
at the true state (Tichavsky, Muravchik and Nehorai, Posterior Cramer-Rao bounds for discrete-time
nonlinear filtering, 1998):

    P = F P F^T + Q,    P^-1 += H^T R^-1 H    at each sample

F, H and the error state are those of the joint filter. Q and R are the true noise of the
simulated sensors, and the initial P is that of the filter at take-off. Of the inertial sensors
only white noise and bias walk count: vibration does not accumulate.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_estimation.joint import drag, flow, pressure, slant_range
from mambo_estimation.joint.joint_parameters import JointValues
from mambo_estimation.joint.propagation import spread, turned_rate
from mambo_estimation.joint.state import correct, covariance_with, Nominal, SIZE
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate, to_matrix
from mambo_model.motion.vector import add, scale, Vec3
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SampledFlight(NamedTuple):
    """True motion and the steps with a sample of each sensor; row k at step k."""

    state: Array                    # (n, 13) true rho m, nu m/s, q, omega rad/s
    force: Array                    # (n, 3) m/s^2, body FRD, true specific force
    flow: NDArray[np.bool_]         # (n,)
    sonar: NDArray[np.bool_]        # (n,)
    pressure: NDArray[np.bool_]     # (n,)


class TrueParameters(NamedTuple):
    """True values of the parameters that the filter estimates."""

    scale: float    # -, Q at the reference height
    slope: float    # 1/m
    drag: float     # s/m
    latency: float  # s


@jit
def _nominal(row: Array, t: TrueParameters) -> Nominal:
    """Return the true state of one row, without biases: the Jacobians do not depend on them."""
    q = (row[6], row[7], row[8], row[9])
    return Nominal(
        (row[0], row[1], row[2]), rotate(q, (row[3], row[4], row[5])), q, (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0), t.scale, t.slope, (t.drag, t.drag), t.latency, 0.0, 0.0, 0.0)


@jit
def _row3(a: Array, k: int, first: int) -> Vec3:
    return (a[k, first], a[k, first + 1], a[k, first + 2])


@jit
def _past(s: SampledFlight, k: int, lag: int, dt: float, t: TrueParameters) -> flow.Past:
    """Return the true state ``lag`` steps before step k, with its error transition."""
    S, V = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(k - lag, k):
        x = _nominal(s.state[i], t)
        R = to_matrix(x.q)
        W = turned_rate(x.v, R)
        for a in range(3):
            for b in range(3):
                S[a, b] += dt * R[a][b]
                V[a, b] += dt * W[a][b]
    there = k - lag
    return flow.Past(
        _nominal(s.state[there], t), _row3(s.state, there, 10), _row3(s.force, there, 0),
        lag * dt, S, V)


@jit
def _update(P: Array, h: Array, variance: float) -> None:
    """Update P in place with a scalar sample of this variance."""
    column, no_change = np.empty(SIZE), np.zeros(SIZE)
    correct(P, column, 0.0, covariance_with(P, h, column) + variance, no_change)


@jit
def covariances(
    s: SampledFlight, start: int, P: Array, dt: float, t: TrueParameters, v: JointValues,
    out: Array,
) -> None:
    """
    Store the bound of each step from ``start`` on in ``out``, (n, SIZE, SIZE).

    Parameters
    ----------
    s
        Flight and its samples.
    start
        Step at which the vehicle starts to move.
    P : (SIZE, SIZE)
        Covariance at that step; overwritten.
    dt : s
        Duration of a step.
    t, v
        True values, and the true noise of the sensors.

    """
    lag, window = round(t.latency / dt), max(1, round(v.drag.window / dt))
    H, h, mean = np.zeros((2, SIZE)), np.zeros(SIZE), drag.EMPTY
    has_pressure = P[pressure.PRESSURE_OFFSET, pressure.PRESSURE_OFFSET] > 0.0
    out[:start + 1] = P
    x = _nominal(s.state[start], t)
    for k in range(start + 1, len(s.state)):
        before, x = x, _nominal(s.state[k], t)
        spread(P, scale(0.5, add(before.v, x.v)), to_matrix(before.q), dt, v.motion.gyro_noise,
               v.motion.accel_noise, v)
        flying = -x.p[2] > v.drag.min_height
        mean = drag.accumulate(mean, before, x, _row3(s.force, k, 0), dt) if flying else drag.EMPTY
        if mean.time > (window - 0.5) * dt:
            drag.jacobian(mean, x, H)
            noise = v.motion.accel_noise * v.motion.accel_noise / mean.time
            _update(P, H[0], noise)
            _update(P, H[1], noise)
            mean = drag.EMPTY
        if s.sonar[k]:
            slant_range.jacobian(x, h)
            _update(P, h, v.sonar.noise * v.sonar.noise)
        if s.pressure[k] and has_pressure:
            pressure.jacobian(h)
            _update(P, h, v.barometer.noise * v.barometer.noise)
        if s.flow[k] and k - lag > start:
            past = _past(s, k, lag, dt, t)
            flow.jacobian(past, x.v, v.gravity, v.optical_flow, H)
            _update(P, H[0], v.optical_flow.noise * v.optical_flow.noise)
            _update(P, H[1], v.optical_flow.noise * v.optical_flow.noise)
        out[k] = P
