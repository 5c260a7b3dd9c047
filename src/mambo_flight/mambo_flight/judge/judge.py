"""
Compare the joint filter with the best that any estimator could do, over many seeds.

SCENARIO is an experiment, a scenario file, or the name of a trajectory, which is then flown for
69 s without landing. Each flight of its own seed is flown in one process. For each quantity the
table shows the posterior Cramer-Rao bound, what the filter reached, and their ratio: deviations
over all flights, of drift, biases and scale at the end, of velocity and tilt from 10 s after
take-off on. NEES is the squared error over the variance that the filter states, at the end of
each flight; it is honest between the two limits beside it, where 95 % of honest filters are. The
bound leaves out the vibration, of which an estimate at the time of a sample keeps some mm/s.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import math
from typing import Any, NamedTuple

from mambo_bags.command import guard, Parser, write_json
from mambo_estimation.joint.state import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, SCALE, SLOPE, VELOCITY
from mambo_model.errors import InputError
from mambo_model.motion.trajectory import TRAJECTORIES
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from .. import closed_loop, offline_replay, scenario_file
from ..scenario import override, Scenario, scenario
from .flights import DT, judge, Judged, SETTLED, with_unknowns

Array = NDArray[np.float64]
DURATION = 69.0  # s: 60 s of the trajectory after 9 s of take-off and joining it


class Row(NamedTuple):
    """One quantity of one flight."""

    bound: float        # variance, mean over the components
    reached: float      # squared error, likewise
    nees: float         # squared error over the variance that the filter states
    components: int


class Quantity(NamedTuple):
    """What is compared, in which unit, and how one flight is measured."""

    name: str
    unit: str
    factor: float
    measure: Callable[[Judged], Row]


def _nees(error: Array, P: Array) -> float:
    """Return the squared error over its covariance; NaN where the filter is certain."""
    if not np.all(np.linalg.eigvalsh(P) > 0.0):
        return math.nan
    return float(error @ np.linalg.solve(P, error))


def _bound(j: Judged, on: int, part: slice) -> float:
    """Return the mean variance of some components by the bound; NaN without it."""
    if j.limit is None:
        return math.nan
    return float(np.diagonal(j.limit[on:, part, part], axis1=1, axis2=2).mean())


def _at_end(first: int, count: int) -> Callable[[Judged], Row]:
    """Return how components of the error state are compared at the end of a flight."""
    def measure(j: Judged) -> Row:
        part = slice(first, first + count)
        error, P = j.error[-1, part], j.made.P[-1, part, part]
        return Row(_bound(j, -1, part), float(np.mean(error ** 2)), _nees(error, P), count)
    return measure


def _all_along(first: int, count: int) -> Callable[[Judged], Row]:
    """Return how components are compared along a flight; NEES at its end."""
    def measure(j: Judged) -> Row:
        part, on = slice(first, first + count), j.start + round(SETTLED / DT)
        error = j.error[on:, part]
        return Row(_bound(j, on, part), float(np.mean(error ** 2)),
                   _nees(j.error[-1, part], j.made.P[-1, part, part]), count)
    return measure


def _velocity(first: int, count: int) -> Callable[[Judged], Row]:
    """Return how the body velocity is compared along a flight, with its published covariance."""
    def measure(j: Judged) -> Row:
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


SENSORS = (('sonar', 1), ('flow', 2), ('barometer', 1))  # and numbers in a sample


class Line(NamedTuple):
    """One quantity over all flights."""

    name: str
    unit: str
    bound: float
    reached: float
    ratio: float
    nees: float     # per component
    low: float      # 95 % limits of it
    high: float


class Report(NamedTuple):
    """All quantities, and the mean normalised innovation of each sensor."""

    flights: int
    lines: list[Line]
    nis: dict[str, float]


class Measured(NamedTuple):
    """What is kept of one flight."""

    rows: tuple[Row, ...]               # one for each of QUANTITIES
    nis: tuple[float, float, float]     # mean normalised innovation of SENSORS, NaN: none


def measured(j: Judged) -> Measured:
    """Return what is kept of one flight."""
    nis = []
    for i, (_, size) in enumerate(SENSORS):
        seen = j.made.ratios[j.start:, i] / size
        nis.append(float(np.nanmean(seen)) if np.isfinite(seen).any() else math.nan)
    return Measured(tuple(one.measure(j) for one in QUANTITIES), (nis[0], nis[1], nis[2]))


def summary(flights: list[Measured]) -> Report:
    """Return the comparison of several flights."""
    lines = []
    for i, quantity in enumerate(QUANTITIES):
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
    return Report(len(flights), lines, nis)


def drift_beside(flight: Scenario, estimator: str) -> float:
    """Return the mean square of x and y, m^2, by which another estimator is off at the end."""
    recording = closed_loop.fly(flight)
    other = override(flight, {'estimator_node.estimator': estimator}).estimator_node
    state = offline_replay.estimate_again(recording, other)
    return float(np.mean((recording.truth[-1, :2] - state[-1, :2]) ** 2))


def table(report: Report) -> str:
    """Return a report as lines of text."""
    out = [f'{"":<26}{"bound":>10}{"reached":>10}{"ratio":>8}{"NEES":>8}   95 %']
    for line in report.lines:
        name = f'{line.name} [{line.unit}]'
        out.append(
            f'{name:<26}{line.bound:>10.4g}{line.reached:>10.4g}{line.ratio:>8.2f}'
            f'{line.nees:>8.2f}   {line.low:.2f} to {line.high:.2f}')
    seen = ', '.join(f'{name} {x:.2f}' for name, x in report.nis.items() if math.isfinite(x))
    return '\n'.join([*out, f'{report.flights} flights; mean NIS: {seen}'])


def flight_of(name: str) -> Scenario:
    """Return the scenario of a trajectory, experiment or file, flown on the joint filter."""
    if name in TRAJECTORIES:
        return scenario(trajectory=name, estimator='joint', duration=DURATION, land=False)
    found = scenario_file.load(name)[1]
    if not found.sim_node.duration > SETTLED + 10.0:
        raise InputError(
            f'{name}: sim_node.duration must be more than {SETTLED + 10.0:g} s to be judged')
    return override(found, {'estimator_node.estimator': 'joint'})


def add_seeds(out: Parser, default: int, what: str = 'how many flights') -> None:
    """Add the options of a command that flies many seeds; :func:`seeds_of` reads them."""
    out.add_argument('--seeds', type=int, default=default, metavar='N',
                     help=f'{what} (default: %(default)s)')
    out.add_argument('--first', type=int, default=1, metavar='SEED',
                     help='seed of the first (default: %(default)s)')


def seeds_of(options: argparse.Namespace) -> range:
    """Return the seeds that are asked for; InputError if there are none."""
    if options.seeds < 1:
        raise InputError(f'--seeds {options.seeds}: must be 1 or more')
    return range(options.first, options.first + options.seeds)


def _run(options: argparse.Namespace) -> None:
    seeds, flight = seeds_of(options), flight_of(options.scenario)
    flights = [with_unknowns(flight, seed, options.vary, options.slope) for seed in seeds]
    report = summary([measured(judge(one)) for one in flights])
    found: dict[str, Any] = {
        'flights': report.flights, 'nis': report.nis,
        'quantities': [line._asdict() for line in report.lines]}
    text = f'{options.scenario}\n{table(report)}'
    if options.beside:
        off = math.sqrt(float(np.mean([drift_beside(one, options.beside) for one in flights])))
        found['beside'] = {'estimator': options.beside, 'drift': off}
        text += f'\ndrift of {options.beside} on the same samples: {off:.4g} m'
    if options.json:
        write_json(options.json, json.dumps(found, indent=1))
    if options.json != '-':
        print(text)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('bound', __doc__)
    add = out.add_argument
    add('scenario', metavar='SCENARIO', help='experiment, experiment/flight, file or trajectory')
    add_seeds(out, 20)
    add('--vary', action='store_true',
        help='draw slope (-0.1 to 0.15 1/m), scale (8 %%) and latency (0 to 0.1 s) of the flow')
    add('--slope', type=float, metavar='X', help='true slope of the scale in 1/m')
    add('--beside', choices=('kalman', 'toolbox'), metavar='ESTIMATOR',
        help='also the drift of kalman or toolbox on the same samples')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``bound``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('bound', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
