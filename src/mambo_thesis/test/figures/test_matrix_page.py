"""The page of the matrix: every claim a row, every mutation a column, and what contradicts it."""

from hypothesis import given, settings, strategies as st
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


@given(noticed=st.lists(st.sets(st.sampled_from(sorted(MUTATIONS))), min_size=1, max_size=5))
@settings(max_examples=30, deadline=None)
def test_the_counts_of_the_page_are_those_of_its_marks(noticed):
    entries = [entry(f'5.{k}', 'reproduced' if names else 'partly', sorted(names))
               for k, names in enumerate(noticed)]
    rows = [[cell.strip() for cell in line.strip('|').split('|')]
            for line in matrix_page.markdown(entries).splitlines() if line.startswith('|')]
    marks = [row[2:] for row in rows if len(row) == 2 + len(MUTATIONS) and row[0] != 'claim'
             and row[1] in ('reproduced', 'partly')]
    for k, name in enumerate(MUTATIONS):
        count, = (row[3] for row in rows if len(row) == 4 and row[1] == name)
        assert int(count) == sum(row[k] == 'x' for row in marks) == sum(
            name in names for names in noticed)
    assert not matrix_page.problems(entries)


def test_every_contradiction_is_a_line_of_its_own():
    found = matrix_page.problems([
        entry('5.5', 'reproduced', [], ['wind']), entry('5.6', 'by construction'),
        entry('5.7', 'partly', ['wind'], ['wind', 'slope 0'])])
    assert found == ['Figure 5.5: does not notice wind', 'Figure 5.7: does not notice slope 0',
                     'Figure 5.5: is reproduced, but notices no mutation']
