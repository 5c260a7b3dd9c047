r"""
Model predictive control of the position, with the jerk as input.

M. W. Mueller, R. D'Andrea, "A model predictive controller for quadrocopter state interception",
European Control Conference, 2013, for triple integrators with bounds on acceleration and jerk that
stand for those of thrust and body rate; U. Maeder, F. Borrelli, M. Morari, "Linear offset-free
model predictive control", Automatica 45 (2009), for the disturbance that is held over the horizon.
The quadratic programme is solved by OSQP (B. Stellato and others, Mathematical Programming
Computation 12 (2020)), an optional package: ``pip install -r requirements/osqp.txt``.

On each inertial axis the state is position, velocity and acceleration, the input the jerk, held
for h. With e and w the state and the jerk minus those of the reference,

.. math::
    \min_w \sum_{k=0}^{N-1} (e_{k,1}^2 + r w_k^2) + e_N^T S e_N, \quad
    e_{k+1} = A e_k + B w_k, \quad r = \omega^{-6} \\
    |j_k| \le j_{max}, \quad a_{min} \le a_k \le a_{max}

with S the solution of the algebraic Riccati equation, so that without active bounds the law is the
linear-quadratic regulator of bandwidth :math:`\omega`. Beyond the present the reference is its
own polynomial of fourth order. The acceleration that is commanded, :math:`n = g e_3 + d - a`, and
its derivative :math:`\dot d - j_0` give attitude, rate and thrust as in :mod:`.geometric`; d is
that of :mod:`.indi`. Plain Python: a step takes a hundred times as long as a compiled one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Any, NamedTuple

from mambo_model.errors import InputError
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import values_type
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.parameters import VehicleValues
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import block_diag, solve_discrete_are

from . import indi
from ..command import Command, no_thrust
from .flight import FlightLimits

__all__ = ['initial', 'Memory', 'plan', 'PredictiveParams', 'PredictiveValues', 'step', 'stopped']

_ZERO = (0.0, 0.0, 0.0)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class PredictiveParams(FlightLimits):
    """Horizon, bandwidth and bounds of the programme, gains of the attitude, and limits."""

    steps: int = quantity(10, '1', 2, 50, 'N: half a second (judgement: beyond, the polynomial of '
                          'the reference is not the reference)')
    interval: float = quantity(0.05, 's', 0.005, 0.5, 'h (judgement)')
    bandwidth: float = quantity(5.0, 'rad/s', 0.1, 50.0, 'omega (judgement)')
    jerk: float = quantity(100.0, 'm/s^3', 1.0, 1e4, 'j_max: 10 rad/s in hover (judgement)')
    tilt: float = quantity(
        math.radians(40.0), 'rad', 0.01, 1.0, 'of the thrust along each axis (judgement)')
    thrust_share: float = quantity(
        0.9, '1', 0.1, 1.0, 'of the full thrust, the rest is for the attitude (judgement)')
    k_R: float = quantity(300.0, '1/s^2', 0.1, 5000.0, 'judgement: as incremental inversion')
    k_omega: float = quantity(30.0, '1/s', 0.1, 300.0, 'judgement: as incremental inversion')
    rate_filter: float = quantity(3.0, 'rad/s', 0.1, 500.0, 'judgement: as incremental inversion')
    velocity_filter: float = quantity(
        30.0, 'rad/s', 0.1, 500.0, 'judgement: as incremental inversion')
    damping: float = quantity(0.7, '1', 0.1, 0.99, 'judgement: as incremental inversion')
    force_limit: float = quantity(
        6.0, 'm/s^2', 0.0, 100.0, 'judgement: as incremental inversion')
    torque_limit: float = quantity(
        50.0, 'rad/s^2', 0.0, 1000.0, 'judgement: as incremental inversion')


PredictiveValues = values_type(PredictiveParams)
Params = PredictiveParams  # as an installed component has it


class Memory(NamedTuple):
    """What is passed from step to step."""

    solver: Any  # of OSQP; None before the first step in flight
    acceleration: Vec3  # (3,) m/s^2, inertial NED, commanded for now
    observer: indi.Memory  # of d


class Programme(NamedTuple):
    """The quadratic programme of one axis in its jerks w, (N,): constant matrices."""

    H: Array  # (N, N), cost w'Hw/2 + (F e_0)'w
    F: Array  # (N, 3)
    G: Array  # (N, N), acceleration after each step from the jerks


@lru_cache(maxsize=8)
def programme(steps: int, interval: float, bandwidth: float) -> Programme:
    """Return the condensed programme of one axis; arguments as in :class:`PredictiveParams`."""
    h, N = interval, steps
    A = np.array([[1.0, h, h * h / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    B = np.array([[h**3 / 6], [h * h / 2], [h]])
    Q, r = np.diag([1.0, 0.0, 0.0]), bandwidth ** -6
    S = solve_discrete_are(A, B, Q, np.array([[r]]))
    powers = [np.linalg.matrix_power(A, k) for k in range(N + 1)]
    free = np.vstack(powers[1:])
    forced = np.zeros((3 * N, N))
    for k in range(N):
        for i in range(k + 1):
            forced[3 * k:3 * k + 3, i:i + 1] = powers[k - i] @ B
    weights = block_diag(*[Q] * (N - 1), S)
    scale = 1.0 / r  # the cost in units of the jerk's
    return Programme(
        2.0 * scale * (forced.T @ weights @ forced + r * np.eye(N)),
        2.0 * scale * forced.T @ weights @ free, forced[2::3])


def _solver(p: Programme) -> Any:
    """
    Return OSQP set up for three axes; bounds and linear cost come at each step.

    Raises
    ------
    InputError
        If OSQP is not installed.

    """
    try:
        import osqp
    except ImportError:
        raise InputError('the controller predictive needs OSQP: '
                         'pip install -r requirements/osqp.txt') from None
    N = len(p.H)
    rows = sparse.vstack([sparse.eye(3 * N), sparse.block_diag([p.G] * 3)], format='csc')
    out = osqp.OSQP()
    out.setup(
        sparse.triu(sparse.block_diag([p.H] * 3), format='csc'), np.zeros(3 * N), rows,
        np.full(6 * N, -np.inf), np.full(6 * N, np.inf), verbose=False, eps_abs=1e-5, eps_rel=1e-6,
        max_iter=500, adaptive_rho_interval=25)  # a count, not a time: the same on any machine
    return out


def initial(gains: PredictiveValues) -> Memory:
    """Return the memory at start, with any gains."""
    return Memory(None, (math.nan, math.nan, math.nan), indi.initial(gains))


def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, memory.observer.d, memory.observer.d_dot)


def bounds(d: Vec3, gains: PredictiveValues, vv: VehicleValues) -> tuple[Array, Array]:
    """
    Return the lowest and highest acceleration, (3,) m/s^2, inertial NED.

    Parameters
    ----------
    d : (3,) m/s^2, inertial NED
        Acceleration that is neither gravity nor thrust.
    gains
        Tilt and share of the thrust.
    vv
        Believed vehicle.

    """
    most = gains.thrust_share * 4.0 * thrust_from_pwm(vv.pwm_max, vv) / vv.mass
    side = vv.gravity * math.tan(gains.tilt)
    up = math.sqrt(max(most * most - 2.0 * side * side, (1.2 * vv.gravity) ** 2))
    free = np.array([d[0], d[1], vv.gravity + d[2]])
    return free - [side, side, up], free + [side, side, -0.2 * vv.gravity]


def plan(
    solver: Any, e: Array, ref: Reference, low: Array, high: Array, gains: PredictiveValues,
) -> Array | None:
    """
    Return the jerks of the horizon, (3, N) m/s^3, inertial NED; None if there are none.

    Parameters
    ----------
    solver
        Of OSQP; it remembers its last solution.
    e : (3, 3) m, m/s, m/s^2
        Rows of x, y, z: position, velocity, acceleration minus those of the reference.
    ref
        Its acceleration, jerk and snap are used.
    low, high : (3,) m/s^2
        From :func:`bounds`.
    gains
        Horizon and bounds.

    """
    p = programme(gains.steps, gains.interval, gains.bandwidth)
    k = np.arange(gains.steps)
    j_r = np.array(ref.j)[:, None] + np.array(ref.s)[:, None] * (k + 0.5) * gains.interval
    a_r = np.array(ref.a)[:, None] + np.cumsum(j_r, axis=1) * gains.interval
    now = np.array(ref.a) + e[:, 2]
    reach = gains.jerk * (k + 1) * gains.interval  # what the largest jerk brings back
    least = np.minimum(low[:, None], now[:, None] + reach)
    most = np.maximum(high[:, None], now[:, None] - reach)
    offset = a_r + e[:, 2:]  # acceleration without w
    solver.update(
        q=(e @ p.F.T).ravel(),
        l=np.concatenate([(-gains.jerk - j_r).ravel(), (least - offset).ravel()]),
        u=np.concatenate([(gains.jerk - j_r).ravel(), (most - offset).ravel()]))
    result = solver.solve(raise_error=False)
    if result.info.status not in ('solved', 'solved inaccurate', 'maximum iterations reached'):
        return None
    jerks = result.x.reshape(3, -1) + j_r
    return jerks if np.isfinite(jerks).all() else None


def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: PredictiveValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate in flight; arguments and result as of :func:`cascaded.step`.

    The last period was as long as ``dt``. In the command ``integral`` and ``integral_rate`` show d
    and its derivative. Where the programme has no solution the jerk is that of the reference.

    Raises
    ------
    InputError
        If OSQP is not installed.

    """
    solver = memory.solver
    if solver is None:
        solver = _solver(programme(gains.steps, gains.interval, gains.bandwidth))
        memory = memory._replace(acceleration=ref.a)
    v = rotate(state.q, state.nu)
    d, d_dot, e, e_dot = indi.observe(memory.observer, v, state, dt, gains, vv)
    a = np.array(memory.acceleration)
    error = np.stack([np.subtract(state.rho, ref.rho), np.subtract(v, ref.v), a - ref.a], axis=1)
    low, high = bounds(d, gains, vv)
    jerks = plan(solver, error, ref, low, high, gains)
    j = np.array(ref.j) if jerks is None else jerks[:, 0]
    jet = (sub((d[0], d[1], vv.gravity + d[2]), memory.acceleration),
           sub(d_dot, tuple(j.tolist())), sub(_ZERO, ref.s))
    observer, command = indi.follow(
        memory.observer, state, ref, v, jet, (d, d_dot, e, e_dot), dt, gains, vv)
    return Memory(solver, tuple((a + dt * j).tolist()), observer), command
