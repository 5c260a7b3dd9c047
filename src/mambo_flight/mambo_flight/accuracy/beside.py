"""How far other estimators are from the truth of a flight whose samples they get."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import crazyflie
from .. import offline_replay
from ..scenario import override, Scenario
from .error_statistics import Measured, MOTION, Row
from .filter_error import _truth, DT, SETTLED, true_noise
from .from_bag import Samples

Array = NDArray[np.float64]
OWN = ('kalman', 'toolbox')
WITH_DRAG = 'crazyflie_with_drag'
FIRMWARE = ('crazyflie', WITH_DRAG)
ESTIMATORS = (*OWN, *FIRMWARE)


def told(flight: Scenario, with_drag: bool) -> crazyflie.Told:
    """Return the true noise of the sensors and, if asked for, the true linear drag."""
    noise = true_noise(flight)
    drag = _truth(flight).drag * noise.gravity if with_drag else 0.0
    return crazyflie.Told(
        noise.optical_flow.noise, flight.sim_node.simulator.optical_flow.rate, noise.sonar.noise,
        drag)


def _states(flight: Scenario, s: Samples, start: int, estimator: str) -> tuple[Array, int]:
    """Return states (n, 13) of an estimator, and how many steps it is from one to the next."""
    steps = offline_replay.steps_of(s)
    if estimator in OWN:
        node = override(flight, {'estimator_node.estimator': estimator}).estimator_node
        return offline_replay.run(steps, node.filter).state, 1
    return (crazyflie.states(steps, start, told(flight, estimator == WITH_DRAG)),
            crazyflie.STRIDE)


def measured_beside(
    flight: Scenario, s: Samples, start: int, joint: Measured, estimator: str,
) -> Measured:
    """
    Return errors of position, velocity and tilt of another estimator.

    A tilt is the vertical in body axes, which a wrong yaw does not change.

    Parameters
    ----------
    flight, s
        The flight and its samples.
    start
        Step of take-off.
    joint
        The joint filter on it, for the bound.
    estimator
        One of ``ESTIMATORS``.

    """
    state, stride = _states(flight, s, start, estimator)
    truth = s.truth[::stride][:len(state)]
    on = (start + round(SETTLED / DT)) // stride
    off = truth[:, :6] - state[:, :6]
    down, believed = (
        Rotation.from_quat(rows[:, [7, 8, 9, 6]]).inv().apply([0.0, 0.0, 1.0])
        for rows in (truth, state))
    errors = (off[-1:, :2], off[on:, 2:3], off[on:, 3:5], off[on:, 5:6],
              (down - believed)[on:, :2])
    rows = tuple(
        Row(own.bound, float(np.mean(error**2)), math.nan, own.components)
        for own, error in zip(joint.rows[:MOTION], errors, strict=True))
    return Measured(rows, (math.nan,) * 3)
