"""
Impossible poses of a motion capture: the tracker mixes up markers and flips the body.

Between two frames no vehicle turns faster than ``FASTEST_TURN`` or moves faster than ``FASTEST``.
If a recording does, the tracker has changed its assignment of markers to points of the body. Until
the next jump its poses differ from the truth by a constant rotation and translation. The segments
between jumps are therefore grouped by the sum of the jumps before them. Segments with the same sum
have the same assignment, and the assignment of most poses is taken for the correct one. That is no
proof: importers ask the other sensors first (``mambo_analysis.importers.checks.assignments``).

Some drivers give one fixed position, such as 0 0 0, while they do not see the body. It does not
move with the body, so it is left out before the jumps are added up.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_bags.mcap_reader import BagError
import numpy as np
from scipy.spatial.transform import Rotation

from .resample import Bools, Floats, Ints, runs

FASTEST_TURN = 35.0  # rad/s, 2000 deg/s: the full scale of the gyros of small drones
FASTEST = 30.0       # m/s
SAME_TURN = 0.5      # rad, tolerance for one assignment: true rotation during the jumps
SAME_SHIFT = 0.3     # m, tolerance for one assignment: true motion during the jumps
MOST = 0.5           # [-] share of jumps or impossible poses above which a recording is unusable
LEAST_POSES = 10     # in a recording whose share of jumps is judged
CAUSES = 'mixed-up markers, a fixed position of a body out of sight, or wrong times or units'
MAX_ASSIGNMENTS = 100  # a tracker has a few; in noise every pose would make another


def step_sizes(position: Floats, turns: Rotation) -> tuple[Floats, Floats]:
    """Return how far a body moves and turns between n poses, (n - 1,) m and (n - 1,) rad."""
    return (np.linalg.norm(np.diff(position, axis=0), axis=1),
            (turns[:-1].inv() * turns[1:]).magnitude())


def _jumps(times: Floats, position: Floats, turns: Rotation, apart: int = 1) -> Ints:
    """
    Return the indices of poses that a vehicle could not reach from the previous pose.

    Stamps from a busy computer come in bursts: a step takes at least the usual time, the median
    between poses that are some steps apart.
    """
    usual = np.median(times[apart:] - times[:-apart]) / apart
    steps = np.maximum(np.diff(times), usual)
    moved, turned = step_sizes(position, turns)
    return np.flatnonzero((turned > FASTEST_TURN * steps) | (moved > FASTEST * steps)) + 1


def _placeholders(times: Floats, position: Floats, turns: Rotation) -> Bools:
    """
    Return which poses repeat one position to the digit between two jumps, (n,).

    Where all three numbers are the same, such as 0 0 0, a step by ``SAME_SHIFT`` is enough on both
    sides: a tracker that loses the body may give nothing for a moment before and after.
    """
    out = np.zeros(len(times), bool)
    if len(times) < 3:
        return out
    jumps = np.zeros(len(times) + 1, bool)
    jumps[_jumps(times, position, turns)] = True
    for first, end in runs(np.append(False, (np.diff(position, axis=0) == 0.0).all(axis=1))):
        out[first - 1:end] = jumps[first - 1] and jumps[end]
    for first, end in runs(np.ptp(position, axis=1) == 0.0):
        if 0 < first and end < len(times):
            steps = np.linalg.norm(position[[first - 1, end]] - position[first], axis=1)
            out[first:end] |= steps.min() > SAME_SHIFT
    return out


class Sorted(NamedTuple):
    """
    Poses of a recording, sorted by the assignment of the markers that they have.

    Attributes
    ----------
    labels : (n,)
        Number of the assignment; -1: of a body out of sight, or one more than are told apart.
    turns : (k, 4)
        Quaternions x y z w, from the body of the largest group to that of each assignment.
    right
        The assignment that is taken for the correct one.
    by
        Name of the sensor that shows it; empty: it is that of most poses.

    """

    labels: Ints
    turns: Floats
    right: int
    by: str = ''

    @property
    def wrong(self) -> Bools:
        """Return which poses have another assignment than the correct one, (n,)."""
        return self.labels != self.right


def impossible(times: Floats, position: Floats, orientation: Floats) -> Bools:
    """
    Return which poses are impossible: those with another assignment than most.

    Parameters
    ----------
    times, position, orientation
        As of :func:`sort`.

    Returns
    -------
    (n,) mask; all False for a recording without jumps.

    """
    return sort(times, position, orientation).wrong


def sort(times: Floats, position: Floats, orientation: Floats) -> Sorted:
    """
    Return the poses sorted by the assignment of their markers; that of most counts as correct.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m
    orientation : (n, 4)
        Unit quaternions x y z w, body to inertial, finite.

    """
    turns = Rotation.from_quat(orientation)
    seen = ~_placeholders(times, position, turns)
    labels = np.where(seen, 0, -1)
    if seen.sum() < 3:
        return Sorted(labels, np.array([[0.0, 0.0, 0.0, 1.0]]), 0)
    begins = _jumps(times[seen], position[seen], turns[seen])
    labels[seen], rough = _assignments(position[seen], turns[seen], begins)
    right = int(np.argmax(np.bincount(labels[labels >= 0], minlength=1)))
    return Sorted(labels, _turns(turns[seen], labels[seen], begins, rough, right), right)


def _assignments(position: Floats, turns: Rotation, begins: Ints) -> tuple[Ints, Floats]:
    """
    Return the assignment of each pose, (n,), and the turns from the first to each, (k, 4).

    A new one may begin at the poses ``begins``; -1 is one more than ``MAX_ASSIGNMENTS``.
    """
    lengths = np.diff(np.concatenate([[0], begins, [len(position)]])).astype(int)
    steps, moves = turns[begins - 1].inv() * turns[begins], position[begins] - position[begins - 1]
    rotations, shifts = np.zeros((MAX_ASSIGNMENTS, 4)), np.zeros((MAX_ASSIGNMENTS, 3))
    turn, shift, count = Rotation.identity(), np.zeros(3), 1
    rotations[0], chosen = turn.as_quat(), [0]
    for k in range(len(begins)):
        turn, shift = turn * steps[k], shift + moves[k]
        q = turn.as_quat()
        same = (np.abs(rotations[:count] @ q) > np.cos(0.5 * SAME_TURN)) & (
            np.linalg.norm(shifts[:count] - shift, axis=1) < SAME_SHIFT)
        assignment = int(np.argmax(same)) if same.any() else count
        if assignment == MAX_ASSIGNMENTS:
            chosen.append(-1)
            continue
        if assignment == count:
            rotations[assignment], shifts[assignment], count = q, shift, count + 1
        else:  # reset, so that true motion during the jumps does not accumulate
            turn, shift = Rotation.from_quat(rotations[assignment]), shifts[assignment].copy()
        chosen.append(assignment)
    return np.repeat(np.array(chosen), lengths), rotations[:count]


def _turns(
    turns: Rotation, labels: Ints, begins: Ints, rough: Floats, largest: int,
) -> Floats:
    """
    Return the turns from the body of the largest group to that of each assignment, (k, 4).

    A mean over all jumps between both, which true rotation during a jump makes wrong by little;
    without one the sum of jumps, (k, 4) from the first assignment.
    """
    steps = turns[begins - 1].inv() * turns[begins]
    before, after = labels[begins - 1], labels[begins]
    out = (Rotation.from_quat(rough[largest]).inv() * Rotation.from_quat(rough)).as_quat()
    for label in set(labels.tolist()) - {largest, -1}:
        there = (before == largest) & (after == label)
        back = (before == label) & (after == largest)
        if there.any() or back.any():
            both = np.concatenate([steps[there].as_quat(), steps[back].inv().as_quat()])
            out[label] = Rotation.from_quat(both).mean().as_quat()
    return out


def refuse_most(
    where: str, times: Floats, position: Floats, orientation: Floats, found: Sorted | None = None,
) -> Bools:
    """
    Return which poses are impossible, and refuse a recording of which most is.

    Jumps are counted, too. With a wrong unit of time every step is a jump, but a small one: then
    all poses count as one assignment of the markers, and :func:`impossible` finds none.

    Parameters
    ----------
    where
        File and topic, for the error.
    times, position, orientation
        As of :func:`sort`.
    found
        Its result; default: it is called.

    Raises
    ------
    BagError
        If more than ``MOST`` of the steps are jumps, or of the poses are impossible though no
        sensor shows which.

    """
    found = found or sort(times, position, orientation)
    count = int(found.wrong.sum())
    if len(times) >= LEAST_POSES:
        jumps = len(_jumps(times, position, Rotation.from_quat(orientation),
                           min(LEAST_POSES, len(times) - 1)))
        if jumps > MOST * (len(times) - 1):
            raise BagError(f'{where}: {jumps} of {len(times) - 1} steps are {_limits()}: wrong '
                           'times or units')
    if count > MOST * len(times) and not found.by:
        raise BagError(f'{where}: {count} of {len(times)} poses are impossible, reached '
                       f'{_limits()}: {CAUSES}')
    return found.wrong


def _limits() -> str:
    return f'faster than {np.degrees(FASTEST_TURN):.0f} deg/s or {FASTEST:g} m/s'


def describe(name: str, count: int) -> str:
    """Return a line that reports rejected poses."""
    return (f'{name}: {count} impossible pose{"s" * (count != 1)} left out, reached {_limits()}: '
            f'{CAUSES}')
