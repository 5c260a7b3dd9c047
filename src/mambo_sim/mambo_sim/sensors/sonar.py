"""
Downward ultrasonic range: slant distance to the floor along the body z axis.

Defaults are measured on the flights of the vehicle's predecessor with the same toolbox
(RollingSpiderEdu). There a new value comes each 8 steps of 5 ms, values are whole multiples of
1.28496 mm (to 1e-6 in twelve recordings), and none is below 338 of them: nearer than 0.434 m,
also on the floor, the sensor reads that limit or a little more.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.normal import standard_normal
from mambo_model.arithmetic.trigonometry import cos
from mambo_model.compiled import jit
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError, quantity
from mambo_model.values import derived, Parameters, values_type
import numpy as np
from numpy.random import Generator

from .sampling import clamp, due, period_ns, quantise, tilt_cosine

RESOLUTION = 1.284958e-3  # m


class SonarSample(NamedTuple):
    """Output of the sensor at one tick."""

    new: bool     # there is one at this tick
    range: float  # m, slant, a float32 number; NaN if not new


@dataclass(frozen=True)
class SonarParams(Parameters):
    """
    Range, rate and noise of the sonar.

    An echo nearer than ``min_range`` reads as from there. There is no echo, hence no sample,
    from farther than ``max_range`` or at more than ``max_tilt``. An outlier is an echo from
    anywhere in the range, a multi-path one comes late: the true range times 1 to
    ``1 + 2 multipath_excess``. A dropout is a missing echo.
    """

    rate: float = quantity(
        25.0, 'Hz', 1.0, 200.0, 'new value each 8 steps of 5 ms, median of 12 flights')
    noise: float = quantity(
        0.005, 'm', 0.0, 1.0,
        'second differences over sqrt(6), robust, of the cleanest flight: 0.0047 m')
    offset: float = quantity(0.0, 'm', -1.0, 1.0, 'design choice: reading minus truth')
    resolution: float = quantity(RESOLUTION, 'm', 0.0, 0.1, 'all values of 12 flights; 0: none')
    min_range: float = quantity(
        338 * RESOLUTION, 'm', 0.0, 2.0, 'smallest value of 7 of 12 flights, 0.434 m')
    max_range: float = quantity(5.26, 'm', 0.5, 20.0, 'largest value of 12 flights')
    max_tilt: float = quantity(0.7, 'rad', 0.0, 1.5, 'assumed: beam of 40 degrees each side')
    outlier_probability: float = quantity(
        0.0, '1', 0.0, 1.0,
        'design choice; outliers of any kind (identify_sensors): 0.011 and 0.021 in the best two '
        'of 8 free flights, 0.12 of all their values, up to 0.25')
    multipath_probability: float = quantity(
        0.0, '1', 0.0, 1.0, 'design choice; 0.71 of the outliers are late (identify_sensors)')
    multipath_excess: float = quantity(
        0.75, '1', 0.0, 5.0, 'median of late outliers in 10 recordings (identify_sensors)')
    dropout_probability: float = quantity(
        0.0, '1', 0.0, 1.0,
        'design choice; 0.0028 of the values in 8 free flights read 0 (identify_sensors)')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.min_range < self.max_range:
            raise ParameterError(
                f'min_range = {self.min_range:g} m must be below '
                f'max_range = {self.max_range:g} m')
        chances = (
            self.outlier_probability, self.multipath_probability, self.dropout_probability)
        if sum(chances) > 1.0:
            raise ParameterError(
                'outlier_probability, multipath_probability and dropout_probability '
                f'sum to {sum(chances):g}; at most 1 of each sample can go wrong')

    @derived('ns', 'rate')
    def period(self) -> int:
        """Time between samples."""
        return period_ns(self.rate)

    @derived('-', 'max_tilt')
    def min_cosine(self) -> float:
        """Cosine of the largest tilt with an echo."""
        return cos(self.max_tilt)


SonarValues = values_type(SonarParams)


@jit
def step(
    tick: int, body: State, rng: Generator, noise: bool, p: SonarValues,
) -> SonarSample:
    """
    Take a sample if one is due: ``h / (cos phi cos theta)``, h = -rho_z.

    The sensor has no memory. It draws the same numbers whether there is an echo or not.

    Parameters
    ----------
    tick : 5 ms
        Number of the control step.
    body
        True state.
    rng
        The generator of this sensor.
    noise
        False: no noise, outliers or dropouts, and nothing drawn.
    p
        From :meth:`SonarParams.values`.

    """
    if not due(tick, p.period):
        return SonarSample(False, math.nan)
    error, stray, place = 0.0, 1.0, 0.0
    if noise:
        error, stray, place = p.noise * standard_normal(rng), rng.random(), rng.random()
    cosine = tilt_cosine(body.q)
    if cosine < p.min_cosine:
        return SonarSample(False, math.nan)
    slant = max(-body.rho[2] / cosine, p.min_range)
    if slant > p.max_range:
        return SonarSample(False, math.nan)
    reading = slant + p.offset + error
    late = p.outlier_probability + p.multipath_probability
    if stray < p.outlier_probability:
        reading = p.min_range + place * (p.max_range - p.min_range)
    elif stray < late:
        reading += 2.0 * p.multipath_excess * place * slant
        if reading > p.max_range:
            return SonarSample(False, math.nan)
    elif stray < late + p.dropout_probability:
        return SonarSample(False, math.nan)
    reading = clamp(quantise(reading, p.resolution), p.min_range, p.max_range)
    return SonarSample(True, np.float64(np.float32(reading)))
