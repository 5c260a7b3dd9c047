"""
Compare the joint filter with the lower bound of any estimator (Cramer-Rao), over many seeds.

SCENARIO is an experiment, a scenario file, or the name of a trajectory, which is then flown for
69 s without landing. Every flight has a seed of its own. For each quantity the table shows the
posterior Cramer-Rao bound, the standard deviation that the filter reached over all flights, and
their ratio: of drift, biases and scale at the end, of velocity and tilt from 10 s after take-off.
NEES is the squared error over the variance that the filter states, at the end of each flight. For
a consistent filter it lies between the two limits beside it with a probability of 95 %. The bound
leaves out vibration, which adds some mm/s to an estimate at the time of a sample. A flight that
lands is compared up to its landing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
import json
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import SLOPE, whole
from mambo_bags.command import counted, guard, Parser, write_json
from mambo_model.errors import InputError
from mambo_model.motion.trajectory import TRAJECTORIES
from mambo_model.schema import ParameterError

from . import crazyflie, from_bag
from .. import closed_loop, scenario_file
from ..scenario import override, Scenario, scenario
from .beside import ESTIMATORS, FIRMWARE, measured_beside
from .error_statistics import measured, Report, summary, table, table_beside
from .filter_error import DT, evaluate_recording, SETTLED, with_unknowns

MOST = 10_000  # flights of a command, so that their list stays small
LAST = 2**31 - 1  # largest seed
DURATION = 69.0  # s: 60 s of the trajectory after 9 s of take-off and joining it


def flight_of(name: str) -> Scenario:
    """Return the scenario of a trajectory, experiment or file, flown on the joint filter."""
    if name in TRAJECTORIES:
        return scenario(trajectory=name, estimator='joint', duration=DURATION, land=False)
    found = scenario_file.load_alone(name)[1]
    if not found.sim_node.duration > SETTLED + 10.0:
        raise InputError(
            f'{name}: sim_node.duration must be more than {SETTLED + 10.0:g} s')
    return override(found, {'estimator_node.estimator': 'joint'})


def check_slopes(flight: Scenario, slopes: Iterable[float], vary: bool) -> None:
    """Raise InputError for a slope in 1/m with which the flow cannot be simulated."""
    for slope in slopes:
        try:
            with_unknowns(flight, 0, vary, slope)
        except ParameterError as error:
            raise InputError(f'slope {slope:g} 1/m: {error}') from None


def add_seeds(out: Parser, default: int, what: str = 'how many flights') -> None:
    """Add the options of a command that flies many seeds; :func:`seeds_of` reads them."""
    out.add_argument('--seeds', type=whole(1, MOST), metavar='N',
                     help=f'{what} (default: {default})')
    out.add_argument('--first', type=whole(0, LAST), metavar='SEED',
                     help='seed of the first (default: 1)')
    out.set_defaults(usual_seeds=default)


def seeds_of(options: argparse.Namespace) -> range:
    """Return the seeds of the options; InputError for none, too many or one out of range."""
    count = options.usual_seeds if options.seeds is None else options.seeds
    first = 1 if options.first is None else options.first
    if first > LAST + 1 - count:
        raise InputError(f'--first {first}: every seed must be within 0 to {LAST}')
    return range(first, first + count)


def flown_already(options: argparse.Namespace, *others: str) -> list[str]:
    """Return which options that only a scenario takes are given."""
    names = ('seeds', 'first', 'vary', 'slope', *others)
    values = vars(options)  # 0 is a value that was given
    return [f'--{name}' for name in names if not any(values[name] is no for no in (None, False))]


def flights_of(
    options: argparse.Namespace,
) -> Iterator[tuple[Scenario, closed_loop.Recording | from_bag.Samples]]:
    """Return the flight of a bag, or fly the scenario once for each seed."""
    if from_bag.is_bag(options.scenario):
        if given := flown_already(options):
            raise InputError(f'{options.scenario}: a bag has been flown: leave out '
                             f'{", ".join(given)}')
        yield from_bag.read(Path(options.scenario))
        return
    seeds, flight = seeds_of(options), flight_of(options.scenario)
    if options.slope is not None:
        check_slopes(flight, [options.slope], options.vary)
    for seed in seeds:
        one = with_unknowns(flight, seed, options.vary, options.slope)
        yield one, closed_loop.fly(one)


def _data(report: Report) -> dict[str, Any]:
    return {'flights': report.flights, 'nis': report.nis,
            'quantities': [line._asdict() for line in report.lines]}


def compare(options: argparse.Namespace) -> None:
    """Fly as the options say, and print the comparison."""
    own, others = [], []
    if options.beside in FIRMWARE:
        crazyflie.bindings()  # what is wrong with them is said before anything is flown
    with counted(own, 1 if from_bag.is_bag(options.scenario) else len(seeds_of(options))):
        for flight, whole in flights_of(options):
            samples = from_bag.until_landing(whole)
            error = evaluate_recording(flight, samples)
            if error.start + round(SETTLED / DT) >= len(samples.t):
                raise InputError(f'{options.scenario}: the flight must last more than '
                                 f'{SETTLED:g} s after take-off')
            own.append(measured(error))
            if options.beside:
                others.append(measured_beside(
                    flight, samples, error.start, own[-1], options.beside))
    report = summary(own)
    found, text = _data(report), f'{options.scenario}\n{table(report)}'
    if others:
        other = summary(others)
        found['beside'] = {'estimator': options.beside, **_data(other)}
        text += f'\n{table_beside(other, options.beside)}'
    if options.json:
        write_json(options.json, json.dumps(found, indent=1))
    if options.json != '-':
        print(text)


def parser(bags: str = 'bag of a simulated flight') -> Parser:
    """Return the command line; ``bags`` says in its help which ones it takes."""
    out = Parser('bound', __doc__)
    add = out.add_argument
    add('scenario', metavar='SCENARIO',
        help=f'experiment, experiment/flight, file, trajectory, or {bags}')
    add_seeds(out, 20)
    add('--vary', action='store_true',
        help='draw slope (-0.1 to 0.15 1/m), scale (8 %%) and latency (0 to 0.1 s) of the flow')
    add('--slope', type=SLOPE, metavar='X',
        help='true slope of the scale in 1/m; with --vary in place of a drawn one')
    add('--beside', choices=ESTIMATORS, metavar='ESTIMATOR',
        help=f'also another one on the same samples: {", ".join(ESTIMATORS)}; the last two are '
             'the filter of the Crazyflie, whose Python bindings the environment variable '
             'CFFIRMWARE leads to')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``bound``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('bound', lambda: compare(options))


if __name__ == '__main__':
    raise SystemExit(main())
