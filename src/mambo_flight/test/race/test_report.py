"""Numbers of a race: medians by hand, who survives, the page and its picture."""

from mambo_flight.race import report
from mambo_flight.race.field import Start
import pytest


def row(rms, largest=0.1, shutdown=False):
    return {'tracking_rms': rms, 'tracking_max': largest, 'tracking_final': 2.0 * rms,
            'saturated_share': 0.25, 'energy': 100.0 * rms, 'shutdown': shutdown}


STARTS = [Start('indi', 'circle', 'known', draw) for draw in range(4)]
ROWS = {0: row(0.01), 1: row(0.03), 2: row(0.02, largest=2.5), 3: row(0.04, shutdown=True)}


def test_results_are_medians_and_shares():
    found, = report.results(STARTS, ROWS, True)
    assert found.rms == pytest.approx(0.025) and found.end == pytest.approx(0.05)
    assert found.rms_95 == pytest.approx(0.0385)  # 0.03 + 0.85 of the way to 0.04
    assert (found.flights, found.survived, found.largest) == (4, 0.5, 2.5)
    assert (found.saturated, found.energy) == (0.25, pytest.approx(2.5))


def test_each_entrant_course_and_condition_is_a_line():
    starts = [Start(entrant, course, 'known', 0)
              for entrant in ('indi', 'geometric') for course in ('circle', 'step')]
    rows = {number: row(0.001 * (number + 1)) for number in range(4)}
    found = report.results(starts, rows, False)
    assert [(r.entrant, r.course, r.rms) for r in found] == [
        ('indi', 'circle', 0.001), ('indi', 'step', 0.002), ('geometric', 'circle', 0.003),
        ('geometric', 'step', 0.004)]
    text = report.markdown(found, {'indi': 0.51, 'geometric': 0.3}, 'Four flights.', ['a.png'])
    assert '| `indi` | 1 | 2 | 100.0 % |' in text
    assert '| `geometric` | 3 | 4 | 100.0 % |' in text
    assert '| `indi` | Smeur 2016, Sun 2022 | 0.51 |' in text
    assert '![a.png](a.png)' in text and '## Everything known: estimates' in text


def test_a_picture_is_drawn(tmp_path):
    found = report.results(STARTS, ROWS, True) + report.results(STARTS, ROWS, False)
    report.draw(tmp_path / 'a.png', found, 'known')
    assert (tmp_path / 'a.png').read_bytes().startswith(b'\x89PNG')
