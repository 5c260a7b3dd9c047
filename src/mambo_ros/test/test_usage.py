"""Every node answers ``--help`` without ROS, and the text is correct."""

import importlib
from pathlib import Path
import subprocess
import sys

from mambo_model import schema
from mambo_ros import usage
import pytest
from rclpy.parameter import Parameter

NODES = {
    'mambo_sim.sim_node': 'SimNode', 'mambo_sim.optitrack_node': 'OptitrackNode',
    'mambo_estimation.estimator_node': 'EstimatorNode',
    'mambo_control.controller_node': 'ControllerNode',
    'mambo_control.reference_node': 'ReferenceNode',
    'mambo_mocap.natnet_client_node': 'NatNetClientNode',
    'mambo_mocap.natnet_server_node': 'NatNetServerNode',
    'mambo_view.view_node': 'ViewNode',
    'mambo_description.description_node': 'DescriptionNode',
    'mambo_bags.recorder_node': 'RecorderNode', 'mambo_bags.replay_node': 'ReplayNode'}
OPTIONS = {
    'mambo_sim.optitrack_node': [{'watermark': True}],
    'mambo_estimation.estimator_node': [
        {'estimator': 'ground_truth'}, {'estimator': 'joint', 'joint.pose.enabled': True}],
    'mambo_control.reference_node': [{'commands.enabled': True}],
    'mambo_control.controller_node': [{'estimate': 'map'}],
    'mambo_description.description_node': [{'paths': True, 'markers': True}]}
"""Parameters with which a node has more topics."""
SRC = Path(__file__).parents[2]


def node_type(module):
    return getattr(importlib.import_module(module), NODES[module])


def run(module, *words):
    """Run an executable where ROS cannot be started."""
    code = (f'import sys; sys.argv[0] = "/lib/{module.replace(".", "/")}"\n'
            f'import rclpy; rclpy.init = None\n'
            f'from {module} import main; main()')
    return subprocess.run(
        [sys.executable, '-c', code, *words], text=True, capture_output=True, timeout=60)


def test_every_node_is_tested():
    found = {f'{file.parent.name}.{file.stem}' for file in SRC.glob('*/mambo_*/*_node.py')}
    assert found == {
        *NODES, 'mambo_bringup.composed_node', 'mambo_bringup.hall_capture_node'}


@pytest.mark.long
@pytest.mark.parametrize('module, word', [
    *((name, '--help') for name in NODES), ('mambo_sim.sim_node', '-h')])
def test_help_names_purpose_topics_parameters_and_an_example(module, word):
    done = run(module, word)
    assert (done.returncode, done.stderr) == (0, '')
    kind, (package, executable) = node_type(module), module.split('.')
    assert done.stdout.startswith(f'usage: ros2 run {package} {executable} ')
    assert kind.__doc__.split()[0] in done.stdout
    for topic in (*kind.publishes, *kind.subscribes, *kind.serves):
        assert f'  {topic.name}  {topic.type_name}\n' in done.stdout
    for name, field in schema.walk(usage._params_type(kind)):
        assert f'\n  {name} = ' in done.stdout
        assert field.metadata['source'] in done.stdout
    assert done.stdout.splitlines()[-1].startswith(f'  ros2 run {package} {executable} --ros-args')


@pytest.mark.long
def test_help_of_a_parameter_has_default_unit_range_and_source():
    text = run('mambo_bags.replay_node', '--help').stdout
    assert ('  patience = 30.0 s (range 1 to 3600)\n'
            '      wall time without an answer after which to give up\n') in text
    assert "  bag = ''\n      rosbag2 directory or .mcap file\n" in text


@pytest.mark.long
def test_help_of_the_composed_nodes_has_a_section_for_each():
    done = run('mambo_bringup.composed_node', '--help')
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith('usage: ros2 run mambo_bringup composed_node ')
    for name in ('recorder', 'optitrack', 'estimator', 'reference', 'controller', 'sim'):
        assert f'--- {name}_node ---' in done.stdout


def test_help_after_ros_args_is_not_handled_here():
    assert not usage.asked(['--ros-args', '-p', '--help'])


@pytest.mark.long
@pytest.mark.parametrize('module', [
    name for name in NODES if not name.startswith(('mambo_bags', 'mambo_view'))])
def test_a_node_has_the_topics_that_its_help_names(ros, module):
    kind = node_type(module)
    nodes = [kind(parameter_overrides=[Parameter(key, value=value) for key, value in one.items()])
             for one in ({}, *OPTIONS.get(module, ()))]
    name = nodes[0].resolve_topic_name
    assert {output.publisher.topic_name for node in nodes for output in node.outputs} == {
        name(topic.name) for topic in kind.publishes}
    assert {entry.name for node in nodes for entry in node.inputs} == {
        name(topic.name) for topic in kind.subscribes}
