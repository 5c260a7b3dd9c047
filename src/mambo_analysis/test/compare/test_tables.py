"""Comparisons as text and CSV: every number in its column, every gap in words."""

import csv

from mambo_analysis.compare import tables
import pytest


def row(part='whole flight', count=100, delay=(None, None, None), scale=1.0):
    rms, most, drift = ([scale * v for v in values] for values in (
        (0.1, 0.2, 0.3), (1.0, 2.0, 3.0), (-0.01, 0.02, -0.03)))
    return {'part': part, 'count': count, 'rms': rms, 'rms_total': 0.4 * scale, 'maximum': most,
            'maximum_total': 4.0 * scale, 'drift': drift, 'drift_total': 0.05 * scale,
            'drift_at': 18.5, 'delay': list(delay)}


def section(*rows, **changed):
    return {'title': 'Position: estimate minus truth', 'quantity': 'position', 'unit': 'm',
            'axes': ['x', 'y', 'z'], 'rows': list(rows) or [row()], 'too_few': {},
            'ends_early': False, **changed}


def result(**changed):
    return {'bag': 'circle', 'duration': 18.5, 'real_time_factor': None, 'source': '',
            'ending': [], 'takeoff_end': None, 'takeoff': '', 'landing_start': None,
            'errors': [section()], 'notes': [],
            'topics': [{'topic': 'estimate/odom', 'messages': 3700, 'rate': 200.0, 'lost': 0}],
            **changed}


@pytest.mark.parametrize('scale', [1.0, 1e3, 1e4, 1e7, -1e5, 1e12])
def test_large_numbers_never_run_together(scale):
    """A head of n columns has n numbers below it, whatever their size."""
    whole, drift = tables.section(section(row(scale=scale)))[2:]
    assert len(whole.split()) == len('whole flight'.split()) + 5 + 1
    assert [float(x) for x in whole.split()[2:5]] == pytest.approx(
        [0.1 * scale, 0.2 * scale, 0.3 * scale], rel=0.06)
    assert len(drift.split()) == len('at the end [m]'.split()) + 4


def test_the_row_that_says_most_is_that_after_take_off():
    whole, after = row(), row('after take-off', 80)
    assert tables.main_row(section(whole, after)) is after
    assert tables.main_row(section(whole, row('landing'))) is whole


def test_a_section_has_rms_maximum_and_samples_of_each_part_below_their_headings():
    lines = tables.section(section(row(), row('after take-off', 80, scale=2.0)))
    title, head, whole, after, drift = lines
    assert title == 'Position: estimate minus truth'
    assert head.split() == ['RMS', '[m]', 'x', 'y', 'z', 'total', 'max', 'samples']
    assert whole.split() == ['whole', 'flight', '0.1000', '0.2000', '0.3000', '0.4000', '4.0000',
                             '100']
    assert after.split()[2:] == ['0.2000', '0.4000', '0.6000', '0.8000', '8.0000', '80']
    # of the whole flight, the first row: where it ends
    assert drift.split() == ['at', 'the', 'end', '[m]', '-0.0100', '0.0200', '-0.0300', '0.0500']
    for name, value in (('x', '0.1000'), ('total', '0.4000'), ('samples', '100')):
        assert head.index(name) + len(name) == whole.rindex(value) + len(value)


def test_long_names_of_axes_widen_their_columns():
    axes = ['roll about x', 'pitch', 'yaw']
    _, head, whole, _ = tables.section(section(axes=axes))
    assert head.index('roll about x') + len('roll about x') == whole.index('0.1000') + 6


def test_delays_are_those_of_the_row_that_says_most():
    lines = tables.section(section(
        row(delay=(9.0, 9.0, 9.0)), row('after take-off', 80, (0.125, None, -0.05))))
    assert lines[-1].split() == ['delay', '[s]', '0.1250', '-', '-0.0500']
    assert 'delay' not in '\n'.join(tables.section(section()))


def test_what_has_nothing_or_little_to_compare_says_so():
    lines = tables.section(section(row(count=0)))
    assert lines[2].split() == ['whole', 'flight', 'nothing', 'to', 'compare']
    assert len(lines) == 3                       # no drift of nothing
    entry = section(row(), row('landing', 0), row('ground', 0),
                    too_few={'landing': 1, 'ground': 5})
    assert tables.too_few(entry) == [
        ('landing', '1 sample: too few for statistics'),
        ('ground', '5 samples: too few for statistics')]
    text = '\n'.join(tables.section(entry))
    assert text.count('too few for statistics') == 2 and 'nothing to compare' not in text


