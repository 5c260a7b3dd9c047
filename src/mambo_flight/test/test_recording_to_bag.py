"""The bag of a flight in one process; tests/graph/test_graph.py tests that it is the graph's."""

from geometry_msgs.msg import TransformStamped
from mambo_analysis.compare.estimate import messages
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriterError
from mambo_flight import fly, offline_replay, recording_to_bag, scenario_file
from mambo_flight.scenario import from_yaml, override, Scenario
from mambo_ros import cdr, topics
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

SCENARIO = """
title: A short flight
duration: 3
landing: false
seed: 2
"""


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('fly')
    (folder / 'short.yaml').write_text(SCENARIO)
    code = fly.main([str(folder / 'short.yaml'), '--out', str(folder / 'bag')])
    assert code == 0
    return folder / 'bag'


def test_it_has_the_topics_of_the_graph_at_their_rates(bag):
    found = read_bag(bag)
    for topic in topics.RECORDED:
        count = len(found[topic.name])
        if topic.rate == 200.0:
            assert count == 601, topic.name
        assert count > 0, topic.name
    assert len(found[topics.TF.name]) == 151 and len(found[topics.DIAGNOSTICS.name]) == 16


def test_it_says_what_was_flown(bag):
    recorded = from_yaml(read_bag(bag, topics=()).attachments['scenario.yaml'])
    assert recorded == scenario_file.load(str(bag.parent / 'short.yaml'))[1]


def test_its_sensors_through_the_estimator_give_its_estimate(bag):
    found = read_bag(bag)
    node = scenario_file.load(str(bag.parent / 'short.yaml'))[1].estimator_node
    for topic, table in messages(offline_replay.estimate(found, node.filter)).items():
        assert table.tobytes() == b''.join(found[topic.name].raw)


def test_columns_become_vectors_and_numbers_in_their_order():
    rows = np.arange(12.0).reshape(2, 6)
    vector, number, pair = recording_to_bag._vectors(rows, 3, 1, 2)
    np.testing.assert_array_equal(vector, [[0, 6], [1, 7], [2, 8]])
    np.testing.assert_array_equal(number, [3, 9])
    np.testing.assert_array_equal(pair, [[4, 10], [5, 11]])


@pytest.mark.parametrize(('size', 'padded'), [(4, 4), (5, 8), (7, 8), (8, 8)])
def test_messages_are_padded_to_a_multiple_of_four_bytes(size, padded):
    stamps = np.arange(3)
    found, (rows,) = recording_to_bag._block(stamps, np.full((3, size), 9, np.uint8))
    assert found is stamps and rows.shape == (3, padded)
    assert (rows[:, :size] == 9).all() and not rows[:, size:].any()


@pytest.mark.parametrize('map_to_odom', [False, True])
def test_the_offsets_of_a_transform_are_those_of_its_stamps_and_numbers(map_to_odom):
    data, stamps, numbers = recording_to_bag._tf_template(map_to_odom)
    count = 1 + map_to_odom
    assert (len(stamps), len(numbers)) == (count, 7 * count)
    filled = bytearray(data)
    for at in stamps:
        filled[at:at + 8] = np.array([7, 8], '<u4').tobytes()
    for k, at in enumerate(numbers):
        filled[at:at + 8] = np.float64(k).tobytes()
    expected = []
    for k, (parent, child) in enumerate([('odom', 'base_link'), ('map', 'odom')][:count]):
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.header.stamp.sec, one.header.stamp.nanosec = parent, 7, 8
        place, turn = one.transform.translation, one.transform.rotation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = np.arange(
            7.0 * k, 7.0 * k + 7.0).tolist()
        expected.append(one)
    assert bytes(filled) == cdr.serialize(TFMessage(transforms=expected))


def test_a_flight_without_motion_capture_has_odom_at_the_origin_of_map():
    class Plain:
        located = None
    some = np.array([True, False, True])
    columns = recording_to_bag._anchors(Plain, some)
    np.testing.assert_array_equal(np.stack(columns, axis=1), [[0, 0, 0, 0, 0, 0, 1]] * 2)


def test_motion_capture_adds_its_topics():
    aided = override(Scenario(), {
        'estimator_node.estimator': 'joint', 'estimator_node.joint.pose.enabled': True})
    assert recording_to_bag.recorded(Scenario()) == topics.RECORDED
    assert recording_to_bag.recorded(aided) == topics.RECORDED + topics.AIDED


@pytest.mark.parametrize('fault', ['imu.kind', 'sonar.kind', 'barometer.kind'])
def test_faults_of_sensors_need_the_graph(fault, tmp_path):
    flight = override(Scenario(), {f'sim_node.simulator.faults.{fault}': 'late'})
    with pytest.raises(BagWriterError, match=rf'faults\.{fault} = late: a bag .* with ./run'):
        recording_to_bag.check(flight)
    with pytest.raises(BagWriterError, match='fly it with ./run$'):
        recording_to_bag.write(tmp_path / 'bag', flight, None)
    assert not (tmp_path / 'bag').exists()


def test_a_flight_without_faults_can_be_written():
    assert recording_to_bag.check(Scenario()) is None
