"""
Inertial measurement unit: body rate and specific force with noise, biases and resolution.

The accelerometer measures ``(F_D - f e3)/m`` in body axes (plus the reaction of the floor), not an
acceleration in the inertial frame. Defaults are measured on the vehicle's predecessor with the
same toolbox (RollingSpiderEdu): ``noisedata.mat`` at rest, the calibration values and the free
flights with propellers (``RSdata*``, ``p9_trial*``, ``square_1``). sensors.md lists them with
the command that measures them.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import expm1
from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import jit
from mambo_model.motion.vector import add, mul, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters, values_type
import numpy as np
from numpy.random import Generator

from .sampling import clamp, quantise, STEP


class ImuMemory(NamedTuple):
    """Biases of this flight and the last draws of the vibration."""

    started: bool     # the biases have been drawn
    gyro_bias: Vec3   # (3,) rad/s, body FRD
    accel_bias: Vec3  # (3,) m/s^2, body FRD
    warmth: float     # 1, share of the warm-up that has passed
    gyro_draw: Vec3   # (3,) 1
    accel_draw: Vec3  # (3,) 1


class ImuSample(NamedTuple):
    """One reading."""

    gyro: Vec3   # (3,) rad/s, body FRD
    accel: Vec3  # (3,) m/s^2, body FRD, specific force: (0, 0, -g) at rest and level


_ZERO: Vec3 = (0.0, 0.0, 0.0)
START = ImuMemory(False, _ZERO, _ZERO, 0.0, _ZERO, _ZERO)


@dataclass(frozen=True)
class ImuParams(Parameters):
    """
    Noise of the inertial measurement unit, one sample each 5 ms.

    ``*_noise`` is white, at rest. ``*_vibration`` is what the turning propellers add, for a thrust
    equal to the weight and proportional to thrust: the difference of successive white draws, as
    the measured spectrum lies above 20 Hz and is some 25 times lower below 10 Hz than that of
    white noise of the same size.

    The bias is that of the drone plus what changes when it is turned on; then it walks, and warms
    up as ``*_warm_up (1 - exp(-t/warm_up_time))``. ``drone`` is a serial number: one number, one
    constant bias, drawn with ``*_bias``, to which each flight adds ``*_turn_on``. Drone 0 is
    another one in each flight: all of ``*_bias`` is drawn anew.
    """

    gyro_noise: Vec3 = quantity(
        (0.00058, 0.00065, 0.00062), 'rad/s', 0.0, 1.0,
        'standard deviation of noisedata.mat less its resolution/sqrt(12)')
    accel_noise: Vec3 = quantity(
        (0.0165, 0.0153, 0.0216), 'm/s^2', 0.0, 10.0, 'standard deviation of noisedata.mat')
    gyro_vibration: Vec3 = quantity(
        (0.013, 0.012, 0.052), 'rad/s', 0.0, 10.0,
        'median of 8 free flights, above 15 Hz, in the air at mean PWM 180 to 350 '
        '(identify_sensors)')
    accel_vibration: Vec3 = quantity((1.1, 1.1, 1.3), 'm/s^2', 0.0, 100.0, 'as gyro_vibration')
    gyro_bias: Vec3 = quantity(
        (0.016, 0.018, 0.016), 'rad/s', 0.0, 1.0, 'rms of the calibration values of 12 flights')
    accel_bias: Vec3 = quantity(
        (0.3, 0.15, 0.4), 'm/s^2', 0.0, 5.0,
        'calibration values of 11 flights less gravity; x and y hold the slope of the floor too')
    drone: int = quantity(
        0, '1', 0, 2**31 - 1, 'design choice: serial number; 0: another drone in each flight')
    gyro_turn_on: Vec3 = quantity(
        (0.0026, 0.0020, 0.0019), 'rad/s', 0.0, 1.0,
        'calibration values of 8 flights in three series, less the mean of each series, pooled')
    accel_turn_on: Vec3 = quantity(
        (0.076, 0.076, 0.076), 'm/s^2', 0.0, 5.0,
        'z as gyro_turn_on; x and y, where the slope of the floor is unknown, as z')
    gyro_warm_up: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'rad/s', -1.0, 1.0,
        'design choice; recordings of at most 18 s cannot show it; 0: no warm-up')
    accel_warm_up: Vec3 = quantity((0.0, 0.0, 0.0), 'm/s^2', -5.0, 5.0, 'as gyro_warm_up')
    warm_up_time: float = quantity(60.0, 's', 0.1, 3600.0, 'assumed: time constant')
    gyro_walk: float = quantity(
        1.5e-5, 'rad/s/sqrt(s)', 0.0, 0.01,
        'calibration values of two flights 468 s apart: rms change 3.3e-4 rad/s')
    accel_walk: float = quantity(
        3.6e-4, 'm/s^2/sqrt(s)', 0.0, 0.1, 'as gyro_walk, z axis: 7.7e-3 m/s^2')
    gyro_resolution: float = quantity(
        math.radians(1.0 / 16.4), 'rad/s', 0.0, 1.0, 'steps in noisedata.mat; 0: none')
    accel_resolution: float = quantity(
        9.80665 / 8192.0, 'm/s^2', 0.0, 1.0, 'steps in noisedata.mat; 0: none')
    gyro_range: float = quantity(
        math.radians(2000.0), 'rad/s', 0.1, 1000.0, '16 bit of gyro_resolution')
    accel_range: float = quantity(4.0 * 9.80665, 'm/s^2', 10.0, 1000.0, '16 bit')

    def _of_drone(self) -> tuple[Vec3, Vec3]:
        """Return the constant biases of gyro and accelerometer, zero for drone 0."""
        if not self.drone:
            return _ZERO, _ZERO
        rng = np.random.default_rng(self.drone)
        gyro = _draw(rng)
        return mul(self.gyro_bias, gyro), mul(self.accel_bias, _draw(rng))

    @derived('rad/s', 'drone')
    def gyro_constant(self) -> Vec3:
        """Bias of this drone, the same in every flight, (3,)."""
        return self._of_drone()[0]

    @derived('m/s^2')
    def accel_constant(self) -> Vec3:
        """Bias of this drone, the same in every flight, (3,)."""
        return self._of_drone()[1]

    @derived('rad/s', 'gyro_bias', 'gyro_turn_on')
    def gyro_drawn(self) -> Vec3:
        """Standard deviation of the bias that is drawn at turn-on, (3,)."""
        return self.gyro_turn_on if self.drone else self.gyro_bias

    @derived('m/s^2', 'accel_bias', 'accel_turn_on')
    def accel_drawn(self) -> Vec3:
        """Standard deviation of the bias that is drawn at turn-on, (3,)."""
        return self.accel_turn_on if self.drone else self.accel_bias

    @derived('-', 'warm_up_time')
    def warming(self) -> float:
        """Share of the remaining warm-up in one sample."""
        return -expm1(-STEP / self.warm_up_time)


ImuValues = values_type(ImuParams)


@jit
def _draw(rng: Generator) -> Vec3:
    """Return three standard normal numbers."""
    return (standard_normal(rng), standard_normal(rng), standard_normal(rng))


@jit
def _vary(base: Vec3, sigma: Vec3, gain: float, draw: Vec3) -> Vec3:
    """Return base + gain sigma draw, element by element."""
    return add(base, scale(gain, mul(sigma, draw)))


@jit
def _shake(base: Vec3, sigma: Vec3, load: float, draw: Vec3, last: Vec3) -> Vec3:
    """Return base plus vibration of standard deviation load sigma without low frequencies."""
    return _vary(base, sigma, load * math.sqrt(0.5), sub(draw, last))


@jit
def _read(x: Vec3, resolution: float, limit: float) -> Vec3:
    """Return x rounded to the resolution and cut to the measuring range."""
    return (
        clamp(quantise(x[0], resolution), -limit, limit),
        clamp(quantise(x[1], resolution), -limit, limit),
        clamp(quantise(x[2], resolution), -limit, limit))


@jit
def _drift(memory: ImuMemory, rng: Generator, p: ImuValues) -> tuple[Vec3, Vec3]:
    """Return the biases of this sample, gyro and accelerometer, drawn at the first one."""
    if not memory.started:
        return (
            _vary(p.gyro_constant, p.gyro_drawn, 1.0, _draw(rng)),
            _vary(p.accel_constant, p.accel_drawn, 1.0, _draw(rng)))
    ones = (1.0, 1.0, 1.0)
    k = math.sqrt(STEP)
    return (
        _vary(memory.gyro_bias, ones, k * p.gyro_walk, _draw(rng)),
        _vary(memory.accel_bias, ones, k * p.accel_walk, _draw(rng)))


@jit
def step(
    memory: ImuMemory, omega: Vec3, force: Vec3, load: float, rng: Generator, noise: bool,
    p: ImuValues,
) -> tuple[ImuMemory, ImuSample]:
    """
    Take one sample; to be called once per tick.

    Parameters
    ----------
    memory
        Result of the previous call; ``START`` at first.
    omega : (3,) rad/s, body FRD
        True body rate.
    force : (3,) m/s^2, body FRD
        True specific force, gravity not included.
    load
        Total thrust over weight: scales the vibration.
    rng
        The generator of this sensor.
    noise
        False: no noise, vibration or bias, and nothing drawn; resolution and range stay.
    p
        From :meth:`ImuParams.values`.

    """
    if not noise:
        return memory, ImuSample(
            _read(omega, p.gyro_resolution, p.gyro_range),
            _read(force, p.accel_resolution, p.accel_range))
    gyro_bias, accel_bias = _drift(memory, rng, p)
    warm = memory.warmth
    gyro = add(add(omega, gyro_bias), scale(warm, p.gyro_warm_up))
    accel = add(add(force, accel_bias), scale(warm, p.accel_warm_up))
    gyro = _vary(gyro, p.gyro_noise, 1.0, _draw(rng))
    accel = _vary(accel, p.accel_noise, 1.0, _draw(rng))
    gyro_draw, accel_draw = _draw(rng), _draw(rng)
    gyro = _shake(gyro, p.gyro_vibration, load, gyro_draw, memory.gyro_draw)
    accel = _shake(accel, p.accel_vibration, load, accel_draw, memory.accel_draw)
    return (
        ImuMemory(
            True, gyro_bias, accel_bias, warm + p.warming * (1.0 - warm), gyro_draw, accel_draw),
        ImuSample(
            _read(gyro, p.gyro_resolution, p.gyro_range),
            _read(accel, p.accel_resolution, p.accel_range)))
