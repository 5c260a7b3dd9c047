"""What a user gives to an environment: taken in the types of numpy, or refused in one line."""

from mambo_flight.gym import inputs
from mambo_model.errors import InputError
import numpy as np
import pytest


def test_values_of_numpy_become_those_of_python():
    given = (np.float32(0.5), [np.int64(2), np.True_], np.arange(4).reshape(2, 2), 'x', None)
    assert inputs.plain(given) == (0.5, [2, True], [[0, 1], [2, 3]], 'x', None)
    assert type(inputs.plain(np.int64(2))) is int and type(inputs.plain(np.True_)) is bool


def test_a_mapping_is_taken_with_its_values_as_they_are():
    mask = np.array([True])
    assert inputs.mapping('options', '{}', {'reset_mask': mask})['reset_mask'] is mask
    assert inputs.mapping('options', '{}', None) == inputs.by_name('parameters', '{}', None) == {}


@pytest.mark.parametrize(('values', 'said'), [
    (5, '^parameters = 5 must be {name: value}$'), ('', "^parameters = '' must be"),
    (np.eye(2), r'^parameters = \[\[1.0, 0.0\], \[0.0, 1.0\]\] must be'),
    ({'a': 1, 5: 1}, '^parameters: the name 5 must be text$')])
def test_what_has_no_names_is_refused_in_one_line(values, said):
    with pytest.raises(InputError, match=said):
        inputs.by_name('parameters', '{name: value}', values)


def test_whole_numbers_are_taken_as_int():
    for value in (3, np.int8(3), np.uint64(3), np.array(3)):
        assert inputs.whole('threads', value, 1) == 3
        assert type(inputs.whole('threads', value, 1)) is int


@pytest.mark.parametrize('value', [
    0, True, np.True_, 2.0, np.float64(2.0), '2', None, [2], np.array([2]), 1j])
def test_what_is_no_whole_number_is_refused(value):
    with pytest.raises(InputError, match='^threads = .* must be a whole number, at least 1$'):
        inputs.whole('threads', value, 1)


def test_a_whole_number_has_a_limit_where_memory_has():
    assert inputs.whole('num_envs', 1000, 1, 1000) == 1000
    with pytest.raises(InputError, match='^num_envs = 1001 must be a whole number, 1 to 1000$'):
        inputs.whole('num_envs', 1001, 1, 1000)


@pytest.mark.parametrize(('value', 'expected'), [
    (None, [None] * 3), (4, [4, 5, 6]), (np.array(4), [4, 5, 6]), ([4, None, 0], [4, None, 0]),
    (np.array([1, 2, 3]), [1, 2, 3]), (range(3), [0, 1, 2]), (iter((3, 2, 1)), [3, 2, 1])])
def test_each_drone_gets_its_seed(value, expected):
    assert inputs.seeds(value, 3) == expected


@pytest.mark.parametrize(('value', 'said'), [
    ([1, 2], '^seed has 2 numbers, one for each of 3 drones'), ('abc', "^seed = 'abc' must be"),
    (b'abc', "^seed = b'abc' must be"), (np.array([1.0, 2.0, 3.0]), r'^seed\[0\] = 1.0 must be'),
    ([1, -2, 3], r'^seed\[1\] = -2 must be a whole number, at least 0$'),
    (np.eye(3), r'^seed\[0\] = \[1.0, 0.0, 0.0\] must be')])
def test_what_is_no_seed_is_refused(value, said):
    with pytest.raises(InputError, match=said):
        inputs.seeds(value, 3)


def test_numbers_become_floats_and_floats_are_not_copied():
    given = np.array([1.0, 2.0])
    assert inputs.floats('action', given, 'x') is given
    for values in ((1, 2), np.array([1, 2], dtype=np.uint8), [np.float32(1.0), 2],
                   np.array([1.0, 2], dtype=object)):
        np.testing.assert_array_equal(inputs.floats('action', values, 'x'), given)
        assert inputs.floats('action', values, 'x').dtype == float


@pytest.mark.parametrize('values', [
    'up', ['1', '2'], [1.0, 1j], np.array([1j]), np.array([1j], dtype=object),
    np.array(['2020'], dtype='M8[Y]'), np.array([3], dtype='m8[s]'), [[1.0], [1.0, 2.0]],
    np.array([np.datetime64('2020'), 1.0], dtype=object), {'x': 1},
    np.ma.array([1.0, 2.0], mask=[False, True])])
def test_what_are_no_numbers_is_refused(values):
    with pytest.raises(InputError, match=r'^action must be numbers: x \[m\]$'):
        inputs.floats('action', values, 'x [m]')


def test_an_integer_beyond_all_floats_is_refused():
    with pytest.raises(InputError, match=r'^action has a number that is too large: x \[m\]$'):
        inputs.floats('action', [10**400], 'x [m]')
