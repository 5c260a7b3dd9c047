"""
Fly every experiment of the thesis again and report which claims are reproduced.

It writes ``index.html`` with every figure, ``reproduction.md`` and ``reproduction.json``. With
``--mutations`` it flies mutated drones instead, reports which claims notice them, and writes
``claims.md`` and ``claims.json``.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mambo_bags.command import guard, Parser
from mambo_model.errors import JobError, MamboError
from mambo_model.whole_file import PAGE, refuse_other_kind, write_text
from tqdm import tqdm

from .figures import (  # noqa: F401 (each module registers its figures)
    appendix_c, chapter_2, chapter_3, chapter_4, chapter_5, chapter_6, matrix, matrix_page, tables)
from .figures.claim import Claim, CLAIMS
from .figures.page import data, Examined, line, markdown, page, picture, summary


class ReproductionError(MamboError):
    """The report cannot be made; the message gives the reason in one line."""


def select_figures(numbers: list[str]) -> list[Claim]:
    """
    Return the figures with these numbers or in these chapters; without numbers, all of them.

    Raises
    ------
    ReproductionError
        If a number is unknown; the message lists the known ones.

    """
    def belongs(claim: Claim, number: str) -> bool:
        return number.lower() in (claim.number.lower(), claim.place.lower()) or (
            claim.place.lower().startswith(f'{number.lower()}.'))
    known = sorted(CLAIMS.values(), key=lambda claim: claim.order)
    for number in numbers:
        if not any(belongs(claim, number) for claim in known):
            raise ReproductionError(
                f'no figure {number!r}: choose one of {"; ".join(c.number for c in known)}; '
                'or a chapter')
    return [claim for claim in known
            if not numbers or any(belongs(claim, number) for number in numbers)]


def examine(claims: list[Claim]) -> list[Examined]:
    """Fly, measure and draw each figure."""
    bar = tqdm(claims, desc='flying (compiles once)', disable=None, leave=False)
    out = []
    for claim in bar:
        bar.set_description_str(claim.title)
        out.append(Examined(claim, claim.examine()))
    return out


def write(examined: list[Examined], folder: Path) -> Path:
    """Write the report and its figures into a folder; return the path of the HTML page."""
    for each in examined:
        if each.result.figure is not None:
            picture(each.result.figure, folder / f'fig_{_file(each.claim.number)}.png')
    write_text(folder / 'reproduction.md', markdown(examined))
    write_text(folder / 'reproduction.json', json.dumps(data(examined), indent=1) + '\n')
    return write_text(folder / 'index.html', page(examined), PAGE)


def _file(number: str) -> str:
    return number.lower().replace('.', '_').replace(', ', '_and_').replace(' ', '_')


def _run(options: argparse.Namespace) -> None:
    claims = select_figures(options.figures)
    options.output.mkdir(parents=True, exist_ok=True)  # fails before anything is flown
    if options.mutations:
        _run_matrix(claims, options.output)
        return
    refuse_other_kind(options.output / 'index.html', PAGE)
    examined = examine(claims)
    print('\n'.join(map(line, examined)))
    print(f'\n{summary(examined)}\npage: {write(examined, options.output)}')


def _run_matrix(claims: list[Claim], folder: Path) -> None:
    entries = matrix.matrix(claims)
    write_text(folder / 'claims.json', json.dumps(matrix_page.data(entries), indent=1) + '\n')
    path = write_text(folder / 'claims.md', matrix_page.markdown(entries))
    for entry in entries:
        print(f'{entry.claim.title:<16} {entry.verdict:<16} notices '
              f'{", ".join(entry.noticed) or "nothing"}')
    print(f'\npage: {path}')
    if found := matrix_page.problems(entries):
        raise JobError('; '.join(found))


def parser() -> Parser:
    """Return the command line."""
    out = Parser('reproduce', __doc__.split('\n\n')[0])
    out.add_argument(
        'figures', nargs='*', metavar='FIGURE',
        help='a figure such as 5.11 or C.3, or a chapter such as 6 (default: all)')
    out.add_argument(
        '--mutations', action='store_true',
        help='report which claims notice a mutated drone: other drag, flow, motors, ...')
    out.add_output('DIR', 'folder to write into; older files are replaced (default: reproduction)',
                   Path('reproduction'))
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``reproduce``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('reproduce', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
