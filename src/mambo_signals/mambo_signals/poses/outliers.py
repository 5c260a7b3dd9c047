"""
Impossible poses of a motion capture: the tracker mixes up markers and flips the body.

Between two frames no vehicle turns faster than ``FASTEST_TURN`` or moves faster than ``FASTEST``.
If a recording does, the tracker has changed its assignment of markers to points of the body. Until
the next jump its poses differ from the truth by a constant rotation and translation. The segments
between jumps are therefore grouped by the sum of the jumps before them. Segments with the same sum
have the same assignment, and the assignment of most poses is taken for the correct one. That is no
proof: importers ask the other sensors first (``mambo_analysis.importers.checks.assignments``).

Over a gap a vehicle may turn and move farther; what is beyond its motion there is found by
:mod:`.gap_jumps`, and counts if another sensor shows it or if the poses jump back.

Some drivers give one fixed position, such as 0 0 0, while they do not see the body. It does not
move with the body, so it is left out before the jumps are added up.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_bags.mcap_reader import BagError
import numpy as np
from scipy.spatial.transform import Rotation

from . import gap_jumps
from ..resample import Bools, Floats, Ints, runs
from .gap_jumps import Turned

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
    doubtful : (m,)
        Numbers of the poses that may begin another assignment after a gap; they count as none.

    """

    labels: Ints
    turns: Floats
    right: int
    by: str = ''
    doubtful: Ints = np.zeros(0, np.int64)

    @property
    def wrong(self) -> Bools:
        """Return which poses have another assignment than the correct one, (n,)."""
        return self.labels != self.right


def impossible(times: Floats, position: Floats, orientation: Floats) -> Bools:
    """
    Return which poses are impossible: those with another assignment than most.

    Jumps over gaps do not count. An import judges them with the other sensors, and a maneuver that
    a gyro has shown there must not be taken for a jump later.

    Parameters
    ----------
    times, position, orientation
        As of :func:`sort`.

    Returns
    -------
    (n,) mask; all False for a recording without jumps.

    """
    return sort(times, position, orientation, by_speeds=False).wrong


def sort(
    times: Floats, position: Floats, orientation: Floats, turned: Turned | None = None,
    by_speeds: bool = True,
) -> Sorted:
    """
    Return the poses sorted by the assignment of their markers; that of most counts as correct.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m
    orientation : (n, 4)
        Unit quaternions x y z w, body to inertial, finite.
    turned
        How the body turns between two times by another sensor.
    by_speeds
        Whether the speeds beside a gap may show a jump.

    """
    turns = Rotation.from_quat(orientation)
    seen = ~_placeholders(times, position, turns)
    labels = np.where(seen, 0, -1)
    if seen.sum() < 3:
        return Sorted(labels, np.array([[0.0, 0.0, 0.0, 1.0]]), 0)
    jumps, doubtful = _all_jumps(times[seen], position[seen], turns[seen], turned, by_speeds)
    chosen, rough = _assignments(jumps)
    counts = jumps.sure | assignment_returns(chosen)
    if not counts.all():
        doubtful = np.sort(np.append(doubtful, jumps.begins[~counts]))
        jumps = Jumps(*(part[counts] for part in jumps))
        chosen, rough = _assignments(jumps)
    lengths = np.diff(np.concatenate([[0], jumps.begins, [seen.sum()]])).astype(int)
    labels[seen] = np.repeat(chosen, lengths)
    right = int(np.argmax(np.bincount(labels[labels >= 0], minlength=1)))
    return Sorted(labels, _turns(jumps, labels[seen], rough, right), right,
                  doubtful=np.flatnonzero(seen)[doubtful])


class Jumps(NamedTuple):
    """
    Places where another assignment may begin.

    Attributes
    ----------
    begins : (k,)
        Numbers of the poses.
    turns : (k, 4), shifts : (k, 3) m
        From the pose before, without the motion of the vehicle in a gap.
    alike : (k, 2)
        Tolerances for one assignment, rad and m.
    sure : (k,)
        False: only if the poses jump back later.

    """

    begins: Ints
    turns: Floats
    shifts: Floats
    alike: Floats
    sure: Bools


