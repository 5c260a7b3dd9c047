"""
Health of the sensors: which ones the filters use now, and the faults of the others.

A sensor is healthy if one of its samples has been used recently; single outliers are counted
elsewhere and do not make it unhealthy. Where a sensor cannot measure (flow on the floor) no sample
is expected. Holds no equation of the thesis.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.vector import Vec3
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters

from .blocks import Vec2

GYRO, ACCELEROMETER, SONAR, OPTICAL_FLOW, BAROMETER = range(5)  # as in EstimatorState.msg
GOOD, OUT_OF_REACH, MISSING, NOT_FINITE, IMPLAUSIBLE, STUCK = range(6)  # likewise

Five = tuple[bool, bool, bool, bool, bool]
NAMES = ('gyro', 'accelerometer', 'sonar', 'optical flow', 'barometer')
ROUGH_TIME = 0.05  # s, over which the roughness of a signal is averaged
NOISE_TIME = 0.5   # s, over which its noise is
LARGEST_NOISE = 1.0  # unit of the sensor


class Sensor(NamedTuple):
    """Memory of one sensor."""

    fault: int       # why its last sample was not used, GOOD: it was
    age: float         # s, since a sample was used or the sensor out of reach
    sample_age: float     # s, likewise since a sample came
    equal: int         # [-] samples in a row that were equal to the one before
    # unit of the sensor, its last sample; a sample of fewer components repeats them
    value: Vec3
    roughness: float   # the same squared, mean square of its differences from sample to sample
    not_finite: int    # [-] samples since start
    noise: Vec3        # the same squared, variance of one used sample


class Sensors(NamedTuple):
    """All of them, in the order of ``NAMES``."""

    gyro: Sensor  # body rate
    accel: Sensor  # specific force
    sonar: Sensor  # slant range
    flow: Sensor  # optical flow
    barometer: Sensor  # pressure


class Health(NamedTuple):
    """Published health of the sensors, (5,) each, in the order of ``NAMES``."""

    health: tuple[int, int, int, int, int]            # GOOD, ...
    age: tuple[float, float, float, float, float]     # s, as of Sensor
    not_finite: tuple[int, int, int, int, int]        # [-] samples since start


class Limits(NamedTuple):
    """Largest age of the last used sample, s."""

    imu: float  # s, of gyro and accelerometer
    sonar: float  # s
    flow: float  # s
    barometer: float  # s


NEW = Sensor(
    GOOD, 0.0, 0.0, 0, (math.nan, math.nan, math.nan), 0.0, 0, (0.0, 0.0, 0.0))
START = Sensors(NEW, NEW, NEW, NEW, NEW)


@jit
def is_none(x: Vec3) -> bool:
    """Tell whether all numbers are NaN: there is no sample."""
    return math.isnan(x[0]) and math.isnan(x[1]) and math.isnan(x[2])


@jit
def is_finite(x: Vec3) -> bool:
    """Tell whether all numbers are finite."""
    return math.isfinite(x[0]) and math.isfinite(x[1]) and math.isfinite(x[2])


@jit
def repeats(s: Sensor, value: Vec3) -> int:
    """Return how many samples in a row have equalled the one before, with this one."""
    x = s.value
    same = value[0] == x[0] and value[1] == x[1] and value[2] == x[2]
    return s.equal + 1 if same else 0


@jit
def roughness(s: Sensor, value: Vec3, dt: float) -> float:
    """
    Return the mean square difference of successive samples, with this one; 0 if unavailable.

    Parameters
    ----------
    s
        Of the samples before.
    value : (3,) unit of the sensor
        New.
    dt : s
        Since the one before.

    """
    old, weight = s.value, min(1.0, dt / ROUGH_TIME)
    x, y, z = value[0] - old[0], value[1] - old[1], value[2] - old[2]
    rough = (1.0 - weight) * s.roughness + weight * (x * x + y * y + z * z)
    return rough if math.isfinite(rough) else 0.0


@jit
def _variance(old: float, before: float, now: float, weight: float) -> float:
    """Return an averaged variance with two successive samples more; they differ by twice it."""
    if not math.isfinite(now - before):
        return old
    step = min(abs(now - before), LARGEST_NOISE)
    return old + weight * (0.5 * step * step - old)


@jit
def noise(s: Sensor, value: Vec3, dt: float) -> Vec3:
    """
    Return the variance of one sample about the motion, each number, with this one.

    That of white noise is half the mean square difference of successive samples. Vibration above
    a quarter of the sampling rate has less, so that for it this is too large, by 1.5 where it is
    a difference of white draws. A step beyond ``LARGEST_NOISE`` is a shock and counts as so much.

    Parameters
    ----------
    s
        Of the samples before.
    value : (3,) unit of the sensor
        New.
    dt : s
        Since the one before.

    """
    weight, x = min(1.0, dt / NOISE_TIME), s.value
    return (
        _variance(s.noise[0], x[0], value[0], weight),
        _variance(s.noise[1], x[1], value[1], weight),
        _variance(s.noise[2], x[2], value[2], weight))


@jit
def observe(
    s: Sensor, dt: float, value: Vec3, came: bool, used: bool, stuck: bool, in_reach: bool,
) -> Sensor:
    """
    Return the memory of a sensor after a step.

    Parameters
    ----------
    s
        Before the step.
    dt : s
        Its length.
    value : (3,) unit of the sensor
        New sample.
    came
        Whether there is one.
    used
        Whether the filters used it.
    stuck
        Whether it counts as a repetition of the one before.
    in_reach
        Whether the sensor can measure at the estimated state.

    """
    fault, finite = s.fault, is_finite(value)
    if used:
        fault = GOOD
    elif not in_reach:
        fault = OUT_OF_REACH
    elif came:
        fault = IMPLAUSIBLE if finite else NOT_FINITE
        fault = STUCK if stuck and finite else fault
    age = 0.0 if used or not in_reach else s.age + dt
    sample_age = 0.0 if came or not in_reach else s.sample_age + dt
    if not came:
        return Sensor(
            fault, age, sample_age, s.equal, s.value, s.roughness, s.not_finite, s.noise)
    return Sensor(
        fault, age, sample_age, repeats(s, value), value, roughness(s, value, dt),
        s.not_finite + (0 if finite else 1), noise(s, value, dt) if used else s.noise)


@jit_inside
def observe_all(
    s: Sensors, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2, pressure: float,
    used: Five, stuck: Five, in_reach: tuple[bool, bool],
) -> Sensors:
    """
    Return the memory of all sensors after a step.

    Parameters
    ----------
    s
        Before the step.
    dt : s
        Its length.
    gyro, accel, sonar, flow, pressure
        New samples, as an estimator gets them; NaN: none.
    used, stuck : (5,)
        As for :func:`observe`, in the order of ``NAMES``.
    in_reach : (2,)
        Likewise of sonar and flow; the others can measure anywhere.

    """
    came = not (is_none(gyro) and is_none(accel))
    looked = not (math.isnan(flow[0]) and math.isnan(flow[1]))
    return Sensors(
        observe(s.gyro, dt, gyro, came, used[0], stuck[0], True),
        observe(s.accel, dt, accel, came, used[1], stuck[1], True),
        observe(s.sonar, dt, (sonar, sonar, sonar), not math.isnan(sonar), used[2], stuck[2],
                in_reach[0]),
        observe(s.flow, dt, (flow[0], flow[1], flow[1]), looked, used[3], stuck[3], in_reach[1]),
        observe(s.barometer, dt, (pressure, pressure, pressure), not math.isnan(pressure),
                used[4], stuck[4], True))


def limits(params: Any) -> Limits:
    """Return the limits among an estimator's parameters, ``max_*_age`` in s."""
    return Limits(float(params.max_imu_age), float(params.max_sonar_age),
                  float(params.max_flow_age), float(params.max_barometer_age))


