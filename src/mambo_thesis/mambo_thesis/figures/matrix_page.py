"""The matrix of claims and mutated drones as a Markdown page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .claim import REPRODUCED, VERDICTS
from .matrix import Entry, SEEDS
from .page import COUNTS, table
from .truths import MUTATIONS

COMMAND = 'mambo reproduce --mutations'
LEAD = (
    'A claim that holds for every drone proves nothing. Here the simulated drone of the '
    'experiments is mutated in one respect, while the model under test and the limits stay the '
    'same. A claim notices the mutation if one of its measurements no longer holds. Each mutation '
    f'is flown with {len(SEEDS)} seeds.')


def counts(entries: Sequence[Entry]) -> list[tuple[str, int, str]]:
    """Return the verdicts that occur, with their count and meaning."""
    found = [e.verdict for e in entries]
    return [(name, found.count(name), meaning) for name, meaning in VERDICTS.items()
            if name in found]


def markdown(entries: Sequence[Entry]) -> str:
    """Return the page ``docs/evidence/claims.md``."""
    numbers = {name: str(k) for k, name in enumerate(MUTATIONS, 1)}
    noticed = {name: sum(name in e.noticed for e in entries) for name in MUTATIONS}
    out = ['# Which claims can fail', '', LEAD, '', f'    {COMMAND}', '', 'writes this page.', '',
           *table(COUNTS, counts(entries)), '',
           '## Mutated drones', '',
           *table(('', 'mutation', 'what is changed', 'noticed by'), [
               (numbers[m.name], m.name, m.description, noticed[m.name])
               for m in MUTATIONS.values()]), '',
           '## Claims', '', 'x: the claim notices the mutation of that number.', '',
           *table(('claim', 'verdict', *numbers.values()), [
               (e.claim.title, e.verdict, *('x' if name in e.noticed else '' for name in numbers))
               for e in entries]), '',
           '## What the simulator contains and what is tested', '',
           *table(('claim', 'in the simulator', 'tested', 'noticed'), [
               (e.claim.title, e.claim.contains, e.claim.tests, ', '.join(e.noticed) or 'nothing')
               for e in entries]), '']
    return '\n'.join(out)


def data(entries: Sequence[Entry]) -> list[Mapping[str, object]]:
    """Return the matrix for JSON: the measurements that each mutation breaks."""
    return [{'claim': e.claim.title, 'verdict': e.verdict, 'noticed': e.noticed}
            for e in entries]


def problems(entries: Sequence[Entry]) -> list[str]:
    """Return the contradictions to the verdicts, one line each."""
    return [f'{e.claim.title}: does not notice {", ".join(e.missing)}' for e in entries
            if e.missing] + [
        f'{e.claim.title}: is reproduced, but notices no mutation' for e in entries
        if e.verdict == REPRODUCED and not e.noticed]
