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

from mambo_bags.command import guard, Parser
from mambo_model.compiled import source_digest
from mambo_model.errors import InputError

from . import report
from ..sweep.run import run
from ..sweep.table import Journal, SweepEndedError
from .comparison import Comparison, CONDITIONS, COURSES, enter, Entrant, ENTRANTS
from .timing import step_time


def race(
    folder: Path, entrants: Mapping[str, Entrant], courses: Sequence[str],
    conditions: Sequence[str], draws: int, states: Sequence[bool], workers: int | None = None,
) -> list[report.Result]:
    """
    Fly a comparison and write its page.

    Parameters
    ----------
    folder
        Folder of the page, the numbers and the plots.
    entrants, courses, conditions, draws
        See :class:`Comparison`.
    states
        Whether the controllers get the true state, for each round of flights.
    workers
        Number of processes; None: one for each core.

    Raises
    ------
    InputError
        If the unfinished rows in the folder belong to another comparison.
    SweepEndedError
        If it was interrupted; the finished rows are kept.

    """
    folder.mkdir(parents=True, exist_ok=True)
    found: list[report.Result] = []
    journals = []
    for ideal in states:
        flights = Comparison(entrants, courses, conditions, draws, ideal)
        digest = hashlib.sha256(
            f'{source_digest()} {entrants} {flights.starts}'.encode()).hexdigest()
        name = 'true_state' if ideal else 'estimates'
        journals.append(Journal(folder / f'race_{name}.rows', digest))
        try:
            run(flights, journals[-1], ideal, workers)
        except BaseException:
            for journal in journals:
                journal.close()
            raise
        found += report.results(flights.starts, journals[-1].rows, ideal)
    times = {name: step_time(Comparison({name: entrant}, courses[:1], ['known'], 1, True)[0])
             for name, entrant in entrants.items()}
    _write(folder, found, entrants, times, conditions, draws)
    for journal in journals:
        journal.remove()
    return found


def _write(
    folder: Path, found: Sequence[report.Result], entrants: Mapping[str, Entrant],
    times: dict[str, float], conditions: Sequence[str], draws: int,
) -> None:
    pictures = []
    for condition in conditions:
        pictures.append(f'controllers_{condition}.png')
        report.draw(folder / pictures[-1], found, condition)
    about = (f'{sum(r.flights for r in found)} flights of 30 s, {draws} draws of each kind '
             '(one if nothing is random).')
    steps = {name: (entrants[name].title, took) for name, took in times.items()}
    (folder / 'controllers.md').write_text(report.markdown(found, steps, about, pictures))
    (folder / 'controllers.json').write_text(json.dumps(
        {'draws': draws, 'step_us': times, 'results': [r._asdict() for r in found]}, indent=1)
        + '\n')


def _names(text: str, known: Sequence[str], option: str) -> list[str]:
    """Return the names of a comma-separated list; InputError for an unknown one."""
    names = text.split(',') if text else list(known)
    for name in names:
        if name not in known:
            raise InputError(f'{option}: {name} is unknown; known: {", ".join(known)}')
    return names


def _run(options: argparse.Namespace) -> None:
    if options.draws < 1:
        raise InputError(f'--draws {options.draws}: must be 1 or more')
    if options.workers is not None and options.workers < 1:
        raise InputError(f'--workers {options.workers}: must be 1 or more')
    given = options.controllers.split(',') if options.controllers else list(ENTRANTS)
    names = (enter([*given, *options.controller]),
             _names(options.courses, COURSES, '--courses'),
             _names(options.conditions, list(CONDITIONS), '--conditions'))
    states = {'both': (True, False), 'true': (True,), 'estimated': (False,)}[options.state]
    try:
        race(options.output, *names, options.draws, states, options.workers)
    except KeyboardInterrupt:
        raise SweepEndedError(
            'stopped by you; finished flights are kept, the same command continues') from None
    print(f'page: {options.output / "controllers.md"}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('race', __doc__)
    add = out.add_argument
    add('-o', '--output', type=Path, metavar='FOLDER', required=True,
        help='folder for the page, the numbers and the plots')
    add('--draws', type=int, default=1000, metavar='N',
        help='flights of each controller, course and condition (default: 1000)')
    add('--controller', default=[], action='append', metavar='NAME',
        help='add a controller of yours: FILE.py, FILE.py:NAME, or an installed one; '
        'repeatable')
    add('--controllers', default='', metavar='A,B,...',
        help=f'comma-separated names out of {", ".join(ENTRANTS)} (default: all)')
    for name, known in (('courses', COURSES), ('conditions', CONDITIONS)):
        add(f'--{name}', default='', metavar='A,B,...', help=f'out of {", ".join(known)}')
    add('--state', default='both', choices=('both', 'true', 'estimated'),
        help='state that the controllers get: true or estimated (default: both)')
    add('--workers', type=int, metavar='N', help='processes (default: one for each core)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``race``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('race', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
