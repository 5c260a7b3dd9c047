"""
Fly a scenario many times over seeds, vehicles, wind, sensor defects, gains: any parameter.

Writes a Parquet table with a row for each flight and a PNG with percentiles beside it; where two
numbers vary, another with a heat map over them. ``--flight N`` writes one flight as a bag.
Finished flights are kept if it is interrupted: the same command continues. The result does not
depend on the number of workers. The file is described in mambo_flight/sweep/design.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import math
from pathlib import Path
import sys
from typing import Any
import warnings

from mambo_bags.cli.option_types import FLIGHT, WORKERS
from mambo_bags.command import guard, interrupted, Parser, program
from mambo_bags.writer import refuse_name
from mambo_model.motion.height_check import FAR
from mambo_model.whole_file import PICTURE, refuse_existing, refuse_other_kind
import numpy as np

from . import design, heat_map, monte_carlo, plot, table
from .. import fly, recording_to_bag
from ..course import course_warnings
from .run import run
from .table import KEPT, SweepError

SHOWN = ('tracking_rms', 'tracking_max', 'estimation_rms', 'estimation_final',
         'saturated_share', 'pwm_max')
MOST_CHECKED = 20  # flights of a course that differ in plan or vehicle; 15 ms each


def sweep(
    path: Path, out: Path, ideal: bool = False, workers: int | None = None,
    dask: str | None = None, warn: Callable[[str], object] = warnings.warn,
) -> dict[str, list[Any]]:
    """
    Fly a sweep file.

    Parameters
    ----------
    path
        Sweep file.
    out
        Parquet file to write; until then the finished rows are in ``out.rows``.
    ideal
        Whether to fly without sensors, on the true state.
    workers, dask
        See :func:`run.run`.
    warn
        Called before the flights with what the vehicle cannot fly of their courses, a line for
        each, if there is any.

    Returns
    -------
    Columns of the result by name.

    Raises
    ------
    mambo_model.schema.ParameterError
        For a wrong file, naming file, line and key.
    mambo_model.errors.InputError
        If the result exists, its plots would replace a file of another kind, or the unfinished
        rows belong to another sweep.
    SweepEndedError
        If it was interrupted; the finished rows are kept.

    """
    refuse_existing(out)
    for picture in (out.with_suffix('.png'), map_of(out)):
        refuse_other_kind(picture, PICTURE)
    flights = design.Flights(design.read(path))
    if lines := _check(flights):
        warn('\n'.join(lines))
    journal = table.Journal(
        out.with_name(f'{out.name}.rows'), table.digest(flights, ideal))
    if said := table.continued(flights, journal):
        print(f'{program("sweep")}: {said}', file=sys.stderr)
    try:
        run(flights, journal, ideal, workers, dask)
        data, title = table.columns(flights.sweep, journal.rows), flights.sweep.head.title
        what = (data, list(table.parameters(flights.sweep, 0)), title or path.stem,
                table.units(flights.sweep))
        plot.draw(out.with_suffix('.png'), *what)
        heat_map.draw(map_of(out), *what)
        table.write(out, data, title)  # last: a table is a sweep that has ended
        journal.remove()
    except BaseException:
        journal.leave()
        raise
    return data


def _check(flights: design.Flights) -> list[str]:
    """
    Refuse wrong input before anything is flown; return warnings about the courses, a line each.

    Those of a course are of the first flight that has any, among its first ``MOST_CHECKED``
    flights that differ in plan or vehicle.
    """
    lines: list[str] = []
    told: set[str] = set()
    checked: dict[str, set[Any]] = {}
    for number in range(len(flights)):
        reference = flights[number].reference_node
        plan, pair = reference.plan, (reference.plan, reference.vehicle)
        others = checked.setdefault(plan.course, set())
        if plan.course in told or pair in others or len(others) == MOST_CHECKED:
            continue
        others.add(pair)
        if found := [f'flight {number}: {line}' for line in course_warnings.describe(*pair)]:
            lines += found
            told.add(plan.course)
    return lines


def _print_warnings(lines: str) -> None:
    """Print warnings as ``mambo fly`` does."""
    for line in lines.splitlines():
        print(f'warning: {line}', flush=True)


def map_of(out: Path) -> Path:
    """Return the file of the heat map beside a result."""
    return out.with_name(f'{out.stem}_map.png')


def summary(data: Mapping[str, Sequence[Any]]) -> str:
    """Return the percentiles of a result as a table, with the number of flights of each row."""
    flights = len(data['flight'])
    lines = [f'{"":<18}{"5 %":>10}{"50 %":>10}{"95 %":>10}{"max":>10}  of flights']
    for name in SHOWN:
        values = np.asarray(data[name], dtype=float)
        good = values[np.isfinite(values)]
        if len(good):
            shown = (*np.percentile(good, (5, 50, 95)), good.max())
            lines.append(f'{name:<18}' + ''.join(f' {x:>9.3g}' for x in shown)
                         + f'  {len(good)} of {flights}')
    untracked, unestimated = (np.isnan(np.asarray(data[name], dtype=float))
                              for name in ('tracking_rms', 'estimation_rms'))
    if grounded := int((untracked & unestimated).sum()):
        lines.append(f'{grounded} of {flights} flights never took off: no errors')
    if unknown := int((~untracked & unestimated).sum()):
        lines.append(f'{unknown} of {flights} flights have no estimation error: their estimate '
                     'was not finite')
    lines.append(f'{sum(data["shutdown"])} of {flights} flights were shut down')
    if landed := sum(bool(why) and not down for why, down in zip(
            data['failsafe'], data['shutdown'], strict=True)):
        lines.append(f'{landed} of {flights} flights ended while the failsafe held or landed them')
    if fallen := sum(data['fallen']):
        lines.append(f'{fallen} of {flights} flights lay on the floor below their reference, '
                     'fell after their landing, or hit the floor')
    if strayed := sum(data['strayed']):
        lines.append(f'{strayed} of {flights} flights were more than {FAR:g} m beside their '
                     'reference, or far from its height, for 2 s')
    rows = list(zip(*(values for name, values in data.items() if name != 'flight'), strict=True))
    if repeats := flights - len(set(map(repr, rows))):  # NaN equals NaN there
        lines.append(f'{repeats} of {flights} flights repeat another one, with all its values')
    results = zip(*(data[name] for name in SHOWN), strict=True)
    flown = {repr(row): result for row, result, error in zip(
        rows, results, data['estimation_rms'], strict=True) if math.isfinite(error)}
    if same := len(flown) - len(set(map(repr, flown.values()))):
        lines.append(f'{same} of {flights} flights have the numbers of one with other parameters: '
                     'what varies between these has no effect')
    return '\n'.join(lines)


def _measure(path: Path, ideal: bool) -> None:
    speed = monte_carlo.speed(design.Flights(design.read(path))[0], ideal)
    what = 'without' if ideal else 'with'
    print(f'{what} sensors, one core: {speed.real_time_factor:.0f} times real time, '
          f'{speed.drone_steps / 1e6:.2f} million drone-steps/s')


def _fly(path: Path, number: int, out: Path) -> None:
    """Fly one flight of a sweep and write its bag."""
    refuse_existing(out)
    refuse_name(out)
    flights = design.Flights(design.read(path))
    if number >= len(flights):
        raise SweepError(f'--flight {number}: the last flight of {path} is {len(flights) - 1}')
    flight = flights[number]
    recording_to_bag.check(flight)
    reference = flight.reference_node
    for line in course_warnings.describe(reference.plan, reference.vehicle):
        _print_warnings(line)
    fly.write_flight(f'flight {number}', flight, out)


def _run(options: argparse.Namespace) -> None:
    if options.measure:
        others = {'--flight': options.flight, '--output': options.output,
                  '--workers': options.workers, '--dask': options.dask}
        if given := [name for name, value in others.items() if value is not None]:
            raise SweepError(f'--measure only measures: leave out {", ".join(given)}')
        _measure(options.sweep, options.ideal)
        return
    if options.output is None:
        raise SweepError('give --output RESULT.parquet')
    if options.flight is not None:
        if options.ideal or options.dask or options.workers:
            raise SweepError('--flight flies one flight here, with sensors: leave out --ideal, '
                             '--dask and --workers')
        _fly(options.sweep, options.flight, options.output)
        return
    try:
        data = sweep(options.sweep, options.output, options.ideal, options.workers, options.dask,
                     _print_warnings)
    except KeyboardInterrupt as end:
        raise interrupted(end, KEPT) from None
    print(f'{summary(data)}\ntable: {options.output}\nplots: {options.output.with_suffix(".png")}')
    if map_of(options.output).exists():
        print(f'heat map: {map_of(options.output)}; the bag of the flight of a cell: mambo sweep '
              f'{options.sweep} --flight N -o BAG')
    table.report_faults([(f'flight {k}', fault) for k, fault in enumerate(data['fault'])])


def parser() -> Parser:
    """Return the command line."""
    out = Parser('sweep', __doc__)
    add = out.add_argument
    add('sweep', type=Path, metavar='SWEEP.yaml', help='sweep file')
    out.add_output('RESULT.parquet', 'table to write, with --flight the bag')
    add('--flight', type=FLIGHT, metavar='N',
        help='fly this one, numbered from 0 as in the table, and write its bag to --output')
    add('--workers', type=WORKERS, metavar='N', help='processes (default: one for each core)')
    add('--dask', metavar='ADDRESS',
        help="fly on the workers of a Dask scheduler, e.g. tcp://host:8786, in place of this "
        "machine's processes")
    add('--ideal', action='store_true', help='without sensors: the controller gets the true state')
    add('--measure', action='store_true',
        help='only measure how fast one core flies the first flight')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``sweep``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('sweep', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
