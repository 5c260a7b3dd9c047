"""
Identify which mechanisms cause the drift in flights with Optitrack, with their probabilities.

Each bag must hold ``optical_flow`` and ``optitrack/pose``; a gyro helps. By default every sample
of the flow is used. With a ``--window`` of one or a few turns only the drift is used, as in the
thesis. With ``--estimate TOPIC`` the position of an estimator is examined in place of the flow;
errors of the estimator (C1, C2, G) can be seen only there. The probabilities are relative to the
mechanisms considered, one or two at a time, and to the priors in the JSON output.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
import math
from pathlib import Path
from typing import Any

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.mcap_reader import BagError
from mambo_model import palette
from mambo_signals import outliers
from matplotlib.figure import Figure
import numpy as np

from ..figures.drawing import sheet
from ..figures.page import picture
from .evidence import (
    Evidence, Fit, inclusion, minor, Noise, not_separated, PRIOR, separating)
from .flight import Flight, MIN_HEIGHT, read
from .mechanisms import flow, MECHANISMS, PARAMETERS

SURE = 0.95
SHOWN = 6
ODDS = 3.0  # ln: 20 to 1
DIM = 0.03  # share of noise in the rotation, by which a leakage comes out too small


def label(model: Sequence[str]) -> str:
    """Return the name of a model, such as ``A+D``, or ``none``."""
    return '+'.join(model) or 'none'


def _values(fit: Fit) -> str:
    return ', '.join(
        f'{name} {value:.4g} +- {1.96 * fit.sigmas[name]:.2g} {PARAMETERS[name].unit}'
        .removesuffix(' 1') for name, value in fit.values.items())


def sentence(fits: list[Fit], small: Sequence[str] = ()) -> str:
    """Return what the flights say, in one sentence; ``small`` of :func:`minor`."""
    best, left = fits[0], not_separated(fits, SURE)
    what = ' and '.join(f'{x} ({MECHANISMS[x].says})' for x in best.model if x not in small) \
        or 'no mechanism: a constant scale is enough'
    if small:
        whole = inclusion(fits)
        main = min(whole[x] for x in best.model if x not in small)
        return (f'the flights support {what}, probability {main:.2f}; {small[0]} beside it adds '
                'less than the noise: no finding')
    if len(left) == 1:
        return f'the flights support {what}, probability {best.probability:.2f}'
    sure = [x for x, p in inclusion(fits).items() if p >= SURE]
    more = f'; {" and ".join(sure)} is part of it (at least {SURE:.2f})' if sure else ''
    others = ', '.join(label(f.model) for f in left[1:SHOWN])
    return (f'these flights cannot separate {label(best.model)} ({best.probability:.2f}) from '
            f'{others}{more}')


def advice(fits: list[Fit], noise: Noise, window: float | None) -> str:
    """Return which experiment would separate the two most probable models; '' if none need be."""
    left = not_separated(fits, SURE)
    if len(left) < 2:
        return ''
    odds = separating(left[0], left[1], noise, window)
    name = max(odds, key=lambda key: odds[key])
    pair = f'{label(left[0].model)} and {label(left[1].model)}'
    if odds[name] < ODDS:
        return (f'30 s of none of {", ".join(odds)} would separate {pair} as they are fitted '
                f'(at best {name}, ln odds {odds[name]:.1f})')
    return f'{pair} would be separated best by 30 s of {name} (ln odds {odds[name]:.0f})'


def caveat(flights: Sequence[Flight]) -> str:
    """Return that rotation cannot be judged, if it is hidden in the noise of its measurement."""
    seen = np.concatenate([f.track.omega[:, :2].ravel() for f in flights])
    noise = np.concatenate([np.full(2 * len(f.flow), f.rate_noise) for f in flights])
    rotation, unsure = math.sqrt(np.mean(seen**2)), math.sqrt(np.mean(noise**2))
    if unsure**2 <= DIM * rotation**2:
        return ''
    return (f'little rotation: {rotation:.3f} rad/s measured with a noise of {unsure:.3f} rad/s: '
            'D and G may be taken for others; add a faster flight such as drift_w_2')


def table(fits: list[Fit]) -> str:
    """Return the most probable models and the probability of every mechanism as text."""
    lines = [f'{"model":<10}{"probability":>12}{"ln evidence":>13}  values with 95 % intervals']
    shown = fits[:max(SHOWN, min(len(not_separated(fits, SURE)), 12))]
    lines += [f'{label(f.model):<10}{f.probability:>12.4f}{f.log_evidence:>13.1f}  {_values(f)}'
              for f in shown]
    lines += ['', 'mechanism, alone or with another one']
    lines += [f'  {x:<4}{p:>8.4f}  {MECHANISMS[x].says}' for x, p in inclusion(fits).items()]
    return '\n'.join(lines)


def apparent_factor(f: Flight, seen: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the factor that best makes flow times depth the velocity, in bins of height."""
    signal, nu = seen * f.track.depth[:, None], f.track.nu[:, :2]
    out = np.full(len(edges) - 1, np.nan)
    for k, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        rows = (f.track.height >= low) & (f.track.height < high)
        if rows.sum() > 30:
            out[k] = np.sum(signal[rows] * nu[rows]) / np.sum(signal[rows]**2)
    return out


