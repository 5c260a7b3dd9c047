"""A simulated flight read from its bag: the same as flown."""

from pathlib import Path
import re

from mambo_bags.reader import BagError, read_bag
from mambo_flight import closed_loop, offline_replay
from mambo_flight.accuracy import from_bag
from mambo_flight.offline_replay import Steps, steps_of
from mambo_ros import topics
import numpy as np
import pytest

pytestmark = pytest.mark.long

BAG = Path(__file__).parents[4] / 'bags/circle_short'


def test_samples_and_truth_are_those_of_the_flight_to_the_bit():
    flight, found = from_bag.read(BAG)
    flown = closed_loop.fly(flight, inner=True)
    np.testing.assert_array_equal(found.truth, flown.truth)
    for name, ours, theirs in zip(Steps._fields, steps_of(found), steps_of(flown), strict=True):
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


def test_a_flight_ends_at_its_landing():
    _, found = from_bag.read(BAG)
    assert len(from_bag.until_landing(found).t) == len(found.t)  # it ends in the air
    landing = found._replace(truth=found.truth.copy())
    landing.truth[1300:, 2] = -0.05
    cut = from_bag.until_landing(landing)
    for name, column in zip(from_bag.Samples._fields, cut, strict=True):
        np.testing.assert_array_equal(column, getattr(found, name)[:1300], err_msg=name)
    landing.truth[:, 2] = 0.0
    assert len(from_bag.until_landing(landing).t) == len(found.t)  # it never left the floor


def test_a_folder_or_an_mcap_file_is_a_bag(tmp_path):
    assert from_bag.is_bag(str(BAG)) and from_bag.is_bag(str(BAG / 'circle_short_0.mcap'))
    assert not from_bag.is_bag('circle') and not from_bag.is_bag(str(tmp_path / 'no.mcap'))


def test_a_bag_without_a_complete_step_is_one_line(monkeypatch):
    whole = steps_of(closed_loop.fly(from_bag.read(BAG)[0], inner=True))
    monkeypatch.setattr(from_bag.offline_replay, 'steps', lambda bag: Steps(
        *(values[:0] for values in whole)))
    with pytest.raises(BagError, match='circle_short: no step of the sensors is complete'):
        from_bag.read(BAG)


def test_what_a_bag_without_a_complete_step_lacks_is_named():
    bag = read_bag(BAG, [topic.name for topic in (
        topics.IMU, topics.OPTICAL_FLOW, topics.BAROMETER, topics.SENSOR_TICK)])
    assert not len(offline_replay.steps(bag).t)
    said = str(offline_replay.nothing_complete(bag))
    assert re.fullmatch(
        r'.*circle_short: no step of the sensors is complete, nothing to estimate '
        r'\((\d+) of \1 samples of sonar/range that were published are not in the bag\)', said)


@pytest.mark.parametrize(('field', 'value'), [
    ('position', 1e308), ('velocity', np.nan), ('orientation', 0.0)])
def test_an_impossible_true_state_is_one_line(field, value):
    bag = read_bag(BAG)
    stamps = bag['ground_truth/odom'].stamp
    getattr(bag['ground_truth/odom'], field)[5] = value
    with pytest.raises(BagError, match=f'impossible state at {1e-9 * stamps[5]:.3f} s'):
        from_bag.true_states(bag, stamps)


def test_a_bag_without_truth_or_scenario_is_one_line(monkeypatch):
    bag = read_bag(BAG)
    stamps = bag['ground_truth/odom'].stamp
    with pytest.raises(BagError, match='not a state for every inertial sample'):
        from_bag.true_states(bag, stamps + 1)
    with pytest.raises(BagError, match='no ground_truth/odom'):
        from_bag.true_states(read_bag(BAG, ['imu/data']), stamps)
    bag.attachments.pop('scenario.yaml')
    monkeypatch.setattr(from_bag, 'read_bag', lambda path: bag)
    with pytest.raises(BagError, match='no scenario.yaml inside'):
        from_bag.read(BAG)
