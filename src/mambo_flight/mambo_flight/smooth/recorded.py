"""Smooth a recorded flight: states, biases and factors from all samples of the bag."""

from __future__ import annotations

from typing import NamedTuple

from mambo_bags.reader import Bag, BagError
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_model.frames import flip_vector
from mambo_ros import messages, topics
import numpy as np
from numpy.typing import NDArray

from . import intervals
from .. import offline_replay
from .odometry import odometry
from .smoother import smooth, Smoothed

TOPIC = 'estimate/smoothed'


class Answer(NamedTuple):
    """A smoothed flight."""

    numbers: Smoothed
    text: str                   # table of quantities with intervals, and the error of the path
    table: NDArray[np.uint8]    # (n, size) odometry in odom, as serialised messages


def _truth(bag: Bag, t: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """Return the true positions at some stamps, (n, 3) m NED; None: not in the bag."""
    if topics.GROUND_TRUTH.name not in bag:
        return None
    true = bag[topics.GROUND_TRUTH.name]
    return np.stack([
        np.interp(t, true.stamp, axis, left=np.nan, right=np.nan)
        for axis in flip_vector(tuple(true.position.T))], axis=1)


def smoothed(bag: Bag, params: JointParams) -> Answer:
    """
    Return the smoothed flight of a bag.

    Parameters
    ----------
    bag
        Bag that was read with its sensors.
    params
        Parameters of the joint filter.

    Raises
    ------
    BagError
        If the vehicle never moves.

    """
    found = offline_replay.steps(bag)
    s = smooth(found, params)
    if s.moving.sum() < 2:
        raise BagError(f'{bag.path}: the vehicle never moves, nothing to smooth')
    made = odometry(s, found, params.motion.rate_noise)
    rho, nu, q, omega = np.split(made.state, [3, 6, 10], axis=1)
    state = messages.State(*(tuple(part.T) for part in (rho, nu, q, omega)))
    table = messages.estimate(
        s.t, state, tuple(made.pose_covariance.T), tuple(made.twist_covariance.T))
    return Answer(s, intervals.table(s, _truth(bag, s.t)), table)
