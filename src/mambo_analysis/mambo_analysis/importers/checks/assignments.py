"""
Which poses of a motion capture have the right assignment of the markers: :func:`sort_poses`.

A tracker that takes symmetric markers for each other turns some poses of the body, by 180 degrees
as a rule. :mod:`mambo_signals.poses.outliers` sorts the poses by their assignment. Most poses may
be the wrong ones: where a gyro or another attitude turns as the poses of a smaller group, that is
taken, else the largest. :func:`describe` says what was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mambo_signals.derivative import body_rates
from mambo_signals.gyro_check import compare, OTHER, WINDOW
from mambo_signals.poses import gap_jumps
from mambo_signals.poses.gap_jumps import Turned
from mambo_signals.poses.outliers import SAME_TURN, sort, Sorted
from mambo_signals.resample import Bools, Floats, gaps, interpolate, Ints, runs
import numpy as np
from scipy.spatial.transform import Rotation

SHARE = 0.1  # of the poses that a group has at least; single errors are fewer
TOLD = 3     # gaps that are named
LONG = 2.0   # s of rejected poses on end that are told with their times
STEP = 0.005  # s, of the integral of a gyro
SPAN, SPANS = 0.5, 60  # s over which its turns are compared with those of the poses; how many
TURNS = 0.1  # rad in that time that show more than noise
LEAST, AGREES = 5, 0.7  # of such turns, and the share that must agree within half of their size
LATE = 0.1   # s between a sensor and the attitude; more is told as another clock


class Turning(NamedTuple):
    """Rates of the body by another sensor, (n, 3) rad/s FLU at times (n,) s, and its name."""

    name: str
    times: Floats
    rates: Floats


def of_attitude(name: str, times: Floats, orientation: Floats) -> Turning:
    """Return the turning by another attitude, (n, 4) x y z w at ascending times (n,) s."""
    return Turning(name, *body_rates(times, orientation, window=WINDOW))


def sort_poses(
    times: Floats, position: Floats, orientation: Floats, beside: Sequence[Turning],
) -> Sorted:
    """
    Return the poses sorted by their assignment, with the right one by the sensors beside.

    Parameters
    ----------
    times, position, orientation
        As of :func:`mambo_signals.poses.outliers.sort`.
    beside
        Sensors on the same clock, the most trusted first.

    """
    turns = Rotation.from_quat(orientation)
    found = sort(times, position, orientation, _turned(times, turns, beside))
    groups = _groups(found) if beside else []
    for one in beside:
        best, right, decided = 0.0, found.right, False
        for group in groups:
            turn = Rotation.from_quat(found.turns[group])
            as_it, as_most = (_agreement(times, turns, found.labels, pair, between, one)
                              for pair, between in (((group, found.right), turn),
                                                    ((found.right, group), turn.inv())))
            if max(as_it, as_most) < OTHER[0] or abs(as_it - as_most) < OTHER[1]:
                continue
            decided = True
            if as_it > max(as_most, best):
                best, right = as_it, group
        if decided:
            return found._replace(right=right, by=one.name)
    return found


def _turn(one: Turning, begin: float, end: float) -> Floats:
    """Return the turn between two times by a sensor, a quaternion x y z w; NaN: not known."""
    at = np.linspace(begin, end, 2 + int((end - begin) / STEP))
    near = slice(max(np.searchsorted(one.times, begin) - 1, 0),
                 np.searchsorted(one.times, end) + 1)
    rates = interpolate(0.5 * (at[1:] + at[:-1]), one.times[near], one.rates[near], LATE)
    if not np.isfinite(rates).all():
        return np.full(4, np.nan)
    turn = Rotation.identity()
    for part in Rotation.from_rotvec(rates * (at[1] - at[0])):
        turn = turn * part
    return np.asarray(turn.as_quat())


def _is_trusted(times: Floats, turns: Rotation, one: Turning) -> bool:
    """
    Return whether a sensor turns as the poses do where these have no gap.

    The turns over ``SPAN`` are compared up to the heading of the body, so poses that are flipped
    about its z axis count as the others. A sensor of other axes, in another unit or on another
    clock is told later; it must not decide here.
    """
    first = np.unique(np.searchsorted(times, np.linspace(times[0], times[-1], SPANS + 1)[:-1]))
    last = np.minimum(np.searchsorted(times, times[first] + SPAN), len(times) - 1)
    crossed = np.concatenate([[0], np.cumsum(gaps(times))])
    agree = []
    for i, j in zip(first, last, strict=True):
        if i < j and crossed[i] == crossed[j]:
            seen = (turns[i].inv() * turns[j]).as_quat()
            shown = _turn(one, float(times[i]), float(times[j]))
            size = max((Rotation.from_quat(q).magnitude() for q in (seen, shown)
                        if np.isfinite(q).all()), default=0.0)
            if size > TURNS and np.isfinite(shown).all():
                agree.append(gap_jumps.between(seen, shown) < 0.5 * size)
    return len(agree) >= LEAST and float(np.mean(agree)) >= AGREES


def _turned(times: Floats, turns: Rotation, beside: Sequence[Turning]) -> Turned | None:
    """Return the turn between two times by the first trusted sensor that knows it."""
    if len(times) < LEAST or not gaps(times).any():
        return None
    trusted = [one for one in beside if len(one.times) and _is_trusted(times, turns, one)]

    def turned(begin: float, end: float) -> Floats:
        """Return the turn, a quaternion x y z w; NaN: not known."""
        known = (_turn(one, begin, end) for one in trusted)
        return next((turn for turn in known if np.isfinite(turn).all()), np.full(4, np.nan))
    return turned if trusted else None


def _agreement(
    times: Floats, turns: Rotation, labels: Ints, pair: tuple[int, int], between: Rotation,
    beside: Turning,
) -> float:
    """
    Return the mean correlation of a sensor's rates with those of the poses of two groups.

    Those of the second group are turned into the body of the first by ``between``. 0 without
    enough poses in common.
    """
    first, second = (labels == label for label in pair)
    q = turns.as_quat()
    q[second] = (turns[second] * between).as_quat()
    there = first | second
    seen = compare(beside.times, beside.rates, times[there], q[there], search=LATE)
    return 0.0 if seen is None else float(seen.correlation.mean())


def _groups(found: Sorted) -> list[int]:
    """Return the assignments of many poses whose body is turned against the right one."""
    counts = np.bincount(found.labels[found.labels >= 0], minlength=len(found.turns))
    turned = _between(found, np.arange(len(found.turns))).magnitude()
    return np.flatnonzero((counts >= SHARE * len(found.labels)) & (turned >= SAME_TURN)).tolist()


def _between(found: Sorted, labels: int | Ints) -> Rotation:
    """Return the turn from the body of the right assignment to that of others."""
    return (Rotation.from_quat(found.turns[found.right]).inv()
            * Rotation.from_quat(found.turns[labels]))


def _returns(labels: Ints, label: int, right: int) -> bool:
    """Return whether an assignment is no beginning or end of a recording: it comes and goes."""
    parts, others = runs(labels == label), np.flatnonzero(labels == right)
    return len(parts) > 1 or others[0] < parts[0, 0] < others[-1]


def _when(times: Floats, there: Bools) -> str:
    """Return the number of some poses and their times in words."""
    parts, at = len(runs(there)), times[there]
    return (f'{len(at)} poses from t = {at[0]:.2f} to {at[-1]:.2f} s'
            + (f' in {parts} parts' if parts > 1 else ''))


def describe(name: str, times: Floats, found: Sorted) -> list[str]:
    """
    Return lines on groups of poses with a turned body, and on poses that are left out for long.

    Parameters
    ----------
    name
        Of the topic.
    times : (n,) s, ascending
    found
        What :func:`sort_poses` returns.

    """
    out, groups = [], _groups(found)
    for group in groups:
        turn = _between(found, group).as_rotvec()
        angle = float(np.linalg.norm(turn))
        axis = ', '.join(f'{x + 0.0:.2f}' for x in (turn / angle).round(2))
        out.append(
            f'{name}: {_when(times, found.labels == group)}, left out, show the body turned by '
            f'{np.degrees(angle):.0f} deg about its axis ({axis}) against '
            f'{_when(times, ~found.wrong)}, kept: the tracker takes symmetric markers for each '
            'other. ' + (
                f'Those kept turn as {found.by} does' if found.by else
                'The larger group is kept, and the other may be the right one: compare them with '
                'how the vehicle stood, and place the markers without symmetry'))
    return out + _long(name, times, found, groups) + _doubtful(name, times, found)


def _doubtful(name: str, times: Floats, found: Sorted) -> list[str]:
    """Return a line on gaps behind which the tracker may have flipped the body."""
    after = found.doubtful
    if not len(after):
        return []
    where = ', '.join(f'{times[k - 1]:.2f} to {times[k]:.2f} s' for k in after[:TOLD])
    more = f' and {len(after) - TOLD} more' if len(after) > TOLD else ''
    return [f'{name}: the body turns or moves farther in a gap of the poses than its speed before '
            f'and after tells, from t = {where}{more}. A maneuver, or the tracker found it with '
            'other markers: all are kept; compare the yaw on both sides']


def _long(name: str, times: Floats, found: Sorted, groups: list[int]) -> list[str]:
    """Return a line on poses left out for ``LONG`` on end, which mixed-up markers seldom need."""
    spans = [(times[first], times[end - 1], first, end) for first, end in runs(found.wrong)]
    first, last, begin, end = max(
        spans, key=lambda span: span[1] - span[0], default=(0.0, 0.0, 0, 0))
    if last - first < LONG:
        return []
    label = int(np.bincount(found.labels[begin:end] + 1).argmax()) - 1  # of most of them
    returns = _returns(found.labels, label, found.right)
    if returns and label in groups:
        return []
    return [f'{name}: all poses from t = {first:.2f} to {last:.2f} s are among them: '
            + ('the tracker had lost the body, or mixed up its markers, for so long' if returns
               else 'the recording jumps there; was it cut, or is it of two takes?')]
