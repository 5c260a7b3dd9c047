"""
Identify which mechanisms cause the drift in flights with Optitrack, with their probabilities.

Each bag must hold ``optical_flow`` and ``optitrack/pose``; a gyro helps. By default every sample
of the flow is used. With a ``--window`` of one or a few turns only the drift is used, as in the
thesis. With ``--estimate TOPIC`` the position of an estimator is examined in place of the flow;
errors of the estimator (C1, C2, G) can be seen only there. The probabilities are relative to the
mechanisms considered, one or two at a time, and to the priors in the JSON output. If even the most
probable one cannot be true, there are none, and the exit code is 1.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
import math
from pathlib import Path
from typing import Any

from mambo_analysis.identify import flow_doubts
from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, write_json
from mambo_bags.mcap_reader import BagError
from mambo_model import palette
from mambo_model.errors import JobError
from mambo_signals.poses import outliers
from matplotlib.figure import Figure
import numpy as np

from ..figures.drawing import sheet
from ..figures.page import picture
from .evidence import (
    credible_models, Evidence, Fit, inclusion, misfit, negligible, Noise, PRIOR, separating_odds)
from .flight import Flight, MIN_HEIGHT, read
from .mechanisms import flow, MECHANISMS, PARAMETERS

CONFIDENCE = 0.95
SHOWN_MODELS = 6
SEPARATING_ODDS = 3.0   # ln odds that separate two models: 20 to 1
MAX_NOISE_SHARE = 0.03  # share of noise in the rotation's power: it biases the leakage towards 0


def label(model: Sequence[str]) -> str:
    """Return the name of a model, such as ``A+D``, or ``none``."""
    return '+'.join(model) or 'none'


def _values(fit: Fit) -> str:
    return ', '.join(
        f'{name} {value:.4g} +- {1.96 * fit.sigmas[name]:.2g} {PARAMETERS[name].unit}'
        .removesuffix(' 1') for name, value in fit.values.items())


def conclusion(fits: list[Fit], small: Sequence[str] = ()) -> str:
    """Return the conclusion from the flights in one sentence; ``small`` of `negligible`."""
    best, credible = fits[0], credible_models(fits, CONFIDENCE)
    what = ' and '.join(f'{x} ({MECHANISMS[x].description})' for x in best.model
                        if x not in small) \
        or 'no mechanism: a constant scale is enough'
    if small:
        whole = inclusion(fits)
        main = min(whole[x] for x in best.model if x not in small)
        return (f'the flights support {what}, probability {main:.2f}; {small[0]} adds less than '
                'the noise and is not a finding')
    if len(credible) == 1:
        return f'the flights support {what}, probability {best.probability:.2f}'
    certain = [x for x, p in inclusion(fits).items() if p >= CONFIDENCE]
    more = f'; {" and ".join(certain)} present with probability of at least {CONFIDENCE:.2f}' \
        if certain else ''
    others = ', '.join(label(f.model) for f in credible[1:SHOWN_MODELS])
    return (f'these flights cannot separate {label(best.model)} ({best.probability:.2f}) from '
            f'{others}{more}')


def recommendation(fits: list[Fit], noise: Noise, window: float | None) -> str:
    """Return the experiment that best separates the two most probable models; '' if not needed."""
    credible = credible_models(fits, CONFIDENCE)
    if len(credible) < 2:
        return ''
    odds = separating_odds(credible[0], credible[1], noise, window)
    name = max(odds, key=lambda key: odds[key])
    pair = f'{label(credible[0].model)} and {label(credible[1].model)}'
    if odds[name] < SEPARATING_ODDS:
        return (f'30 s of any one of {", ".join(odds)} would not separate {pair} as fitted '
                f'(best: {name}, ln odds {odds[name]:.1f})')
    return f'30 s of {name} would separate {pair} best (ln odds {odds[name]:.0f})'


def rotation_warning(flights: Sequence[Flight]) -> str:
    """Return a warning if the rotation is too small against its measurement noise, else ''."""
    measured = np.concatenate([f.track.omega[:, :2].ravel() for f in flights])
    noises = np.concatenate([np.full(2 * len(f.flow), f.rate_noise) for f in flights])
    rotation, noise = math.sqrt(np.mean(measured**2)), math.sqrt(np.mean(noises**2))
    if noise**2 <= MAX_NOISE_SHARE * rotation**2:
        return ''
    return (f'little rotation: {rotation:.3f} rad/s measured with a noise of {noise:.3f} rad/s; '
            'D and G may be mistaken for other mechanisms; add a faster flight such as drift_w_2')


def resolution_warning(flights: Sequence[Flight]) -> str:
    """
    Return a warning if the flow is no finer than the motion, else ''.

    Rounding then hides or doubles the motion, and its error follows it: no noise is like that.
    """
    values = np.abs(np.concatenate([f.flow.ravel() for f in flights]))
    exact = np.concatenate([
        (f.track.nu[:, :2] / f.track.depth[:, None]).ravel() for f in flights])
    step = float(values[values > 0.0].min(initial=np.inf))
    size = math.sqrt(np.mean(exact**2))
    if not size <= step < math.inf:
        return ''
    return (f'coarse flow: its least value, {step:.3f} rad/s, is not below the motion of '
            f'{size:.3f} rad/s, and {np.mean(values == 0.0):.0%} of it is 0; rounding may be '
            'mistaken for a mechanism; fly faster or lower')


def table(fits: list[Fit]) -> str:
    """Return the most probable models and the probability of every mechanism as text."""
    lines = [f'{"model":<10}{"probability":>12}{"ln evidence":>13}  values with 95 % intervals']
    shown = fits[:max(SHOWN_MODELS, min(len(credible_models(fits, CONFIDENCE)), 12))]
    lines += [f'{label(f.model):<10}{f.probability:>12.4f}{f.log_evidence:>13.1f}  {_values(f)}'
              for f in shown]
    lines += ['', 'probability of each mechanism, alone or in a pair']
    lines += [f'  {x:<4}{p:>8.4f}  {MECHANISMS[x].description}'
              for x, p in inclusion(fits).items()]
    return '\n'.join(lines)


def apparent_factor(f: Flight, rates: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the least-squares factor from flow times depth to velocity in bins of height."""
    signal, nu = rates * f.track.depth[:, None], f.track.nu[:, :2]
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
    left.set(ylim=(0.0, 1.0), ylabel='probability', xlabel='mechanism, alone or in a pair')
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
        'models': [f._asdict() for f in fits], 'mechanisms': inclusion(fits), 'summary': lines}


