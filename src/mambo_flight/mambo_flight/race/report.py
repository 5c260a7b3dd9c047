"""Result of a comparison: metrics of each controller, course and condition, as page and plots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import math
from pathlib import Path
import textwrap
from typing import Any, NamedTuple

from mambo_model import palette
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from .comparison import Start

LOST = 2.0  # m, a flight with a larger error did not survive
TITLES = {
    'known': 'everything known',
    'twenty_percent': 'mass and drag wrong by 20 %, gusts of 0.5 m/s',
    'everything': 'mass and drag wrong by up to 20 %, battery, lag of the motors, wind and gusts'}
_STATES = {True: 'true state', False: 'estimates'}


class Result(NamedTuple):
    """Metrics of the flights of one controller on one course under one condition."""

    entrant: str
    course: str
    condition: str
    ideal: bool
    flights: int
    survived: float  # share without shutdown and with all errors below LOST
    rms: float  # m, median of the flights' RMS errors
    rms_95: float  # m, 95th percentile of the RMS errors
    largest: float  # m, largest error of any flight
    end: float  # m, median error at the end
    saturated: float  # mean share of the steps with a motor at a limit
    energy: float  # J, mean


def survived(row: Mapping[str, Any]) -> bool:
    """Return whether a flight was not shut down and stayed within LOST."""
    return not row['shutdown'] and row['tracking_max'] < LOST


def results(
    starts: Sequence[Start], rows: Mapping[int, Mapping[str, Any]], ideal: bool,
) -> list[Result]:
    """Return the results of flights, in the order of their starts."""
    groups: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for number, start in enumerate(starts):
        groups.setdefault((start.entrant, start.course, start.condition), []).append(rows[number])
    return [_result(*key, ideal, flown) for key, flown in groups.items()]


def _result(
    entrant: str, course: str, condition: str, ideal: bool, flown: Sequence[Mapping[str, Any]],
) -> Result:
    def column(name: str) -> np.ndarray:
        return np.array([row[name] for row in flown], dtype=float)
    rms = column('tracking_rms')
    return Result(
        entrant, course, condition, ideal, len(flown),
        sum(map(survived, flown)) / len(flown), float(np.median(rms)),
        float(np.percentile(rms, 95)), float(column('tracking_max').max()),
        float(np.median(column('tracking_final'))), float(column('saturated_share').mean()),
        float(column('energy').mean()))


def _mm(x: float) -> str:
    """Return a length in mm with three digits."""
    return f'{1e3 * x:.3g}' if 1e3 * x < 999.5 else f'{1e3 * x:.0f}'


def _table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [' | '.join(line) for line in (header, ['---'] + ['---:'] * (len(header) - 1), *lines)]
    return '\n'.join(f'| {row} |' for row in rows)


def _overview(found: Sequence[Result], condition: str, ideal: bool) -> str:
    """Return the table of the median RMS errors, one controller a line."""
    part = [r for r in found if (r.condition, r.ideal) == (condition, ideal)]
    courses = list(dict.fromkeys(r.course for r in part))
    lines = []
    for entrant in dict.fromkeys(r.entrant for r in part):
        own = {r.course: r for r in part if r.entrant == entrant}
        flights = sum(r.flights for r in own.values())
        alive = sum(r.survived * r.flights for r in own.values()) / flights
        lines.append([
            f'`{entrant}`', *(_mm(own[course].rms) for course in courses), f'{100 * alive:.1f} %',
            f'{100 * np.mean([r.saturated for r in own.values()]):.2f} %',
            f'{np.mean([r.energy for r in own.values()]):.0f}'])
    return _table(['', *(f'`{course}`' for course in courses), 'survived', 'saturated',
                   'energy [J]'], lines)


def _details(found: Sequence[Result]) -> str:
    return _table(
        ['', 'course', 'condition', 'state', 'flights', 'RMS [mm]', '95 % [mm]', 'largest [mm]',
         'at the end [mm]', 'survived'],
        ([f'`{r.entrant}`', f'`{r.course}`', f'`{r.condition}`', _STATES[r.ideal], str(r.flights),
          _mm(r.rms), _mm(r.rms_95), _mm(r.largest), _mm(r.end), f'{100 * r.survived:.1f} %']
         for r in found))


def markdown(
    found: Sequence[Result], steps: Mapping[str, tuple[str, float]], about: str,
    pictures: Sequence[str],
) -> str:
    """
    Return the page of a comparison as Markdown.

    Parameters
    ----------
    found
        Result of :func:`results`.
    steps : us
        Title of each controller and the time of a step, by name.
    about
        Description of the flights, in a sentence or two.
    pictures
        Names of the plots beside the page.

    """
    out = ['# Controllers compared', '',
           f'Written by `mambo race`, which flies it again. {about}', '',
           'Numbers are the median of the RMS position error of a flight in mm, take-off '
           'included. A flight survives if it is neither shut down nor 2 m off. Saturated: share '
           'of the control steps with a motor at a limit. Energy: that of the commanded '
           'thrusts.', '']
    for condition in dict.fromkeys(r.condition for r in found):
        for ideal in dict.fromkeys(r.ideal for r in found if r.condition == condition):
            out += [f'## {TITLES[condition][0].upper()}{TITLES[condition][1:]}: '
                    f'{_STATES[ideal]}', '', _overview(found, condition, ideal), '']
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
    kinds = list(dict.fromkeys(r.ideal for r in part))
    courses = list(dict.fromkeys(r.course for r in part))
    entrants = list(dict.fromkeys(r.entrant for r in part))
    figure = Figure(figsize=(5.5 * len(kinds), 4.0), layout='constrained')
    FigureCanvasAgg(figure)
    for axes, ideal in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds):
        for entrant, style in zip(entrants, palette.lines(entrants)):
            own = {r.course: r.rms for r in part if (r.entrant, r.ideal) == (entrant, ideal)}
            axes.semilogy(
                range(len(courses)), [1e3 * own.get(c, math.nan) for c in courses], marker='o',
                label=entrant, **style)
        axes.set_xticks(range(len(courses)), courses, rotation=25, ha='right')
        axes.set(title=_STATES[ideal], ylabel='RMS error, median [mm]')
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize='small')
    figure.suptitle(textwrap.fill(TITLES[condition], 30 * len(kinds) + 20), fontsize='medium')
    figure.savefig(path, dpi=110, metadata={'Software': None})
