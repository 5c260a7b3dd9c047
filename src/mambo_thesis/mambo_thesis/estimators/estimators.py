"""
Compare the joint filter, the default, with the three filters of ``kalman``, row by row.

Simulated flights are flown on the joint filter, once for each seed, and ``kalman`` gets the same
samples; where a sensor fails, each flies by itself, and a row is the largest distance after the
fault begins. With DATA, the folder of ``mambo recordings``, both also get the samples of
real flights. Sections: thesis, slopes, flow_deck, run, faults; crazyflie, rolling_spider.

A row has the root mean square over the seeds, the posterior Cramer-Rao bound beside it, and the
typical ratio of the errors with its 95 % interval, paired flight by flight; of a recording, by
parts of 2 s.
``better`` names the better estimator, or says ``undecided`` where the interval holds 0. The
position of one recording is a single number: it is undecided where the difference is below the
bound, the deviation that chance gives even the best estimator. Where both are equally good, one
row in forty is called worse by chance.
"""

from __future__ import annotations

import argparse
from fnmatch import fnmatchcase
import json
from pathlib import Path
import tempfile

from mambo_bags.command import counted, guard, nearest, Parser, write_json
from mambo_flight.accuracy import crazyflie
from mambo_flight.accuracy.beside import ESTIMATORS, FIRMWARE
from mambo_flight.accuracy.bound import add_seeds, seeds_of
from mambo_model.errors import InputError
from tqdm import tqdm

from . import recorded_rows, simulated_rows
from .case import Case
from .paired_rows import pooled, Row
from .paired_table import decision, numbers, section, TITLES

RECORDED = ('crazyflie', 'rolling_spider')
OTHERS = tuple(name for name in ESTIMATORS if name != 'kalman')


def chosen(cases: list[Case], patterns: list[str] | None) -> list[Case]:
    """
    Return the cases that match one of some patterns, or all of them without patterns.

    Parameters
    ----------
    cases
        All cases.
    patterns
        Names of sections, or ``section/case`` with the wildcards of a shell.

    Raises
    ------
    InputError
        If a pattern matches no case.

    """
    if patterns is None:
        return cases
    out = []
    for pattern in patterns:
        found = [case for case in cases if pattern == case.section
                 or fnmatchcase(f'{case.section}/{case.name}', pattern)]
        if not found:
            if pattern.partition('/')[0] in RECORDED:
                raise InputError(f'--rows {pattern}: no such recording; give DATA, the folder '
                                 'that docs/evidence/real_recordings.md describes')
            known = [*TITLES, *(f'{case.section}/{case.name}' for case in cases)]
            raise InputError(f'--rows {pattern}: no such rows; sections are '
                             f'{", ".join(TITLES)}{nearest(pattern, known)}')
        out += found
    return [case for case in cases if case in out]


def compare(cases: list[Case], seeds: range, others: list[str]) -> dict[str, list[Row]]:
    """Return {section: rows} of some cases."""
    found: dict[str, list[Row]] = {}
    done: list[Case] = []
    with counted(done, len(cases), 'cases'):
        for case in tqdm(cases, desc='comparing', disable=None, leave=False):
            found.setdefault(case.section, []).extend(case.rows(seeds, others))
            done.append(case)
    for name in RECORDED:
        if name in found:
            found[name] += pooled(found[name])
    return found


def _run(options: argparse.Namespace) -> None:
    seeds = seeds_of(options)
    if set(options.beside) & set(FIRMWARE):
        crazyflie.bindings()  # what is wrong with them is said before anything is flown
    with tempfile.TemporaryDirectory() as folder:
        cases = simulated_rows.cases()
        if options.data:
            cases += recorded_rows.cases(options.data, Path(folder))
        found = compare(chosen(cases, options.rows), seeds, options.beside)
    if options.json:
        write_json(options.json, json.dumps(numbers(found), indent=1, allow_nan=False))
    if options.json != '-':
        tables = [section(name, rows) for name, rows in found.items()]
        print('\n\n'.join([
            *(table.markdown() if options.markdown else table.text() for table in tables),
            decision(found)]))


def parser() -> Parser:
    """Return the command line."""
    out = Parser('estimators', __doc__)
    add = out.add_argument
    add('data', nargs='?', type=Path, metavar='DATA',
        help='folder with the recordings (default: simulated flights alone)')
    add_seeds(out, 20, 'flights of a simulated case')
    add('--rows', nargs='+', metavar='ROWS',
        help='only these: a section, or section/case with * and ?, such as faults/accel*')
    add('--beside', nargs='+', choices=OTHERS, default=[], metavar='ESTIMATOR',
        help=f'show others besides, where they need not fly: {", ".join(OTHERS)}; the last two '
             'need the environment variable CFFIRMWARE, as mambo bound does')
    add('--markdown', action='store_true',
        help='print Markdown, as in docs/evidence/estimators.md')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``estimators``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('estimators', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
