"""The topics of the graph: names, types and rates that bags and nodes rely on."""

import importlib

from mambo_model.schema import ParameterError
from mambo_ros import topics
from mambo_ros.topics import Topic
import pytest

EVERY = [value for value in vars(topics).values() if isinstance(value, Topic)]


@pytest.mark.parametrize('topic', EVERY, ids=lambda topic: topic.name)
def test_a_type_name_leads_back_to_its_class(topic):
    package, kind, name = topic.type_name.split('/')
    assert kind == 'msg'
    assert getattr(importlib.import_module(f'{package}.msg'), name) is topic.msg_type


def test_names_differ_and_those_of_the_whole_graph_are_absolute():
    names = [topic.name for topic in EVERY]
    assert len(set(names)) == len(names)
    assert {name for name in names if name.startswith('/')} == {
        '/clock', '/tf', '/tf_static', '/diagnostics'}


def test_what_depends_on_the_simulated_flight_alone_is_recorded():
    left_out = set(EVERY) - set(topics.RECORDABLE)
    # who heard whom is of the run and not of the flight; commands stand for what they came from
    assert left_out == {topics.LINKS, topics.JOY, topics.SETPOINT, *topics.DESCRIBED}
    assert len(set(topics.RECORDABLE)) == len(topics.RECORDABLE)


def test_what_several_nodes_publish_is_shared_and_links_wait_for_latecomers():
    assert {topic.name for topic in EVERY if topic.shared} == {
        '/tf', '/tf_static', '/diagnostics', 'graph/links'}
    assert [topic for topic in EVERY if topic.transient_local] == [
        topics.LINKS, topics.TF_STATIC, topics.ROBOT_DESCRIPTION]
    assert all(topic.rate > 0.0 for topic in topics.RECORDED)


def test_full_names_of_one_drone_and_of_several():
    for topic, alone, one in ((topics.IMU, '/mambo/imu/data_raw', '/mambo2/imu/data_raw'),
                              (topics.CLOCK, '/clock', '/mambo2/clock'),
                              (topics.DIAGNOSTICS, '/diagnostics', '/mambo2/diagnostics')):
        assert topics.full_name(topic, topics.NAMESPACE) == alone
        assert topics.full_name(topic, '/mambo2') == one


def test_no_names_are_every_topic_of_the_flight():
    assert tuple(topics.selected('')) == tuple(topics.RECORDED)
    assert tuple(topics.selected(' , ')) == tuple(topics.RECORDED)


def test_names_are_taken_in_their_order_without_their_blanks():
    names = [topic.name for topic in topics.RECORDED][:3]
    found = topics.selected(f' {names[2]},{names[0]} ,')
    assert [topic.name for topic in found] == [names[2], names[0]]


def test_an_unknown_topic_is_named_with_those_that_there_are():
    with pytest.raises(ParameterError, match=r'unknown topic sonar; known: .*sonar/range'):
        topics.selected('sonar/range,sonar')