def draw(flights: Sequence[Flight], fits: list[Fit]) -> Figure:
    """Draw the probabilities, and the apparent factor over height, measured and modelled."""
    figure, (left, right) = sheet(1, 2, 3.2)
    shares = inclusion(fits)
    left.bar(list(shares), list(shares.values()), color=palette.COLOURS[palette.SERIES[0]])
    left.set(ylim=(0.0, 1.0), ylabel='probability', xlabel='mechanism, alone or with another')
    heights = np.concatenate([f.track.height for f in flights])
    edges = np.linspace(heights.min(), heights.max(), 13)
    for k, f in enumerate(flights):
        style = {'color': palette.COLOURS[palette.SERIES[k % len(palette.SERIES)]],
                 'markersize': 3}
        mark = 'os^Dv<>'[k // len(palette.SERIES) % 7]  # more flights than colours
        model = flow(f.track, f.height_before(fits[0].values.get('height_lag', 0.0)),
                     fits[0].values)
        middle = 0.5 * (edges[1:] + edges[:-1])
        right.plot(middle, apparent_factor(f, f.flow, edges), mark,
                   label=palette.in_figure(f.name), **style)
        right.plot(middle, apparent_factor(f, model, edges), '-', **style)
    right.set(xlabel='height [m]', ylabel='apparent factor')
    right.set_title(f'line: {label(fits[0].model)}', fontsize='medium')
    right.legend(fontsize='small')
    return figure


def data(flights: Sequence[Flight], lag: float, fits: list[Fit], noise: Noise,
         lines: list[str]) -> dict[str, Any]:
    """Return the whole result in a form that JSON can hold."""
    return {
        'flights': [{'name': f.name, 'samples': len(f.flow), 'flow_lag_s': lag,
                     'velocity_noise_m_s': f.velocity_noise} for f in flights],
        'noise': {'sigma_rad_s': noise.sigma, 'coefficients': noise.coefficients.tolist()},
        'prior': {'models_of_no_one_two_mechanisms': PRIOR,
                  'widths': {p.name: p.width for p in PARAMETERS.values()}},
        'models': [f._asdict() for f in fits], 'mechanisms': inclusion(fits), 'says': lines}


def _run(options: argparse.Namespace) -> None:
    flights, lag = read(options.bags, options.namespace, options.flow_lag, options.height,
                        options.min_height, options.estimate)
    try:
        evidence = Evidence(flights, options.window)
    except ValueError as error:
        raise BagError(f'{options.bags[0]}: {error}') from None
    fits = evidence.compare()
    small = minor(flights, fits[0], evidence.noise)
    lines = [sentence(fits, small), advice(fits, evidence.noise, options.window), caveat(flights)]
    lines = [line for line in lines if line]
    if options.json != '-':
        _print_result(flights, lag, fits, evidence.noise, lines)
    if options.json:
        write_json(options.json, json.dumps(
            data(flights, lag, fits, evidence.noise, lines), indent=1))
    if options.figure:
        picture(draw(flights, fits), options.figure)


def _print_result(flights: Sequence[Flight], lag: float, fits: Sequence[Fit], noise: Noise,
                  lines: Sequence[str]) -> None:
    """Print the result for a terminal."""
    for f in flights:
        print(f'{f.name}: {len(f.flow)} samples, {f.track.height.min():.2f} to '
              f'{f.track.height.max():.2f} m high; flow {1e3 * lag:.0f} ms behind; noise of the '
              f'velocity of Optitrack {f.velocity_noise:.4f} m/s')
        if f.impossible:
            print(f'  {outliers.describe("optitrack/pose", f.impossible)}')
    print(f'noise of the flow {noise.sigma:.4f} rad/s, of its slow part '
          f'{noise.long_run:.4f} rad/s\n\n{table(fits)}\n')
    print('\n'.join(lines))


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1e4:
        raise argparse.ArgumentTypeError(f'{text} is no number above 0')
    return value


def _lag(text: str) -> float | None:
    if text == 'auto':
        return None
    value = float(text)
    if not -1.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f'{text} is neither auto nor within a second')
    return value


def parser() -> Parser:
    """Return the command line."""
    out = Parser('identify_drift', __doc__.split('\n\n')[0])
    out.add_argument('bags', type=Path, nargs='+', metavar='BAG',
                     help='flights of one drone with optical_flow and optitrack/pose')
    out.add_argument('--window', type=_positive, metavar='SECONDS',
                     help='look at displacements over windows only; a turn: drift alone')
    out.add_argument('--estimate', metavar='TOPIC',
                     help='judge this estimate (estimate/odom) in place of the flow')
    out.add_argument('--flow-lag', type=_lag, default=None, metavar='SECONDS',
                     help='by how much the flow is behind (default: auto, found)')
    out.add_argument('--height', choices=('optitrack', 'sonar'), default='optitrack',
                     help='whose height is taken for the true one (default: %(default)s)')
    out.add_argument('--min-height', type=_positive, default=MIN_HEIGHT, metavar='M',
                     help='leave out what is lower (default: %(default)s)')
    out.add_argument('--figure', type=Path, metavar='PNG', help='draw probabilities and factor')
    out.add_json()
    out.add_argument('--namespace', help='of the drone, if a bag holds several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_drift``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('identify_drift', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
