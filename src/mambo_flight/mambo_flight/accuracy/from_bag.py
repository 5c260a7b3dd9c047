"""A simulated flight read from its bag."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mambo_bags.reader import Bag, BagError, read_bag
from mambo_model.frames import flip_vector
from mambo_ros import topics
import numpy as np
from numpy.typing import NDArray

from .. import offline_replay
from ..scenario import from_yaml, Scenario

Array = NDArray[np.float64]
LARGEST = 1e6  # of a true state, SI units
TOUCHING = 0.1  # m of height, below which a landing vehicle may touch the floor


class Samples(NamedTuple):
    """Samples and truth of a flight: the fields of ``closed_loop.Recording`` of these names."""

    t: NDArray[np.int64]
    truth: Array
    imu: Array
    sonar: Array
    flow: Array
    pressure: Array


def until_landing(s: Samples) -> Samples:
    """
    Return a flight up to its landing; all of it, if it ends in the air or never left the floor.

    The shock of a touchdown and the rest on the floor are not in the models of filter and bound.
    """
    high = np.flatnonzero(-s.truth[:, 2] > TOUCHING)
    end = int(high[-1]) + 1 if len(high) else len(s.t)
    return Samples(*(getattr(s, name)[:end] for name in Samples._fields))


def is_bag(name: str) -> bool:
    """Return whether a name is that of a bag: an MCAP file or a folder."""
    path = Path(name)
    return path.is_dir() or path.suffix == '.mcap' and path.is_file()


def true_states(bag: Bag, t: NDArray[np.int64]) -> Array:
    """
    Return the true states of a simulated flight at some stamps, (n, 13).

    Raises
    ------
    BagError
        If the bag has no ground truth, or none or an impossible one at one of the stamps.

    """
    if topics.GROUND_TRUTH.name not in bag:
        raise BagError(f'{bag.path}: no {topics.GROUND_TRUTH.name}, so there is no truth to '
                       'compare with')
    true = bag[topics.GROUND_TRUTH.name]
    row = np.searchsorted(true.stamp, t)
    if not np.array_equal(true.stamp[np.minimum(row, len(true) - 1)], t):
        raise BagError(f'{bag.path}: {topics.GROUND_TRUTH.name} has not a state for every '
                       'inertial sample')
    ned = [np.stack(flip_vector(tuple(vectors[row].T)), axis=1) for vectors in (
        true.position, true.velocity, true.orientation[:, :3], true.angular_velocity)]
    q = np.column_stack([true.orientation[row, 3], ned[2]])
    out = np.hstack([ned[0], ned[1], q, ned[3]])
    possible = (np.abs(out) < LARGEST).all(axis=1) & (
        np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.01)
    if not possible.all():
        raise BagError(f'{bag.path}: {topics.GROUND_TRUTH.name} has an impossible state at '
                       f'{1e-9 * t[np.argmin(possible)]:.3f} s')
    return out


def read(path: Path) -> tuple[Scenario, Samples]:
    """
    Return the scenario of a bag and what its sensors saw.

    Raises
    ------
    BagError
        If the bag holds no scenario, no truth or no complete step of the sensors.

    """
    bag = read_bag(path)
    own = bag.attachments.get('scenario.yaml')
    if not isinstance(own, str):
        raise BagError(f'{path}: no scenario.yaml inside, which tells what the sensors were; '
                       'only a simulated flight has it')
    flight, s = from_yaml(own, f'{path}: scenario.yaml'), offline_replay.steps(bag)
    if not len(s.t):
        raise offline_replay.nothing_complete(bag)
    seen = ~np.isnan(s.flow[:, :1])
    flow = np.where(seen, np.column_stack([s.flow, s.flow_quality]), np.nan)
    return flight, Samples(
        s.t, true_states(bag, s.t), np.hstack([s.gyro, s.accel]), s.sonar, flow, s.pressure)
