"""
Impossible poses of a motion capture: the tracker mixes up markers and flips the body.

Between two frames no vehicle turns faster than ``FASTEST_TURN`` or moves faster than ``FASTEST``.
If a recording does, the tracker has changed its assignment of markers to points of the body. Until
the next jump its poses differ from the truth by a constant rotation and translation. The segments
between jumps are therefore grouped by the sum of the jumps before them. Segments with the same sum
have the same assignment, and the assignment of most poses is taken for the correct one.

Some drivers give one fixed position, such as 0 0 0, while they do not see the body. It does not
move with the body, so it is left out before the jumps are added up.
"""

from __future__ import annotations

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
LONG = 2.0           # s of rejected poses on end that are told with their times
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


def impossible(times: Floats, position: Floats, orientation: Floats) -> Bools:
    """
    Return which poses are impossible.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m
    orientation : (n, 4)
        Unit quaternions x y z w, body to inertial, finite.

    Returns
    -------
    (n,) mask; all False for a recording without jumps.

    """
    turns = Rotation.from_quat(orientation)
    out = _placeholders(times, position, turns)
    out[~out] = _other_assignments(times[~out], position[~out], turns[~out])
    return out


def _other_assignments(times: Floats, position: Floats, turns: Rotation) -> Bools:
    """Return which poses have another assignment of the markers than most, (n,)."""
    if len(times) < 3:
        return np.zeros(len(times), bool)
    begins = _jumps(times, position, turns)
    lengths = np.diff(np.concatenate([[0], begins, [len(times)]])).astype(int)
    steps, moves = turns[begins - 1].inv() * turns[begins], position[begins] - position[begins - 1]
    rotations, shifts = np.zeros((MAX_ASSIGNMENTS, 4)), np.zeros((MAX_ASSIGNMENTS, 3))
    counts = np.zeros(MAX_ASSIGNMENTS, int)  # poses of each assignment
    turn, shift, count = Rotation.identity(), np.zeros(3), 1
    rotations[0], counts[0], chosen = turn.as_quat(), lengths[0], [0]
    for k, length in enumerate(lengths[1:].tolist()):
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
        counts[assignment] += length
        chosen.append(assignment)
    return np.repeat(np.array(chosen) != int(np.argmax(counts)), lengths)


def refuse_most(where: str, times: Floats, position: Floats, orientation: Floats) -> Bools:
    """
    Return which poses are impossible, and refuse a recording of which most is.

    Jumps are counted, too. With a wrong unit of time every step is a jump, but a small one: then
    all poses count as one assignment of the markers, and :func:`impossible` finds none.

    Parameters
    ----------
    where
        File and topic, for the error.
    times, position, orientation
        As of :func:`impossible`.

    Raises
    ------
    BagError
        If more than ``MOST`` of the steps are jumps, or of the poses are impossible.

    """
    wrong = impossible(times, position, orientation)
    count = int(wrong.sum())
    if len(times) >= LEAST_POSES:
        jumps = len(_jumps(times, position, Rotation.from_quat(orientation),
                           min(LEAST_POSES, len(times) - 1)))
        if jumps > MOST * (len(times) - 1):
            raise BagError(f'{where}: {jumps} of {len(times) - 1} steps are {_limits()}: wrong '
                           'times or units')
    if count > MOST * len(times):
        raise BagError(f'{where}: {count} of {len(times)} poses are impossible, reached '
                       f'{_limits()}: {CAUSES}')
    return wrong


def _limits() -> str:
    return f'faster than {np.degrees(FASTEST_TURN):.0f} deg/s or {FASTEST:g} m/s'


def describe(name: str, count: int) -> str:
    """Return a line that reports rejected poses."""
    return (f'{name}: {count} impossible pose{"s" * (count != 1)} left out, reached {_limits()}: '
            f'{CAUSES}')


def describe_long(name: str, times: Floats, wrong: Bools) -> list[str]:
    """
    Return a line on rejected poses that go on for ``LONG``, which mixed-up markers seldom do.

    Parameters
    ----------
    name
        Of the topic.
    times : (n,) s
        Of all poses, ascending.
    wrong : (n,)
        Which are rejected.

    """
    spans = [(times[first], times[end - 1]) for first, end in runs(wrong)]
    first, last = max(spans, key=lambda span: span[1] - span[0], default=(0.0, 0.0))
    if last - first < LONG:
        return []
    return [f'{name}: all poses from t = {first:.2f} to {last:.2f} s are among them: the '
            'recording jumps there; was it cut, or is it of two takes?']
