"""
Readings that repeat the one before: held by a table that is faster than its sensor, or equal.

A table that is faster than a sensor holds each reading for a fixed number of rows. A sensor of
coarse resolution has equal readings too, but for no fixed number, and rarely between jumps by
several steps.
"""

from __future__ import annotations

from mambo_bags.mcap_reader import BagError
from mambo_signals.resample import constant_runs
import numpy as np
from numpy.typing import NDArray

from ..recording import Recording, Stream
from .statistics import Array, proportion, STRETCHES

FEWEST = 2 * STRETCHES  # runs or repeats that tell a pattern
SLOWER = 0.1  # share of repeats between jumps, from which on the rate is wrong by a tenth
HELD = 0.8    # the same, held whatever the steps: noise correlated by 0.8 from reading to reading
#               repeats 0.76 at most
COMB = 12.0   # n times the squared mean cosine; by chance exp(-12) for each length tried
COMMON = 0.5  # mean cosine of the lengths of runs by the rows held; 1 if all are multiples
LONGEST_HOLD = 0.25  # s, of a sensor that a vehicle is steered by; what bobs repeats for longer
TOPICS = {'sonar': 'sonar/range', 'flow': 'optical_flow', 'barometer': 'barometer/pressure'}


def smallest_step(values: Array) -> float:
    """Return the least change from reading to reading, (n,); 0 if there is none."""
    sizes = np.abs(np.diff(values))
    return float(sizes[sizes > 0.0].min(initial=np.inf)) if (sizes > 0.0).any() else 0.0


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
    for rows in np.arange(max(2.0, 0.75 * shortest), 1.25 * shortest + 0.01, 0.05):
        match = float(np.cos(2.0 * np.pi * lengths / rows).mean())
        if rows * period <= LONGEST_HOLD and match > COMMON and len(lengths) * match**2 > COMB:
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
        share = (np.diff(_readings(stream), axis=0) == 0.0).all(axis=1).mean()
        raise BagError(
            f'{recording.name}: {topic}: {100.0 * share:.0f} % of the readings repeat the one '
            'before, as of a table that is faster than its sensor: import it with '
            'only_changes: true for this topic in the mapping, or leave these out')
