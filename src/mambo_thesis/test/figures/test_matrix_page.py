"""The page of the matrix: every claim a row, every mutation a column, and what contradicts it."""

from mambo_thesis.figures import matrix_page
from mambo_thesis.figures.claim import Claim, Result
from mambo_thesis.figures.matrix import Entry
from mambo_thesis.figures.truths import MUTATIONS


def entry(number, verdict, noticed=(), broken_by=()):
    claim = Claim(number, 'x', '', lambda: Result([]), 'the mass', 'whether', tuple(broken_by))
    return Entry(claim, verdict, {name: ['something'] for name in noticed})


ENTRIES = [entry('5.3', 'reproduced', ['wind', 'leak +1'], ['wind']),
           entry('5.4', 'by construction'), entry('C.1', 'reproduced', ['wind'])]


def test_verdicts_are_counted_first():
    text = matrix_page.markdown(ENTRIES)
    head, _, rest = text.partition('## Mutated drones')
    assert '| reproduced | 2 |' in head and '| by construction | 1 |' in head
    assert '| partly |' not in head


def test_a_row_marks_the_mutations_by_number():
    rows = matrix_page.markdown(ENTRIES).splitlines()
    row, = (r for r in rows if r.startswith('| Figure 5.3 | reproduced |'))
    cells = [cell.strip() for cell in row.strip('|').split('|')][2:]
    assert len(cells) == len(MUTATIONS)
    assert {name for name, cell in zip(MUTATIONS, cells, strict=True) if cell} == {
        'wind', 'leak +1'}
    assert any(r.startswith(f'| {list(MUTATIONS).index("wind") + 1} | wind |') and
               r.endswith('| 2 |') for r in rows)


def test_each_claim_says_what_the_simulator_has_and_what_it_noticed():
    text = matrix_page.markdown(ENTRIES)
    assert '| Figure 5.3 | the mass | whether | wind, leak +1 |' in text
    assert '| Figure 5.4 | the mass | whether | nothing |' in text


def test_a_verdict_without_a_mutation_that_breaks_it_is_a_problem():
    assert not matrix_page.problems(ENTRIES)
    assert matrix_page.problems([entry('5.5', 'reproduced')]) == [
        'Figure 5.5: is reproduced, but notices no mutation']
    assert matrix_page.problems([entry('5.6', 'partly', [], ['wind', 'leak +1'])]) == [
        'Figure 5.6: does not notice wind, leak +1']


def test_data_is_what_no_longer_holds():
    assert matrix_page.data(ENTRIES)[2] == {
        'claim': 'Figure C.1', 'verdict': 'reproduced', 'noticed': {'wind': ['something']}}
