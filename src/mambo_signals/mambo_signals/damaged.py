"""Samples of a recording that are no numbers, in words."""

from __future__ import annotations

from mambo_bags.reader import Bag, BagError, FieldError
import numpy as np

FIELDS = {
    'imu/data_raw': {'gyro': ('angular_velocity',), 'accelerometer': ('linear_acceleration',)},
    'barometer/pressure': {'barometer': ('fluid_pressure',)}}
"""Sensors of a topic and their fields. Range and flow may be no numbers: nothing was seen."""


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
                values = np.column_stack([messages[field] for field in fields])
                stamps = messages.stamp
            except (BagError, FieldError, KeyError):  # of another type: its reader says so
                continue
            finite = np.isfinite(values)
            wrong = np.flatnonzero(~finite[:, finite.any(axis=0)].all(axis=1))
            if len(wrong):
                out.append(f'{messages.topic}: {len(wrong)} of {len(values)} samples of the '
                           f'{name} are not finite, the first at '
                           f'{stamps[wrong[0]] * 1e-9:.3f} s: no estimator uses them')
    return out
