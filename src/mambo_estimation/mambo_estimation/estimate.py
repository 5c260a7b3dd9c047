"""Result of an estimator step, and the diagnostic status of estimator and sensors."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate
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
