"""Parameters of the recorder: a bag must be named, the rest has a meaning when empty."""

from mambo_bags.recorder_parameters import RecorderNodeParams
from mambo_model.schema import flatten, ParameterError
import pytest


def test_a_bag_is_enough():
    found = RecorderNodeParams(bag='my_flight')
    assert flatten(found) == {
        'bag': 'my_flight', 'topics': '', 'scenario': '', 'whole': True, 'world': ''}


def test_without_a_bag_it_says_which_parameter_is_missing():
    with pytest.raises(ParameterError, match=r'^bag: give the directory of the bag$'):
        RecorderNodeParams()


@pytest.mark.parametrize('name', ['bag', 'topics', 'scenario'])
def test_what_is_no_text_is_refused_by_name(name):
    with pytest.raises(ParameterError, match=rf'^{name} = '):
        RecorderNodeParams(**{'bag': 'my_flight', name: 3})
