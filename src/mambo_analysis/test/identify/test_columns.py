"""Columns of bench files: every format gives the same numbers, and what is wrong is one line."""

import json
from pathlib import Path

from hypothesis import given, settings, strategies as st
from mambo_analysis.identify.columns import column, read, times
from mambo_analysis.identify.regression import IdentifyError
import numpy as np
import pytest
from scipy import io

FILE = Path('bench.csv')
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_a_csv_file_is_read_by_the_names_of_its_first_row(tmp_path):
    table = read(written(tmp_path / 'a.csv', ' t , force\n0.0,1.5\n0.5,-2e-3\n'))
    assert list(table) == ['t', 'force']
    assert table['force'][0] is None
    np.testing.assert_array_equal(table['t'][1], [0.0, 0.5])
    np.testing.assert_array_equal(table['force'][1], [1.5, -2e-3])


def test_a_spreadsheets_mark_empty_lines_and_empty_fields_are_no_mistakes(tmp_path):
    content = b'\xef\xbb\xbft,x\r\n\r\n0,1\r\n1,\r\n2, 3\r\n'
    table = read(written(tmp_path / 'a.CSV', content))
    assert list(table) == ['t', 'x']
    np.testing.assert_array_equal(table['x'][1], [1.0, np.nan, 3.0])


@settings(max_examples=10)  # each is read in a process of its own
@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=20))
def test_what_a_program_writes_is_read_to_the_bit(tmp_path_factory, rows):
    path = tmp_path_factory.getbasetemp() / 'property.csv'
    path.write_text('a,b\n' + ''.join(f'{a!r},{b!r}\n' for a, b in rows))
    table = read(path)
    np.testing.assert_array_equal(np.stack([table['a'][1], table['b'][1]], axis=1), rows)


def test_a_mat_file_gives_vectors_columns_of_matrices_and_structures(tmp_path):
    matrix = np.arange(6.0).reshape(3, 2)
    cells = np.empty(2, object)
    cells[:] = [np.array([1.0, 2.0]), np.array([3.0, 4.0, 5.0])]
    io.savemat(tmp_path / 'a.mat', {
        'rpm': np.array([7, 8, 9]), 'rig': {'load': np.array([0.5, 0.6]), 'm': matrix},
        'runs': cells, 'note': 'by hand'})
    table = {name: values for name, (_, values) in read(tmp_path / 'a.mat').items()}
    assert sorted(table) == ['rig.load', 'rig.m[0]', 'rig.m[1]', 'rpm', 'runs[0]', 'runs[1]']
    np.testing.assert_array_equal(table['rpm'], [7.0, 8.0, 9.0])
    assert table['rpm'].dtype == float
    np.testing.assert_array_equal(table['rig.m[1]'], [1.0, 3.0, 5.0])
    np.testing.assert_array_equal(table['runs[1]'], [3.0, 4.0, 5.0])


def test_a_json_file_gives_columns_with_times_of_their_own_at_any_depth(tmp_path):
    content = {'cf1': {'motor': {'m1': {'time': [0, 0.1], 'data': [10, 20]}, 'unit': 'PWM'}},
               'scale': {'time': [1.0], 'data': [0.5]}, 'about': {'time': 'today'}}
    table = read(written(tmp_path / 'a.json', json.dumps(content)))
    assert list(table) == ['cf1.motor.m1', 'scale']
    np.testing.assert_array_equal(table['cf1.motor.m1'][0], [0.0, 0.1])
    np.testing.assert_array_equal(table['cf1.motor.m1'][1], [10.0, 20.0])


@pytest.mark.parametrize(('name', 'content', 'wanted'), [
    ('a.txt', 't\n1\n', 'is no .csv, .mat, .json file or bag'),
    ('a.csv', '', 'holds no column of numbers'),
    ('a.csv', 't,x\n0,1\n0\n', 'row 3 has 1 fields, the first one 2'),
    ('a.csv', 't;x\n0;1,5\n', 'separate columns by commas, and write numbers with decimal points'),
    ('a.csv', 't,x\n0,fast\n', "could not convert string to float: 'fast'"),
    ('a.csv', 't,x,x\n0,1,2\n', 'several columns have the name x'),
    ('a.mat', '# Created by Octave 8.4\n# name: x\n# type: matrix\n',
     'it is damaged or not of MATLAB'),
    ('a.mat', 'MATLAB 7.3 MAT-file' + ' ' * 500, 'version 7.3; save it with -v7 in MATLAB first'),
    ('a.json', '[1, 2]', 'holds no column of numbers'),
    ('a.json', '{"a": ', 'cannot be read ('), ('a.mat', 'none', 'cannot be read ('),
    ('a.json', '{"a": {"time": [0], "data": ["x"]}}', 'could not convert string to float')])
def test_what_cannot_be_read_is_one_line_that_names_the_file(tmp_path, name, content, wanted):
    path = written(tmp_path / name, content)
    with pytest.raises(IdentifyError) as caught:
        read(path)
    assert str(caught.value).startswith(f'{path}: ') and wanted in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(IdentifyError, match='none.csv: No such file or directory'):
        read(tmp_path / 'none.csv')


def test_a_column_is_found_by_its_name_or_the_end_of_it():
    table = {name: (None, np.array([float(k)])) for k, name in enumerate(
        ('t', 'cf1.t', 'cf1.m1', 'cf2.m1', 'thrust'))}
    assert column(table, 't', FILE)[1] == [0.0]      # the whole name before the end of another
    assert column(table, 'cf2.m1', FILE)[1] == [3.0]
    with pytest.raises(IdentifyError, match=r'bench.csv: several columns m1; it has t, cf1.t'):
        column(table, 'm1', FILE)
    with pytest.raises(IdentifyError, match=r'bench.csv: no column rust; it has t'):
        column(table, 'rust', FILE)


def test_times_are_those_of_the_column_then_of_the_file_then_of_a_rate():
    own, table = np.array([3.0, 3.5, 4.5]), {'t': (None, np.array([10.0, 11.0, 13.0]))}
    np.testing.assert_allclose(times(None, {}, 't', 200.0, 3, FILE), [0.0, 0.005, 0.01])
    for found in (own, None):
        with pytest.raises(IdentifyError, match=r'^--rate: .* has times.*: leave it out'):
            times(found, table, 't', 200.0, 3, FILE)
    np.testing.assert_array_equal(times(own, table, 't', 0.0, 3, FILE), [0.0, 0.5, 1.5])
    np.testing.assert_array_equal(times(None, table, 't', 0.0, 3, FILE), [0.0, 1.0, 3.0])
    with pytest.raises(IdentifyError, match='bench.csv: no column seconds; give --time t$'):
        times(None, table, 'seconds', 0.0, 3, FILE)
    with pytest.raises(IdentifyError, match=r'no times; name their column with --time or give'):
        times(None, {'x': table['t']}, 'seconds', 0.0, 3, FILE)
    assert not len(times(np.array([]), table, 't', 0.0, 0, FILE))


def test_times_in_a_column_of_another_name_are_named(tmp_path):
    table = read(written(tmp_path / 'a.csv', 'Time,x\n0,1\n0.005,2\n'))
    for rate, says in (
            (100.0, '^--rate: a.csv has times in its column Time: leave it out and give --time '
             'Time$'), (0.0, '^a.csv: no column t; give --time Time$')):
        with pytest.raises(IdentifyError, match=says):
            times(None, table, 't', rate, 2, Path('a.csv'))
    np.testing.assert_array_equal(times(None, table, 'Time', 0.0, 2, FILE), [0.0, 0.005])
