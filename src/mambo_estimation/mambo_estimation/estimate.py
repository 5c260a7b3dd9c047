"""
Result of an estimator step, whether it can be used, and the diagnostic status of the sensors.

In the estimate of a user's estimator NaN is allowed where it means that there is no value: in the
offset of the barometer and in what a sample showed. :func:`is_sound` is for compiled code,
:func:`complaint` says what is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import is_unit, norm, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import Vec3

from . import health
from .blocks import Vec2
from .health import Health

STATUS_ALIGNING, STATUS_DEAD_RECKONING, STATUS_NOMINAL = range(3)  # as in EstimatorState.msg
STATUS = ('aligning', 'dead reckoning', 'nominal')
GOOD, DOUBTFUL, BAD = range(3)
UNKNOWN = (0.0,) * 36  # covariance of an estimator that publishes none
NOT_ALIGNED = 0.08  # rad: as the controller's limit of a take-off
LARGEST_COUNT = 2**32 - 1  # of samples: a uint32
LONGEST_AGE = 1e9  # s, of a used sample


class Estimate(NamedTuple):
    """Result of a step; NED and FRD. Fields as in EstimatorState.msg but for the axes."""

    state: State                           # omega without bias
    pose_covariance: tuple[float, ...]     # (36,) m, rad: both blocks in inertial axes
    twist_covariance: tuple[float, ...]    # (36,) m/s, rad/s: both blocks in body axes
    status: int                            # STATUS_*
    height: float                          # m, above the floor
    vertical_velocity: float               # m/s, upward
    gyro_bias: Vec3                        # (3,) rad/s, body FRD
    accel_bias: Vec3                       # (3,) m/s^2, body FRD
    barometer_offset: float                # m, NaN: no pressure used
    sonar_innovation: float                # m, NaN: no sample, or not valid
    sonar_test_ratio: float                # -, refused above 1
    flow_innovation: Vec2                  # (2,) m/s, body FRD x and y
    flow_test_ratio: float                 # -
    barometer_innovation: float            # m
    barometer_test_ratio: float            # -
    sonar_refused: int                     # samples since start, as the next two
    flow_refused: int                      # -
    barometer_refused: int                 # -
    invalid_samples: int                   # of any sensor, that could not be read
    health: Health                         # of every sensor


@jit
def count_broken(sonar: float, flow: Vec2, pressure: float) -> int:
    """Return how many of the three samples cannot be read; NaN means that there is none."""
    half = math.isnan(flow[0]) != math.isnan(flow[1])
    broken = 1 if math.isinf(sonar) else 0
    broken += 1 if half or math.isinf(flow[0]) or math.isinf(flow[1]) else 0
    return broken + (1 if math.isinf(pressure) else 0)


@jit
def status_of(aligning: bool, sonar_age: float, flow_age: float, values) -> int:
    """
    Return the status of an estimator, ``STATUS_*``.

    Parameters
    ----------
    aligning
        Whether it still calibrates.
    sonar_age, flow_age : s
        Since a range and flow were used.
    values
        With ``max_sonar_age`` and ``max_flow_age``, s.

    """
    if aligning:
        return STATUS_ALIGNING
    if sonar_age <= values.max_sonar_age and flow_age <= values.max_flow_age:
        return STATUS_NOMINAL
    return STATUS_DEAD_RECKONING


@jit
def of_state(state: State, status: int, gyro_bias: Vec3, accel_bias: Vec3) -> Estimate:
    """
    Return the estimate of an estimator that has a state and biases only.

    Parameters
    ----------
    state
        Inertial NED and body FRD, rate without bias.
    status
        ``STATUS_*``.
    gyro_bias, accel_bias : (3,) rad/s, m/s^2, body FRD

    Returns
    -------
    estimate
        Covariances are zero (unknown), innovations NaN, sensors in good health.

    """
    nan, nan2, none = math.nan, (math.nan, math.nan), (0, 0, 0, 0, 0)
    return Estimate(
        state, UNKNOWN, UNKNOWN, status, -state.rho[2], -rotate(state.q, state.nu)[2], gyro_bias,
        accel_bias, nan, nan, nan, nan2, nan, nan, nan, 0, 0, 0, 0,
        Health(none, (0.0, 0.0, 0.0, 0.0, 0.0), none))


@jit
def _finite(numbers) -> bool:
    """Tell whether all numbers of a tuple are finite."""
    for x in numbers:
        if not math.isfinite(x):
            return False
    return True


@jit
def _covariance(P) -> bool:
    """Tell whether 36 numbers can be a covariance: finite, and no variance below 0."""
    if not _finite(P):
        return False
    for k in range(0, 36, 7):  # the diagonal
        if P[k] < 0.0:
            return False
    return True


@jit
def _counts(numbers) -> bool:
    """Tell whether all whole numbers of a tuple are counts."""
    for n in numbers:
        if n < 0 or n > LARGEST_COUNT:
            return False
    return True


@jit
def _health(e: Estimate) -> bool:
    """Tell whether the health of the sensors can be published."""
    for code in e.health.health:
        if code < 0 or code > health.STUCK:
            return False
    for age in e.health.age:
        if not 0.0 <= age <= LONGEST_AGE:
            return False
    return _counts(e.health.not_finite)


@jit
def is_sound(e: Estimate) -> bool:
    """Tell whether an estimate can be used: :func:`complaint` would return nothing."""
    s = e.state
    if not (_finite(s.rho) and _finite(s.nu) and _finite(s.q) and _finite(s.omega)
            and is_unit(s.q)):
        return False
    if not (_finite((e.height, e.vertical_velocity)) and _finite(e.gyro_bias)
            and _finite(e.accel_bias)):
        return False
    if not (_covariance(e.pose_covariance) and _covariance(e.twist_covariance)):
        return False
    for x in (e.barometer_offset, e.sonar_innovation, e.flow_innovation[0], e.flow_innovation[1],
              e.barometer_innovation):
        if math.isinf(x):
            return False
    for x in (e.sonar_test_ratio, e.flow_test_ratio, e.barometer_test_ratio):
        if x < 0.0:
            return False
    return 0 <= e.status <= STATUS_NOMINAL and _health(e) and _counts((
        e.sonar_refused, e.flow_refused, e.barometer_refused, e.invalid_samples))


def complaint(e: Estimate) -> str:
    """Return the field of an estimate that cannot be used, with its value; empty: none."""
    for name, numbers in zip(('position', 'velocity', 'attitude', 'body rate'), e.state):
        if not all(map(math.isfinite, numbers)):
            return f'{name} = {numbers}'
    if not is_unit(e.state.q):
        return (f'attitude = {e.state.q}, a quaternion of length {norm(e.state.q):.9g} instead '
                'of 1')
    for name in ('height', 'vertical_velocity'):
        if not math.isfinite(getattr(e, name)):
            return f'{name} = {getattr(e, name)}'
    for name in ('gyro_bias', 'accel_bias'):
        if not all(map(math.isfinite, getattr(e, name))):
            return f'{name} = {getattr(e, name)}'
    for name in ('pose_covariance', 'twist_covariance'):
        P = getattr(e, name)
        if not all(map(math.isfinite, P)):
            k = next(k for k, x in enumerate(P) if not math.isfinite(x))
            return f'{name}[{k}] = {P[k]}'
        if min(P[::7]) < 0.0:  # the diagonal
            k = 7 * P[::7].index(min(P[::7]))
            return f'{name}[{k}] = {P[k]}, a variance below 0'
    for name in ('barometer_offset', 'sonar_innovation', 'flow_innovation',
                 'barometer_innovation'):
        x = getattr(e, name)
        if any(map(math.isinf, x if isinstance(x, tuple) else (x,))):
            return f'{name} = {x}: NaN means that there is none'
    for name in ('sonar_test_ratio', 'flow_test_ratio', 'barometer_test_ratio'):
        if getattr(e, name) < 0.0:
            return f'{name} = {getattr(e, name)}, below 0'
    if not 0 <= e.status <= STATUS_NOMINAL:
        return f'status = {e.status}: wanted 0 to {STATUS_NOMINAL}'
    for name, numbers, largest in (
            ('health.health', e.health.health, health.STUCK),
            ('health.age', e.health.age, LONGEST_AGE),
            ('health.not_finite', e.health.not_finite, LARGEST_COUNT)):
        if not all(0 <= x <= largest for x in numbers):
            return f'{name} = {numbers}: wanted 0 to {largest:g}'
    for name in ('sonar_refused', 'flow_refused', 'barometer_refused', 'invalid_samples'):
        if not 0 <= getattr(e, name) <= LARGEST_COUNT:
            return f'{name} = {getattr(e, name)}: wanted 0 to {LARGEST_COUNT}'
    return ''


def tilt_deviation(pose_covariance: Sequence[float]) -> float:
    """Return the larger standard deviation of the attitude about x and y, rad; (36,) row-major."""
    return math.sqrt(max(pose_covariance[21], pose_covariance[28]))


def diagnostic_status(
    status: int, height: float, refused: tuple[int, int, int], invalid: int, h: Health,
    not_finite: tuple[int, ...], dropped: tuple[int, ...], tilt_std: float,
) -> tuple[int, str, dict[str, float]]:
    """
    Return the level (GOOD, DOUBTFUL or BAD), one line of text, and the values for diagnostics.

    Parameters
    ----------
    status
        ``STATUS_*``.
    height : m
    refused
        Counts of sonar, flow and barometer.
    invalid
        Count of samples that could not be used.
    h
        Of the sensors.
    not_finite, dropped
        New samples, as of :func:`health.complaints`.
    tilt_std : rad
        Of the attitude about a horizontal axis, 0: not known.

    """
    complaints = health.complaints(h, not_finite, dropped)
    if status != STATUS_ALIGNING and tilt_std > NOT_ALIGNED:
        complaints.append(
            f'not aligned, the vehicle has not rested: tilt known to {math.degrees(tilt_std):.1f} '
            'degrees, no take-off')
    level = GOOD if status == STATUS_NOMINAL and not complaints else DOUBTFUL
    if status == STATUS_DEAD_RECKONING and complaints:
        level = BAD
    names = ('sonar refused', 'flow refused', 'barometer refused')
    return level, '; '.join((STATUS[status], *complaints)), {
        'height [m]': height, **dict(zip(names, refused, strict=True)),
        'invalid samples': invalid, 'tilt deviation [rad]': tilt_std,
        **{f'{name} age [s]': age for name, age in zip(health.NAMES, h.age, strict=True)}}
