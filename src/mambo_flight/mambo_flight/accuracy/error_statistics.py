"""
Statistics of the filter error over flights: deviation beside the bound, NEES and NIS.

NEES is the squared error over the covariance that the filter states, NIS the same of the
innovations; of a consistent filter both are 1 per component on average. Where the variance of a
sensor is itself found from the last innovations, an innovation over it is distributed as F, and
the mean is n / (n - 2), with n the number of innovations that the found variance stands for.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

from mambo_estimation.joint.state import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, SCALE, SLOPE, VELOCITY
from mambo_estimation.joint.update import WEIGHT
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from .filter_error import DT, FilterError, SETTLED

Array = NDArray[np.float64]


class Row(NamedTuple):
    """One quantity of one flight."""

    bound: float        # variance, mean over the components
    reached: float      # squared error, mean over the components
    nees: float         # squared error over the variance that the filter states
    components: int


class Quantity(NamedTuple):
    """A quantity that is compared: name, unit and how to measure it in one flight."""

    name: str
    unit: str
    factor: float
    measure: Callable[[FilterError], Row]


def _nees(error: Array, P: Array) -> float:
    """Return the error squared by the inverse covariance; NaN if that is singular."""
    if not np.all(np.linalg.eigvalsh(P) > 0.0):
        return math.nan
    return float(error @ np.linalg.solve(P, error))


def _bound(j: FilterError, on: int, part: slice) -> float:
    """Return the bound of some components, their mean variance; NaN without a bound."""
    if j.limit is None:
        return math.nan
    return float(np.diagonal(j.limit[on:, part, part], axis1=1, axis2=2).mean())


def _at_end(first: int, count: int) -> Callable[[FilterError], Row]:
    """Return a measure of components of the error state at the end of a flight."""
    def measure(j: FilterError) -> Row:
        part = slice(first, first + count)
        error, P = j.error[-1, part], j.made.P[-1, part, part]
        return Row(_bound(j, -1, part), float(np.mean(error ** 2)), _nees(error, P), count)
    return measure


def _all_along(first: int, count: int) -> Callable[[FilterError], Row]:
    """Return a measure of components along a flight, with the NEES at its end."""
    def measure(j: FilterError) -> Row:
        part, on = slice(first, first + count), j.start + round(SETTLED / DT)
        error = j.error[on:, part]
        return Row(_bound(j, on, part), float(np.mean(error ** 2)),
                   _nees(j.error[-1, part], j.made.P[-1, part, part]), count)
    return measure


def _velocity(first: int, count: int) -> Callable[[FilterError], Row]:
    """Return a measure of the body velocity along a flight, by its published covariance."""
    def measure(j: FilterError) -> Row:
        on, part = j.start + round(SETTLED / DT), slice(VELOCITY + first, VELOCITY + first + count)
        axes = slice(first, first + count)
        return Row(_bound(j, on, part), float(np.mean(j.nu[on:, axes] ** 2)),
                   _nees(j.nu[-1, axes], j.made.twist[-1, axes, axes]), count)
    return measure


QUANTITIES = (
    Quantity('drift at the end', 'm', 1.0, _at_end(0, 2)),
    Quantity('height', 'm', 1.0, _all_along(2, 1)),
    Quantity('horizontal velocity', 'mm/s', 1e3, _velocity(0, 2)),
    Quantity('vertical velocity', 'mm/s', 1e3, _velocity(2, 1)),
    Quantity('tilt', 'deg', math.degrees(1.0), _all_along(ATTITUDE, 2)),
    Quantity('gyro bias', 'mrad/s', 1e3, _at_end(GYRO_BIAS, 3)),
    Quantity('accelerometer bias', 'mm/s^2', 1e3, _at_end(ACCEL_BIAS, 3)),
    Quantity('scale of the flow', '%', 100.0, _at_end(SCALE, 1)),
    Quantity('its slope', '1/km', 1e3, _at_end(SLOPE, 1)))
MOTION = 5  # the first so many are of the motion, which every estimator states


SENSORS = (('sonar', 1), ('flow', 2), ('barometer', 1))  # with the dimension of a sample


class Line(NamedTuple):
    """One quantity over all flights."""

    name: str
    unit: str
    bound: float
    reached: float
    ratio: float
    nees: float     # per component
    low: float      # 95 % limits of the NEES
    high: float


class Report(NamedTuple):
    """All quantities, and the mean normalised innovation of each sensor."""

    flights: int
    lines: list[Line]
    nis: dict[str, float]
    nis_limits: dict[str, tuple[float, float]]  # 95 % limits of the mean


class Measured(NamedTuple):
    """Errors and innovations of one flight."""

    rows: tuple[Row, ...]               # one for each of QUANTITIES, or of the first MOTION
    nis: tuple[float, float, float]     # mean normalised innovation of SENSORS, NaN: none
    samples: tuple[int, int, int] = (0, 0, 0)   # how many of each


def measured(j: FilterError) -> Measured:
    """Return errors and innovations of one flight."""
    nis, counts = [], []
    for i, (_, size) in enumerate(SENSORS):
        seen = j.made.ratios[j.start:, i] / size
        counts.append(int(np.isfinite(seen).sum()))
        nis.append(float(np.nanmean(seen)) if counts[-1] else math.nan)
    return Measured(tuple(one.measure(j) for one in QUANTITIES), (nis[0], nis[1], nis[2]),
                    (counts[0], counts[1], counts[2]))


def nis_limits(size: int, samples: int) -> tuple[float, float]:
    """
    Return the 95 % limits of the mean normalised innovation of a consistent filter.

    Parameters
    ----------
    size
        Numbers in a sample, whose squares are averaged.
    samples
        How many; none: the limits are infinitely wide.

    """
    found = size * (2.0 / WEIGHT - 1.0)  # innovations that an exponential mean stands for
    if not samples:
        return -math.inf, math.inf
    mean, half = found / (found - 2.0), 1.96 * math.sqrt(2.0 / (size * samples))
    return mean - half, mean + half


def summary(flights: list[Measured]) -> Report:
    """Return the comparison of several flights."""
    lines = []
    for i, quantity in enumerate(QUANTITIES[:len(flights[0].rows)]):
        rows = [one.rows[i] for one in flights]
        bound, reached = (
            quantity.factor * math.sqrt(float(np.mean([getattr(row, field) for row in rows])))
            for field in ('bound', 'reached'))
        degrees = sum(row.components for row in rows)
        lines.append(Line(
            quantity.name, quantity.unit, bound, reached,
            reached / bound if bound > 0.0 else math.nan,
            sum(row.nees for row in rows) / degrees,
            *(float(chi2.ppf(p, degrees)) / degrees for p in (0.025, 0.975))))
    nis = {name: float(np.mean([one.nis[i] for one in flights]))
           for i, (name, _) in enumerate(SENSORS)}
    limits = {name: nis_limits(size, sum(one.samples[i] for one in flights))
              for i, (name, size) in enumerate(SENSORS)}
    return Report(len(flights), lines, nis, limits)


def table(report: Report) -> str:
    """Return a report as lines of text."""
    out = [f'{"":<26}{"bound":>10}{"reached":>10}{"ratio":>8}{"NEES":>8}   95 %']
    out += [f'{_deviations(line)}{line.nees:>8.2f}   {line.low:.2f} to {line.high:.2f}'
            for line in report.lines]
    seen = ', '.join(f'{name} {x:.2f}' for name, x in report.nis.items() if math.isfinite(x))
    return '\n'.join([*out, f'{report.flights} flights; mean NIS: {seen}'])


def table_beside(report: Report, estimator: str) -> str:
    """Return a report of another estimator, which has no NEES, as lines of text."""
    return '\n'.join([f'{estimator} on the same samples', *map(_deviations, report.lines)])


def _deviations(line: Line) -> str:
    name = f'{line.name} [{line.unit}]'
    return f'{name:<26}{line.bound:>10.4g}{line.reached:>10.4g}{line.ratio:>8.2f}'
