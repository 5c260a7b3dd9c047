"""
Smooth many simulated flights and count how often the intervals contain the true values.

Slope, scale and latency of the flow are drawn for each flight as `mambo bound --vary` draws them.
A 95 % interval should contain the true value in 95 of 100 flights.
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

from mambo_bags.command import counted, guard, Parser
from mambo_model.errors import JobError
import numpy as np

from .. import closed_loop, offline_replay
from ..accuracy.bound import add_seeds, flight_of, seeds_of
from ..accuracy.filter_error import evaluate_recording, with_unknowns
from ..scenario import Scenario
from .intervals import intervals, middle, NAME, Path, path_error, QUANTITIES
from .smoother import smooth


class Trial(NamedTuple):
    """Result of one flight."""

    held: tuple[bool, ...]    # by QUANTITIES: the interval contains the true value
    errors: tuple[float, ...]  # by QUANTITIES: estimate minus truth
    filtered: Path
    smoothed: Path


def trial(flight: Scenario) -> Trial | None:
    """Smooth one flight and compare it with the truth; None if the vehicle never moved."""
    recording = closed_loop.fly(flight)
    evaluated = evaluate_recording(flight, recording, bounded=False)
    s = smooth(offline_replay.steps_of(recording), flight.estimator_node.joint)
    if not s.moving.any():
        return None
    k, held, errors = middle(s), [], []
    for one in intervals(s):
        i = one.quantity.index
        true = one.quantity.sign * float(evaluated.made.x[k, i + 1] + evaluated.error[k, i])
        held.append(one.low <= true <= one.high)
        errors.append(one.value - true)
    truth = recording.truth[s.moving]
    return Trial(tuple(held), tuple(errors), path_error(s.filtered.x[s.moving], truth),
                 path_error(s.x[s.moving], truth))


def table(trials: list[Trial]) -> str:
    """Return the flights as lines of text."""
    n = len(trials)
    out = [f'{"":<{NAME}}{"held":>6} of {n}{"rms error":>13}']
    for i, quantity in enumerate(QUANTITIES):
        error = math.sqrt(float(np.mean([one.errors[i] ** 2 for one in trials])))
        held = sum(one.held[i] for one in trials)
        out.append(f'{f"{quantity.name} [{quantity.unit}]":<{NAME}}{held:>6}'
                   f'{"":>{4 + len(str(n))}}{error:>13.4g}')
    for name in ('filtered', 'smoothed'):
        paths = np.array([getattr(one, name) for one in trials])
        rms, largest, end = np.sqrt((paths**2).mean(axis=0))
        out.append(f'{f"horizontal path, {name} [m]":<{NAME}} rms {rms:.4f}, '
                   f'largest {largest:.4f}, end {end:.4f}')
    return '\n'.join(out)


def _run(options: argparse.Namespace) -> None:
    seeds, flight, done = seeds_of(options), flight_of(options.scenario), []
    with counted(done, len(seeds)):
        for seed in seeds:
            done.append(trial(with_unknowns(flight, seed, True)))
    flown = [one for one in done if one]
    if not flown:
        raise JobError(f'{options.scenario}: the vehicle never took off: nothing to compare')
    print(f'{options.scenario}\n{table(flown)}')
    if len(flown) < len(done):
        print(f'{len(done) - len(flown)} of {len(done)} vehicles never took off: left out')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('coverage', __doc__)
    out.add_argument('scenario', metavar='SCENARIO',
                     help='experiment, experiment/flight, file or trajectory')
    add_seeds(out, 100)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``coverage``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('coverage', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
