"""Changes of parameters that a bag has recorded, read back by node."""

from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_flight import recorded_changes
from mambo_flight.scenario import scenario
from mambo_model.motion import parameter_change
from mambo_model.motion.parameter_change import Change
from mambo_ros import diagnostics
from mambo_ros.commands import change_message
import pytest

GAIN, NOISE = 'cascaded.k_p', 'joint.sonar.noise'
RECORDED = (
    (1_000_000_000, '{drone}/controller_node', {GAIN: 2.0}),
    (1_200_000_000, 'shadow/controller_node', {GAIN: 9.0}),  # beside the drone
    (1_500_000_000, '{drone}/estimator_node', {NOISE: 0.03}),
    (2_000_000_000, 'controller_node', {GAIN: 2.5}),
    (2_500_000_000, 'recorder_node', {'speed': 1.0}))  # of a node whose changes are not flown


@pytest.fixture(scope='module', params=[
    ('/diagnostics', '/mambo/sensor_tick'), ('/mambo2/diagnostics', '/mambo2/sensor_tick')])
def bag(request, tmp_path_factory):
    """Return a bag of diagnostics, of a drone alone and of one of several in a hall."""
    path = tmp_path_factory.mktemp('bags') / 'changed'
    name, tick = request.param
    writer = BagWriter(path)
    writer.add_topic(name, 'diagnostic_msgs/msg/DiagnosticArray')
    writer.add_topic(tick, 'mambo_interfaces/msg/SensorTick')
    writer.write(name, diagnostics.report(0, 'sim_node', diagnostics.OK, 'well', {}), 0)
    for t, node, values in RECORDED:
        node = node.format(drone=tick.split('/')[1])
        writer.write(name, change_message.encode(t, node, values), t)
    writer.close()
    return read_bag(path, recorded_changes.RECORD)


def test_changes_are_read_by_node_in_their_order(bag):
    found = recorded_changes.changes_of(bag)
    assert {name: parameter_change.parse(text) for name, text in found.items() if text} == {
        'controller_node.changes': [
            Change(1_000_000_000, {GAIN: 2.0}), Change(2_000_000_000, {GAIN: 2.5})],
        'estimator_node.changes': [Change(1_500_000_000, {NOISE: 0.03})]}


def test_an_estimate_again_takes_those_of_the_estimator_only(bag):
    flight = recorded_changes.estimated(scenario(), bag)
    assert parameter_change.parse(flight.estimator_node.changes) == [
        Change(1_500_000_000, {NOISE: 0.03})]
    assert flight.controller_node.changes == scenario().controller_node.changes == ''
