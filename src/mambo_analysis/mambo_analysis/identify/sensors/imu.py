"""Gyro and accelerometer: rate, resolution, noise at rest and vibration in flight."""

from __future__ import annotations

from mambo_bags.mcap_reader import BagError
import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..allan import (
    allan, Allan, bias_instability, deviation_at_rest, Interval, random_walk, white_density)
from ..recording import Recording, Stream
from .phases import airborne, SHORTEST_REST, stretch_at_rest, WEIGHT
from .repeats import hidden, WHOLE
from .rounding import rounding, Rounding, without
from .statistics import Array, FEW, repeating, resolution, robust_sigma
from .table import entry, Measured, timing

AXES = 'xyz'
LEAST = 40  # samples
VIBRATION = 15.0  # Hz, lowest frequency of a vibration
SLOWEST_VIBRATION = 4.0 * VIBRATION  # Hz, of the samples
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
            step = _step(stream, axis)
            by = rounding(x, rate, step)
            if by is None:
                told = [hidden(step)] * len(_quantities(sensor))
            else:
                curves[name] = allan(x, rate)
                told = _noise(x, rate, curves[name], by)
            lines += [entry(name, quantity, f'{unit}{per}', found, len(x), note)
                      for (quantity, per), (found, note) in zip(_quantities(sensor), told)]
    return lines, curves


def _quantities(sensor: str) -> tuple[tuple[str, str], ...]:
    """Return what :func:`_noise` tells of a sensor, and what its unit is divided by."""
    walk = 'angle' if sensor == 'gyro' else 'velocity'
    return (('noise at rest', ''), (f'{walk} random walk', '/sqrt(Hz)'),
            ('bias instability', ''), ('bias random walk', '/sqrt(s)'))


def _noise(x: Array, rate: float, curve: Allan, by: Rounding) -> list[tuple[Interval, str]]:
    """Return noise, white density, bias instability and walk of samples, (n,), and notes."""
    lowest, reached, share = bias_instability(curve)
    walk = random_walk(x, rate)
    return [
        (without(deviation_at_rest(x), by), ''),
        (without(white_density(x, rate, walk), by, 1.0 / rate), ''),
        (without(lowest, by, share), '') if reached else (
            lowest, 'at most: the curve still falls'),
        (walk, '')]


def _step(stream: Stream, axis: int) -> float:
    """Return the resolution of an axis in the unit of the stream; 0 if it has none."""
    found = resolution(stream.values[:, axis])
    return found.value if found else 0.0


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
        high = sosfiltfilt(
            butter(4, VIBRATION, 'high', fs=rate, output='sos'), stream.values, axis=0)
        for axis in range(3):
            step = _step(stream, axis)
            found, note = robust_sigma(high[air, axis]), ''
            if found.value < WHOLE * step:
                found, note = hidden(step)
            else:
                found = without(found, Rounding(step**2 / 12.0, 0.0), 1.0 - 2.0 * VIBRATION / rate)
            lines.append(entry(
                f'{sensor} {AXES[axis]}', 'vibration in flight', unit, found, air.sum(), note))
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
        many, few = ([r for r in (resolution(x, fewest) for x in stream.values.T) if r]
                     for fewest in (FEW, 2))
        if found := many or few:
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
