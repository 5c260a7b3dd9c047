"""
Check that the covariance of the joint filter is consistent with its errors, over many seeds.

Each SCENARIO, by default hover and the trajectories of the thesis, is flown with each true slope
of the flow. Scale, latency and the offset of the sonar are drawn for every flight. NEES is the
squared error at the end of a flight over the variance that the filter states, per component. For
a consistent filter it lies between the limits in brackets with a probability of 95 %, so that one
number in twenty is outside by chance (marked with *). NIS is the same for the innovations, mean
over the flights. Its limits are near 1.01, because the filter finds the variance of a sensor from
the last 200 innovations.
"""

from __future__ import annotations

import argparse
import json
import math
import os

from mambo_bags.cli.option_types import SLOPE, WORKERS
from mambo_bags.command import guard, Parser, write_json

from ..worker_pool import worker_pool
from .bound import add_seeds, check_slopes, flight_of, seeds_of
from .error_statistics import Measured, measured, Report, summary
from .filter_error import evaluate, with_unknowns

PATHS = (
    'hover', 'circle', 'circle_rising', 'vertical_circle', 'figure_3_3', 'vertical_circle_large')
SLOPES = (0.0, -0.07, 0.14)


def one(name: str, slope: float, seed: int) -> Measured:
    """Fly once with random sensor errors and a slope in 1/m; return its errors and NIS."""
    return measured(evaluate(with_unknowns(flight_of(name), seed, True, slope), False))


def consistency(
    names: list[str], slopes: list[float], seeds: range, workers: int,
) -> dict[tuple[str, float], Report]:
    """
    Return the report of each path and slope.

    Parameters
    ----------
    names
        Scenarios, see :func:`bound.flight_of`.
    slopes : 1/m
    seeds
        Seeds of the flights.
    workers
        Number of processes.

    """
    for name in names:
        check_slopes(flight_of(name), slopes, True)  # wrong input, before anything is flown
    cases = [(name, slope) for name in names for slope in slopes]
    jobs = [(*case, seed) for case in cases for seed in seeds]
    with worker_pool(min(workers, len(jobs))) as pool:
        found = list(pool.map(one, *zip(*jobs, strict=True)))
    count = len(seeds)
    return {case: summary(found[i * count:(i + 1) * count]) for i, case in enumerate(cases)}


def outside(report: Report) -> list[str]:
    """Return the names of the quantities whose NEES is not between its limits."""
    return [line.name for line in report.lines
            if math.isfinite(line.nees) and not line.low <= line.nees <= line.high]


def outside_nis(report: Report) -> list[str]:
    """Return the names of the sensors whose mean NIS is not between its limits."""
    return [name for name, (low, high) in report.nis_limits.items()
            if math.isfinite(report.nis[name]) and not low <= report.nis[name] <= high]


def table(reports: dict[tuple[str, float], Report]) -> str:
    """Return the NEES of all cases as text, with the number outside the limits."""
    first = next(iter(reports.values()))
    heads = [f'{line.name} ({line.low:.2f} to {line.high:.2f})' for line in first.lines]
    out, bad, total = [f'{first.flights} flights a line; NEES of'], 0, 0
    out += [f'  {chr(97 + i)}: {head}' for i, head in enumerate(heads)]
    out.append('NIS of ' + ', '.join(
        f'{name} ({low:.3f} to {high:.3f})' for name, (low, high) in first.nis_limits.items()))
    out.append(f'{"":<23}{"slope":>7}' + ''.join(
        f'{chr(97 + i):>7}' for i in range(len(heads))) + '   NIS sonar, flow, barometer')
    for (name, slope), report in reports.items():
        wrong, spoilt = outside(report), outside_nis(report)
        bad += len(wrong) + len(spoilt)
        total += sum(math.isfinite(line.nees) for line in report.lines)
        total += sum(math.isfinite(report.nis[sensor]) for sensor in report.nis_limits)
        cells = ''.join(
            f'{line.nees:>6.2f}{"*" if line.name in wrong else " "}' for line in report.lines)
        nis = ', '.join(
            f'{x:.3f}{"*" if sensor in spoilt else ""}' for sensor, x in report.nis.items())
        out.append(f'{name:<23}{slope:>7g}{cells}   {nis}')
    out.append(f'{bad} of {total} outside their 95 % limits; chance alone: '
               f'about {0.05 * total:.0f}')
    return '\n'.join(out)


def _run(options: argparse.Namespace) -> None:
    seeds = seeds_of(options)
    reports = consistency(
        options.scenario or list(PATHS), options.slopes, seeds, options.workers)
    if options.json:
        write_json(options.json, json.dumps([
            {'scenario': name, 'slope': slope, 'flights': report.flights, 'nis': report.nis,
             'nis_limits': report.nis_limits,
             'outside': outside(report) + outside_nis(report), 'quantities': [
                 {key: value for key, value in line._asdict().items()
                  if key in ('name', 'nees', 'low', 'high')} for line in report.lines]}
            for (name, slope), report in reports.items()], indent=1))
    if options.json != '-':
        print(table(reports))


def parser() -> Parser:
    """Return the command line."""
    out = Parser('consistency', __doc__)
    add = out.add_argument
    add('scenario', nargs='*', metavar='SCENARIO',
        help=f'experiment, file or trajectory (default: {", ".join(PATHS)})')
    add('--slopes', type=SLOPE, nargs='+', default=list(SLOPES), metavar='X',
        help='true slopes of the scale of the flow, 1/m (default: 0 -0.07 0.14)')
    add_seeds(out, 100, 'flights a line')
    add('--workers', type=WORKERS, default=os.cpu_count() or 1, metavar='N',
        help='processes (default: one for each core)')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``consistency``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('consistency', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
