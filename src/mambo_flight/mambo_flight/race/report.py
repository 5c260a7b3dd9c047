"""Result of a comparison: metrics of each controller, course and condition, as page and plots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import json
import math
from pathlib import Path
import textwrap
from typing import Any

from mambo_model import palette
from mambo_model.errors import InputError
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from . import goals
from .comparison import CONDITIONS, COURSES, ENTRANTS, Start, STATES
from .result import length, LOST, Result

TITLES = {
    'known': 'everything known',
    'twenty_percent': 'mass and drag wrong by 20 %, gusts of 0.5 m/s',
    'everything': 'mass and drag wrong by up to 20 %, battery, lag of the motors, wind and gusts'}
_STATES = {'true': 'true state', 'estimated': 'estimates',
           'aided': 'estimates aided by motion capture'}


def survived(row: Mapping[str, Any]) -> bool:
    """Return whether a flight had no shutdown, failsafe or fall, and stayed within LOST."""
    return not (row['shutdown'] or row['failsafe'] or row['fallen']) and row['tracking_max'] < LOST


def results(
    starts: Sequence[Start], rows: Mapping[int, Mapping[str, Any]], state: str,
) -> list[Result]:
    """Return the results of flights, in the order of their starts."""
    groups: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for number, start in enumerate(starts):
        groups.setdefault((start.entrant, start.course, start.condition), []).append(rows[number])
    return [_result(*key, state, flown) for key, flown in groups.items()]


def _result(
    entrant: str, course: str, condition: str, state: str, flown: Sequence[Mapping[str, Any]],
) -> Result:
    def column(name: str) -> np.ndarray:
        return np.array([row[name] for row in flown], dtype=float)
    rms = column('tracking_rms')
    return Result(
        entrant, course, condition, state, len(flown),
        sum(map(survived, flown)) / len(flown), float(np.median(rms)),
        float(np.percentile(rms, 95)), float(column('tracking_max').max()),
        float(np.median(column('tracking_final'))), float(column('saturated_share').mean()),
        float(column('energy').mean()))


def _table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [' | '.join(line) for line in (header, ['---'] + ['---:'] * (len(header) - 1), *lines)]
    return '\n'.join(f'| {row} |' for row in rows)


def merged(before: Sequence[Result], found: Sequence[Result]) -> list[Result]:
    """Return results in the order of the page; a later one of the same flights replaces."""
    every = {(r.entrant, r.course, r.condition, r.state): r for r in (*before, *found)}
    entrants = list(dict.fromkeys((*ENTRANTS, *(r.entrant for r in every.values()))))
    orders = (entrants, list(COURSES), list(CONDITIONS), list(STATES))

    def place(r: Result) -> tuple[int, ...]:
        names = (r.entrant, r.course, r.condition, r.state)
        entrant, course, condition, state = (
            order.index(name) for order, name in zip(orders, names, strict=True))
        return state, entrant, condition, course
    return sorted(every.values(), key=place)


def load(path: Path) -> tuple[dict[str, tuple[str, float]], list[Result]]:
    """
    Return what a race wrote: title and us a step of each entrant, and its results.

    Raises
    ------
    InputError
        If there is no such file, or it is not one of a race.

    """
    try:
        data = json.loads(path.read_text(encoding='utf-8'))
        return ({name: tuple(step) for name, step in data['steps_us'].items()},
                [Result(**r) for r in data['results']])
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}: race without --add first') from None
    except (ValueError, TypeError, LookupError, AttributeError):
        raise InputError(f'{path}: not the numbers of a race of this version') from None


def _overview(found: Sequence[Result], condition: str, state: str) -> str:
    """Return the table of the median RMS errors, an entrant a line."""
    part = [r for r in found if (r.condition, r.state) == (condition, state)]
    courses = list(dict.fromkeys(r.course for r in part))
    lines = []
    for entrant in dict.fromkeys(r.entrant for r in part):
        own = {r.course: r for r in part if r.entrant == entrant}
        flights = sum(r.flights for r in own.values())
        alive = sum(r.survived * r.flights for r in own.values()) / flights
        lines.append([
            f'`{entrant}`', *(length(own[course].rms) for course in courses),
            f'{100 * alive:.1f} %',
            f'{100 * np.mean([r.saturated for r in own.values()]):.2f} %',
            f'{np.mean([r.energy for r in own.values()]):.0f}'])
    return _table(['', *(f'`{course}`' for course in courses), 'survived', 'saturated',
                   'energy [J]'], lines)


def _details(found: Sequence[Result]) -> str:
    return _table(
        ['', 'course', 'condition', 'state', 'flights', 'RMS [mm]', '95 % [mm]', 'largest [mm]',
         'at the end [mm]', 'survived'],
        ([f'`{r.entrant}`', f'`{r.course}`', f'`{r.condition}`', _STATES[r.state], str(r.flights),
          *map(length, (r.rms, r.rms_95, r.largest, r.end)), f'{100 * r.survived:.1f} %']
         for r in found))


def _draws(flights: Iterable[int]) -> str:
    """Return the numbers of draws in words; 1 is that of what is not random."""
    numbers = sorted(set(flights) - {1}) or [1]
    return ' or '.join(map(str, numbers))


def markdown(
    found: Sequence[Result], steps: Mapping[str, tuple[str, float]], pictures: Sequence[str],
) -> str:
    """
    Return the page of a comparison as Markdown.

    Parameters
    ----------
    found
        Result of :func:`results`.
    steps : us
        Title of each controller and the time of a step, by name.
    pictures
        Names of the plots beside the page.

    """
    draws = ', '.join(
        f'{_draws(r.flights for r in found if r.state == state)} for the {_STATES[state]}'
        for state in dict.fromkeys(r.state for r in found))
    out = ['# Controllers compared', '',
           f'Written by `mambo race`, which flies it again. {sum(r.flights for r in found)} '
           f'flights of 30 s. Draws of each kind: {draws}; one if nothing is random. The '
           'estimates are those of `joint`.', '',
           'Numbers are the median of the RMS position error of a flight in mm, take-off '
           'included. A flight survives if it is neither shut down nor 2 m off, nor on the floor '
           'below its reference. Saturated: share of the control steps with a motor at a limit. '
           'Energy: that of the rotors.', '', *goals.lines(found)]
    for condition in dict.fromkeys(r.condition for r in found):
        for state in dict.fromkeys(r.state for r in found if r.condition == condition):
            out += [f'## {TITLES[condition][0].upper()}{TITLES[condition][1:]}: '
                    f'{_STATES[state]}', '', _overview(found, condition, state), '']
    out += [line for name in pictures for line in (f'![{name}]({name})', '')]
    out += ['## A step', '', _table(
        ['', 'controller', 'us'],
        ([f'`{name}`', title, f'{took:.2f}'] for name, (title, took) in steps.items())), '',
        'The guard of the controller is included, on one core.', '', '## Every course', '',
        _details(found), '']
    return '\n'.join(out)


def draw(path: Path, found: Sequence[Result], condition: str) -> None:
    """Draw the median RMS errors of one condition, a panel for each kind of state, into a PNG."""
    part = [r for r in found if r.condition == condition]
    kinds = list(dict.fromkeys(r.state for r in part))
    courses = list(dict.fromkeys(r.course for r in part))
    entrants = list(dict.fromkeys(r.entrant for r in part))
    figure = Figure(figsize=(5.5 * len(kinds), 4.0), layout='constrained')
    FigureCanvasAgg(figure)
    for axes, state in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds):
        for entrant, style in zip(entrants, palette.lines(entrants)):
            own = {r.course: r.rms for r in part if (r.entrant, r.state) == (entrant, state)}
            axes.semilogy(
                range(len(courses)), [1e3 * own.get(c, math.nan) for c in courses], marker='o',
                label=entrant, **style)
        axes.set_xticks(range(len(courses)), courses, rotation=25, ha='right')
        axes.set(title=_STATES[state], ylabel='RMS error, median [mm]')
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize='small')
    figure.suptitle(textwrap.fill(TITLES[condition], 30 * len(kinds) + 20), fontsize='medium')
    figure.savefig(path, format='png', dpi=110, metadata={'Software': None})