def test_take_off_and_landing_are_told_if_they_are_known():
    assert tables.times(result()) == []
    known = result(takeoff_end=7.954, takeoff='by the reference', landing_start=16.0)
    assert tables.times(known) == [
        'take-off ends at 7.95 s: by the reference', 'landing begins at 16.00 s']
    assert tables.times(result(takeoff='no take-off seen')) == ['no take-off seen']
    assert tables.times(result(takeoff='it stayed on the floor', ending=[
        'the vehicle never took off: on the floor from 2.00 to 6.00 s'])) == []


def test_a_flight_is_headed_by_its_bag_and_ends_with_its_topics_and_notes():
    lines = tables.table(result(
        real_time_factor=4.25, source='log.mat', ending=['ended by the user'],
        topics=[{'topic': 'a', 'messages': 1, 'rate': None, 'lost': None},
                {'topic': 'optitrack/pose', 'messages': 900, 'rate': 119.96, 'lost': 12}],
        notes=['the clock jumps'])).splitlines()
    assert lines[0] == 'circle: 18.50 s, real-time factor 4.25, imported from log.mat'
    assert lines[1] == 'ended by the user'
    at = next(k for k, line in enumerate(lines) if line.startswith('topic'))
    assert [line.split() for line in lines[at:at + 3]] == [
        ['topic', 'messages', 'Hz', 'lost'], ['a', '1', '-', '-'],
        ['optitrack/pose', '900', '120.0', '12']]
    assert lines[at + 3] == 'lost "-": nothing counts the messages of this topic'
    assert 'lost "-"' not in tables.table(result())
    assert lines[-1] == 'note: the clock jumps'
    assert tables.table(result()).startswith('circle: 18.50 s\n')


def two(**changed):
    return {'bags': ('a', 'b'), 'compared': ('estimate/odom', 'optitrack/pose'),
            'duration': 17.0, 'ending': [], 'takeoff_end': None, 'takeoff': '',
            'landing_start': None, 'errors': [section()], 'differences': [], 'notes': [],
            **changed}


def test_of_two_bags_each_is_named_with_its_topic():
    lines = tables.table(two(notes=['moved by 3 s'])).splitlines()
    assert lines[:3] == ['A: a, estimate/odom', 'B: b, optitrack/pose', '17.00 s in common']
    assert 'position: A minus B' in lines
    assert lines[-1] == 'note: moved by 3 s'


def test_parameters_that_differ_are_shown_up_to_twelve():
    some = [('mass', 0.068, None), ('drag.enabled', True, False)]
    lines = tables.table(two(differences=some)).splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith('parameters'))
    assert [line.split() for line in lines[at + 1:at + 3]] == [
        ['mass', '0.068', '-'], ['drag.enabled', 'True', 'False']]
    many = [(f'p{k}', k, k + 1) for k in range(15)]
    text = tables.table(two(differences=many))
    assert 'p11 ' in text and 'p12 ' not in text and 'and 3 more, see --json' in text
    assert 'more, see' not in tables.table(two(differences=many[:12]))


def test_a_table_fits_a_terminal():
    assert max(map(len, tables.table(result()).splitlines())) <= 80


def test_a_csv_file_has_a_line_for_each_axis_and_part(tmp_path):
    found = result(errors=[section(row(), row('after take-off', 80, (0.1, None, 0.3)))])
    assert tables.write_csv(found, tmp_path / 'a.csv') == tmp_path / 'a.csv'
    with (tmp_path / 'a.csv').open(newline='') as file:
        lines = list(csv.DictReader(file))
    assert [line['axis'] for line in lines] == ['x', 'y', 'z', 'total'] * 2
    y, total = lines[5], lines[7]
    assert (y['part'], y['quantity'], y['unit'], y['samples']) == (
        'after take-off', 'position', 'm', '80')
    assert [float(y[name]) for name in ('rms', 'maximum', 'final_drift')] == [0.2, 2.0, 0.02]
    assert [line['delay_s'] for line in lines[4:]] == ['0.1', '', '0.3', '']
    assert [float(total[name]) for name in ('rms', 'maximum', 'final_drift')] == [0.4, 4.0, 0.05]


def test_a_csv_file_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(ValueError, match='file'):
        tables.write_csv(result(), tmp_path / 'file' / 'a.csv')


def test_the_last_error_has_its_time_where_the_flight_goes_on():
    assert tables.section(section(ends_early=True))[-1].startswith('  at 18.50 s [m]  ')
    assert tables.section(section())[-1].startswith('  at the end [m]  ')
