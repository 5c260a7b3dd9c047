"""Several drones in one hall in the graph: the flight in one process to the bit, and replays."""

from mambo_bags.reader import read_bag
from mambo_bringup.flight.runner import fly_several
from mambo_bringup.replay import replay
from mambo_flight import recording_to_bag
from mambo_flight.scenario import from_yaml, scenario
from mambo_flight.world import formation, separation, together, world_file
from mambo_ros import topics
from mambo_sim.downwash import DownwashParams
from mambo_sim.world import WorldParams
import pytest

SECONDS = 4.0
PARAMS = WorldParams(
    drones=2, spacing=0.25, least_separation=0.2, collision_distance=0.2, formation='line',
    downwash=DownwashParams(enabled=True))
"""So near that the drones feel each other while they climb."""


def hall():
    return formation.hall(
        scenario('hover', duration=SECONDS, land=False, seed=3,
                 overrides={'sim_node.mode': 'lockstep'}), PARAMS)


@pytest.fixture(scope='module', params=[True, pytest.param(False, marks=pytest.mark.long)],
                ids=['composed', 'processes'])
def flown(request, tmp_path_factory):
    """Return outcomes and bags by namespace."""
    drones, folder = hall(), tmp_path_factory.mktemp('world')
    bags = {space: folder / space[1:] for space in drones.hall.places}
    flights = dict(zip(bags, drones.flights, strict=True))
    return fly_several(flights, bags, request.param, hall=drones.hall), bags


def payloads(path, topic, namespace):
    return list(map(bytes, read_bag(path)[topics.full_name(topic, namespace)].raw))


@pytest.mark.long
def test_the_graph_flies_what_one_process_flies(flown, tmp_path):
    outcomes, bags = flown
    assert [(o.flown, o.missed, o.fault) for o in outcomes] == [(SECONDS, 0, '')] * 2
    drones = hall()
    result = together.fly(drones.flights, PARAMS, list(drones.hall.places.values()))
    for (space, path), recording in zip(bags.items(), result.recordings, strict=True):
        kept = read_bag(path, topics=()).attachments
        assert kept['world.yaml'] == world_file.to_text(drones.hall)
        recording_to_bag.write(
            tmp_path / space[1:], from_yaml(kept['scenario.yaml']), recording, space,
            kept['world.yaml'])
        for topic in topics.RECORDED:
            assert payloads(path, topic, space) == payloads(
                tmp_path / space[1:], topic, space), (space, topic.name)
    assert outcomes[0].collisions == [
        one.describe(list(bags)) for one in result.collisions]
    tracks, limit = separation.read(list(bags.values()))
    assert limit == 0.2 and len(separation.pairs(tracks)[0].t) == 801


@pytest.mark.long
def test_each_drone_replays_to_the_bit(flown, tmp_path):
    path = flown[1]['/mambo2']
    replay(path, tmp_path / 'again')
    again = read_bag(tmp_path / 'again')
    for topic in (topics.ESTIMATE, topics.ESTIMATOR_STATE):
        assert list(map(bytes, again[topic.name].raw)) == payloads(path, topic, '/mambo2')
