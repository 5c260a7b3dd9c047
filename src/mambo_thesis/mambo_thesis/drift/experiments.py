"""
Fly the experiments that separate the mechanisms of the drift: ``drift_experiments``.

The circle of Figure C.4 is flown in closed loop, with noise, at half, normal and twice the speed
and at half the size, and it is carried by hand; each of these with four mechanisms in turn. The
drift measured is that of (5.2) with height and attitude from Optitrack. It is compared with the
prediction of the mechanism along the motion flown and with perfect tracking. Then the mechanism
is identified from the flights, as :mod:`mambo_thesis.drift.identify_drift` does.
"""

from __future__ import annotations

import argparse
import functools
import json
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.compare import digest
from mambo_bags.command import guard, Parser
from mambo_flight import closed_loop, scenario_file
from mambo_model import limits
from mambo_model.whole_file import write_text
import numpy as np
from tqdm import tqdm

from . import observations, report, table
from .evidence import Evidence, inclusion, negligible
from .flight import Flight, flow_of, from_recording
from .mechanisms import flow
from .paths import Array, EXPERIMENTS, Track
from .report import Flown, Identification

Q0 = 1.06
SEEDS = (1, 2, 3)
TURNS = 4.0 * np.pi  # s, a whole number of turns at every speed
ONE_PATH = ('drift_w_1',)
DATA_SETS = {  # {name: (experiments, window in s)}
    'all five, every sample': (tuple(EXPERIMENTS), None),
    'all five, drift alone': (tuple(EXPERIMENTS), TURNS),
    '`drift_w_1`, every sample': (ONE_PATH, None),
    '`drift_w_1`, drift alone': (ONE_PATH, TURNS),
}


class Truth(NamedTuple):
    """The error that a flight of the scenarios contains."""

    row: str                  # its row in the table of mechanisms
    sensor: dict[str, float]  # parameters of the flow equation
    letter: str               # of the mechanism to identify
    parameter: str            # the parameter of that mechanism
    value: float              # its true value


SLOPE = 0.07 / 1.025  # 1/m, (C.2b) about 1.5 m
TRUTHS = {  # {flight of the scenario: its error}; C2 is an error of the estimator
    'a': Truth('A', {'slope': SLOPE, 'scale': 1.025}, 'A', 'slope', SLOPE),
    'c2': Truth('C2 drag', {'scale': Q0}, 'C2', 'frame', 1.0),
    'd2': Truth('D2 drag', {'leakage': -1.0, 'scale': Q0}, 'D', 'leakage', -1.0),
    'f': Truth('F', {'cubic': 0.1, 'scale': Q0}, 'F', 'cubic', 0.1),
}


def flow_of_estimator(key: str, track: Track, samples: Array) -> Array:
    """Return the flow, (n, 2) rad/s, equivalent to the estimator's velocity; C2 alone differs."""
    if key != 'c2':
        return samples
    return flow_of(track, table.without_rotation(track, Q0 * samples)) / Q0


@functools.cache
def fly(name: str, seed: int = 1) -> Flight:
    """Fly a scenario such as ``drift_w_1/d2`` and return it as evidence; cached."""
    over = {'seed': scenario_file.Place(seed, '--seed')}
    flight = from_recording(name, closed_loop.fly(scenario_file.load(name, over)[1]))
    key = name.rpartition('/')[2]
    return flight._replace(flow=flow_of_estimator(key, flight.track, flight.flow))


def per_turn(track: Track, path: Array, speed: float) -> float:
    """Return the mean change of a quantity, (n,), per turn, over all whole turns."""
    T = 2.0 * np.pi / speed
    turns = int((track.t[-1] - track.t[0]) / T)
    begin, end = np.interp([track.t[0], track.t[0] + turns * T], track.t, path)
    return float(end - begin) / turns


