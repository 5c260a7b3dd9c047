"""Motion capture in the graph: lockstep, replay and closed loop give the same bytes."""

import hashlib

from mambo_analysis.compare import estimate
from mambo_bags.reader import read_bag
from mambo_bringup.flight.runner import fly
from mambo_bringup.replay import replay
from mambo_flight import closed_loop, offline_replay, recording_to_bag
from mambo_flight.scenario import scenario
from mambo_ros import topics
import pytest

SECONDS = 9.0
STEPS = 1801
CAMERAS = {'latency': 0.03, 'fault': 'lost', 'fault_begin': 6.0, 'fault_end': 7.0}


def flight():
    """Return a flight that answers the estimate in map, and is not seen for a second."""
    return scenario(estimator='joint', duration=SECONDS, seed=3, land=False, overrides={
        'sim_node.mode': 'lockstep', 'controller_node.estimate': 'map',
        'estimator_node.joint.pose.enabled': True,
        **{f'optitrack_node.optitrack.{name}': value for name, value in CAMERAS.items()}})


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return the flight recorded in lockstep, every node a process."""
    path = tmp_path_factory.mktemp('graph') / 'bag'
    fly(flight(), path)
    return path


def payloads(bag, topic):
    return read_bag(bag)[topic.name if topic.name.startswith('/') else f'/mambo/{topic.name}'].raw


def digest(bag):
    return [hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(bag.glob('*.mcap'))]


@pytest.mark.long
def test_two_flights_with_one_seed_have_identical_bags(bag, tmp_path):
    again = tmp_path / 'again'
    fly(flight(), again, composed=True)  # one process: no message goes the same way
    for topic in (*topics.RECORDED, *topics.AIDED):
        first = payloads(bag, topic)
        assert first and first == payloads(again, topic), topic.name
    assert digest(bag) == digest(again)


@pytest.mark.long
def test_the_closed_loop_says_what_the_graph_says(bag, tmp_path):
    alone = tmp_path / 'alone'
    recording_to_bag.write(alone, flight(), closed_loop.fly(flight(), inner=True))
    for topic in (*topics.RECORDED, *topics.AIDED):
        assert payloads(alone, topic) == payloads(bag, topic), topic.name
    for topic in (topics.LOCATED, topics.CAPTURE_TICK):
        assert len(payloads(bag, topic)) == STEPS


@pytest.mark.long
def test_replays_live_and_offline_give_the_recorded_estimate_to_the_bit(bag, tmp_path):
    output = tmp_path / 'replayed'
    replay(bag, output)
    found = estimate.messages(
        offline_replay.estimate(read_bag(bag), flight().estimator_node.filter))
    for topic in (topics.ESTIMATE, topics.LOCATED, topics.ESTIMATOR_STATE):
        recorded = payloads(bag, topic)
        assert payloads(output, topic) == recorded, topic.name
        assert found[topic].tobytes() == b''.join(recorded), topic.name
    assert payloads(output, topics.TF) == payloads(bag, topics.TF)
