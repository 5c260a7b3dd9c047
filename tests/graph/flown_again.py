"""A recorded flight, flown again with what was commanded and changed: the same messages."""

from mambo_bags.reader import read_bag
from mambo_bringup.flight.runner import fly
from mambo_flight import closed_loop, commanded, recording_to_bag
from mambo_flight.scenario import override


def _payloads(bag):
    """Return the messages of every topic of a bag."""
    read = read_bag(bag)
    return {name: read[name].raw for name in read.topics}


def _assert_same(again, before, aside):
    again, before = _payloads(again), _payloads(before)
    assert again.keys() == before.keys()
    for name in before:
        assert again[name] == before[name] or name == aside, name


def assert_one_process_gives(bag, folder, aside=''):
    """Fly a flight of the graph again in this process; ``aside`` is a topic that may differ."""
    flight = commanded.scenario_of(bag)
    recording_to_bag.write(folder / 'alone', flight, closed_loop.fly(flight, inner=True))
    _assert_same(folder / 'alone', bag, aside)


def assert_the_graph_gives(bag, folder, aside=''):
    """Fly a flight of the graph again there, without its pause; ``aside`` as above."""
    fly(override(commanded.scenario_of(bag), {'sim_node.paused': False}), folder / 'graph')
    _assert_same(folder / 'graph', bag, aside)
