r"""
Fixed-interval smoother of the joint filter: each state from the samples of the whole flight.

It runs backward over the steps of the filter (Rauch, Tung and Striebel, 1965), on the error
state. x_k, P_k are the filter's after the samples of step k, x^-_{k+1}, P^-_{k+1} the prediction:

    G_k   = P_k F_k^T (P^-_{k+1})^-1
    x^s_k = x_k (+) G_k (x^s_{k+1} (-) x^-_{k+1})
    P^s_k = P_k + G_k (P^s_{k+1} - P^-_{k+1}) G_k^T

F is that of :mod:`mambo_estimation.joint.propagation`. Each motion is smoothed alone, from the
step in which the vehicle starts to move to that in which it is at rest again, if it is; the steps
of rest are the filter's. Errors with a variance of zero are not changed.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from . import forward_pass
from ..offline_replay import Steps

Array = NDArray[np.float64]
RIDGE = 1e-12  # added to correlations: rounding error in a direction without variance


class Smoothed(NamedTuple):
    """A smoothed flight, row k at step k; NED and FRD."""

    t: NDArray[np.int64]  # (n,) ns
    x: Array   # (n, 24) smoothed, columns as in forward_pass.Forward
    P: Array   # (n, SIZE, SIZE) of the error state
    filtered: forward_pass.Forward

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Return which steps are smoothed, (n,)."""
        return self.filtered.moving


def _rotation(x: Array) -> Rotation:
    """Return the attitude of a state, body to inertial."""
    return Rotation.from_quat(x[[7, 8, 9, 6]])


def difference(x: Array, y: Array) -> Array:
    """Return the error state that leads from y to x, (SIZE,), as joint.state defines it."""
    turn = _rotation(x) * _rotation(y).inv()
    return np.concatenate([
        x[:3] - y[:3], x[3:6] - turn.apply(y[3:6]), turn.as_rotvec(), x[10:] - y[10:]])


def added(x: Array, d: Array) -> Array:
    """Return a state corrected by an error state, (24,)."""
    turn = Rotation.from_rotvec(d[6:9])
    q = (turn * _rotation(x)).as_quat()
    return np.concatenate([
        x[:3] + d[:3], turn.apply(x[3:6]) + d[3:6], q[[3, 0, 1, 2]], x[10:] + d[9:]])


def _cross(v: Array) -> Array:
    """Return [v x], (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def transition(x: Array, later: Array, dt: float, gravity: float) -> Array:
    """
    Return F from one step to the next, (SIZE, SIZE).

    Parameters
    ----------
    x, later : (24,)
        State before the step, and the predicted one.
    dt : s
    gravity : m/s^2

    """
    F, R, v = np.eye(SIZE), _rotation(x).as_matrix(), _cross(0.5 * (x[3:6] + later[3:6]))
    F[:3, 3:6] = dt * np.eye(3)
    F[:3, 6:9] = -dt * v
    F[3:6, 6:9] = dt * _cross(np.array([0.0, 0.0, gravity]))
    F[3:6, 9:12] = -dt * v @ R
    F[3:6, 12:15] = -dt * R
    F[6:9, 9:12] = -dt * R
    return F


def _gain(P: Array, F: Array, predicted: Array) -> Array:
    """Return G, (SIZE, SIZE), computed with correlations for numbers of similar size."""
    root = np.sqrt(np.maximum(np.diag(predicted), 0.0))
    known = root == 0.0
    scale = np.where(known, 1.0, root)
    C = predicted / np.outer(scale, scale)
    C[known] = C[:, known] = 0.0
    C[np.diag_indices(SIZE)] = 1.0 + RIDGE
    right = (F @ P) / scale[:, None]
    right[known] = 0.0
    return (cho_solve(cho_factor(C), right) / scale[:, None]).T


def smooth(found: Steps, params: JointParams) -> Smoothed:
    """
    Smooth the filter steps of a flight.

    Parameters
    ----------
    found
        Result of :func:`mambo_flight.offline_replay.steps`.
    params
        Parameters of the joint filter: model and noise.

    """
    f = forward_pass.run(found, params)
    x, P = f.x.copy(), f.P.copy()
    for k in np.flatnonzero(f.moving[:-1] & f.moving[1:])[::-1].tolist():
        F = transition(f.x[k], f.predicted[k + 1], f.dt[k + 1], params.gravity)
        G = _gain(f.P[k], F, f.predicted_P[k + 1])
        x[k] = added(f.x[k], G @ difference(x[k + 1], f.predicted[k + 1]))
        change = G @ (P[k + 1] - f.predicted_P[k + 1]) @ G.T
        P[k] = f.P[k] + 0.5 * (change + change.T)
    return Smoothed(found.t, x, P, f)
