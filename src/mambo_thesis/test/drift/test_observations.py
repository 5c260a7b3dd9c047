"""What the thesis saw, against the mechanisms: the scorecard of the audit, with its numbers."""

from pathlib import Path

from mambo_thesis.drift import observations, report
from mambo_thesis.drift.observations import corrected, factors, OBSERVATIONS, ramp
from mambo_thesis.drift.table import ROWS
import pytest

DOCUMENT = Path(__file__).parents[4] / 'docs' / 'evidence' / 'drift.md'
SHOWN = {o.name: o.shown for o in OBSERVATIONS}


@pytest.mark.parametrize(('row', 'wanted'), [  # audit, 10.3
    ('A', (0.973, 0.990, 1.025, 1.095)), ('A2', (0.995, 1.020, 1.070, 1.169)),
    ('H', (0.843, 0.877, 0.915, 0.947)), ('D1', (0.929, 0.908, 0.868, 0.797)),
    ('F', (0.882, 0.930, 0.968, 0.988))])
def test_the_best_factor_over_the_height_is_that_of_the_audit(row, wanted):
    assert factors(ROWS[row]) == pytest.approx(wanted, abs=0.002)


def test_the_ramp_grows_as_in_the_audit():
    growth, modulation = ramp(ROWS['A'], 1.06)
    assert growth == pytest.approx(0.037, abs=0.002)
    assert modulation == pytest.approx(0.014, abs=0.001)
    assert ramp(ROWS['E'], 1.0)[1] == pytest.approx(0.05, abs=0.006)


@pytest.mark.parametrize(('row', 'path', 'wanted'), [  # audit, 10.5: x and y with 0.92 + 0.10 h
    ('A', 'C.4', (-0.08, 0.0)), ('A2', 'C.4', (0.0, 0.0)), ('C2 drag', 'swapped', (0.03, -0.17)),
    ('D2 drag', 'swapped', (0.08, -0.20))])
def test_corrections_leave_what_the_audit_says(row, path, wanted):
    assert corrected(ROWS[row], path, 0.10) == pytest.approx(wanted, abs=0.012)


@pytest.mark.parametrize(('row', 'shows', 'not_shown'), [  # audit, 10.4
    ('A', ('O1', 'O2', 'O3', 'O4', 'O5', 'O6', 'O7', 'O8'), ('O10',)),
    ('D1', ('O1', 'O2'), ('O6', 'O8')), ('D2', ('O8',), ('O6',)), ('D2 drag', ('O10',), ('O2',)),
    ('B', ('O1',), ('O2', 'O3', 'O4', 'O5', 'O8')), ('F', ('O6', 'O8'), ('O5', 'O10')),
    ('E', ('O1', 'O4'), ('O2', 'O5', 'O6', 'O7'))])
def test_mechanisms_show_what_the_scorecard_says(row, shows, not_shown):
    assert all(SHOWN[name](ROWS[row]) for name in shows)
    assert not any(SHOWN[name](ROWS[row]) for name in not_shown)


def test_a_table_counts_what_is_shown():
    shown = {'A': {o.name: o.name != 'O10' for o in OBSERVATIONS}}
    head, _, line = report.observed_table(shown).splitlines()
    assert line.endswith('| - | 9 |') and head.count('|') == line.count('|') == 13
    assert len(report.sources_table().splitlines()) == 12


def test_the_document_has_the_observations_of_today():
    lines = DOCUMENT.read_text().splitlines()
    observed = report.observed_table(observations.observed_by_mechanism())
    for table in (report.sources_table(), observed):
        assert all(row in lines for row in table.splitlines())
