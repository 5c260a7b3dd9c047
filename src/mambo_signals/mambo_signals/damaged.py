"""Samples and poses of a recording that are no numbers, in words."""

from __future__ import annotations

from mambo_bags.reader import Bag, BagError, FieldError
import numpy as np

from .motion import KINDS, MOTIONS
from .resample import Bools, Floats

FIELDS = {
    'imu/data_raw': {'gyro': ('angular_velocity',), 'accelerometer': ('linear_acceleration',)},
    'barometer/pressure': {'barometer': ('fluid_pressure',)}}
"""Sensors of a topic and their fields. Range and flow may be no numbers: nothing was seen."""


def _wrong(values: Floats) -> Bools:
    """
    Return which rows of (n, k) have a value that is not finite, (n,).

    An axis that is never finite was not measured, and does not count.
    """
    finite = np.isfinite(values)
    return ~finite[:, finite.any(axis=0)].all(axis=1)


def not_finite(bag: Bag) -> list[str]:
    """
    Return a line about each sensor some of whose samples are infinite or not a number.

    An axis that is never finite was not measured, and does not count.
    """
    out = []
    for topic, sensors in FIELDS.items():
        if topic not in bag:
            continue
        messages = bag[topic]
        for name, fields in sensors.items():
            try:
                wrong = _wrong(np.column_stack([messages[field] for field in fields]))
                stamps = messages.stamp
            except (BagError, FieldError, KeyError):  # of another type: its reader says so
                continue
            if wrong.any():
                out.append(f'{messages.topic}: {wrong.sum()} of {len(wrong)} samples of the '
                           f'{name} are not finite, the first at '
                           f'{stamps[wrong.argmax()] * 1e-9:.3f} s: no estimator uses them')
    return out


def poses_not_finite(bag: Bag) -> list[str]:
    """
    Return a line about each topic of ``MOTIONS`` with positions, or attitudes, not finite.

    An axis that is never finite was not measured, and does not count.
    """
    out = []
    for topic in MOTIONS:
        if topic not in bag or (messages := bag[topic]).type_name not in KINDS:
            continue
        try:
            t, values = messages.t, (messages.position, messages.orientation)
        except BagError:  # of an unknown encoding: its reader says so
            continue
        for name, wrong in zip(('positions', 'attitudes'), map(_wrong, values)):
            if wrong.any():
                last = float(t[~wrong].max(initial=-np.inf))
                end = (f'. None of the last {t.max() - last:.3f} s is: the last one that counts '
                       f'is at {last:.3f} s') if -np.inf < last < t.max() else ''
                out.append(f'{messages.topic}: {wrong.sum()} of {len(wrong)} {name} are not '
                           f'finite, the first at {t[wrong].min():.3f} s: they are not compared'
                           f'{end}')
    return out
