"""MATLAB files of version 7.3 hold what those of version 7 do."""

from io import BytesIO
import sys

from mambo_analysis.importers import mat_file
from mambo_analysis.importers.logs import hdf5
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest

TEXT = b'MATLAB 7.3 MAT-file, Platform: GLNXA64'
h5py = pytest.importorskip('h5py', reason='h5py is not installed: requirements/logs.txt')


def dataset(group, name, values, kind='double', **attributes):
    """Write an array as MATLAB does: with its axes the other way round, and its class."""
    made = group.create_dataset(name, data=np.atleast_2d(values).T)
    made.attrs['MATLAB_class'] = np.bytes_(kind)
    for key, value in attributes.items():
        made.attrs[key] = value
    return made


def matlab(fill):
    """Return a file that a function fills, behind the first block of text."""
    buffer = BytesIO()
    with h5py.File(buffer, 'w', userblock_size=512) as file:
        fill(file)
    return TEXT.ljust(512) + buffer.getvalue()[512:]


def references(file, name, items):
    """Write a cell, or a field of a structure of several elements: references to others."""
    hidden = file.require_group('#refs#')
    made = [dataset(hidden, f'{name}{i}', item).ref for i, item in enumerate(items)]
    return np.array(made, dtype=h5py.ref_dtype)


def example(file):
    dataset(file, 't', np.arange(5.0))
    dataset(file, 'gyro', np.arange(15.0).reshape(5, 3))
    dataset(file, 'name', np.frombuffer(b'mambo', np.uint8).astype(np.uint16), 'char')
    dataset(file, 'nothing', [0, 0], MATLAB_empty=np.uint8(1))
    dataset(file, 'on', [1, 0, 1], 'logical')
    group = file.create_group('log')
    group.attrs['MATLAB_class'] = np.bytes_('struct')
    dataset(group, 'z', [1.0, 2.0])
    cell = file.create_dataset('cell', data=references(file, 'c', [[1.0, 2.0], [3.0]])[None])
    cell.attrs['MATLAB_class'] = np.bytes_('cell')
    several = file.create_group('several')
    several.attrs['MATLAB_fields'] = 'a b'
    for field in 'ab':
        several.create_dataset(field, data=references(file, field, [[1.0], [2.0]])[:, None])


def test_every_kind_of_variable():
    found = hdf5.load(matlab(example))
    assert '#refs#' not in found
    np.testing.assert_array_equal(found['t'], np.arange(5.0))
    np.testing.assert_array_equal(found['gyro'], np.arange(15.0).reshape(5, 3))
    assert found['name'] == 'mambo' and found['nothing'].size == 0
    np.testing.assert_array_equal(found['on'], [1, 0, 1])
    np.testing.assert_array_equal(found['log']['z'], [1.0, 2.0])
    np.testing.assert_array_equal(found['cell'][0], [1.0, 2.0])
    assert [float(one['b']) for one in found['several']] == [1.0, 2.0]


def test_readers_of_matlab_files_take_it(tmp_path):
    path, content = tmp_path / 'a.mat', matlab(example)
    path.write_bytes(content)
    found = mat_file.variables(path, content)
    np.testing.assert_array_equal(found['gyro'][:, 2], np.arange(5.0) * 3.0 + 2.0)


def test_structures_in_structures_have_an_end():
    def deep(file):
        group = file
        for _ in range(20):
            group = group.create_group('x')
        group.create_group('round').parent['x'] = h5py.SoftLink('/x')
    found, depth = hdf5.load(matlab(deep)), 0
    while isinstance(found, dict):
        found, depth = found.get('x'), depth + 1
    assert depth == hdf5.DEEPEST + 2


def test_a_damaged_file_is_one_line_or_what_is_left(tmp_path):
    content = matlab(example)
    rng = np.random.default_rng(3)
    for i in range(20):
        spoilt = bytearray(content[:int(rng.integers(600, len(content) + 1))])
        for at in rng.integers(512, len(spoilt), 30 * (i % 2)):
            spoilt[at] = int(rng.integers(256))
        try:
            mat_file.variables(tmp_path / 'a.mat', bytes(spoilt))
        except BagError as error:
            assert '\n' not in str(error) and str(error).startswith(str(tmp_path / 'a.mat'))


def test_without_the_library_it_says_what_to_do(monkeypatch):
    content = matlab(example)
    monkeypatch.setitem(sys.modules, 'h5py', None)
    with pytest.raises(ValueError, match='-v7 in MATLAB first, or pip install -r'):
        hdf5.load(content)


def test_text_of_other_tools_and_links_to_other_files_are_no_damage():
    def fill(file):
        example(file)
        file['note'] = 'pilot: me'
        file['elsewhere'] = h5py.ExternalLink('other.h5', '/x')
    found = hdf5.load(matlab(fill))
    assert found['note'] is None and 'elsewhere' not in found
    assert found.keys() - {'note'} == hdf5.load(matlab(example)).keys()
