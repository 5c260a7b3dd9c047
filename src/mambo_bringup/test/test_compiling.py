"""Compilation of a flight's nodes before it: once, each in a process, never in the way."""

import os
from pathlib import Path
import time

from mambo_bringup import compiling
from mambo_control.controller_node import ControllerNode
from mambo_control.reference_node import ReferenceNode
from mambo_estimation import estimator_node, filters
from mambo_estimation.estimator_node import EstimatorNode
from mambo_flight.scenario import override, scenario
from mambo_model.compiled import hold
from mambo_ros import messages
from mambo_sim.optitrack_node import OptitrackNode
from mambo_sim.sim_node import SimNode
import pytest

LEVEL = (1.0, 0.0, 0.0, 0.0)
PD = Path(__file__).parents[3] / 'examples/pd_controller.py'


class Params:
    """Parameters of a stand-in: what its process appends to a file, and how it ends."""

    def __init__(self, file, fails=False):
        self.file, self.fails = file, fails

    def compiled(self):
        return 1.0, self.fails


def stand_in(params):
    """Compile nothing."""
    print('not shown')
    with params.file.open('a') as file:
        file.write(f'{os.getpid()}\n')
    if params.fails:
        raise ValueError('not shown')


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {0, 1})
    return tmp_path / 'seen'


def test_nodes_are_compiled_once_each_in_a_process_of_its_own(here, monkeypatch, capfd):
    monkeypatch.setattr(compiling, '_tasks', lambda flight: [(stand_in, Params(here))] * 3)
    for _ in range(2):
        assert compiling.compile_ahead(None)
        processes = here.read_text().split()
        assert len(set(processes)) == 3 and str(os.getpid()) not in processes
    assert capfd.readouterr() == ('', '')


def test_what_fails_is_left_to_the_flight_and_tried_again(here, monkeypatch, capfd):
    monkeypatch.setattr(compiling, '_tasks', lambda flight: [
        (stand_in, Params(here, fails)) for fails in (True, False)])
    for count in (2, 4):
        assert not compiling.compile_ahead(None)
        assert len(here.read_text().split()) == count
    assert capfd.readouterr() == ('', '')


def test_what_never_ends_is_killed(here, monkeypatch):
    monkeypatch.setattr(compiling, '_tasks', lambda flight: [
        (lambda params: time.sleep(600.0), Params(here))])
    monkeypatch.setattr(compiling, '_LONGEST', 0.2)
    began = time.monotonic()
    assert not compiling.compile_ahead(None)
    assert time.monotonic() - began < 30.0


def test_one_core_has_nothing_to_gain(here, monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {0})
    assert not compiling.compile_ahead(scenario())


@pytest.mark.parametrize(('choices', 'nodes'), [
    ({}, [EstimatorNode, ControllerNode, SimNode, OptitrackNode, ReferenceNode]),
    ({'estimator': 'ground_truth'}, [ControllerNode, SimNode, OptitrackNode, ReferenceNode]),
    ({'controller': str(PD)}, [EstimatorNode, SimNode, OptitrackNode, ReferenceNode]),
    ({'overrides': {'reference_node.commands.enabled': True}},
     [EstimatorNode, ControllerNode, SimNode, OptitrackNode])])
def test_all_nodes_but_those_of_the_user_are_compiled(choices, nodes):
    assert [task for task, _ in compiling._tasks(scenario(**choices))] == [
        node.compile for node in nodes]


def test_other_components_and_options_are_compiled_anew():
    flights = [scenario(), scenario(estimator='kalman'), scenario(controller='indi'),
               scenario(overrides={'sim_node.simulator.vehicle.battery.enabled': True})]
    kinds = [tuple(compiling._kind(params) for _, params in compiling._tasks(flight))
             for flight in flights]
    assert len(set(kinds)) == len(flights)
    same = scenario(overrides={'sim_node.simulator.vehicle.mass': 0.1})
    assert tuple(compiling._kind(params) for _, params in compiling._tasks(same)) == kinds[0]


def test_the_first_pose_of_a_flight_has_nothing_left_to_compile():
    """A flight in real time would lose its estimate meanwhile."""
    aided = override(scenario(), {'estimator_node.joint.pose.enabled': True}).estimator_node
    EstimatorNode.compile(aided)
    offer = estimator_node._offer.for_python
    before = list(offer.signatures)
    _, rho, q = messages.decode_pose(messages.optitrack(0, (0.0, 1.0, 2.0), LEVEL))
    values = aided.compiled()
    estimator_node._offer(hold(filters.initial(values), None, values), 0.01, rho, q)
    assert before and offer.signatures == before