def _run(options: argparse.Namespace) -> None:
    flights, lag = read(options.bags, options.namespace, options.flow_lag, options.height,
                        options.min_height, options.estimate)
    try:
        evidence = Evidence(flights, options.window)
    except ValueError as error:
        raise BagError(f'{options.bags[0]}: {error}') from None
    fits = evidence.compare()
    if reason := misfit(evidence, fits[0]):
        raise JobError(
            f'{", ".join(f.name for f in flights)}: none of the mechanisms explains these '
            f'flights: the best, {label(fits[0].model)}, {reason}: check clocks, axes (nose) and '
            'units of flow and motion capture, and flow that is 0 where it saw nothing')
    small = negligible(flights, fits[0], evidence.noise)
    lines = [conclusion(fits, small), recommendation(fits, evidence.noise, options.window),
             rotation_warning(flights), resolution_warning(flights),
             *(f'{f.name}: {line}' for f in flights for line in flow_doubts.unequal(
                 f.flow, f.track.nu[:, :2] / f.track.depth[:, None]))]
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
        print(f'{f.name}: {len(f.flow)} samples at {f.track.height.min():.2f} to '
              f'{f.track.height.max():.2f} m; flow lags by {1e3 * lag:.0f} ms; velocity noise of '
              f'Optitrack {f.velocity_noise:.4f} m/s')
        if f.impossible:
            print(f'  {outliers.describe("optitrack/pose", f.impossible)}')
    print(f'flow noise {noise.sigma:.4f} rad/s, its slow part {noise.long_run:.4f} rad/s\n\n'
          f'{table(fits)}\n')
    print('\n'.join(lines))


def _lag(text: str) -> float | None:
    return None if text == 'auto' else real(-1.0, 1.0, 's')(text)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('identify_drift', __doc__.split('\n\n')[0])
    out.add_argument('bags', type=Path, nargs='+', metavar='BAG',
                     help='flights of one drone with optical_flow and optitrack/pose')
    out.add_argument('--window', type=real(0.0, 1e4, 's', above=True), metavar='SECONDS',
                     help='use only displacements over windows of this length; a window of one '
                          'turn leaves only the drift')
    out.add_argument('--estimate', metavar='TOPIC',
                     help='examine this estimate (such as estimate/odom) in place of the flow')
    out.add_argument('--flow-lag', type=_lag, default=None, metavar='SECONDS',
                     help='lag of the flow (default: auto, found from the flights)')
    out.add_argument('--height', choices=('optitrack', 'sonar'), default='optitrack',
                     help='source of the true height (default: %(default)s)')
    out.add_argument('--min-height', type=real(0.0, 1e4, 'm', above=True),
                     default=MIN_HEIGHT, metavar='M',
                     help='leave out samples below this height (default: %(default)s)')
    out.add_argument('--figure', type=Path, metavar='PNG',
                     help='draw the probabilities and the apparent factor; an older file is '
                          'replaced')
    out.add_json()
    out.add_argument('--namespace', help='namespace of the drone, if a bag holds several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_drift``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('identify_drift', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
