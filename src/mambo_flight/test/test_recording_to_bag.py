"""The bag of a flight in one process; tests/graph/test_graph.py tests that it is the graph's."""

from mambo_analysis.compare.estimate import messages
from mambo_bags.reader import read_bag
from mambo_flight import fly, offline_replay, scenario_file
from mambo_flight.scenario import from_yaml
from mambo_ros import topics
import pytest

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
