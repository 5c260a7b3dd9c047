"""
Readings that repeat the one before: held by a table that is faster than its sensor, or equal.

A table that is faster than a sensor holds each reading for a fixed number of rows. A sensor of
coarse resolution has equal readings too, but for no fixed number, and rarely between jumps by
several steps. Where only changes were recorded no two neighbours are equal, and an equal reading
cannot be told from a lost one.
"""

from __future__ import annotations

from mambo_bags.mcap_reader import BagError
from mambo_signals.resample import constant_runs
import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from ..allan import Interval
from ..recording import Recording, Stream
from .statistics import Array, proportion, repeating, STRETCHES

FEWEST = 2 * STRETCHES  # runs or repeats that tell a pattern
SLOWER = 0.1  # share of repeats between jumps, from which on the rate is wrong by a tenth
HELD = 0.8    # the same, held whatever the steps: noise correlated by 0.8 from reading to reading
#               repeats 0.76 at most
COMB = 12.0   # n times the squared mean cosine; by chance exp(-12) for each length tried
COMMON = 0.5  # mean cosine of the lengths of runs by the rows held; 1 if all are multiples
LONGEST_HOLD = 0.25  # s, of a sensor that a vehicle is steered by; what bobs repeats for longer
SINGLE = 0.25  # share of single readings between changes, from which on rows are readings
OFTEN = 0.4   # share of equal neighbours, from which on they are noted; as `HELD` of the IMU
CHANCE = 1e-4  # of so few equal neighbours among readings that were all kept
TOPICS = {'sonar': 'sonar/range', 'flow': 'optical_flow', 'barometer': 'barometer/pressure'}
HIDDEN = 0.3  # steps, half-way between the sizes 0 and 0.6 of a rounded noise
WHOLE = 0.9   # steps, half-way between the sizes 0.6 and 1.2
MOST_EQUAL = 100  # readings in a row; the longest of a hover in steps of 1 cm had 87
NOT_TOLD = Interval(np.nan, np.nan, np.nan)


def smallest_step(values: Array) -> float:
    """Return the least change from reading to reading, (n,); 0 if there is none."""
    sizes = np.abs(np.diff(values))
    steps = sizes[sizes > 0.0]
    return float(steps.min()) if len(steps) else 0.0


def _readings(stream: Stream) -> Array:
    """Return the readings that are known, (n, k)."""
    rows = stream.values.reshape(len(stream.t), -1)
    return rows[np.isfinite(rows).all(axis=1)]


def _runs(rows: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_], int]:
    """
    Return the runs of equal readings, (n, k), but the first and last and those of zeros.

    Returns
    -------
    lengths : (m,)
        Readings of each run.
    jumps : (m,)
        The readings jump before and after by more than a step.
    returns : (m,)
        They change by a step and back.
    singles
        Changes of one axis by one step, in all.

    """
    steps = np.array([smallest_step(x) for x in rows.T])
    steps = np.where(steps > 0.0, steps, 1.0)
    moves = np.diff(rows, axis=0) / steps
    singles = int((np.rint(np.abs(moves)).sum(axis=1) == 1.0).sum())
    runs = constant_runs(rows)[1:-1]
    runs = runs[rows[runs[:, 0]].any(axis=1)]  # a flow of zeros is no motion, or no texture
    before, after = moves[runs[:, 0] - 1], moves[runs[:, 1] - 1]
    jumps = (np.abs(before).max(axis=1, initial=0.0) > 1.5) & (
        np.abs(after).max(axis=1, initial=0.0) > 1.5)
    returns = (before * after < 0.0).any(axis=1) & ~jumps
    return runs[:, 1] - runs[:, 0], jumps, returns, singles


def _common_length(lengths: NDArray[np.int64], period: float) -> bool:
    """Return whether the lengths of runs, (n,), are multiples of about the shortest of them."""
    if len(lengths) < FEWEST:
        return False
    shortest = float(np.quantile(lengths, 0.05))
    longest = min(1.25 * shortest, LONGEST_HOLD / period)
    for rows in np.arange(max(2.0, 0.75 * shortest), longest + 0.01, 0.05):
        match = float(np.cos(2.0 * np.pi * lengths / rows).mean())
        if match > COMMON and len(lengths) * match**2 > COMB:
            return True
    return False


