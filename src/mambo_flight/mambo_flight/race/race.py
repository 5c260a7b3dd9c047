"""
Compare controllers: fly each over the same courses, in the same wind, with the same model errors.

Writes controllers.md, controllers.json and a plot for each condition into a folder. Finished
flights are kept if it is interrupted: the same command continues.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import hashlib
import json
from pathlib import Path

from mambo_bags.cli.option_types import whole, WORKERS
from mambo_bags.command import guard, interrupted, Parser
from mambo_model.compiled import source_digest
from mambo_model.errors import InputError
from mambo_model.whole_file import PICTURE, replacing, write_text

from . import report
from ..sweep.run import run
from ..sweep.table import Journal, KEPT, report_faults
from .comparison import (
    Comparison, CONDITIONS, COURSES, enter, Entrant, ENTRANTS, NAMES, SLOW, STATES,
    TRUE)
from .timing import step_time

PAGE, NUMBERS = 'controllers.md', 'controllers.json'
MOST = 10_000  # draws, so that the list of the flights stays small


def race(
    folder: Path, entrants: Mapping[str, Entrant], courses: Sequence[str],
    conditions: Sequence[str], draws: int, states: Sequence[str], workers: int | None = None,
    add: bool = False,
) -> list[tuple[str, str]]:
    """
    Fly a comparison and write its page; return each flight and its fault, empty for none.

    Parameters
    ----------
    folder
        Folder of the page, the numbers and the plots.
    entrants, courses, conditions, draws
        See :class:`Comparison`.
    states
        Names in :data:`STATES`, flown one after the other.
    workers
        Number of processes; None: one for each core.
    add
        Whether to keep the results of other flights that the page has.

    Raises
    ------
    InputError
        If the folder is a bag, it has a page and ``add`` is not given, the unfinished rows in it
        belong to another comparison, or there is no page to add to.
    SweepEndedError
        If it was interrupted; the finished rows are kept.

    """
    if (folder / 'metadata.yaml').exists():
        raise InputError(f'{folder}: is a bag; give a folder for the page')
    if not add:
        _refuse_ended(folder, conditions, states)
    steps, before = report.load(folder / NUMBERS) if add else ({}, [])
    folder.mkdir(parents=True, exist_ok=True)
    found: list[report.Result] = []
    journals: list[Journal] = []
    faults: list[tuple[str, str]] = []
    try:
        for state in states:
            flights = Comparison(entrants, courses, conditions, draws, state)
            digest = hashlib.sha256(
                f'{source_digest()} {entrants} {flights.starts}'.encode()).hexdigest()
            journals.append(Journal(_journal(folder, state), digest, 'race'))
            run(flights, journals[-1], state == TRUE, workers)
            rows = journals[-1].rows
            found += report.results(flights.starts, rows, state)
            faults += [('/'.join(map(str, (*start, state))), rows[number]['fault'])
                       for number, start in enumerate(flights.starts)]
        for name, entrant in entrants.items():
            flight = Comparison({name: entrant}, courses[:1], ['known'], 1, TRUE)[0]
            steps[name] = entrant.title, step_time(flight)
        _write(folder, report.merged(before, found), steps)
    except BaseException:
        for journal in journals:
            journal.leave()
        raise
    for journal in journals:
        journal.remove()
    return faults


def _refuse_ended(folder: Path, conditions: Sequence[str], states: Sequence[str]) -> None:
    """Raise InputError if a folder has files of a race, unless that one is unfinished."""
    if not (folder / NUMBERS).exists() and any(
            _journal(folder, state).exists() for state in states):
        return
    for name in (PAGE, NUMBERS, *map(_picture, conditions)):
        if (folder / name).exists():
            raise InputError(f'{folder / name} exists: --add keeps what it has; or give another '
                             '--output or remove it')


def _journal(folder: Path, state: str) -> Path:
    """Return the file with the finished flights on an estimate, until the race has ended."""
    return folder / f'race_{state}.rows'


def _picture(condition: str) -> str:
    """Return the name of the plot of a condition."""
    return f'controllers_{condition}.png'


def _write(
    folder: Path, found: Sequence[report.Result], steps: dict[str, tuple[str, float]],
) -> None:
    """Write plots, page and numbers, each completely or not at all; numbers last."""
    conditions = list(dict.fromkeys(r.condition for r in found))
    for condition in conditions:
        with replacing(folder / _picture(condition), PICTURE) as part:
            report.draw(part, found, condition)
    write_text(folder / PAGE, report.markdown(found, steps, list(map(_picture, conditions))))
    write_text(folder / NUMBERS, json.dumps(
        {'steps_us': steps, 'results': [r._asdict() for r in found]}, indent=1) + '\n')


def _names(text: str | None, known: Sequence[str], option: str) -> list[str]:
    """Return the names of a comma-separated list; InputError for an unknown one."""
    names = text.split(',') if text is not None else list(known)
    for name in names:
        if name not in known:
            raise InputError(f'{option}: {name} is unknown; known: {", ".join(known)}')
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f'{option}: {twice} is given twice')
    return names


def _run(options: argparse.Namespace) -> None:
    given = [name for name in ENTRANTS if name not in SLOW]
    if options.controllers is not None:
        given = options.controllers.split(',')
    names = (enter([*given, *options.controller]),
             _names(options.courses, COURSES, '--courses'),
             _names(options.conditions, list(CONDITIONS), '--conditions'))
    states = _names(options.state, list(STATES), '--state')
    try:
        faults = race(
            options.output, *names, options.draws, states, options.workers, options.add)
    except KeyboardInterrupt as end:
        raise interrupted(end, KEPT) from None
    print(f'page: {options.output / PAGE}')
    report_faults(faults)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('race', __doc__)
    add = out.add_argument
    out.add_output('DIR', 'folder for the page, the numbers and the plots', required=True)
    add('--draws', type=whole(1, MOST), default=1000, metavar='N',
        help='flights of each controller, course and condition (default: 1000)')
    add('--controller', default=[], action='append', metavar='NAME',
        help='add a controller of yours: FILE.py, FILE.py:NAME, or an installed one; '
        'repeatable')
    add('--controllers', metavar='A,B,...',
        help=f'comma-separated names out of {", ".join(NAMES)} (default: all but '
        f'{", ".join(SLOW)}, which needs a package of its own and is slow, and '
        f'{", ".join(NAMES[len(ENTRANTS):])})')
    for name, known in (('courses', COURSES), ('conditions', CONDITIONS)):
        add(f'--{name}', metavar='A,B,...', help=f'out of {", ".join(known)}')
    add('--state', metavar='A,B,...',
        help=f'what the controllers get, out of {", ".join(STATES)}: the true state, an estimate '
        'from the sensors on board, one that motion capture aids')
    add('--add', action='store_true',
        help='keep what the page in FOLDER has of other flights, which this version of the '
        'software must still fly as they were')
    add('--workers', type=WORKERS, metavar='N', help='processes (default: one for each core)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``race``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('race', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
