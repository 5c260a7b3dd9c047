"""Gyro and accelerometer: rate, resolution, noise at rest and vibration in flight."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..allan import (
    allan, Allan, bias_instability, deviation_at_rest, random_walk, white_density)
from ..recording import Recording
from .phases import airborne, stretch_at_rest
from .statistics import resolution, robust_sigma
from .table import entry, Measured, timing

AXES = 'xyz'


def _at_rest(recording: Recording, rest: slice) -> tuple[list[Measured], dict[str, Allan]]:
    """Return the noise of the IMU at rest, and its Allan curves by signal."""
    lines, curves = [], {}
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        rate = 1.0 / float(np.median(np.diff(stream.t)))
        for axis in range(3):
            x, name = stream.values[rest, axis], f'{sensor} {AXES[axis]}'
            if not x.std() > 0.0:
                continue
            n = len(x)
            curve = curves[name] = allan(x, rate)
            lowest, reached = bias_instability(curve)
            walk = 'angle' if sensor == 'gyro' else 'velocity'
            lines += [
                entry(name, 'noise at rest', unit, deviation_at_rest(x), n),
                entry(name, f'{walk} random walk', f'{unit}/sqrt(Hz)', white_density(x, rate), n),
                entry(name, 'bias instability', unit, lowest, n,
                      '' if reached else 'at most: the curve still falls'),
                entry(name, 'bias random walk', f'{unit}/sqrt(s)', random_walk(x, rate), n)]
    return lines, curves


def _in_flight(recording: Recording) -> list[Measured]:
    """Return the vibration by the propellers: robust deviation above 15 Hz in the air."""
    lines = []
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        rate = 1.0 / float(np.median(np.diff(stream.t)))
        air = airborne(recording, stream.t)
        if rate < 60.0 or air.sum() < rate:
            continue
        high = sosfiltfilt(butter(4, 15.0, 'high', fs=rate, output='sos'), stream.values, axis=0)
        for axis in range(3):
            lines.append(entry(f'{sensor} {AXES[axis]}', 'vibration in flight', unit,
                               robust_sigma(high[air, axis]), air.sum()))
    return lines


def measure(recording: Recording) -> tuple[list[Measured], dict[str, Allan]]:
    """Return all results for gyro and accelerometer."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < 40:
        return [], {}
    lines, curves = timing('imu', recording.gyro), {}
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        found = [r for r in (resolution(stream.values[:, k]) for k in range(3)) if r]
        if found:
            best = min(found, key=lambda r: r.high - r.low)
            lines.append(entry(sensor, 'resolution', unit, best, len(stream.t)))
    rest = stretch_at_rest(recording)
    if rest is not None:
        more, curves = _at_rest(recording, rest)
        lines += more
    return lines + _in_flight(recording), curves
