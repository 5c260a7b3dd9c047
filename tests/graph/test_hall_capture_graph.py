"""Drones that disturb each other's motion capture, in the graph: as in one process, to the bit."""

from mambo_bags.reader import read_bag
from mambo_bringup.flight.runner import fly_several
from mambo_bringup.replay import replay
from mambo_flight import recording_to_bag
from mambo_flight.scenario import from_yaml, override, scenario
from mambo_flight.world import formation, together
from mambo_ros import topics
from mambo_sim.sensors.hall_capture import HallCaptureParams
from mambo_sim.world import WorldParams
import pytest

pytestmark = pytest.mark.long

SECONDS = 6.0
PARAMS = WorldParams(
    drones=2, spacing=0.8, capture=HallCaptureParams(
        occlusion=True, cameras=2, camera_height=1.5, body_height=0.1, swap_distance=0.9))
"""The second climbs after the first, past the lines of sight of both cameras, and meets it."""


def hall():
    drones = formation.hall(scenario('hover', estimator='joint', duration=SECONDS, land=False,
                                     seed=3, overrides={
        'estimator_node.joint.pose.enabled': True, 'controller_node.estimate': 'map',
        'sim_node.mode': 'lockstep'}), PARAMS)
    first, second = drones.flights
    return [first, override(second, {'reference_node.plan.takeoff_time': 1.9})], drones.hall


@pytest.fixture(scope='module')
def alone():
    """Return the flight in one process."""
    flights, place = hall()
    return together.fly(flights, PARAMS, list(place.places.values()))


@pytest.fixture(scope='module', params=[True, False], ids=['composed', 'processes'])
def flown(request, tmp_path_factory):
    """Return outcomes and bags by namespace."""
    (flights, place), folder = hall(), tmp_path_factory.mktemp('hall')
    bags = {space: folder / space[1:] for space in place.places}
    return fly_several(
        dict(zip(bags, flights, strict=True)), bags, request.param, hall=place), bags


def payloads(path, topic, namespace):
    return list(map(bytes, read_bag(path)[topics.full_name(topic, namespace)].raw))


def test_the_flight_is_one_in_which_markers_are_hidden_and_drones_mistaken(alone):
    assert [one.pair for one in alone.exchanges] == [(0, 1)]
    for recording in alone.recordings:
        assert recording.inner.health[:, 3].min() < 5.0  # visible markers


def test_the_graph_flies_what_one_process_flies(flown, alone, tmp_path):
    outcomes, bags = flown
    assert [(o.flown, o.missed, o.fault) for o in outcomes] == [(SECONDS, 0, '')] * 2
    for (space, path), recording in zip(bags.items(), alone.recordings, strict=True):
        kept = read_bag(path, topics=()).attachments
        flight = from_yaml(kept['scenario.yaml'])
        again = tmp_path / space[1:]
        recording_to_bag.write(again, flight, recording, space, kept['world.yaml'])
        for topic in recording_to_bag.recorded(flight):
            assert payloads(path, topic, space) == payloads(again, topic, space), (
                space, topic.name)


def test_each_drone_replays_to_the_bit(flown, tmp_path):
    for space, path in flown[1].items():
        again = tmp_path / space[1:]
        replay(path, again)
        for topic in (topics.ESTIMATE, topics.LOCATED, topics.ESTIMATOR_STATE):
            assert list(map(bytes, read_bag(again)[topic.name].raw)) == payloads(
                path, topic, space)
