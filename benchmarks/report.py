"""What was measured: text for the terminal, ``docs/evidence/performance.md`` and JSON."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

import numpy as np

from .measure import Result

TRIED = Path(__file__).with_name('tried.md')
RATE = 1000.0  # Hz, of the physics
UNITS = {
    'factor': 'times real time', 'start': 'first second [s]', 'memory': 'largest node [MB]',
    'lost': 'messages lost', 'missed': 'steps missed', 'cpu': 'CPU s per s of flight',
    'different': 'replays that differ', 'slowdown': 'late over early',
    'steps': 'million drone-steps/s', 'agent': 'thousand control steps/s'}
DIVIDED = ('graph_separate', 'endurance_realtime_separate')
"""Rows whose CPU time is divided by process."""
ORDER = ('reference_c', 'reference_numba')  # then the others as they come


def number(value: float) -> str:
    """Return a number with three digits, or a dash."""
    if not math.isfinite(value):
        return '-'
    if value == 0.0 or abs(value) >= 100.0:
        return f'{value:.0f}'
    return f'{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}'


def spread(values: np.ndarray) -> str:
    """Return median (least - most)."""
    if not len(values):
        return '-'
    return f'{number(np.median(values))} ({number(values.min())} - {number(values.max())})'


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table, its columns as wide as they need to be."""
    lines = [head, *rows]
    width = [max(len(line[i]) for line in lines) for i in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        first, *rest = (cell.ljust(w) if i == 0 else cell.rjust(w)
                        for i, (cell, w) in enumerate(zip(cells, width)))
        return f"| {' | '.join([first, *rest])} |"
    rule = [':' + '-' * (w - 1) if i == 0 else '-' * (w - 1) + ':' for i, w in enumerate(width)]
    return '\n'.join([line(head), line(rule), *map(line, rows)])


def ratio(result: Result, base: Result | None) -> np.ndarray:
    """Return how often faster in CPU time than another, of each repetition, (n,)."""
    if base is None:
        return np.empty(0)
    pairs = zip(result.samples, base.samples)
    return np.array([a['cpu_factor'] / b['cpu_factor'] for a, b in pairs])


def missing(rows: list[Result]) -> str:
    """Return a line for each row that was not measured, and why."""
    return ''.join(f'\n\n**Not measured: {r.contender.title}.** `{r.gap}`' for r in rows if r.gap)


def _side_by_side(results: list[Result]) -> str:
    by_name = {result.contender.name: result for result in results}
    rows = sorted((r for r in results if r.contender.group in (
        'reference', 'closed_loop', 'rotorpy')),
        key=lambda r: ORDER.index(r.contender.name) if r.contender.name in ORDER else len(ORDER))
    if not rows:
        return ''
    peer = by_name.get('rotorpy_fastest')
    table = []
    for r in rows:
        table.append((
            r.contender.title, spread(r.values('factor')), spread(r.values('cpu_factor')),
            number(r.median('cpu_factor') * RATE * 1e-6), *(
                number(float(np.median(q))) if len(q := ratio(r, base)) else '-'
                for base in (by_name.get('reference_c'), peer)),
            number(r.preparation) if r.preparation > 0.01 else '-'))
    notes = ''.join(
        f'- {r.contender.title}: {"; ".join(filter(None, (r.contender.detail, r.note)))}\n'
        for r in rows if r.contender.detail)
    return ('## One drone on a circle of 1 m, one core\n\n' + markdown(
        ('', 'times real time', 'per CPU second', 'million drone-steps per CPU s', 'of C',
         'of RotorPy', 'first call [s]'), table) + missing(rows)
        + '\n\nA drone-step is a millisecond of flight: a step of the physics where that is '
        '1 kHz, with its share of all else. Ratios, to the C reference and to RotorPy at its '
        'fastest, are medians of those within one repetition, in CPU time. The first call '
        'compiles or loads and is in no other number.\n\n' + notes)


def _sweep(results: list[Result]) -> str:
    rows = [r for r in results if r.contender.group == 'sweep']
    return '' if not rows else '## Sweeps over seeds in wind\n\n' + markdown(
        ('', 'million drone-steps/s', 'times real time', 'with the start of the processes',
         'a few flights [s]'),
        [(r.contender.title, spread(r.values('steps')), number(r.median('factor')),
          number(r.median('all')), number(r.median('start'))) for r in rows]) + missing(rows) + (
        '\n\nWall time, metrics of each flight included. The first two columns are what a '
        'flight more costs, as the start of processes is there once.\n')


def _gym(results: list[Result]) -> str:
    rows = [r for r in results if r.contender.group == 'gym']
    return '' if not rows else '## Gymnasium environments, 256 drones\n\n' + markdown(
        ('', 'thousand control steps/s', 'thousand per CPU second'),
        [(r.contender.title, spread(r.values('agent')), spread(r.values('agent_cpu')))
         for r in rows]) + missing(rows) + (
        '\n\nWall time of `step`, in Python: a control step is 5 ms of flight of one drone, with '
        'action, observation and reward; the PWM is constant. The flights up to the handover '
        'are not in it.\n')


def _delay(result: Result) -> str:
    """Return median, 99th percentile and most from an IMU sample to its motor command."""
    return ', '.join(number(result.median(f'delay {name}')) for name in ('median', 'p99', 'most'))


def _graph(results: list[Result]) -> str:
    rows = [r for r in results if r.contender.group in ('graph', 'endurance')]
    if not rows:
        return ''
    text = '## The graph of ROS 2 nodes, every topic recorded\n\n' + markdown(
        ('', 'times real time', 'first second [s]', 'CPU s per s of flight', 'largest node [MB]',
         'all [MB]', 'messages lost', 'steps missed', 'steps that waited',
         'IMU to PWM: p50, p99, max [ms]'),
        [(r.contender.title, spread(r.values('factor')), spread(r.values('start')),
          number(r.median('cpu')), number(r.median('memory')), number(r.median('memory_all')),
          number(r.median('lost')), number(r.median('missed')),
          number(r.median('late')), _delay(r))
         for r in rows]) + missing(rows) + (
        '\n\nFirst second: from starting the processes to a closed bag of one second of flight, '
        'compiled code in the cache. The flights of ten minutes are flown once.\n')
    for r in rows:
        names = sorted({name.removeprefix('cpu ') for sample in r.samples for name in sample
                        if name.startswith('cpu ')})
        if r.contender.name in DIVIDED and names:
            text += f'\n{r.contender.title}:\n\n' + markdown(
                ('process', 'CPU s per s of flight'),
                [(name, number(r.median(f'cpu {name}'))) for name in names]) + '\n'
    return text


def _replay(results: list[Result]) -> str:
    rows = [r for r in results if r.contender.group == 'replay']
    return '' if not rows else '## Replay of a bag\n\n' + markdown(
        ('', 'times real time', 'estimates lost', 'differ'),
        [(r.contender.title, spread(r.values('factor')), number(r.median('lost')),
          number(r.median('different'))) for r in rows]) + missing(rows) + '\n'


def _profile(results: list[Result]) -> str:
    whole, *parts = [r for r in results if r.contender.group == 'profile'] or [None]
    if whole is None:
        return ''
    if whole.gap:
        return f'## Where a control step spends its time\n\nNot measured: {whole.gap}.\n'
    full = whole.values('step')
    saved = {part.contender.title: full - part.values('step') for part in parts}
    rest = full - sum(saved.values())
    rows = [(name, number(float(np.median(values))), spread(100.0 * values / full))
            for name, values in {**saved, 'rest: the loop, and what overlaps': rest}.items()]
    return (
        '## Where a control step spends its time\n\n'
        + markdown(('part', 'us', 'share [%]'),
                   [*rows, ('whole control step of 5 ms', number(float(np.median(full))), '100')])
        + '\n\nBy elimination in one compiled loop: a part is left out, its answers come from a '
        'tape of the same flight, and the others fly on unchanged; what is saved is its share.\n')


def _idle(results: list[Result]) -> str:
    rows = [r for r in results if r.contender.group == 'idle']
    return '' if not rows else '## Idle states\n\n' + markdown(
        ('nine minutes without noise', 'time of a step, late over early', 'subnormal numbers'),
        [(r.contender.title, spread(r.values('slowdown')), number(r.median('subnormal')))
         for r in rows]) + missing(rows) + (
        '\n\nStates that decay without noise could end in subnormal numbers, which are slow.\n')


def _wanted(results: list[Result]) -> str:
    rows = [(f'{r.contender.group.replace("_", " ")}: {r.contender.title}', UNITS[name], bound,
             number(r.median(name)), '-' if not r.samples else 'yes' if kept else '**no**')
            for r in results for name, bound, kept in r.wanted()]
    return '' if not rows else '## Wanted and got\n\n' + markdown(
        ('', 'what', 'wanted', 'got', 'kept'), rows) + '\n'


def text(results: list[Result], machine: dict[str, Any], repetitions: int) -> str:
    """Return the page."""
    head = (
        '# Performance\n\nWritten by `./bench`, which measures it again. Medians (least - most) '
        f'of {repetitions} repetitions, in turn.\n\n'
        + '\n'.join(f'- {name}: {value}' for name, value in machine.items()) + '\n')
    profile = _profile(results)
    if profile:
        profile += '\nWhat was tried, and what it gave:\n\n' + TRIED.read_text()
    sections = (head, _side_by_side(results), _sweep(results), _gym(results), _graph(results),
                _replay(results), profile, _idle(results), _wanted(results))
    return '\n'.join(filter(None, sections))


def data(results: list[Result], machine: dict[str, Any]) -> dict[str, Any]:
    """Return everything that was measured, for a JSON file."""
    return {'machine': machine, 'results': [
        {'name': r.contender.name, 'group': r.contender.group, 'title': r.contender.title,
         'gap': r.gap, 'note': r.note, 'preparation': r.preparation, 'samples': r.samples}
        for r in results]}
