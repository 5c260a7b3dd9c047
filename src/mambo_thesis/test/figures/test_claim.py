"""What a figure claims and what was measured of it: numbers as text, order, verdict."""

from mambo_thesis.figures.claim import Claim, Measured, Result
import pytest


def measured(low, high, unit='m'):
    return Measured('height', low, high, unit, '< 1 m', True)


@pytest.mark.parametrize(('low', 'high', 'unit', 'text'), [
    (0.123456, 0.123456, 'm', '0.1235 m'), (0.1, 0.2, 'm', '0.1 to 0.2 m'),
    (0.12345, 0.12346, 'm', '0.1235 m' if f'{0.12346:.4g}' == f'{0.12345:.4g}'
     else f'{0.12345:.4g} to {0.12346:.4g} m'), (3.0, 3.0, '', '3'), (1.0, 2.0, '', '1 to 2')])
def test_a_number_is_told_with_four_digits_and_a_range_where_there_is_one(low, high, unit, text):
    assert str(measured(low, high, unit)) == text


def test_figures_are_in_the_order_of_the_thesis():
    numbers = ['C.8', '5.11', '2.1', '5.3', 'C.1', '6.2, 6.3', '5.9, 5.10']
    claims = [Claim(number, '', '', lambda: Result([])) for number in numbers]
    assert [claim.number for claim in sorted(claims, key=lambda claim: claim.order)] == [
        '2.1', '5.3', '5.9, 5.10', '5.11', '6.2, 6.3', 'C.1', 'C.8']


@pytest.mark.parametrize(('number', 'title'), [
    ('5.11', 'Figure 5.11'), ('5.9, 5.10', 'Figures 5.9, 5.10')])
def test_a_title_says_one_figure_or_several(number, title):
    assert Claim(number, '', '', lambda: Result([])).title == title