def _all_jumps(
    times: Floats, position: Floats, turns: Rotation, turned: Turned | None, by_speeds: bool,
) -> tuple[Jumps, Ints]:
    """Return the jumps of n poses, and the poses behind a gap that may be one."""
    gaps = gap_jumps.steps(times, position, turns, turned)
    faster = np.zeros(len(times) - 1, bool)
    faster[_jumps(times, position, turns) - 1] = True
    before = np.flatnonzero(faster | gaps.sure | gaps.suspected & by_speeds)
    plain, dt = faster[before, None], np.diff(times)[before]
    over = np.column_stack([np.full(len(dt), gap_jumps.SAME_TURN), gap_jumps.largest_shift(dt)])
    step = (turns[before].inv() * turns[before + 1]).as_quat().reshape(-1, 4)
    return Jumps(
        before + 1, np.where(plain, step, gaps.turns[before]),
        np.where(plain, position[before + 1] - position[before], gaps.shifts[before]),
        np.where(plain, [SAME_TURN, SAME_SHIFT], over),
        (faster | gaps.sure)[before]), np.flatnonzero(gaps.doubtful & ~faster) + 1


def _assignments(jumps: Jumps) -> tuple[Ints, Floats]:
    """
    Return the assignment of each part between jumps, and the turns from the first, (k, 4).

    -1 is one more than ``MAX_ASSIGNMENTS``.
    """
    begins, moves = jumps.begins, jumps.shifts
    steps = Rotation.from_quat(jumps.turns) if len(begins) else Rotation.identity()
    rotations, shifts = np.zeros((MAX_ASSIGNMENTS, 4)), np.zeros((MAX_ASSIGNMENTS, 3))
    known = np.zeros((MAX_ASSIGNMENTS, 2))  # tolerance of the turn and shift of each, rad and m
    turn, shift, count = Rotation.identity(), np.zeros(3), 1
    rotations[0], chosen = turn.as_quat(), [0]
    for k in range(len(begins)):
        turn, shift = turn * steps[k], shift + moves[k]
        q, alike = turn.as_quat(), np.maximum(
            known[:count], np.maximum(known[chosen[-1]], jumps.alike[k]))
        same = (np.abs(rotations[:count] @ q) > np.cos(0.5 * alike[:, 0])) & (
            np.linalg.norm(shifts[:count] - shift, axis=1) < alike[:, 1])
        assignment = int(np.argmax(same)) if same.any() else count
        if assignment == MAX_ASSIGNMENTS:
            chosen.append(-1)
            continue
        if assignment == count:
            rotations[assignment], shifts[assignment], count = q, shift, count + 1
            known[assignment] = np.maximum(known[chosen[-1]], jumps.alike[k])
        else:  # reset, so that true motion during the jumps does not accumulate
            turn, shift = Rotation.from_quat(rotations[assignment]), shifts[assignment].copy()
        chosen.append(assignment)
    return np.array(chosen), rotations[:count]


def assignment_returns(chosen: Ints) -> Bools:
    """
    Return whether the assignment before a jump comes again, or that after it came before.

    Of the assignments (k + 1,) of the parts between k jumps.
    """
    k = np.arange(len(chosen))
    first = np.full(MAX_ASSIGNMENTS + 1, len(chosen))
    last = np.zeros(MAX_ASSIGNMENTS + 1, np.int64)
    np.minimum.at(first, chosen, k)
    np.maximum.at(last, chosen, k)
    return (last[chosen[:-1]] > k[1:]) | (first[chosen[1:]] < k[:-1])


def _turns(jumps: Jumps, labels: Ints, rough: Floats, largest: int) -> Floats:
    """
    Return the turns from the body of the largest group to that of each assignment, (k, 4).

    A mean over all jumps between both, which true rotation during a jump makes wrong by little;
    without one the sum of jumps, (k, 4) from the first assignment.
    """
    before, after = labels[jumps.begins - 1], labels[jumps.begins]
    out = (Rotation.from_quat(rough[largest]).inv() * Rotation.from_quat(rough)).as_quat()
    for label in set(labels.tolist()) - {largest, -1}:
        there = (before == largest) & (after == label)
        back = (before == label) & (after == largest)
        if there.any() or back.any():
            both = np.concatenate([jumps.turns[there], jumps.turns[back] * [-1, -1, -1, 1]])
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
    return (f'{name}: {count} impossible pose{"s" * (count != 1)} left out, reached {_limits()}, '
            f'or otherwise than the motion beside a gap: {CAUSES}')
