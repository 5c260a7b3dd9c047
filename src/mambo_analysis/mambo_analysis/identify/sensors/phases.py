"""Phases of a recording: at rest and in flight."""

from __future__ import annotations

from mambo_signals.resample import longest_run
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..recording import Recording, Stream
from .statistics import Array

REST_WINDOW = 0.5      # s
REST_GYRO, REST_ACCEL = 0.01, 0.2  # rad/s, m/s^2
SHORTEST_REST = 2.0    # s
WEIGHT = (7.8, 11.8)
"""Mean specific force that can be gravity's [m/s^2]: by 20 %, four times the error of scale and
bias of the worst accelerometer known (9.29 m/s^2 of a Rolling Spider on a bench)."""
LOWEST = 0.5           # m, above which the sonar of these drones measures
COMMAND = (180.0, 350.0)  # PWM, mean of the motors of a Mambo or Rolling Spider in flight
MAMBO = (10.0, 520.0)  # PWM, largest command of a recording in their unit
SHARE = (0.7, 1.4)     # [-] the same over the median of the running motors, in another unit
NEIGHBOURS = 9         # sonar samples, 0.36 s, whose median an outlier leaves


def stretch_at_rest(recording: Recording) -> slice | None:
    """Return the longest stretch of IMU samples at rest; None if it is shorter than 2 s."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < 3:
        return None
    rate = 1.0 / np.median(np.diff(recording.gyro.t))
    w = max(int(round(REST_WINDOW * rate)), 2)
    n = len(recording.gyro.t) // w
    if n == 0:
        return None
    quiet = np.ones(n, bool)
    for stream, limit in ((recording.gyro, REST_GYRO), (recording.accel, REST_ACCEL)):
        quiet &= (stream.values[:n * w].reshape(n, w, 3).std(axis=1) < limit).all(axis=1)
    force = np.linalg.norm(recording.accel.values[:n * w].reshape(n, w, 3).mean(axis=1), axis=1)
    quiet &= (force > WEIGHT[0]) & (force < WEIGHT[1])  # what falls is quiet, too
    rest = longest_run(quiet)
    if (rest.stop - rest.start) * w / rate < SHORTEST_REST:
        return None
    return slice(rest.start * w, rest.stop * w)


def heights(sonar: Stream, at: Array) -> Array:
    """Return the height by the sonar at times, (n,) m: the median of its neighbours."""
    heard = np.isfinite(sonar.values)
    if not heard.any():
        return np.full(len(at), np.nan)
    level = median_filter(sonar.values[heard], NEIGHBOURS, mode='nearest')
    return np.interp(at, sonar.t[heard], level)


def airborne(recording: Recording, at: Array) -> NDArray[np.bool_]:
    """
    Return a mask of the times in flight: usual motor commands, and the sonar above 0.5 m.

    Usual is a mean PWM from 180 to 350, as of a Mambo. Commands of another vehicle, told by the
    largest, are from 0.7 to 1.4 of the median of those that run the motors above 0.5 m.
    """
    if recording.pwm is None or recording.sonar is None or len(recording.pwm.t) == 0:
        return np.zeros(len(at), bool)
    mean = np.abs(recording.pwm.values).mean(axis=1)
    high = heights(recording.sonar, recording.pwm.t) > LOWEST
    limits = np.array(COMMAND)
    if not MAMBO[0] <= np.abs(recording.pwm.values).max() <= MAMBO[1]:
        flown = mean[high & (mean > 0.0)]
        if not len(flown):
            return np.zeros(len(at), bool)
        limits = np.median(flown) * np.array(SHARE)
    command = np.interp(at, recording.pwm.t, mean)
    return ((command > limits[0]) & (command < limits[1])
            & (heights(recording.sonar, at) > LOWEST))
