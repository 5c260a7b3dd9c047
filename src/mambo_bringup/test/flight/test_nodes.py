"""The nodes of a flight: which are started, and the parameters that they get."""

import dataclasses
from pathlib import Path

from mambo_bringup.flight import nodes
from mambo_flight.scenario import commented_yaml, override, Scenario, scenario, to_yaml
from mambo_ros.node import MamboNode
import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
import yaml


def test_the_runner_starts_what_the_scenario_has_parameters_for():
    names = {name for _, name in (*nodes.FLIGHT_NODES, nodes.SIMULATOR)}
    assert names == {field.name for field in dataclasses.fields(Scenario)}


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
def test_every_node_reads_from_the_file_what_was_written(tmp_path, write):
    flown = override(scenario(), {
        'sim_node.wait_for': 'one,two', 'sim_node.simulator.vehicle.power_a': 1 / 3e4,
        'sim_node.simulator.vehicle.inertia': (1e-6, 1 / 3e3, 2e-5), 'sim_node.speed': 2,
        'estimator_node.map_to_odom': False})
    file = tmp_path / 'scenario.yaml'
    file.write_text(write(flown))
    rclpy.init(args=['--ros-args', '--params-file', str(file)],
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        for field in dataclasses.fields(Scenario):
            node = MamboNode(field.name, field.metadata['group'])
            assert node.params == getattr(flown, field.name), field.name
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_names_of_bags_are_written_for_ros_as_they_are(tmp_path):
    name = "it's: a \N{GRINNING FACE} #\n{bag"
    file = tmp_path / 'scenario.yaml'
    (_, arguments), = nodes.start_arguments(file, tmp_path / name, True, '/mambo')
    parameters = yaml.safe_load(Path(arguments[-1]).read_text())['/mambo/recorder_node']
    assert parameters['ros__parameters']['bag'] == str(tmp_path / name)
    _, arguments = nodes.start_arguments(file, tmp_path / name, False, '/mambo')[0]
    given = dict(text.split(':=', 1) for text in arguments if ':=' in text)
    assert yaml.safe_load(given['bag']) == str(tmp_path / name)
