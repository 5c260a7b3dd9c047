"""What a figure claims and what was measured of it: numbers as text, order, verdict."""

from hypothesis import given, strategies as st
from mambo_thesis.figures import claim as claims
from mambo_thesis.figures.claim import at_least, at_most, Claim, Measured, near, Result, verdict
import pytest


def measured(low, high, unit='m'):
    return Measured('height', low, high, unit, '< 1 m', True)


@pytest.mark.parametrize(('low', 'high', 'unit', 'text'), [
    (0.123456, 0.123456, 'm', '0.1235 m'), (0.1, 0.2, 'm', '0.1 to 0.2 m'),
    (0.12345, 0.12346, 'm', '0.1235 m' if f'{0.12346:.4g}' == f'{0.12345:.4g}'
     else f'{0.12345:.4g} to {0.12346:.4g} m'), (3.0, 3.0, '', '3'), (1.0, 2.0, '', '1 to 2')])
def test_a_number_is_printed_with_four_digits_and_its_range_over_seeds(low, high, unit, text):
    assert str(measured(low, high, unit)) == text


def test_figures_are_in_the_order_of_the_thesis():
    numbers = ['C.8', 'Section 6.3', '5.11', 'Table 2.1', '2.1', '5.3', 'C.1', '6.2, 6.3',
               '5.9, 5.10', 'Section 4.4.2']
    claims = [Claim(number, '', '', lambda: Result([])) for number in numbers]
    assert [claim.number for claim in sorted(claims, key=lambda claim: claim.order)] == [
        '2.1', 'Table 2.1', 'Section 4.4.2', '5.3', '5.9, 5.10', '5.11', '6.2, 6.3',
        'Section 6.3', 'C.1', 'C.8']


@pytest.mark.parametrize(('number', 'title'), [
    ('5.11', 'Figure 5.11'), ('Table 2.1', 'Table 2.1'), ('5.9, 5.10', 'Figures 5.9, 5.10')])
def test_a_title_is_singular_or_plural(number, title):
    assert Claim(number, '', '', lambda: Result([])).title == title


@pytest.mark.parametrize(('holds', 'expected'), [
    ((), 'nothing to measure'), ((True, True), 'reproduced'), ((True, False), 'partly'),
    ((False, False), 'not reproduced')])
def test_a_verdict_is_by_what_holds(holds, expected):
    found = [measured(0.0, 1.0)._replace(holds=h) for h in holds]
    assert verdict(Result(found)) == expected


@pytest.mark.parametrize(('given', 'broken_by', 'expected'), [
    (False, ('wind',), 'reproduced'), (True, ('wind',), 'by construction'),
    (False, (), 'by construction')])
def test_what_is_given_or_cannot_fail_is_not_reproduced(given, broken_by, expected):
    entry = Claim('5.3', '', '', lambda: None, broken_by=broken_by, given=given)
    assert entry.verdict(Result([measured(0.0, 1.0)])) == expected
    failed = Result([measured(0.0, 1.0), measured(0.0, 1.0)._replace(holds=False)])
    assert entry.verdict(failed) == 'partly' and entry.verdict(Result([])) == 'nothing to measure'


@pytest.mark.parametrize(('values', 'holds'), [
    (0.3, True), (0.31, False), ([0.1, 0.3], True), ([0.1, 0.31], False)])
def test_at_most_is_for_every_seed(values, holds):
    found = at_most('error', values, 0.3, 'm', 'noise')
    assert found.holds is holds and found.expected == 'at most 0.3' and found.unit == 'm'
    assert found.reason == 'noise'
    assert type(found.low) is float


@pytest.mark.parametrize(('values', 'holds'), [
    (0.3, True), (0.29, False), ([0.3, 9.0], True), ([0.29, 9.0], False)])
def test_at_least_is_for_every_seed(values, holds):
    assert at_least('error', values, 0.3).holds is holds


@pytest.mark.parametrize(('values', 'holds'), [
    (1.1, True), (1.11, False), ([0.9, 1.1], True), ([0.89, 1.0], False), ([1.0, 1.11], False)])
def test_near_is_within_a_tolerance_for_every_seed(values, holds):
    found = near('factor', values, 1.0, 0.1 + 1e-12)
    assert found.holds is holds and found.expected == '1 within 0.1'


def test_a_figure_registers_itself(monkeypatch):
    monkeypatch.setattr(claims, 'CLAIMS', {})

    @claims.claim('9.9', 'nothing', 'fig_9_9')
    def figure_9_9():
        return Result([])
    entry, = claims.CLAIMS.values()
    assert (entry.number, entry.statement, entry.scenario) == ('9.9', 'nothing', 'fig_9_9')
    assert entry.examine is figure_9_9


NUMBERS = st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=5)


@given(values=NUMBERS, limit=st.floats(-100.0, 100.0))
def test_at_most_and_at_least_agree_with_every_seed(values, limit):
    below, above = at_most('x', values, limit), at_least('x', values, limit)
    assert below.holds == all(x <= limit for x in values)
    assert above.holds == all(x >= limit for x in values)
    assert (below.low, below.high) == (min(values), max(values)) == (above.low, above.high)


@given(values=NUMBERS, expected=st.floats(-100.0, 100.0), tolerance=st.floats(0.0, 10.0))
def test_near_agrees_with_every_seed(values, expected, tolerance):
    assert near('x', values, expected, tolerance).holds == all(
        expected - tolerance <= x <= expected + tolerance for x in values)


@pytest.mark.parametrize('made', [
    at_most('x', [1.0, float('nan')], 3.0), at_least('x', [float('nan'), 5.0], 3.0),
    near('x', float('nan'), 0.0, 1e9)])
def test_a_measurement_that_is_not_a_number_never_holds(made):
    assert not made.holds


@given(holds=st.lists(st.booleans(), min_size=1, max_size=6))
def test_more_that_holds_never_gives_a_worse_verdict(holds):
    ranks = (claims.NOT_REPRODUCED, claims.PARTLY, claims.REPRODUCED)
    found = [measured(0.0, 1.0)._replace(holds=h) for h in holds]
    better = [m._replace(holds=True) if k == 0 else m for k, m in enumerate(found)]
    assert ranks.index(verdict(Result(better))) >= ranks.index(verdict(Result(found)))


@pytest.mark.parametrize(('given_', 'broken_by', 'expected'), [
    (False, ('wind',), 'reproduced'), (True, ('wind',), 'by construction'),
    (False, (), 'by construction'), (True, (), 'by construction')])
def test_a_claim_that_nothing_can_break_is_by_construction(given_, broken_by, expected):
    entry = Claim('9.9', '', '', None, broken_by=broken_by, given=given_)
    assert entry.verdict(Result([measured(0.0, 1.0)])) == expected
    half = Result([measured(0.0, 1.0), measured(0.0, 1.0)._replace(holds=False)])
    assert entry.verdict(half) == 'partly' and entry.verdict(Result([])) == 'nothing to measure'


@pytest.mark.parametrize(('number', 'place'), [
    ('5.11', '5.11'), ('Table 4.1', '4.1'), ('Section 4.4.2', '4.4.2'), ('4.1, 4.2', '4.1')])
def test_the_place_is_the_first_number_without_its_word(number, place):
    assert Claim(number, '', '', None).place == place
