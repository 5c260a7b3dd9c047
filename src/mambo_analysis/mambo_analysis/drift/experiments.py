"""
The table of mechanisms and the experiments that tell them apart: ``drift_experiments``.

The table is that of :mod:`mambo_analysis.drift.table`, beside the values of the audit. Then the
circle of Figure C.4 is flown in closed loop, with noise, at half, its own and twice the speed, at
half the size, and carried by hand, each with four mechanisms at work; the drift is that of (5.2)
with the height and attitude of Optitrack, beside what the equation of the mechanism gives along
the motion that was flown.
"""

from __future__ import annotations

import argparse
import functools
import json
from pathlib import Path
import sys
from typing import NamedTuple

from matplotlib.figure import Figure
import numpy as np
from tqdm import tqdm

from .. import closed_loop, scenario_file
from ..cli import guard
from ..mcap_file import BagError
from ..thesis.drawing import COLOURS, sheet
from ..thesis.report import picture
from .flight import Flight, from_recording
from .mechanisms import flow
from .paths import Array, EXPERIMENTS, PATHS
from .table import right, ROWS, table, without_turning

Q0 = 1.06
TRUTHS = {  # flight of the scenario: what the equation says of it
    'a': {'slope': 0.07 / 1.025, 'scale': 1.025},
    'c2': {'scale': Q0},
    'd2': {'leakage': -1.0, 'scale': Q0},
    'f': {'cubic': 0.1, 'scale': Q0},
}
SEEDS = (1, 2, 3)


class Flown(NamedTuple):
    """Drift of one mechanism in one experiment, x, in one turn."""

    measured: list[float]  # m, of each seed
    predicted: float       # m, by the equation along the motion of the first seed


@functools.cache
def fly(name: str, seed: int = 1) -> Flight:
    """Return a flight of a scenario such as ``drift_w_1/d2`` as evidence; kept."""
    over = {'seed': scenario_file.Place(seed, '--seed')}
    return from_recording(name, closed_loop.fly(scenario_file.load(name, over)[1]))


def drift(flight: Flight, samples: Array, speed: float, turned: bool = True) -> float:
    """
    Return the drift in x in one turn, m, of (5.2) with factor 1.06, over all whole turns.

    Parameters
    ----------
    flight
        True motion.
    samples : (n, 2) rad/s
        Flow at its instants.
    speed : rad/s
        Of the path.
    turned
        False: body velocity as if it were inertial (C2).

    """
    track, T = flight.track, 2.0 * np.pi / speed
    turns = int((track.t[-1] - track.t[0]) / T)
    error = (right if turned else without_turning)(track, Q0 * samples) - track.velocity[:, :2]
    path = np.concatenate([[0.0], np.cumsum(
        0.5 * (error[1:, 0] + error[:-1, 0]) * np.diff(track.t))])
    begin, end = np.interp([track.t[0], track.t[0] + turns * T], track.t, path)
    return float(end - begin) / turns


def experiment(name: str) -> dict[str, Flown]:
    """Return {flight: drift} of an experiment."""
    speed, out = EXPERIMENTS[name][0], {}
    for key, values in TRUTHS.items():
        flights = [fly(f'{name}/{key}', seed) for seed in SEEDS]
        turned = key != 'c2'
        exact = flow(flights[0].track, flights[0].track.height, values)
        out[key] = Flown([drift(f, f.flow, speed, turned) for f in flights],
                         drift(flights[0], exact, speed, turned))
    return out


def markdown(perfect: dict[str, Array], flown: dict[str, dict[str, Flown]]) -> str:
    """Return both tables."""
    out = ['| mechanism | ' + ' | '.join(PATHS) + ' | largest difference |',
           '|---' * (len(PATHS) + 2) + '|']
    for name, found in perfect.items():
        apart = np.abs(found - np.array(ROWS[name].audit))
        cells = ' | '.join(f'{_number(x)}, {_number(y)}' for x, y in found)
        out.append(f'| {name}: {ROWS[name].says} | {cells} | {np.nanmax(apart):.3f} |')
    out += ['', '| experiment | ' + ' | '.join(k.upper() for k in TRUTHS) + ' |',
            '|---' * (len(TRUTHS) + 1) + '|']
    for name, drifts in flown.items():
        cells = [f'{min(d.measured):+.3f} to {max(d.measured):+.3f} ({d.predicted:+.3f})'
                 for d in drifts.values()]
        out.append(f'| `{name}` | ' + ' | '.join(cells) + ' |')
    return '\n'.join(out) + '\n'


def _number(x: float) -> str:
    return '0' if abs(x) < 5e-4 else f'{x:+.3f}'


def draw(flown: dict[str, dict[str, Flown]]) -> Figure:
    """Return the drift of each mechanism, over the speed, over the size and by hand."""
    figure, (left, middle, right_) = sheet(1, 3, 3.0)
    size_of = {'drift_half_amplitude': 0.5, 'drift_w_1': 1.0}
    speeds = [name for name in EXPERIMENTS if name.startswith('drift_w')]
    for key, colour in zip(TRUTHS, COLOURS, strict=False):
        def mean(names: list[str], key: str = key) -> list[float]:
            return [float(np.mean(flown[name][key].measured)) for name in names]
        left.loglog([EXPERIMENTS[n][0] for n in speeds], mean(speeds), 'o-', color=colour,
                    label=key.upper())
        middle.loglog(list(size_of.values()), mean(list(size_of)), 'o-', color=colour)
        right_.bar(key.upper(), mean(['drift_hand_loop'])[0], color=colour)
    left.set(xlabel='speed [rad/s]', ylabel='drift in a turn [m]')
    middle.set(xlabel='size [m]')
    right_.set(xlabel='carried by hand, level')
    figure.legend(loc='outside upper center', ncols=len(TRUTHS), frameon=False)
    return figure


def _run(options: argparse.Namespace) -> None:
    perfect = table()
    flown = {name: experiment(name) for name in tqdm(
        EXPERIMENTS, desc='flying (compiles once)', disable=None, leave=False)}
    text = markdown(perfect, flown)
    print(text)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / 'drift.md').write_text(text)
        (options.out / 'drift.json').write_text(json.dumps({
            'table': {k: v.tolist() for k, v in perfect.items()},
            'flown': {n: {k: f._asdict() for k, f in d.items()} for n, d in flown.items()},
        }, indent=1) + '\n')
        picture(draw(flown), options.out / 'drift.png')
    except OSError as error:
        raise BagError(f'{options.out}: cannot be written ({error.strerror})') from None
    print(f'figure: {options.out / "drift.png"}')


def main(arguments: list[str] | None = None) -> None:
    """Entry point ``drift_experiments``."""
    parser = argparse.ArgumentParser(
        prog='drift_experiments', description='Drift by mechanism: table and experiments.')
    parser.add_argument('--out', type=Path, default=Path('drift'), metavar='DIR',
                        help='folder to write into (default: drift)')
    options = parser.parse_args(arguments)
    sys.exit(guard('drift_experiments', lambda: _run(options)))


if __name__ == '__main__':
    main()
