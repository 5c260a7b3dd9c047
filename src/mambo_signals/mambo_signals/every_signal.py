"""Every number that a bag recorded over time, at common instants."""

from __future__ import annotations

from collections.abc import Iterator

from mambo_bags.reader import Bag, BagError, Messages
import numpy as np

from . import resample
from .resample import Floats, Ints

ROWS = 20_000   # of a topic that are read; of a longer one every second, third ...
COLUMNS = 16    # of an array that are read
FIRST = ('ground_truth/odom', 'optitrack/pose', 'estimate/odom', 'onboard/odom', 'motor_pwm',
         'imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure', 'estimator/state')
"""Topics whose signals come first."""
_WITHOUT = ('header', 'covariance')  # parts of a path that is no signal


def _columns(messages: Messages, step: int) -> Iterator[tuple[str, Floats]]:
    """Yield (path, values) of every number in messages that changes."""
    for path in messages.leaves():
        if any(word in path for word in _WITHOUT):
            continue
        values = messages[path][::step]
        if values.dtype.kind not in 'fiub' or values.ndim > 2:
            continue
        wide = values.reshape(len(values), -1)[:, :COLUMNS].astype(float)
        wide[~np.isfinite(wide)] = np.nan
        for k, column in enumerate(wide.T):
            known = column[~np.isnan(column)]
            if len(known) and known.min() < known.max():
                yield path if values.ndim == 1 else f'{path}[{k}]', column


def signals(bag: Bag, instants: Ints, most: int) -> list[tuple[str, Floats]]:
    """
    Return the signals of a bag, interpolated linearly.

    Parameters
    ----------
    bag
        Topics whose messages differ in length, such as diagnostics, are left out.
    instants : (n,) ns
    most
        Largest number of signals.

    Returns
    -------
    (name, (n,)) each, in the units of the messages; NaN outside the topic and in its gaps.
    Covariances, and numbers that never change, are left out.

    """
    out: list[tuple[str, Floats]] = []
    prefix = f'{bag.namespace}/'
    known = {bag.name(topic): k for k, topic in enumerate(FIRST)}
    for messages in sorted(bag, key=lambda one: known.get(one.topic, len(known))):
        if len(out) >= most or messages.table is None:
            continue
        step = -(-len(messages) // ROWS)
        try:
            found = list(_columns(messages, step))
            stamps = messages.stamp[::step]
        except (BagError, ValueError):  # of another type than its bytes
            continue
        stamps, first = np.unique(stamps, return_index=True)
        if not found or len(stamps) < 2:
            continue
        values = np.stack([column for _, column in found[:most - len(out)]], axis=1)[first]
        there = resample.interpolate(instants, stamps, values, resample.longest_step(stamps))
        topic = messages.topic.removeprefix(prefix) if bag.namespace else messages.topic
        out += [(f'{topic} {path}', column) for (path, _), column in zip(found, there.T)]
    return out
