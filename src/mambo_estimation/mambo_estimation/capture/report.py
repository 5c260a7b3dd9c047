"""What the estimator says of the motion capture on ``/diagnostics``."""

from __future__ import annotations

import math

from . import aided
from ..estimate import DOUBTFUL
from .aided import Capture

LONG = 1.0  # s without a pose that a flight tells of at its end (judgement)
_TROUBLES = {
    aided.POSITION_OFF: 'position {off:.2f} m off',
    aided.ATTITUDE_OFF: 'attitude off, as by a flip',
    aided.TOO_OLD: 'older than 0.3 s or from the future', aided.NOT_FINITE: 'not finite',
    aided.NEVER: 'the first ones do not agree'}


def complaint(c: Capture, max_age: float) -> str:
    """
    Return what a person should know of the motion capture, empty where all is well.

    Parameters
    ----------
    c
        Of now.
    max_age : s
        Without a used pose for longer something is wrong.

    """
    if c.age <= max_age:
        return ''
    if c.silence > max_age:
        return f'no motion capture for {c.silence:.1f} s'
    return (f'motion capture refused for {c.age:.1f} s: '
            + _TROUBLES.get(c.trouble, _TROUBLES[aided.NEVER]).format(off=c.off))


def longest(t: float, age: float, said: str) -> str:
    """
    Return a line about the longest time without a pose that was used; '' if that is no matter.

    Parameters
    ----------
    t : s
        Its end.
    age : s
        How long it was.
    said
        What the estimator reported then, of :func:`complaint`.

    """
    if not said or age < LONG:
        return ''
    return f'the estimate went on without poses until t = {t:.2f} s: {said}'


def numbers(c: Capture) -> dict[str, float]:
    """Return the numbers behind it, with unit."""
    return {
        'motion capture age [s]': c.age, 'motion capture delay [s]': c.delay,
        'poses used': c.used, 'poses refused': c.refused,
        'odom in map, shift [m]': math.hypot(*c.anchor.shift),
        'odom in map, yaw [rad]': -c.anchor.yaw}


def added(
    status: tuple[int, str, dict[str, float]], c: Capture, max_age: float,
) -> tuple[int, str, dict[str, float]]:
    """
    Return the status of an estimator with what there is to say of the motion capture.

    Parameters
    ----------
    status
        Of :func:`mambo_estimation.estimate.diagnostic_status`.
    c, max_age
        As of :func:`complaint`.

    """
    level, line, values = status
    said = complaint(c, max_age)
    return (max(level, DOUBTFUL) if said else level, f'{line}; {said}' if said else line,
            {**values, **numbers(c)})
