"""
Barometer: height by static pressure, up to an offset that the altitude filter estimates.

Holds no equation of the thesis; the relation is that of the International Standard Atmosphere
(ISO 2533) below 11 km.
"""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model.arithmetic.exponential import power
from mambo_model.compiled import jit
from mambo_model.schema import flag, quantity
from mambo_model.values import Parameters, values_type

SEA_LEVEL_PRESSURE = 101325.0  # Pa
SCALE_HEIGHT = 44330.769       # m, temperature at sea level over its lapse rate
EXPONENT = 0.19026312          # -, gas constant times lapse rate over gravity


@dataclass(frozen=True)
class BarometerParams(Parameters):
    """Barometer model of the altitude filter."""

    enabled: bool = flag(False, 'the estimator of thesis sec. 5.1 does not use it')
    noise: float = quantity(
        0.4, 'm', 1e-3, 100.0, 'standard deviation of a sample; Rolling Spider at rest: 5 Pa')
    offset_walk: float = quantity(
        0.05, 'm/sqrt(s)', 0.0, 10.0, 'weather, doors and rotor wash: judgement')
    min_pressure: float = quantity(3e4, 'Pa', 1e3, 2e5, 'lower readings are refused')
    max_pressure: float = quantity(1.2e5, 'Pa', 1e3, 2e5, 'higher readings are refused')
    gate: float = quantity(4.0, 'sigma', 1.0, 100.0, 'refuses 6e-5 of good samples')
    recovery_time: float = quantity(
        1.0, 's', 0.0, 1e4, 'refusals that agree for so long mean that the offset has jumped')
    stuck_samples: int = quantity(
        20, '-', 0, 100000, 'in flight, so many equal pressures mean a dead sensor; 0: never')


BarometerValues = values_type(BarometerParams)


@jit
def is_valid(pressure: float, v: BarometerValues) -> bool:
    """Return whether a pressure in Pa may be used; NaN is refused."""
    return v.min_pressure <= pressure <= v.max_pressure


@jit
def measured_height(pressure: float) -> float:
    """Return the height in m above the level of 101325 Pa in the standard atmosphere, Pa in."""
    return SCALE_HEIGHT * (1.0 - power(pressure / SEA_LEVEL_PRESSURE, EXPONENT))


@jit
def predict(height_by_pressure: float) -> tuple[float, float]:
    """
    Return the expected pressure and its derivative: the inverse of :func:`measured_height`.

    Parameters
    ----------
    height_by_pressure : m
        Height above the floor plus the offset.

    Returns
    -------
    pressure : Pa
    by_height : Pa/m

    """
    base = 1.0 - height_by_pressure / SCALE_HEIGHT
    pressure = SEA_LEVEL_PRESSURE * power(base, 1.0 / EXPONENT)
    return pressure, -pressure / (EXPONENT * SCALE_HEIGHT * base)
