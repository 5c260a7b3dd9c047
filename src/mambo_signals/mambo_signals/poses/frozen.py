"""
Frozen poses of a motion capture: while the body is lost, its last pose is repeated bit for bit.

A body at rest can repeat a pose, too, where it is simulated or its numbers are rounded, and its
poses are kept. What tells them apart is the motion beside: a body that was lost moved on in the
meantime, so that the next pose is several usual steps away; and at the end of a recording, the
motion before stops within one step, but not at the lowest height, where a simulated vehicle
lands. A body that is lost while it hovers, and is found where it was, does not show.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..resample import Bools, Floats, Ints, runs
from .outliers import step_sizes

LEAST_POSES = 3   # that are equal; two are a frame that was sent twice
BESIDE = 10       # steps before and after a run that tell the usual one
LEAP = 2.0        # [-] usual steps; a run of three poses ends with three, a rounded one with 1.7
FOLLOWS = 1.5     # [-] median periods to the next pose; beyond, a body at rest may be moved unseen
LANDED = 0.02     # m above the lowest position of a recording
MOVING = 0.2      # m/s and rad/s; a body that moves faster does not stop within a step
RESTING = 2       # runs of a body at rest in a recording without noise: at its begin and its end


def frozen(times: Floats, position: Floats, orientation: Floats) -> Bools:
    """
    Return which poses repeat the one before while the body moves on.

    The first pose of such a run is true, and kept, unless the body leaps to it.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m, z up
    orientation : (n, 4)
        Unit quaternions x y z w, body to inertial, finite.

    Returns
    -------
    (n,) mask; all False where poses that repeat are those of rounded numbers: there are more of
    them than those of a lost body.

    """
    out = np.zeros(len(times), bool)
    if len(times) <= LEAST_POSES:
        return out
    same = (np.diff(np.hstack([position, orientation]), axis=0) == 0.0).all(axis=1)
    sizes = np.stack(step_sizes(position, Rotation.from_quat(orientation)), axis=1)
    steps = np.diff(times)
    follows = steps <= FOLLOWS * np.median(steps)
    others = 0
    for first, last in runs(same).tolist():  # poses first to last are equal
        if last - first + 1 < LEAST_POSES:
            continue
        before = np.arange(max(first - BESIDE, 0), first)
        beside = np.concatenate([before, np.arange(last + 1, min(last + 1 + BESIDE, len(same)))])
        ends = (last == len(same) or not follows[last]) and (
            position[first, 2] - position[:, 2].min() > LANDED)
        leapt = _leaps(first - 1, before, sizes, follows & ~same)
        if leapt or _leaps(last, beside, sizes, follows & ~same) or (
                ends and _stops(sizes[before] / steps[before, None])):
            out[first + (not leapt):last + 1] = True
        else:
            others += 1
    found = len(runs(out))
    return out if others <= found + RESTING else np.zeros(len(times), bool)


def _leaps(step: int, beside: Ints, sizes: Floats, moved: Bools) -> bool:
    """
    Return whether a step is more than ``LEAP`` times the usual one beside it.

    Parameters
    ----------
    step
        Its number; -1 or n - 1 for none.
    beside : (k,)
        Numbers of the steps that it is compared with.
    sizes : (n - 1, 2) m, rad
    moved : (n - 1,)
        Whether the step is of one period, to another pose.

    """
    if not (0 <= step < len(sizes) and moved[step]):
        return False
    beside = beside[moved[beside] & (beside != step)]
    return len(beside) > 0 and bool(
        (sizes[step] > LEAP * np.median(sizes[beside], axis=0)).any())


def _stops(speeds: Floats) -> bool:
    """Return whether a body moves to the last of its speeds, (k, 2) m/s and rad/s."""
    return len(speeds) > 0 and bool(
        ((np.median(speeds, axis=0) > MOVING) & (speeds[-1] > 0.5 * MOVING)).any())


def describe(name: str, count: int) -> str:
    """Return a line that reports frozen poses."""
    return (f'{name}: {count} frozen pose{"s" * (count != 1)} left out, equal to the one before '
            'in all numbers while the body moved on: it was lost there')
