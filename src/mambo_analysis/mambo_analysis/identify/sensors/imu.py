"""Gyro and accelerometer: rate, resolution, noise at rest and vibration in flight."""

from __future__ import annotations

from mambo_bags.mcap_reader import BagError
import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..allan import (
    allan, Allan, bias_instability, deviation_at_rest, random_walk, white_density)
from ..recording import Recording, Stream
from .phases import airborne, SHORTEST_REST, stretch_at_rest, WEIGHT
from .statistics import repeating, resolution, robust_sigma
from .table import entry, Measured, timing

AXES = 'xyz'
LEAST = 40  # samples
SLOWEST_VIBRATION = 60.0  # Hz, of the samples: four times the lowest frequency of a vibration
HELD = 0.4  # share of samples that only hold the one before: a sensor has noise on six axes


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


def _no_vibration(recording: Recording, stream: Stream) -> str:
    """Return why a recording tells no vibration of a sensor in flight; empty if it does."""
    rate = 1.0 / float(np.median(np.diff(stream.t)))
    if rate < SLOWEST_VIBRATION:
        return f'the IMU has {rate:.0f} Hz, less than {SLOWEST_VIBRATION:g}'
    if recording.pwm is None or recording.sonar is None:
        lacking = 'motor_pwm' if recording.pwm is None else 'sonar/range'
        return f'without {lacking}, when it flies is not known'
    return ('less than 1 s in the air, by motor_pwm and a sonar above 0.5 m'
            if airborne(recording, stream.t).sum() < rate else '')


def _in_flight(recording: Recording) -> list[Measured]:
    """Return the vibration by the propellers: robust deviation above 15 Hz in the air."""
    lines = []
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        if _no_vibration(recording, stream):
            continue
        rate = 1.0 / float(np.median(np.diff(stream.t)))
        air = airborne(recording, stream.t)
        high = sosfiltfilt(butter(4, 15.0, 'high', fs=rate, output='sos'), stream.values, axis=0)
        for axis in range(3):
            lines.append(entry(f'{sensor} {AXES[axis]}', 'vibration in flight', unit,
                               robust_sigma(high[air, axis]), air.sum()))
    return lines


def _check(recording: Recording) -> None:
    """Raise BagError for a sensor that is dead, or specific forces that cannot be in m/s^2."""
    flies = bool(airborne(recording, recording.gyro.t).any())
    for sensor, stream in (('gyro', recording.gyro), ('accel', recording.accel)):
        dead = np.ptp(stream.values, axis=0) == 0.0
        if dead.all() or (flies and dead.any()):
            axes = ', '.join(AXES[k] for k in np.flatnonzero(dead))
            raise BagError(
                f'{recording.name}: imu/data_raw: {sensor} {axes} has one value throughout, as of '
                'a dead or unfilled sensor: leave the topic out')
    both = np.concatenate([recording.gyro.values, recording.accel.values], axis=1) if len(
        recording.gyro.t) == len(recording.accel.t) else recording.gyro.values
    held = repeating(both)
    if held > HELD:
        raise BagError(
            f'{recording.name}: imu/data_raw: {100.0 * held:.0f} % of the samples repeat the one '
            'before, as of a log that is faster than its sensor: leave these out')
    force = float(np.median(np.linalg.norm(recording.accel.values, axis=1)))
    if not WEIGHT[0] < force < WEIGHT[1]:  # also in flight, where thrust carries the weight
        raise BagError(
            f'{recording.name}: imu/data_raw: the median acceleration is {force:.3g} m/s^2, at '
            'rest or in flight it is 9.81: convert it to m/s^2, with gravity')


def measure(recording: Recording) -> tuple[list[Measured], dict[str, Allan]]:
    """Return all results for gyro and accelerometer; BagError if they cannot be such."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < LEAST:
        return [], {}
    _check(recording)
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


def not_measured(recording: Recording) -> list[str]:
    """Return what of gyro and accelerometer a recording does not tell, each with the reason."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < LEAST:
        return [f'gyro and accelerometer: no imu/data_raw of {LEAST} samples or more that have '
                'all six values']
    lines = []
    if stretch_at_rest(recording) is None:
        lines.append(f'noise at rest: never at rest for {SHORTEST_REST:g} s')
    if why := _no_vibration(recording, recording.gyro):
        lines.append(f'vibration in flight: {why}')
    return lines
