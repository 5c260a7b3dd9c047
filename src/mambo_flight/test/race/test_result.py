"""Lengths as the page of a race shows them."""

from mambo_flight.race.result import length
import pytest


@pytest.mark.parametrize(('metres', 'text'), [
    (0.0123456, '12.3'), (0.9994, '999'), (1.2345, '1234'), (1e-5, '0.01')])
def test_a_length_has_three_digits_in_mm(metres, text):
    assert length(metres) == text
