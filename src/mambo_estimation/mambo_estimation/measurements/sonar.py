"""
Sonar: slant range along the body's down axis, and the tilt-corrected height.

With flat ground and body axis b3 at an angle to the vertical, h = range cos(phi) cos(theta)
(equations.md, C8, Z of (5.2) inverted). Below its shortest range the sensor reads that range or a
little more: such a reading bounds the height but does not measure it.
"""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model.compiled import jit
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type


@dataclass(frozen=True)
class SonarParams(Parameters):
    """Sonar model of the altitude filter."""

    noise: float = quantity(
        0.03, 'm', 1e-4, 1.0,
        'standard deviation of a slant range: 0.005 to 0.1 in Rolling Spider flights')
    min_range: float = quantity(
        0.46, 'm', 0.0, 2.0,
        'shorter readings only bound the height: Rolling Spider logs, from 0.434 m')
    max_range: float = quantity(
        4.0, 'm', 0.1, 20.0, 'longer readings are refused; missed echoes read 5 m in those logs')
    min_tilt_cos: float = quantity(
        0.7, '-', 0.1, 1.0, 'the beam leaves the floor below the vehicle beyond 45 degrees')
    gate: float = quantity(5.0, 'sigma', 1.0, 100.0, 'refuses 6e-7 of good samples')
    recovery_time: float = quantity(
        0.5, 's', 0.0, 1e4, 'refusals that agree for so long mean that the filter is wrong')
    agreement: float = quantity(
        0.5, 'm', 1e-3, 10.0,
        'refused heights this near to each other agree: 1.5 times the scatter of the worst '
               'working sonar, 0.35 m in Rolling Spider flights')
    stuck_samples: int = quantity(
        20, '-', 0, 100000, 'in flight, so many equal ranges mean a dead sensor; 0: never')


SonarValues = values_type(SonarParams)


@jit
def is_valid(slant_range: float, tilt_cos: float, v: SonarValues) -> bool:
    """
    Return whether a finite range may be used; NaN is refused.

    Parameters
    ----------
    slant_range : m
        As measured.
    tilt_cos : -
        cos(phi) cos(theta), element (3, 3) of the rotation matrix.
    v
        Limits.

    """
    return 0.0 <= slant_range <= v.max_range and tilt_cos >= v.min_tilt_cos


@jit
def is_near(slant_range: float, v: SonarValues) -> bool:
    """Return whether a valid range only shows that the floor is nearer than the shortest range."""
    return slant_range < v.min_range


@jit
def nearest_height(height: float, tilt_cos: float, v: SonarValues) -> float:
    """
    Return the height nearest to the predicted one that a near reading allows.

    Parameters
    ----------
    height : m
        Predicted.
    tilt_cos : -
        cos(phi) cos(theta).
    v
        Shortest range.

    """
    return min(max(height, 0.0), v.min_range * tilt_cos)


@jit
def predict(height: float, tilt_cos: float) -> tuple[float, float, float]:
    """
    Return the expected slant range and its derivatives.

    Parameters
    ----------
    height : m
        Above the floor.
    tilt_cos : -
        cos(phi) cos(theta), > 0.

    Returns
    -------
    slant_range : m
    by_height : -
        d range / d height.
    by_tilt_cos : m
        d range / d tilt_cos.

    """
    return height / tilt_cos, 1.0 / tilt_cos, -height / (tilt_cos * tilt_cos)


@jit
def measured_height(
    slant_range: float, tilt_cos: float, tilt_variance: float, v: SonarValues,
) -> tuple[float, float]:
    """
    Return the height of a slant range, corrected for tilt, and its variance.

    Parameters
    ----------
    slant_range : m
        As measured, valid.
    tilt_cos : -
        cos(phi) cos(theta).
    tilt_variance : rad^2
        Of the attitude about a horizontal axis; it matters with the sine of the tilt.
    v
        Noise.

    Returns
    -------
    height : m
    variance : m^2

    """
    tilt_sin_squared = max(0.0, 1.0 - tilt_cos * tilt_cos)
    noise = v.noise * tilt_cos
    return (slant_range * tilt_cos,
            noise * noise + slant_range * slant_range * tilt_sin_squared * tilt_variance)
