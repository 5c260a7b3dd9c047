"""Flights of one vehicle agree within their intervals, those of another do not."""

from flown import flight, TRUE
from mambo_analysis.identify.regression import Value
from mambo_analysis.twin.agreement import agree, COMPARED, identified, table
import pytest


def value(x, half):
    return Value(x, x - half, x + half, '1')


@pytest.mark.parametrize('a, b, same', [
    (value(1.0, 0.3), value(1.49, 0.4), True), (value(1.0, 0.3), value(1.51, 0.4), False),
    (value(1.51, 0.4), value(1.0, 0.3), False), (value(2.0, 0.0), value(2.0, 0.0), True)])
def test_the_interval_of_a_difference_is_the_root_of_both_squares(a, b, same):
    assert agree(a, b) is same


def test_flights_of_one_model_agree_in_nearly_all_pairs():
    """Of 42 pairs 2 disagree by chance; 8 have a chance below 0.2 %."""
    caption, head, rows = table(identified([flight(seed) for seed in range(4)]))
    assert 'pairs of flights that agree' in caption
    assert head == ['parameter', *(['flight'] * 4), 'agree'] and len(rows) == len(COMPARED) + 2
    counts = [row[-1].split(' of ') for row in rows]
    assert {total for _, total in counts[:-2]} == {'6'}
    agreed = [int(count) for count, _ in counts]
    assert sum(agreed[:-2]) >= 35
    assert rows[-2] == ['all', '', '', '', '', f'{sum(agreed[:-2])} of 42']
    tilts = sum(n for row, n in zip(rows, agreed) if row[0].startswith('tilt'))
    assert rows[-1][0] == 'all but tilt' and rows[-1][-1] == f'{agreed[-2] - tilts} of 30'


def test_another_drag_is_seen():
    other = TRUE._replace(drag=(0.5, 0.35, 0.25))
    _, _, rows = table(identified([flight(0), flight(1, model=other)]))
    found = {row[0].rpartition(' [')[0]: row[1:] for row in rows}
    assert found['drag x'][-1] == '0 of 1'
    values = [float(cell.split('+-')[0]) for cell in found['drag x'][:2]]
    assert values == pytest.approx([0.4, 0.5], abs=0.02)
    assert found['drag y'][-1] == '1 of 1'


def test_what_a_flight_does_not_show_is_not_counted():
    still = flight(1)
    still = still._replace(velocity=0.01 * still.velocity)
    _, _, rows = table(identified([flight(0), still, flight(2)]))
    drag = rows[0]
    assert drag[0] == 'drag x [1/s]' and drag[2] == '-' and drag[-1].endswith(' of 1')