def held(stream: Stream) -> bool:
    """Return whether each reading of a sensor is held over several rows."""
    lengths, jumps, returns, singles = _runs(_readings(stream))
    again, n = int((lengths[jumps] > 1).sum()), int(jumps.sum())
    if again >= FEWEST and (again > max(SLOWER * n, singles) or proportion(again, n).low > HELD):
        return True
    return _common_length(lengths[jumps | returns], float(np.median(np.diff(stream.t))))


def check(recording: Recording) -> None:
    """Raise BagError for a sonar, flow or barometer whose readings are held over several rows."""
    for name, topic in TOPICS.items():
        stream = getattr(recording, name)
        if stream is None or len(_readings(stream)) < 2 * FEWEST or not held(stream):
            continue
        share = 100.0 * repeating(_readings(stream))
        raise BagError(
            f'{recording.name}: {topic}: {share:.0f} % of the readings repeat the one before, as '
            'of a table that is faster than its sensor: import it with only_changes: true for '
            'this topic in the mapping, or leave these out')


def undecided(stream: Stream) -> bool:
    """Return whether many readings equal the one before, and nothing tells why."""
    rows = _readings(stream)
    if len(rows) < 2 or repeating(rows) < OFTEN:
        return False
    lengths, jumps, returns, _ = _runs(rows)
    between = lengths[jumps | returns]
    return len(between) < FEWEST or float((between == 1).mean()) < SINGLE


def only_changes(recording: Recording, sensor: str) -> bool:
    """
    Return whether a sensor's equal readings were left out, by the import or by the readings.

    Of readings whose changes have one peak, none is at least as frequent as one step up or one
    step down, whichever is rarer.
    """
    if recording.held or TOPICS[sensor] in recording.changes:
        return True
    values = _readings(getattr(recording, sensor))[:, 0]
    moves = np.diff(values)
    step = smallest_step(values)
    near = (np.abs(moves) > 0.0) & (np.abs(moves) < 1.5 * step)
    rarer = min((near & (moves > 0.0)).sum(), (near & (moves < 0.0)).sum())
    return bool(poisson.cdf((moves == 0.0).sum(), rarer) < CHANCE)


def rate_note(recording: Recording, sensor: str) -> str:
    """Return what repeated readings leave open about a rate; empty if nothing."""
    if recording.held:
        return ''
    if only_changes(recording, sensor):
        return 'of changes: equal readings are left out'
    if undecided(getattr(recording, sensor)):
        return 'of rows: whether readings are held or equal is not to be told'
    return ''


def period(t: Array) -> float:
    """Return the most frequent time between neighbours, within a quarter, s: many are absent."""
    gaps = np.sort(np.diff(t))
    ends = np.searchsorted(gaps, 1.25 * gaps, side='right')
    first = int(np.argmax(ends - np.arange(len(gaps))))
    return float(np.median(gaps[first:ends[first]]))


def filled(t: Array, values: Array) -> Array:
    """
    Return readings, (n,), at times (n,) s, with each absent one equal to the one before.

    Of a pause there are ``MOST_EQUAL``, however long it is.
    """
    counts = np.clip(np.rint(np.diff(t) / period(t)), 1, MOST_EQUAL).astype(int)
    return np.repeat(values, np.r_[counts, 1])


def hidden(step: float) -> tuple[Interval, str]:
    """Return that there is no number for a noise below a step, and the note that says so."""
    return NOT_TOLD, f'not to be told: hidden by steps of {step:.3g}'


def shown(found: Interval, step: float, full: Interval | None = None) -> tuple[Interval, str]:
    """
    Return a noise as far as the recording shows it, and a note.

    The sizes that rounding leaves to a noise below a step are 0 and 0.6 steps, by
    :func:`.statistics.robust_sigma`. With 0, any noise below half a step may be hidden. With 0.6,
    its interval holds the noise: from 0.1 to 0.85 steps, hovering and moving, with 40 seeds each,
    wherever that size was found. Where equal readings were left out, neither size is told.

    Parameters
    ----------
    found
        By the readings.
    step
        Smallest change of the readings.
    full
        With an equal reading for each absent one, of a sensor whose equal readings were left out.
        The interval holds both.

    """
    least = found.value if full is None else min(found.value, full.value)
    if not step:
        return NOT_TOLD, 'not to be told: all readings are equal'
    if least < step * (HIDDEN if full is None else WHOLE):
        return hidden(step)
    if full is not None:
        found = Interval(found.value, min(found.low, full.low), max(found.high, full.high))
    return found, ''
