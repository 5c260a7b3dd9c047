"""
Poses of a motion capture that cannot be true: a tracker that flips the body, and comes back.

Between two frames no vehicle turns faster than ``FASTEST_TURN`` or moves faster than
``FASTEST``. Where a recording does, the tracker has changed its mind about which marker is which.
What it says then is turned and shifted against the truth by the same amount until it jumps
again. So the stretches between jumps are sorted by the sum of the jumps before them: stretches
with one sum are of one mind, and the mind that holds for most of the poses is right.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .resample import Bools, Floats, Ints

FASTEST_TURN = 35.0  # rad/s, 2000 deg/s: the full scale of the gyros of small drones
FASTEST = 30.0       # m/s
ALIKE_TURN = 0.5     # rad, between stretches of one mind: what it may really turn over the jumps
ALIKE = 0.3          # m
MOST = 100           # minds that are told apart: a tracker has a few, noise has one a pose


def _jumps(times: Floats, position: Floats, turns: Rotation) -> Ints:
    """Return the indices of poses that a vehicle could not reach from the previous pose."""
    steps = np.diff(times)
    steps = np.maximum(steps, np.median(steps))  # stamps of a busy machine come in bursts
    turned = (turns[:-1].inv() * turns[1:]).magnitude()
    moved = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return np.flatnonzero((turned > FASTEST_TURN * steps) | (moved > FASTEST * steps)) + 1


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
    if len(times) < 3:
        return np.zeros(len(times), bool)
    turns = Rotation.from_quat(orientation)
    begins = _jumps(times, position, turns)
    lengths = np.diff(np.concatenate([[0], begins, [len(times)]])).astype(int)
    steps, moves = turns[begins - 1].inv() * turns[begins], position[begins] - position[begins - 1]
    held, places, counts = np.zeros((MOST, 4)), np.zeros((MOST, 3)), np.zeros(MOST, int)
    turn, shift, count = Rotation.identity(), np.zeros(3), 1
    held[0], counts[0], chosen = turn.as_quat(), lengths[0], [0]
    for k, length in enumerate(lengths[1:].tolist()):
        turn, shift = turn * steps[k], shift + moves[k]
        q = turn.as_quat()
        alike = (np.abs(held[:count] @ q) > np.cos(0.5 * ALIKE_TURN)) & (
            np.linalg.norm(places[:count] - shift, axis=1) < ALIKE)
        mind = int(np.argmax(alike)) if alike.any() else count
        if mind == MOST:
            chosen.append(-1)  # of no mind that counts
            continue
        if mind == count:
            held[mind], places[mind], count = q, shift, count + 1
        else:  # what it really moves over the jumps does not add up
            turn, shift = Rotation.from_quat(held[mind]), places[mind].copy()
        counts[mind] += length
        chosen.append(mind)
    return np.repeat(np.array(chosen) != int(np.argmax(counts)), lengths)


def describe(name: str, count: int) -> str:
    """Return a line that reports rejected poses."""
    return (f'{name}: {count} pose{"s" * (count != 1)} left out that jump{"s" * (count == 1)} '
            f'faster than {np.degrees(FASTEST_TURN):.0f} deg/s or {FASTEST:g} m/s and back: the '
            'tracker lost the body')
