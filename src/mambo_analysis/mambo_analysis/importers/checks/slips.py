"""
Steps of a position that stay: a marker that slipped, a tracker or an estimator that was set anew.

Between two frames a vehicle moves about as far as between those beside them. A position that is
off once goes back at the next frame; after a slip all later ones are off. A drone whose motors
stop falls, and stays on the floor: what the velocity of the step before and an acceleration of g
explain is no slip, which is 1 mm at 100 Hz and 0.1 m at 10 Hz. Beside frames that are missing the
velocities of the steps are compared, and what ``THRUST`` and a bump explain in the time between
the two frames is no slip (:func:`_moved_so`): 6 mm over 20 ms at 100 Hz, 0.6 m over 0.2 s at
10 Hz. Rows that hold the position before (:mod:`.held_rows`) are no frames. Attitudes are not
judged: a bump at take-off turns a small vehicle as far from one frame to the next.
"""

from __future__ import annotations

from mambo_bags.reader import Bag, BagError
from mambo_signals import motion
from mambo_signals.motion import Motion
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from .held_rows import held
from .stopped import OWN

Floats = NDArray[np.float64]

BESIDE = 5    # frames on each side that say how far is usual
LEAST = 0.02  # m; in some 130 real takes there is no step as long that stays
FAR = 10.0    # times the usual scatter of the steps beside
STAYS = 0.7   # share of the step between positions BESIDE frames before and after
FALL = 1.1 * 9.81  # m/s^2; a tenth more than g, for times and positions that are not exact
CLOSE = 1.5   # median periods between frames that count as neighbours
THRUST = 3.0 * 9.81  # m/s^2; a thrust of twice the weight, as of small drones, and gravity
CLEARLY = 0.5  # of what equal frames leave of the steps beside; times that fit no better leave
#                as much
LEAP = 0.5    # m of an estimate between two samples that is told


def steps(times: Floats, position: Floats) -> list[tuple[float, float]]:
    """
    Return time [s] and length [m] of each step of a position that stands out and stays.

    Rows that hold the position before are left out.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m

    """
    new = np.flatnonzero(~held(times, position))
    times, position, holds = times[new], position[new], np.diff(new) > 1
    moves, periods = np.diff(position, axis=0), np.diff(times)
    if len(moves) <= 2 * BESIDE:
        return []
    inner = slice(BESIDE, -BESIDE)
    regular = np.zeros(len(moves), bool)
    regular[inner] = sliding_window_view(
        periods < CLOSE * np.median(periods), 2 * BESIDE + 1).all(axis=1)
    fell = np.linalg.norm(np.diff(moves, axis=0, prepend=0.0), axis=1) < FALL * periods ** 2
    moved = np.where(regular, fell, _moved_so(moves, periods))
    out = []
    for k in BESIDE + np.flatnonzero((~moved & (np.linalg.norm(moves, axis=1) > LEAST))[inner]):
        part = slice(k - BESIDE, k + 1 + BESIDE)
        excess = _excess(moves[part], periods[part], bool(regular[k]), bool(holds[part].any()))
        if excess.any():
            out.append((float(times[k + 1]), float(np.linalg.norm(excess))))
    return out


def _excess(moves: Floats, periods: Floats, regular: bool, any_held: bool) -> Floats:
    """
    Return by how much the step in the middle is too long, (3,) m; zeros if it may be motion.

    Frames may be missing between two of them, so that a step takes the time between, or a table
    holds each for one row more or less, so that its time is that of any other. The step must stand
    out and stay by both, unless the times explain the steps beside clearly better.

    Parameters
    ----------
    moves : (2 BESIDE + 1, 3) m
    periods : (2 BESIDE + 1,) s
    regular
        Whether no frames are missing.
    any_held
        Whether one of the steps was held over several rows.

    """
    by_frame = _off(moves, np.ones_like(periods))
    if regular and not any_held:
        found = [by_frame]
    else:
        found = [_off(moves, periods), by_frame]
        left = [float(np.delete(np.linalg.norm(off, axis=1), BESIDE).sum()) for off, _ in found]
        if not any_held and left[0] < CLEARLY * left[1]:
            found = found[:1]
    excess = found[0][0][BESIDE]
    for off, scatter in found:
        length = float(np.linalg.norm(off[BESIDE]))
        stays = all(part.sum(axis=0) @ off[BESIDE] > STAYS * length ** 2
                    for part in (off[BESIDE:], off[:BESIDE + 1]))  # later, earlier positions
        if not stays or length < max(LEAST, FAR * scatter) or off[BESIDE] @ excess <= 0.0:
            return np.zeros(3)
    return excess


