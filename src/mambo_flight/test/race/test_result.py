"""Lengths as the page of a race shows them."""

from hypothesis import given, strategies as st
from mambo_flight.race.result import length
import pytest


@pytest.mark.parametrize(('metres', 'text'), [
    (0.0123456, '12.3'), (0.9994, '999'), (1.2345, '1234'), (1e-5, '0.01')])
def test_a_length_has_three_digits_in_mm(metres, text):
    assert length(metres) == text


@given(metres=st.floats(1e-6, 100.0), factor=st.floats(1.02, 10.0))
def test_a_longer_length_never_reads_shorter(metres, factor):
    assert float(length(factor * metres)) >= float(length(metres))
    assert float(length(metres)) == pytest.approx(1e3 * metres, rel=0.006, abs=0.006)
