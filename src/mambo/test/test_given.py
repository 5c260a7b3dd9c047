"""What a script gives is taken as numpy has it, and refused in one line."""

from pathlib import Path

import mambo
from mambo import given
from mambo_model.errors import InputError
import numpy as np
import pytest

CIRCLE = Path(__file__).parents[3] / 'bags/circle_short'


@pytest.mark.parametrize(('value', 'expected'), [
    (np.int64(3), 3), (np.float32(0.5), 0.5), (np.bool_(True), True), (np.array([1, 2]), [1, 2]),
    (np.array(2.0), 2.0), (np.str_('a'), 'a'), ({'a': np.arange(2)}, {'a': [0, 1]}),
    ([np.float64(1.0), (np.int8(2),)], [1.0, (2,)]), (None, None), ('text', 'text')])
def test_numbers_and_arrays_of_numpy_are_plain(value, expected):
    found = given.plain(value)
    assert found == expected and type(found) is type(expected)
    if isinstance(found, list):
        assert [type(one) for one in found] == [type(one) for one in expected]


def test_a_named_tuple_stays_what_it_is():
    found = np.linalg.slogdet(np.eye(2))
    assert given.plain(found) is found


@pytest.mark.parametrize(('values', 'words'), [
    ('x', 'a value of type str'), ([1], 'a value of type list'), ({1: 2}, 'the name 1 must be')])
def test_parameters_are_a_mapping_from_names(values, words):
    assert given.parameters(None) == {} and given.parameters({'a': np.int8(1)}) == {'a': 1}
    with pytest.raises(InputError, match=f'^parameters: .*{words}'):
        given.parameters(values)


def test_a_path_is_text_or_a_path():
    assert given.path('a', 'bag') == given.path(Path('a'), 'bag') == Path('a')
    for value, words in ((None, 'None'), (3, 'a value of type int')):
        with pytest.raises(InputError, match=f'^bag: must be a path, not {words}$'):
            given.path(value, 'bag')


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: mambo.open_bag(None), 'bag: must be a path, not None'),
    (lambda: mambo.open_bag('a', namespace=4), 'namespace: must be text, not 4'),
    (lambda: mambo.compare(None), 'bag: must be a path, not None'),
    (lambda: mambo.estimate(3), 'bag: must be a path, not a value of type int'),
    (lambda: mambo.fly(3), 'scenario: must be a path, not a value of type int'),
    (lambda: mambo.fly(trajectory=3), 'trajectory: 3 is neither a name, a path, a function nor a'),
    (lambda: mambo.fly(controller=3), 'controller: 3 is neither a name, a path, a function nor a'),
    (lambda: mambo.fly(estimator=[]), 'estimator: [] is neither a name, a path, a function nor a'),
    (lambda: mambo.fly(parameters='x'), "parameters: must be {'name': value}, not a value of"),
    (lambda: mambo.compare(CIRCLE, what=['time']), 'what: aligns two recordings; leave it out'),
    (lambda: mambo.compare(CIRCLE, CIRCLE, what=['nope']), "what: must be some of ['time', 'pos"),
    (lambda: mambo.compare(CIRCLE, CIRCLE, what='yaw'), "what: must be some of ['time', 'positi"),
    (lambda: mambo.compare(CIRCLE, CIRCLE, what=5), "what: must be some of ['time', 'position',"),
    (lambda: mambo.estimate(CIRCLE, 'kalman', parameters={'estimator': 'joint'}),
     'estimator: is given twice, also in parameters'),
    (lambda: mambo.compare(CIRCLE).to_html(5), 'path: must be a path, not a value of type int'),
    (lambda: mambo.sweep(None), 'sweep: must be a path, not None'),
    (lambda: mambo.sweep({'title': object()}), 'sweep: cannot represent an object'),
    (lambda: mambo.recorded_commands(None), 'bag: must be a path, not None'),
    (lambda: mambo.command('set', parameters={3: 4}), 'parameters: the name 3 must be text'),
    (lambda: mambo.command('go_to', height=1.0), 'go_to: height is not an argument of this comm'),
    (lambda: mambo.command('takeoff'), 'takeoff: height is missing; it takes height, duration'),
    (lambda: mambo.command('stop', x=1), 'stop: x is not an argument of this command')])
def test_what_cannot_be_is_one_line_that_names_the_argument(call, words):
    with pytest.raises(InputError) as error:
        call()
    assert str(error.value).startswith(words) and '\n' not in str(error.value)


def test_a_flight_takes_numbers_of_numpy_and_does_not_overwrite(tmp_path):
    flight = mambo.fly(
        duration=np.float32(0.5), estimator='ground_truth', seed=np.int64(3), landing=np.bool_(0),
        parameters={'sim_node.simulator.vehicle.inertia': np.array([1e-4, 1e-4, 2e-4])})
    assert (flight.scenario.seed, len(flight.t)) == (3, 101)
    assert flight.scenario.sim_node.simulator.vehicle.inertia == (1e-4, 1e-4, 2e-4)
    (tmp_path / 'bag').mkdir()
    for path, words in (
            (tmp_path / 'bag', 'exists: give another path'), (None, 'path: must be'),
            ('a\0b', 'path: '), (tmp_path / ('n' * 300), 'nn: File name too long')):
        with pytest.raises(InputError, match=words):
            flight.save(path)
