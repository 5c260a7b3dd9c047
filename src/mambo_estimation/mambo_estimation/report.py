"""What an estimator says of itself and of its sensors, in words and numbers."""

from __future__ import annotations

from . import health, kalman

GOOD, DOUBTFUL, BAD = range(3)


def told(
    status: int, height: float, refused: tuple[int, int, int], invalid: int, h: health.Health,
    not_finite: tuple[int, ...], dropped: tuple[int, ...],
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

    """
    complaints = health.complaints(h, not_finite, dropped)
    level = GOOD if status == kalman.STATUS_NOMINAL and not complaints else DOUBTFUL
    if status == kalman.STATUS_DEAD_RECKONING and complaints:
        level = BAD
    names = ('sonar refused', 'flow refused', 'barometer refused')
    return level, '; '.join((kalman.STATUS[status], *complaints)), {
        'height [m]': height, **dict(zip(names, refused, strict=True)),
        'invalid samples': invalid,
        **{f'{name} age [s]': age for name, age in zip(health.NAMES, h.age, strict=True)}}
