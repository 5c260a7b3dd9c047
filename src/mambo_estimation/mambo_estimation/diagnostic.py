"""What an estimator says of itself and of its sensors, in words and numbers."""

from __future__ import annotations

from collections.abc import Sequence
import math

from . import health, kalman

GOOD, DOUBTFUL, BAD = range(3)
NOT_ALIGNED = 0.05  # rad: as the controller's limit of a take-off


def tilt_deviation(pose_covariance: Sequence[float]) -> float:
    """Return the larger standard deviation of the attitude about x and y, rad; (36,) row-major."""
    return math.sqrt(max(pose_covariance[21], pose_covariance[28]))


def diagnostic_status(
    status: int, height: float, refused: tuple[int, int, int], invalid: int, h: health.Health,
    not_finite: tuple[int, ...], dropped: tuple[int, ...], tilt_std: float,
) -> tuple[int, str, dict[str, float]]:
    """
    Return how well it does (GOOD, DOUBTFUL or BAD), one line, and the numbers behind it.

    Parameters
    ----------
    status
        ``kalman.STATUS_*``.
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
    if status != kalman.STATUS_ALIGNING and tilt_std > NOT_ALIGNED:
        complaints.append(
            f'not aligned, the vehicle has not rested: tilt known to {math.degrees(tilt_std):.1f} '
            'degrees, no take-off')
    level = GOOD if status == kalman.STATUS_NOMINAL and not complaints else DOUBTFUL
    if status == kalman.STATUS_DEAD_RECKONING and complaints:
        level = BAD
    names = ('sonar refused', 'flow refused', 'barometer refused')
    return level, '; '.join((kalman.STATUS[status], *complaints)), {
        'height [m]': height, **dict(zip(names, refused, strict=True)),
        'invalid samples': invalid, 'tilt deviation [rad]': tilt_std,
        **{f'{name} age [s]': age for name, age in zip(health.NAMES, h.age, strict=True)}}