def _off(moves: Floats, spans: Floats) -> tuple[Floats, float]:
    """
    Return what a usual pace leaves of each step, (2 BESIDE + 1, 3) m, and its usual size, m.

    Parameters
    ----------
    moves : (2 BESIDE + 1, 3) m
    spans : (2 BESIDE + 1,)
        Times of the steps, in any unit. The size is for that of the step in the middle.

    """
    pace = moves / spans[:, None]
    beside = np.delete(pace, BESIDE, axis=0)
    usual = np.median(beside, axis=0)
    scatter = spans[BESIDE] * float(np.median(np.linalg.norm(beside - usual, axis=1)))
    return moves - spans[:, None] * usual, scatter


def _moved_so(moves: Floats, periods: Floats) -> NDArray[np.bool_]:
    """
    Return whether a vehicle may have moved by each step in its time T, (n,).

    With velocities a before and b after, the way is (a + b) T / 2, and at most |b - a| T / 2 more
    or less if the velocity changes at once, as by a bump, and A T^2 / 4 if it changes with the
    acceleration A and comes back. Both are known as medians over one or ``BESIDE`` steps before
    and after, and change by A times half the time of those: A T / 4 times that time, each. What
    contradicts one of the two is no motion: a leap that fills two steps makes the next one wrong.

    Parameters
    ----------
    moves : (n, 3) m
        Of more than 2 ``BESIDE`` steps.
    periods : (n,) s

    """
    out, spans = np.ones(len(moves), bool), np.maximum(periods, np.median(periods))
    pace = moves / periods[:, None]  # a late stamp makes the time of a step too short: spans
    for count in (1, BESIDE):
        usual = np.median(sliding_window_view(pace, count, axis=0), axis=-1)
        times = sliding_window_view(periods, count).sum(axis=-1)
        before, k, after = slice(-count - 1), slice(count, -count), slice(count + 1, None)
        way = moves[k] - 0.5 * periods[k, None] * (usual[before] + usual[after])
        bump = 0.5 * periods[k] * np.linalg.norm(usual[after] - usual[before], axis=1)
        out[k] &= np.linalg.norm(way, axis=1) <= bump + 0.25 * THRUST * spans[k] * (
            spans[k] + times[before] + times[after])
    return out


def leap(one: Motion) -> list[str]:
    """Return a line on the longest step of an estimate, none if it is shorter than ``LEAP``."""
    at, length = max(steps(one.t, one.position), key=lambda step: step[1], default=(0.0, 0.0))
    return [] if length <= LEAP else [
        f'{one.name}: the position leaps by {length:.2f} m at t = {at:.2f} s and stays there: was '
        'the estimator reset? Cut the recording there']


def own_leap(bag: Bag) -> list[str]:
    """Return the line of :func:`leap` on the drone's own estimate in an imported bag."""
    try:
        return leap(motion.read(bag, OWN)) if OWN in bag else []
    except BagError:  # fewer than two usable samples, which is said by what needs them
        return []


def describe(name: str, times: Floats, position: Floats) -> list[str]:
    """Return a line on the longest step of :func:`steps`, none without; ``name`` of the topic."""
    found = steps(times, position)
    if not found:
        return []
    at, length = max(found, key=lambda one: one[1])
    return [f'{name}: the position moves by {length:.3f} m from one frame to the next at t = '
            f'{at:.2f} s and stays there: did a marker slip, was the tracker set anew, or did it '
            'repeat its last pose before? Cut the recording there']