@dataclass(frozen=True)
class AgeParams(Parameters):
    """Parameters of every built-in filter: gravity, and the largest ages of used samples."""

    gravity: float = quantity(9.81, 'm/s^2', 9.7, 9.9, 'standard value; the thesis gives none')
    max_sonar_age: float = quantity(
        1.0, 's', 0.01, 1e4, 'without a used range for longer the status is dead reckoning')
    max_flow_age: float = quantity(
        0.5, 's', 0.01, 1e4, 'without used flow for longer the status is dead reckoning')
    max_imu_age: float = quantity(
        0.1, 's', 0.005, 1e4, 'unhealthy without a used inertial sample for longer')
    max_barometer_age: float = quantity(
        1.0, 's', 0.01, 1e4, 'unhealthy without plausible pressure for longer')

    @derived('s', 'max_imu_age', 'max_barometer_age')
    def limits(self) -> Limits:
        """Largest age of the last used sample."""
        return limits(self)


@jit
def _state(s: Sensor, limit: float) -> int:
    """Return the health of a sensor whose samples should be used at least each ``limit`` s."""
    if s.fault == OUT_OF_REACH:
        return OUT_OF_REACH
    if s.age <= limit:
        return GOOD
    return MISSING if s.sample_age > limit or s.fault == GOOD else s.fault


@jit
def report(s: Sensors, p: Limits) -> Health:
    """Return the published health of all sensors."""
    return Health(
        (_state(s.gyro, p.imu), _state(s.accel, p.imu), _state(s.sonar, p.sonar),
         _state(s.flow, p.flow), _state(s.barometer, p.barometer)),
        (s.gyro.age, s.accel.age, s.sonar.age, s.flow.age, s.barometer.age),
        (s.gyro.not_finite, s.accel.not_finite, s.sonar.not_finite, s.flow.not_finite,
         s.barometer.not_finite))


_TROUBLES = {
    MISSING: 'no {name} for {age:.1f} s', NOT_FINITE: '{name} not finite for {age:.1f} s',
    IMPLAUSIBLE: '{name} implausible for {age:.1f} s', STUCK: '{name} stuck for {age:.1f} s'}


def complaints(
    h: Health, not_finite: tuple[int, ...], dropped: tuple[int, ...],
) -> list[str]:
    """
    Return the complaints about the sensors, one text each; empty if all are healthy.

    Parameters
    ----------
    h
        Of now.
    not_finite : (5,)
        New samples that were not finite.
    dropped : (4,)
        New samples of IMU, sonar, flow and barometer that were late, repeated or out of order.

    """
    out = [
        _TROUBLES[state].format(name=name, age=age)
        for name, state, age in zip(NAMES, h.health, h.age, strict=True) if state in _TROUBLES]
    out += [f'{name}: {count} samples not finite'
            for name, count in zip(NAMES, not_finite, strict=True) if count]
    out += [f'{name}: {count} samples late, repeated or out of order'
            for name, count in zip(('imu', *NAMES[SONAR:]), dropped, strict=True) if count]
    return out
