"""
Alignment at rest: biases and tilt from the mean of the first samples, and detection of motion.

The mean of the gyro is its bias. The mean of the accelerometer is tilted gravity plus a bias,
which cannot be separated: its horizontal part is split between the slope of the floor and the bias
in the ratio of their variances. The thesis's estimator attributes all of it to the bias (sec.
5.3.1), textbooks attribute all of it to the tilt; both are limiting cases. A reading too large for
either is attributed to the slope.

Rest is decided by a statistical test that needs no noise level: the mean of each block of samples
must equal that of all samples before it within the scatter of the samples. If the vehicle moves,
the collection restarts. If it does not rest within ``patience``, the filters start with wide
defaults; the tilt is then unknown and no controller takes off.

After the alignment the vehicle is assumed to be at rest on the floor until motion is detected. Its
velocity is zero, which keeps the filters from drifting while they wait. It is at rest again when
the same test of its samples says so where the sonar shows the floor and the estimate is low: the
vibration of running motors is no rest.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp, log
from mambo_model.arithmetic.trigonometry import asin, atan2
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import from_euler, Quat
from mambo_model.motion.vector import add, dot, hypot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type

COLLECTING, ALIGNED, MOVED = range(3)


@dataclass(frozen=True)
class AlignmentParams(Parameters):
    """When the vehicle counts as being at rest."""

    samples: int = quantity(
        100, '-', 0, 1000000, 'to average: 0.5 s at 200 Hz; 0: start with the defaults at once')
    gyro_bias: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'rad/s', -1.0, 1.0,
        'body FRD, used where the alignment fails: calibration from elsewhere')
    accel_bias: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'm/s^2', -5.0, 5.0,
        'body FRD, used where the alignment fails: calibration from elsewhere')
    gyro_spread: float = quantity(
        0.1, 'rad/s', 0.0, 10.0, 'a larger standard deviation of one sample means shaking')
    accel_spread: float = quantity(
        0.6, 'm/s^2', 0.0, 100.0, 'a larger standard deviation of one sample means shaking')
    gyro_limit: float = quantity(
        0.2, 'rad/s', 0.0, 10.0, 'no gyro at rest reads more: turn-on bias')
    gravity_tolerance: float = quantity(
        1.5, 'm/s^2', 0.0, 10.0, 'at rest the specific force has the size of gravity, bias aside')
    patience: float = quantity(
        2.0, 's', 0.0, 1e4, 'without rest for so long the filters start with wide defaults')
    gyro_bias_floor: float = quantity(
        1e-4, 'rad/s', 1e-7, 1.0,
        'the bias is not known better than this, however long the mean: judgement')
    accel_bias_std: float = quantity(
        0.3, 'm/s^2', 1e-6, 5.0,
        'horizontal accelerometer bias: x axis in calibration values of 11 Rolling Spider flights')
    floor_slope_std: float = quantity(
        0.0025, 'rad', 0.0, 1.5,
        'slope of the floor: DIN 18202, table 3: a finished floor is flat to 10 mm over 4 m')
    rest_gyro: float = quantity(
        0.03, 'rad/s', 0.0, 10.0,
        'a smoothed rate farther from its mean ends the rest, noise aside')
    rest_accel: float = quantity(
        0.15, 'm/s^2', 0.0, 100.0,
        'a smoothed specific force farther from its mean ends the rest, noise aside')
    rest_time: float = quantity(0.1, 's', 1e-3, 10.0, 'time constant of that smoothing')
    rest_velocity_std: float = quantity(
        0.01, 'm/s', 1e-6, 1.0, 'how well a velocity of zero is known at rest')
    leave_velocity_std: float = quantity(
        0.05, 'm/s', 0.0, 10.0, 'velocity that may have been gained before the rest was ended')


AlignmentValues = values_type(AlignmentParams)


class Sample(NamedTuple):
    """One of the inertial sensors."""

    gyro: Vec3         # (3,) rad/s, body FRD
    accel: Vec3        # (3,) m/s^2, body FRD


class Noise(NamedTuple):
    """Of one sample, from the differences of successive ones, over all three axes."""

    gyro: float        # rad^2/s^2
    accel: float       # m^2/s^4


class Alignment(NamedTuple):
    """Memory of the alignment, and afterwards of the rest."""

    count: int         # [-] samples collected
    first_gyro: Vec3   # (3,) rad/s, body FRD
    first_accel: Vec3  # (3,) m/s^2, body FRD
    gyro: Vec3         # (3,) rad/s, sum while collecting, then mean
    accel: Vec3        # (3,) m/s^2, sum while collecting, then mean
    spread: float      # rad^2/s^2, sum of squared distances of the gyro from its first sample
    noise: Noise       # while collecting sums, then variances
    last: Sample       # the one before
    block: Sample      # sum of those since the last block was judged
    waited: float      # s, since the first sample
    accel_bias: Vec3   # (3,) m/s^2, body FRD, subtracted from every sample
    gyro_off: Vec3     # (3,) rad/s, smoothed distance from the mean
    accel_off: Vec3    # (3,) m/s^2, smoothed distance from the mean


class Landing(NamedTuple):
    """Memory of a vehicle that flies: whether it has come to rest on the floor."""

    rest: Alignment    # samples since it is low and still
    near: bool         # the last range was shorter than the sonar can measure


class Level(NamedTuple):
    """Tilt and bias derived from the mean specific force at rest."""

    q: Quat            # (4,) w x y z, body to inertial, yaw 0
    accel_bias: Vec3   # (3,) m/s^2, body FRD
    tilt_std: float    # rad, about each horizontal axis


ZERO: Vec3 = (0.0, 0.0, 0.0)
EMPTY = Alignment(
    0, ZERO, ZERO, ZERO, ZERO, 0.0, Noise(0.0, 0.0), Sample(ZERO, ZERO), Sample(ZERO, ZERO), 0.0,
    ZERO, ZERO, ZERO)
FLYING = Landing(EMPTY, False)
UNKNOWN: Vec3 = (math.nan, math.nan, math.nan)
LOW = 0.15       # m, height by an estimate of a vehicle that may stand on the floor
SLOW = 0.15      # m/s, vertical velocity likewise
BLOCK = 10       # samples: 50 ms
STUCK = 0.03     # rad/s, bias of a gyro that is not known, as initial_gyro_bias_std
UNLIKELY = 10.3  # chi squared with three degrees of freedom over 3 exceeds it once in 10^6 blocks
TILTED = 0.01    # share of the starts that are not on a level floor: judgement
STEEPER = 10.0   # deviation of their tilt over that of a reading on a level floor: 0.3 rad
NOT_LEVEL = 4.3
"""
Number of deviations beyond which a tilt is more likely than a level start. By Bayes it is
sqrt(2 ln(STEEPER^2 / TILTED)). One level start in 10000 exceeds it. With a threshold of 3, one in
90 took off with a tilt error of 5 degrees.
"""


@jit
def level(mean: Vec3, gravity: float, v: AlignmentValues) -> Level:
    """
    Split the mean specific force of a vehicle at rest into tilt and bias.

    The floor pushes up: the body sees -g R^T e_3. Signs by hand: nose up reads positive on x,
    right side down reads negative on y. The bias along z makes the rest as large as gravity.
    With a reading beyond ``NOT_LEVEL`` deviations the vehicle does not stand on a level floor.

    Parameters
    ----------
    mean : (3,) m/s^2, body FRD
    gravity : m/s^2
    v
        Deviations of the bias and of the slope of the floor.

    """
    bias, slope = v.accel_bias_std * v.accel_bias_std, gravity * v.floor_slope_std
    total = bias + slope * slope
    share = bias / total
    if hypot(mean[0], mean[1]) > NOT_LEVEL * math.sqrt(total):
        share = 0.0
    q, accel_bias = split(mean, gravity, share)
    return Level(q, accel_bias, math.sqrt((1.0 - share) * bias) / gravity)


@jit
def split(mean: Vec3, gravity: float, share: float) -> tuple[Quat, Vec3]:
    """
    Return attitude and accelerometer bias at rest, if a share of the horizontal force is bias.

    Parameters
    ----------
    mean : (3,) m/s^2, body FRD
        Specific force.
    gravity : m/s^2
    share : -
        0: all of it is tilt; 1: all of it is bias.

    """
    x, y = (1.0 - share) * mean[0], (1.0 - share) * mean[1]
    z = math.copysign(math.sqrt(max(gravity * gravity - x * x - y * y, 0.0)), mean[2])
    pitch = asin(max(-1.0, min(1.0, x / gravity)))
    return (from_euler(atan2(-y, -z), pitch, 0.0),
            (share * mean[0], share * mean[1], mean[2] - z))


@jit
def reading_std(gravity: float, v: AlignmentValues) -> float:
    """Return the deviation of the horizontal specific force on a level floor, m/s^2, each axis."""
    return hypot(v.accel_bias_std, gravity * v.floor_slope_std)


@jit
def tilted_probability(mean: Vec3, gravity: float, v: AlignmentValues) -> float:
    """
    Return the probability that a vehicle with this reading does not stand on a level floor.

    With the prior ``TILTED`` and Gaussian readings, two numbers each, whose deviations are in the
    ratio 1 : ``STEEPER``. It is a half about ``NOT_LEVEL`` deviations.

    Parameters
    ----------
    mean : (3,) m/s^2, body FRD
        Specific force at rest.
    gravity : m/s^2
    v
        Deviations of the bias and of the slope of the floor.

    """
    distance = hypot(mean[0], mean[1]) / reading_std(gravity, v)
    wider = STEEPER * STEEPER
    log_odds = (log(TILTED / (1.0 - TILTED) / wider)
                + 0.5 * distance * distance * (1.0 - 1.0 / wider))
    return 1.0 / (1.0 + exp(-log_odds))


@jit
def gyro_bias_variance(m: Alignment, v: AlignmentValues) -> float:
    """
    Return the variance of a mean of the gyro, rad^2/s^2 each axis, from the samples' spread.

    A gyro without any noise, beside an accelerometer with noise, is stuck: its mean is no bias.
    """
    if m.spread == 0.0 and m.noise.accel > 0.0:
        return STUCK * STUCK
    off = sub(m.gyro, m.first_gyro)
    spread = max(m.spread / m.count - dot(off, off), 0.0) / 3.0
    return spread / m.count + v.gyro_bias_floor * v.gyro_bias_floor


@jit
def _is_rest(m: Alignment, size: int, gravity: float, v: AlignmentValues) -> bool:
    """
    Return whether the vehicle was at rest during the last block of samples.

    Parameters
    ----------
    m
        Memory, the block of ``size`` samples part of its sums.
    size
        Of the block.
    gravity : m/s^2
    v
        Limits.

    """
    gyro, accel = scale(1.0 / size, m.block.gyro), scale(1.0 / size, m.block.accel)
    pairs = max(2.0 * (m.count - 1), 1.0)
    noise = Noise(m.noise.gyro / pairs, m.noise.accel / pairs)
    plausible = (
        norm(gyro) <= v.gyro_limit and abs(norm(accel) - gravity) <= v.gravity_tolerance
        and noise.gyro <= 3.0 * v.gyro_spread * v.gyro_spread
        and noise.accel <= 3.0 * v.accel_spread * v.accel_spread)
    before = m.count - size
    if before == 0 or not plausible:
        return plausible
    gyro_off = norm(sub(gyro, scale(1.0 / before, sub(m.gyro, m.block.gyro))))
    accel_off = norm(sub(accel, scale(1.0 / before, sub(m.accel, m.block.accel))))
    expected = UNLIKELY * (1.0 / size + 1.0 / before)
    return (gyro_off <= max(v.rest_gyro, math.sqrt(expected * noise.gyro))
            and accel_off <= max(v.rest_accel, math.sqrt(expected * noise.accel)))


@jit
def _anew(waited: float) -> Alignment:
    """Return a collection without samples that has waited for so many seconds."""
    nothing = Sample(ZERO, ZERO)
    return Alignment(
        0, ZERO, ZERO, ZERO, ZERO, 0.0, Noise(0.0, 0.0), nothing, nothing, waited, ZERO, ZERO,
        ZERO)


@jit
def _added(m: Alignment, gyro: Vec3, accel: Vec3, dt: float) -> Alignment:
    """Return the memory with one more sample in all its sums."""
    if m.count == 0:
        return Alignment(
            1, gyro, accel, gyro, accel, 0.0, m.noise, Sample(gyro, accel), Sample(gyro, accel),
            m.waited + dt, ZERO, ZERO, ZERO)
    off, turn = sub(gyro, m.first_gyro), sub(gyro, m.last.gyro)
    push = sub(accel, m.last.accel)
    return Alignment(
        m.count + 1, m.first_gyro, m.first_accel, add(m.gyro, gyro), add(m.accel, accel),
        m.spread + dot(off, off),
        Noise(m.noise.gyro + dot(turn, turn), m.noise.accel + dot(push, push)),
        Sample(gyro, accel), Sample(add(m.block.gyro, gyro), add(m.block.accel, accel)),
        m.waited + dt, ZERO, ZERO, ZERO)


@jit
def collect(
    m: Alignment, gyro: Vec3, accel: Vec3, dt: float, gravity: float, v: AlignmentValues,
) -> tuple[Alignment, int]:
    """
    Add a sample of a vehicle at rest.

    Parameters
    ----------
    m
        Memory.
    gyro : (3,) rad/s, body FRD
    accel : (3,) m/s^2, body FRD
        Specific force. Both valid.
    dt : s
        Since the sample before.
    gravity : m/s^2
    v
        Limits.

    Returns
    -------
    m
        To be passed to the next call; with ALIGNED it holds means and accelerometer bias.
    verdict
        COLLECTING, ALIGNED or MOVED (not at rest for ``patience``).

    """
    if v.samples == 0:
        return m, MOVED
    m = _added(m, gyro, accel, dt)
    size = m.count % BLOCK
    if size != 0 and m.count < v.samples:
        return m, COLLECTING
    size = BLOCK if size == 0 else size
    if not _is_rest(m, size, gravity, v):
        return _anew(m.waited), MOVED if m.waited >= v.patience else COLLECTING
    if m.count < v.samples:
        return Alignment(
            m.count, m.first_gyro, m.first_accel, m.gyro, m.accel, m.spread, m.noise, m.last,
            Sample(ZERO, ZERO), m.waited, ZERO, ZERO, ZERO), COLLECTING
    gyro, accel = scale(1.0 / m.count, m.gyro), scale(1.0 / m.count, m.accel)
    pairs = max(2.0 * (m.count - 1), 1.0)
    return Alignment(
        m.count, m.first_gyro, m.first_accel, gyro, accel, m.spread,
        Noise(m.noise.gyro / pairs, m.noise.accel / pairs), m.last, m.block, m.waited,
        level(accel, gravity, v).accel_bias, ZERO, ZERO), ALIGNED


@jit
def fall_back(m: Alignment, v: AlignmentValues) -> Alignment:
    """Return the memory of an alignment that failed: the accelerometer bias of the parameters."""
    return with_bias(m, v.accel_bias)


@jit
def with_bias(m: Alignment, accel_bias: Vec3) -> Alignment:
    """Return the memory with another accelerometer bias, (3,) m/s^2, body FRD."""
    return Alignment(
        m.count, m.first_gyro, m.first_accel, m.gyro, m.accel, m.spread, m.noise, m.last,
        m.block, m.waited, accel_bias, ZERO, ZERO)


@jit
def settle(
    m: Landing, sonar: float, min_range: float, height: float, climb: float, gyro: Vec3,
    accel: Vec3, dt: float, gravity: float, v: AlignmentValues,
) -> tuple[Landing, bool]:
    """
    Tell whether a vehicle that has flown is at rest on the floor.

    Parameters
    ----------
    m
        Memory, at first ``FLYING``.
    sonar : m
        New range, NaN: none.
    min_range : m
        Of the sonar; a shorter reading shows that the floor is near.
    height, climb : m, m/s
        By the filter.
    gyro : (3,) rad/s, body FRD
    accel : (3,) m/s^2, body FRD
        Specific force; NaN: none that was measured.
    dt : s
    gravity : m/s^2
    v
        Limits.

    Returns
    -------
    m
        To be passed to the next call; at rest, with the means of the samples.
    resting
        For as long as the alignment takes.

    """
    near = sonar < min_range if math.isfinite(sonar) else m.near
    if not (near and height < LOW and abs(climb) < SLOW and math.isfinite(accel[0])):
        return Landing(EMPTY, near), False
    rest, verdict = collect(m.rest, gyro, accel, dt, gravity, v)
    if verdict == MOVED:
        return Landing(EMPTY, near), False
    return Landing(rest, near), verdict == ALIGNED


@jit
def land(
    m: Landing, rest: Alignment, resting: bool, sonar: float, min_range: float, height: float,
    climb: float, gyro: Vec3, accel: Vec3, measured: bool, dt: float, gravity: float,
    v: AlignmentValues,
) -> tuple[Landing, Alignment, bool]:
    """
    Begin to rest on the floor after a flight, or end that rest where the sonar shows a height.

    Parameters as of :func:`settle`, and these.

    Parameters
    ----------
    rest
        Means of the last rest.
    resting
        Whether it lasts.
    measured
        Whether gyro and accelerometer were, or others took their place.

    Returns
    -------
    m
        To be passed to the next call.
    rest
        Means of the last rest, with the accelerometer bias of the first one.
    resting

    """
    if resting:
        risen = m.near and math.isfinite(sonar) and sonar >= min_range
        return FLYING if risen else m, rest, not risen
    m, settled = settle(
        m, sonar, min_range, height, climb, gyro, accel if measured else UNKNOWN, dt, gravity, v)
    if not settled:
        return m, rest, False
    return Landing(EMPTY, True), with_bias(m.rest, rest.accel_bias), True


@jit
def watch(
    m: Alignment, gyro: Vec3, accel: Vec3, dt: float, v: AlignmentValues,
) -> tuple[Alignment, bool]:
    """
    Tell whether an aligned vehicle is still at rest.

    Parameters
    ----------
    m
        Memory with the means.
    gyro : (3,) rad/s, body FRD
    accel : (3,) m/s^2, body FRD
    dt : s
    v
        Limits.

    """
    part = dt / (v.rest_time + dt)
    gyro_off = add(m.gyro_off, scale(part, sub(sub(gyro, m.gyro), m.gyro_off)))
    accel_off = add(m.accel_off, scale(part, sub(sub(accel, m.accel), m.accel_off)))
    # Variance over that of one sample, by smoothing and by the mean that is taken off.
    expected = UNLIKELY * (0.5 * part + 1.0 / m.count)
    resting = (
        norm(gyro_off) <= max(v.rest_gyro, math.sqrt(expected * m.noise.gyro))
        and norm(accel_off) <= max(v.rest_accel, math.sqrt(expected * m.noise.accel)))
    return Alignment(
        m.count, m.first_gyro, m.first_accel, m.gyro, m.accel, m.spread, m.noise, m.last, m.block,
        m.waited, m.accel_bias, gyro_off, accel_off), resting
