"""
Barometer: pressure of the standard atmosphere at the height of the vehicle.

Defaults are measured on the flights of the vehicle's predecessor with the same toolbox
(RollingSpiderEdu).
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import power
from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import jit
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters, values_type
from numpy.random import Generator

from .sampling import due, period_ns, quantise

LAPSE = 0.0065                              # K/m, ISO 2533
TEMPERATURE = 288.15                        # K, ISO 2533
EXPONENT = 9.80665 / (287.05287 * LAPSE)    # 5.2559, ISO 2533


class BarometerMemory(NamedTuple):
    """Offset of this flight."""

    started: bool  # the offset has been drawn
    offset: float  # Pa


class BarometerSample(NamedTuple):
    """Output of the sensor at one tick."""

    new: bool        # there is one at this tick
    pressure: float  # Pa; NaN if not new


START = BarometerMemory(False, 0.0)


@dataclass(frozen=True)
class BarometerParams(Parameters):
    """Weather, rate and noise of the barometer; the offset is drawn once a flight and walks."""

    rate: float = quantity(
        70.0, 'Hz', 1.0, 200.0, 'design choice; each 5 ms, averaged over two, in the flights')
    ground_pressure: float = quantity(
        101325.0, 'Pa', 80000.0, 110000.0, 'ISO 2533, pressure at the floor')
    noise: float = quantity(
        5.0, 'Pa', 0.0, 1000.0, 'standard deviation at rest, 3 recordings: 5.05 to 5.25 Pa')
    offset: float = quantity(
        10.0, 'Pa', 0.0, 10000.0, 'calibration values of flights minutes apart: 0.3 to 18 Pa')
    walk: float = quantity(
        1.8, 'Pa/sqrt(s)', 0.0, 100.0,
        'changes over 4 s in 7 free flights, height removed, median rms 3.6 Pa; 0.3 at rest')
    resolution: float = quantity(0.23, 'Pa', 0.0, 100.0, 'steps in the flights; 0: none')

    @derived('ns', 'rate')
    def period(self) -> int:
        """Time between samples."""
        return period_ns(self.rate)


BarometerValues = values_type(BarometerParams)


@jit
def pressure_at(height: float, ground_pressure: float) -> float:
    """Return the pressure in Pa at a height in m above the floor, of pressure in Pa (ISO 2533)."""
    return ground_pressure * power(1.0 - LAPSE * height / TEMPERATURE, EXPONENT)


@jit
def step(
    memory: BarometerMemory, tick: int, height: float, rng: Generator, noise: bool,
    p: BarometerValues,
) -> tuple[BarometerMemory, BarometerSample]:
    """
    Take a sample if one is due.

    Parameters
    ----------
    memory
        Result of the previous call; ``START`` at first.
    tick : 5 ms
        Number of the control step.
    height : m
        True height above the floor, -rho_z.
    rng
        The generator of this sensor.
    noise
        False: no noise and no offset, and nothing drawn.
    p
        From :meth:`BarometerParams.values`.

    """
    if not due(tick, p.period):
        return memory, BarometerSample(False, math.nan)
    pressure = pressure_at(height, p.ground_pressure)
    if noise:
        draw = standard_normal(rng)
        if memory.started:
            offset = memory.offset + p.walk * math.sqrt(p.period * 1e-9) * draw
        else:
            offset = p.offset * draw
        memory = BarometerMemory(True, offset)
        pressure += offset + p.noise * standard_normal(rng)
    return memory, BarometerSample(True, quantise(pressure, p.resolution))
