"""Variables of MATLAB files and the signals that Simulink logs in them."""

from pathlib import Path

from hypothesis import given, strategies as st
from mambo_analysis.importers.mat_file import logged, variables
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest
from scipy.io import savemat

FILE = Path('log.mat')


def saved(path, **content):
    savemat(path, content)
    return variables(path, path.read_bytes())


def scope(values, times=None, **entry):
    times = np.arange(len(values)) * 0.1 if times is None else times
    return {'time': times, 'signals': {'values': values, **entry}}


def test_numbers_texts_and_structures_come_as_plain_values(tmp_path):
    cells = np.empty(2, object)
    cells[:] = [np.array([1.0, 2.0]), 'two']
    found = saved(tmp_path / 'a.mat', matrix=np.arange(6).reshape(2, 3), note='by hand',
                  run={'mass': 0.07, 'inner': {'x': np.arange(3.0)}}, cells=cells)
    assert sorted(found) == ['cells', 'matrix', 'note', 'run']  # none of __header__
    np.testing.assert_array_equal(found['matrix'], [[0, 1, 2], [3, 4, 5]])
    assert found['note'] == 'by hand' and found['run']['mass'] == 0.07
    np.testing.assert_array_equal(found['run']['inner']['x'], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(found['cells'][0], [1.0, 2.0])
    assert found['cells'][1] == 'two'


def test_structures_deeper_than_eight_end_in_nothing(tmp_path):
    deep = np.arange(2.0)
    for _ in range(12):
        deep = {'x': deep}
    found = saved(tmp_path / 'a.mat', deep=deep)['deep']
    depth = 0
    while found is not None:
        found, depth = found['x'], depth + 1
    assert depth == 8


@pytest.mark.parametrize(('content', 'wanted'), [
    (b'MATLAB 7.3 MAT-file, and so on', 'version 7.3; save it with -v7 in MATLAB first'),
    (b'\x89HDF\r\n\x1a\n' + bytes(99), 'version 7.3; save it with -v7 in MATLAB first'),
    (bytes(512) + b'\x89HDF\r\n\x1a\n' + bytes(99), 'version 7.3; save it with -v7'),
    (b'no mat file, but long enough to be looked at. ' * 9, 'not a readable mat file ('),
    (b'', 'not a readable mat file (')])
def test_other_files_are_one_line(tmp_path, content, wanted):
    path = tmp_path / 'a.mat'
    path.write_bytes(content)
    with pytest.raises(BagError) as caught:
        variables(path, content)
    assert str(caught.value).startswith(f'{path}: ') and wanted in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_cut_off_anywhere_is_one_line_or_less_of_it(tmp_path):
    path = tmp_path / 'a.mat'
    whole = saved(path, x=np.arange(50.0), y=np.arange(5.0))
    content = path.read_bytes()
    for size in range(130, len(content), 60):
        try:
            found = variables(path, content[:size])
        except BagError as error:
            assert str(error).startswith(f'{path}: not a readable mat file (')
        else:
            for name, values in found.items():
                np.testing.assert_array_equal(values, whole[name])


def test_a_structure_with_time_is_a_signal_of_its_rows():
    signals, others = logged(FILE, {
        'rt_gyro': scope(np.arange(12.0).reshape(4, 3), np.arange(4) * 0.005), 'gain': 2.0})
    name, times, values = signals['rt_gyro']
    assert name == 'rt_gyro' and others == ['gain']
    np.testing.assert_array_equal(times, np.arange(4) * 0.005)
    np.testing.assert_array_equal(values, np.arange(12.0).reshape(4, 3))


def test_matrices_have_their_times_last_as_simulink_logs_them():
    """A 1 x 3 signal over 5 times is logged as (1, 3, 5); the row of each time is wanted."""
    rows = np.arange(15.0).reshape(5, 3)
    signals, _ = logged(FILE, {'a': scope(rows.T.reshape(1, 3, 5), np.arange(5.0)),
                               'b': scope(rows.T, np.arange(5.0))})
    np.testing.assert_array_equal(signals['a'].values, rows)
    np.testing.assert_array_equal(signals['b'].values, rows)


@given(st.integers(2, 6), st.integers(1, 4), st.integers(1, 4))
def test_every_element_of_a_logged_matrix_keeps_its_time(count, high, wide):
    values = np.arange(float(high * wide * count)).reshape(high, wide, count)
    if high == count:
        return  # rows for each time already: nobody can tell
    signals, _ = logged(FILE, {'a': scope(values, np.arange(float(count)))})
    for k in range(count):
        np.testing.assert_array_equal(signals['a'].values[k], values[..., k].reshape(-1))


def test_several_signals_of_a_scope_are_named_by_block_label_or_number():
    entries = [{'values': np.zeros(2), 'blockName': 'model/sub/gyro'},
               {'values': np.ones(2), 'blockName': '', 'label': 'height'},
               {'values': np.full(2, 2.0)},
               {'values': np.full(2, 3.0), 'blockName': 'other/gyro'}]
    signals, _ = logged(FILE, {'s': {'time': [0.0, 1.0] * np.ones(2), 'signals': entries}})
    assert {name: signal.values[0, 0] for name, signal in signals.items()} == {
        's/gyro': 0.0, 's/height': 1.0, 's/2': 2.0, 's/3': 3.0}


def test_an_array_is_logged_if_it_has_a_row_for_each_time_of_the_run():
    signals, others = logged(FILE, {
        'rt_tout': np.arange(4) * 0.1, 'x': np.arange(4.0), 'm': np.ones((4, 2)),
        'other': np.ones(5), 'cube': np.ones((4, 2, 2))})
    assert sorted(signals) == ['m', 'x']
    np.testing.assert_array_equal(signals['x'].values, np.arange(4.0)[:, None])
    np.testing.assert_allclose(signals['m'].times, np.arange(4) * 0.1)
    assert others == ['other (5,)', 'cube (4, 2, 2)']


def test_without_times_of_the_run_an_array_is_no_signal():
    for tout in ({}, {'rt_tout': np.array([0.0])}, {'rt_tout': np.ones((2, 2))}):
        signals, others = logged(FILE, {'x': np.ones((2, 2)), **tout})
        assert not signals and others == ['x (2, 2)']


@pytest.mark.parametrize(('values', 'wanted'), [
    (None, 'a holds what is no number'), ('text', 'a holds what is no number'),
    (np.zeros((4, 2)), r'a has the shape \(4, 2\), expected a row for each of its 3 times'),
    (np.zeros((3, 0)), r'a has the shape \(3, 0\)'),
    (np.zeros(2), r'a has the shape \(2, 1\)')])
def test_a_malformed_signal_is_named(values, wanted):
    with pytest.raises(BagError, match=f'^log.mat: {wanted}'):
        logged(FILE, {'a': scope(values, np.arange(3.0))})


def test_times_that_are_no_numbers_are_named():
    with pytest.raises(BagError, match='^log.mat: a.time holds what is no number'):
        logged(FILE, {'a': {'time': 'now', 'signals': {'values': np.zeros(3)}}})
