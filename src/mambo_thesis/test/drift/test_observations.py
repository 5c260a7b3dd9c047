"""What the thesis saw, against the mechanisms: the scorecard of the audit, with its numbers."""

from pathlib import Path

from mambo_thesis.drift import observations, report
from mambo_thesis.drift.observations import corrected, factors, OBSERVATIONS, ramp
from mambo_thesis.drift.paths import one_turn
from mambo_thesis.drift.table import Row, ROWS
import numpy as np
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


@pytest.mark.long
def test_the_document_has_the_observations_of_today():
    lines = DOCUMENT.read_text().splitlines()
    observed = report.observed_table(observations.observed_by_mechanism())
    for table in (report.sources_table(), observed):
        assert all(row in lines for row in table.splitlines())


def observed(name):
    """Return a table of observed effects in which one row shows the named ones."""
    return {o.name: o.shown(ROWS[name]) for o in OBSERVATIONS}


@pytest.mark.long
def test_a_row_is_shown_by_the_observations_of_the_document():
    cells = observations.observed_by_mechanism()
    assert list(cells) == list(ROWS)
    assert cells['A'] == observed('A') and cells['C1'] == observed('C1')
    assert all(type(shown) is bool for row in cells.values() for shown in row.values())


def test_a_perfect_sensor_shows_only_that_nothing_drifts():
    perfect = Row('no error', ROWS['A'].audit)
    assert [o.name for o in OBSERVATIONS if o.shown(perfect)] == ['O1', 'O4']


@pytest.mark.parametrize('slope', [0.0, 0.07, 0.1])
def test_the_tuned_factor_is_1_at_the_reference_height(slope):
    turn = one_turn('(5.6)')
    found = observations.tuned(turn, slope)
    level = np.abs(turn.height - 1.5) < 1e-9
    assert level.any() and found[level] == pytest.approx(1.0)
    rising = np.argsort(turn.height)
    assert (np.diff(found[rising]) >= -1e-12).all() and np.ptp(found) == pytest.approx(
        slope * np.ptp(turn.height) / (0.92 + 1.5 * slope))


def test_a_sensor_with_the_slope_of_the_estimator_does_not_drift():
    """Q = 0.92 + 0.07 h in sensor and estimator: nothing is left on a vertical circle."""
    row = Row('the same slope', ROWS['A'].audit, {}, 0.92 + 0.07 * 1.5)
    assert corrected(row, 'C.4', 0.07) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert abs(corrected(row, 'C.4', 0.0)[0]) > 0.2


@pytest.mark.parametrize(('row', 'rises'), [('A', True), ('I', False)])
def test_a_factor_that_depends_on_the_height_rises_with_it(row, rises):
    found = factors(ROWS[row])
    assert bool(np.ptp(found) > 0.03) is rises
    if rises:  # half of a sine at a constant height: Q itself, to the tilt
        np.testing.assert_allclose(found, 0.92 + 0.07 * np.array(observations.HEIGHTS), rtol=0.01)
