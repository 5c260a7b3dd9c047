"""Numbers of a race: medians by hand, who survives, the page and its picture."""

from mambo_flight.race import report
from mambo_flight.race.comparison import Start
from mambo_model.errors import InputError
from matplotlib.figure import Figure
import numpy as np
import pytest


def row(rms, largest=0.1, shutdown=False):
    return {'tracking_rms': rms, 'tracking_max': largest, 'tracking_final': 2.0 * rms,
            'saturated_share': 0.25, 'energy': 100.0 * rms, 'shutdown': shutdown,
            'failsafe': '', 'fallen': False}


STARTS = [Start('indi', 'circle', 'known', draw) for draw in range(4)]
ROWS = {0: row(0.01), 1: row(0.03), 2: row(0.02, largest=2.5), 3: row(0.04, shutdown=True)}


def test_results_are_medians_and_shares():
    found, = report.results(STARTS, ROWS, 'true')
    assert found.rms == pytest.approx(0.025) and found.end == pytest.approx(0.05)
    assert found.rms_95 == pytest.approx(0.0385)  # 0.03 + 0.85 of the way to 0.04
    assert (found.flights, found.survived, found.largest) == (4, 0.5, 2.5)
    assert (found.saturated, found.energy) == (0.25, pytest.approx(2.5))


def test_each_entrant_course_and_condition_is_a_line():
    starts = [Start(entrant, course, 'known', 0)
              for entrant in ('indi', 'geometric') for course in ('circle', 'step')]
    rows = {number: row(0.001 * (number + 1)) for number in range(4)}
    found = report.results(starts, rows, 'estimated')
    assert [(r.entrant, r.course, r.rms) for r in found] == [
        ('indi', 'circle', 0.001), ('indi', 'step', 0.002), ('geometric', 'circle', 0.003),
        ('geometric', 'step', 0.004)]
    text = report.markdown(found, {
        'indi': ('Smeur 2016, Sun 2022', 0.51), 'geometric': ('Lee 2010', 0.3)},
        ['a.png'])
    assert '| `indi` | 1 | 2 | 100.0 % |' in text
    assert '| `geometric` | 3 | 4 | 100.0 % |' in text
    assert '| `indi` | Smeur 2016, Sun 2022 | 0.51 |' in text
    assert '![a.png](a.png)' in text and '## Everything known: estimates' in text


def test_a_picture_is_drawn(tmp_path):
    found = report.results(STARTS, ROWS, 'true') + report.results(STARTS, ROWS, 'estimated')
    report.draw(tmp_path / 'a.png', found, 'known')
    assert (tmp_path / 'a.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(('changed', 'alive'), [
    ({}, True), ({'shutdown': True}, False), ({'fallen': True}, False),
    ({'failsafe': 'estimate lost'}, False),
    ({'tracking_max': 2.0}, False),
    ({'tracking_max': 1.999}, True), ({'tracking_max': float('nan')}, False)])
def test_a_flight_that_is_not_shut_down_nor_off_nor_on_the_floor_survives(changed, alive):
    assert report.survived({**row(0.01), **changed}) is alive


def many():
    """Return results of two entrants, two courses, one condition, both kinds of state."""
    starts = [Start(entrant, course, 'known', draw) for entrant in ('indi', 'geometric')
              for course in ('circle', 'step') for draw in range(2)]
    out = []
    for state, scale in (('true', 1.0), ('estimated', 10.0)):
        rows = {k: row(scale * 0.001 * (k + 1), shutdown=k == 7) for k in range(8)}
        out += report.results(starts, rows, state)
    return out


def test_an_overview_is_of_one_condition_and_state():
    lines = report._overview(many(), 'known', 'true').splitlines()
    assert lines[0] == '|  | `circle` | `step` | survived | saturated | energy [J] |'
    assert lines[1].split('|')[1].strip() == '---'
    assert lines[2] == '| `indi` | 1.5 | 3.5 | 100.0 % | 25.00 % | 0 |'
    assert lines[3].startswith('| `geometric` | 5.5 | 7.5 | 75.0 % |')  # one of four shut down
    assert '| `indi` | 15 | 35 |' in report._overview(many(), 'known', 'estimated')


def test_details_have_a_line_for_each_entrant_course_and_state():
    lines = report._details(many()).splitlines()
    assert len(lines) == 2 + 8
    assert lines[2] == ('| `indi` | `circle` | `known` | true state | 2 | 1.5 | 1.95 | 100 | 3 | '
                        '100.0 % |')
    assert lines[-1].endswith('| 50.0 % |') and 'estimates' in lines[-1]


def test_the_page_has_both_states_in_their_order():
    text = report.markdown(many(), {'indi': ('INDI', 0.5)}, [])
    assert text.index('## Everything known: true state') < text.index(
        '## Everything known: estimates') < text.index('## A step')
    assert '![' not in text and text.startswith('# Controllers compared\n')


@pytest.mark.long
def test_a_picture_has_a_panel_for_each_state_and_a_curve_for_each_entrant(tmp_path, monkeypatch):
    figures = []

    def make(*args, **options):
        figures.append(Figure(*args, **options))
        return figures[-1]
    monkeypatch.setattr(report, 'Figure', make)
    report.draw(tmp_path / 'a.png', many(), 'known')
    true, estimated = figures[0].axes
    assert (true.get_title(), estimated.get_title()) == ('true state', 'estimates')
    assert [line.get_label() for line in true.lines] == ['indi', 'geometric']
    np.testing.assert_allclose(true.lines[0].get_ydata(), [1.5, 3.5])  # mm
    np.testing.assert_allclose(estimated.lines[1].get_ydata(), [55.0, 75.0])
    assert [label.get_text() for label in true.get_xticklabels()] == ['circle', 'step']


def test_results_of_two_races_are_in_the_order_of_the_page_and_the_later_counts():
    first = report.results(
        [Start('indi', 'circle', 'known', 0)], {0: row(0.01)}, 'aided')
    second = report.results(
        [Start('mine', 'circle', 'known', 0), Start('indi', 'step', 'known', 0),
         Start('indi', 'circle', 'known', 0)], {k: row(0.02 + 0.01 * k) for k in range(3)}, 'true')
    again = report.results([Start('indi', 'circle', 'known', 0)], {0: row(0.05)}, 'aided')
    found = report.merged([*first, *second], again)
    assert [(r.entrant, r.course, r.state, round(r.rms, 9)) for r in found] == [
        ('indi', 'circle', 'true', 0.04), ('indi', 'step', 'true', 0.03),
        ('mine', 'circle', 'true', 0.02), ('indi', 'circle', 'aided', 0.05)]


@pytest.mark.parametrize('text', [
    '{"draws": 1}', 'no JSON', '[]', '{"steps_us": {}, "results": 1}',
    '{"steps_us": {}, "results": [{"rms": 1}]}'])
def test_numbers_of_another_kind_are_refused_in_one_line(tmp_path, text):
    (tmp_path / 'controllers.json').write_text(text)
    with pytest.raises(InputError, match='not the numbers of a race of this version'):
        report.load(tmp_path / 'controllers.json')


def test_the_page_says_how_many_flights_of_each_state():
    text = report.markdown(many(), {'indi': ('INDI', 0.5)}, [])
    assert '16 flights of 30 s.' in text
    assert 'Draws of each kind: 2 for the true state, 2 for the estimates; one' in text
    assert '## Goals' in text