def integral(t: Array, rate: Array) -> Array:
    """Return the cumulative integral of a rate, (n,), by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])


def drift(flight: Flight, samples: Array, speed: float) -> float:
    """
    Return the mean drift in x per turn, m, of (5.2) with factor 1.06, over all whole turns.

    Parameters
    ----------
    flight
        The flight; its true motion is used.
    samples : (n, 2) rad/s
        Flow at the instants of the flight.
    speed : rad/s
        Angular speed of the path.

    """
    track = flight.track
    error = table.exact_velocity(track, Q0 * samples) - track.velocity[:, :2]
    return per_turn(track, integral(track.t, error[:, 0]), speed)


def loop(flight: Flight, speed: float, size: float) -> float:
    """Return the area enclosed in x and height per turn over the area of the path."""
    track = flight.track
    above = track.height - 0.5 * (track.height.max() + track.height.min())
    area = per_turn(track, integral(track.t, above * track.velocity[:, 0]), speed)
    return abs(area) / (np.pi * size**2)


def experiment(name: str) -> dict[str, Flown]:
    """Return {flight: drift} for the flights of an experiment."""
    (speed, size, path), out = EXPERIMENTS[name], {}
    for key, truth in TRUTHS.items():
        flights = [fly(f'{name}/{key}', seed) for seed in SEEDS]
        track = flights[0].track
        exact = flow_of_estimator(key, track, flow(track, track.height, truth.sensor))
        out[key] = Flown(
            loop(flights[0], speed, size),
            float(table.drift(table.ROWS[truth.row], path, speed, size)[0]),
            drift(flights[0], exact, speed),
            [drift(f, f.flow, speed) for f in flights],
            [per_turn(f.track, f.track.position[:, 0], speed) for f in flights])
    return out


def identify(key: str, data_set: str) -> Identification:
    """Identify the mechanism from flights (first seed) whose error is known."""
    names, window = DATA_SETS[data_set]
    truth = TRUTHS[key]
    evidence = Evidence([fly(f'{name}/{key}') for name in names], window)
    fits = evidence.compare()
    alone, = (f for f in fits if f.model == (truth.letter,))
    best, whole = fits[0], inclusion(fits)
    small = negligible(evidence.flights, best, evidence.noise) if window is None else []
    model = tuple(x for x in best.model if x not in small)
    probability = min(whole[x] for x in model) if small else best.probability
    return Identification(
        key, data_set, model, probability, whole[truth.letter],
        alone.values[truth.parameter], alone.sigmas[truth.parameter])


def _run(options: argparse.Namespace) -> None:
    perfect = table.table()
    tables = [report.perfect_table(perfect), report.sources_table()]
    if options.write:  # refused before anything is flown
        limits.check_regular(options.write)
        report.replace_tables(tables, options.write.read_text(), options.write)
    flown = {name: experiment(name) for name in tqdm(
        EXPERIMENTS, desc='flying (compiles once)', disable=None, leave=False)}
    cases = [(key, data_set) for key in TRUTHS for data_set in DATA_SETS]
    found = [identify(*case) for case in tqdm(
        cases, desc='identifying mechanisms', disable=None, leave=False)]
    shown = observations.observed_by_mechanism()
    tables += [
        report.observed_table(shown), report.flown_table(flown), report.identification_table(
            found, {key: truth.value for key, truth in TRUTHS.items()})]
    print('\n'.join(tables))
    write_text(options.output / 'drift.md', '\n'.join(tables))
    write_text(options.output / 'drift.json', json.dumps({
        'table': {k: v.tolist() for k, v in perfect.items()}, 'observations': shown,
        'flown': {n: {k: f._asdict() for k, f in d.items()} for n, d in flown.items()},
        'identified': [f._asdict() for f in found],
    }, indent=1) + '\n')
    digest.save(report.draw(flown), options.output / 'drift.png', 130,
                report.figure_digest(tables[3]))
    if options.write:
        write_text(options.write, report.replace_tables(
            tables, options.write.read_text(), options.write))
    print(f'figure: {options.output / "drift.png"}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('drift_experiments',
                 'Predict the drift of each mechanism and fly the experiments that separate them.')
    out.add_output('DIR', 'folder to write into; older files are replaced (default: drift)',
                   Path('drift'))
    out.add_argument('--write', type=Path, metavar='FILE',
                     help='replace the tables of this document')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``drift_experiments``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('drift_experiments', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
