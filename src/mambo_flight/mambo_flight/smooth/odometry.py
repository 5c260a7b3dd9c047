"""Smoothed states and covariances as odometry."""

from __future__ import annotations

from typing import NamedTuple

from mambo_estimation.joint.state import ATTITUDE, GYRO_BIAS, POSITION, VELOCITY
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..offline_replay import Steps
from .smoother import Smoothed

Array = NDArray[np.float64]


class Odometry(NamedTuple):
    """Row k at step k; position and attitude inertial NED, velocity and rate body FRD."""

    state: Array             # (n, 13) rho m, nu m/s, q w x y z, omega rad/s
    pose_covariance: Array   # (n, 36) m, rad, inertial axes
    twist_covariance: Array  # (n, 36) m/s, rad/s, body axes


def odometry(s: Smoothed, found: Steps, rate_noise: float) -> Odometry:
    """
    Return a smoothed flight as odometry.

    Parameters
    ----------
    s
        Smoothed flight.
    found
        Filter steps of the flight, for the gyro rates; NaN where a sample is missing.
    rate_noise : rad/s
        Standard deviation of one gyro sample.

    """
    n, x = len(s.t), s.x
    R = Rotation.from_quat(x[:, [7, 8, 9, 6]])
    state = np.hstack([x[:, :3], R.inv().apply(x[:, 3:6]), x[:, 6:10], found.gyro - x[:, 10:13]])
    pose = np.zeros((n, 6, 6))
    twist = np.zeros((n, 6, 6))
    at = [*range(POSITION, POSITION + 3), *range(ATTITUDE, ATTITUDE + 3)]
    pose[:] = s.P[:, at][:, :, at]
    turn, v, b = R.as_matrix(), slice(VELOCITY, VELOCITY + 3), slice(GYRO_BIAS, GYRO_BIAS + 3)
    twist[:, :3, :3] = turn.transpose(0, 2, 1) @ s.P[:, v, v] @ turn
    twist[:, 3:, 3:] = s.P[:, b, b] + rate_noise * rate_noise * np.eye(3)
    return Odometry(state, pose.reshape(n, 36), twist.reshape(n, 36))
