"""A node that had to be killed names the user's compiled step, and no other."""

from mambo_bringup import stuck
from mambo_flight.scenario import Scenario
from mambo_model.components import Component
import pytest


@pytest.fixture
def component(monkeypatch, tmp_path):
    """Return a function that has the controller node fly a component."""
    def choose(compiled):
        path = tmp_path / 'mine.py'
        found = Component('mine', object, len, len, compiled, path=path)
        monkeypatch.setattr(stuck, 'own_components', lambda params: (
            [found] if params == Scenario().controller_node else []))
        return path
    return choose


def test_a_killed_node_names_its_compiled_step(component):
    path = component(True)
    assert stuck.stuck(Scenario(), ['controller_node', 'estimator_node', 'recorder_node']) == (
        f'controller_node had to be killed: the compiled step of {path} may never end')


@pytest.mark.parametrize('killed', [[], ['estimator_node'], ['recorder_node'], ['sim_node']])
def test_other_nodes_say_nothing(component, killed):
    component(True)
    assert not stuck.stuck(Scenario(), killed)


def test_plain_python_can_be_interrupted(component):
    component(False)
    assert not stuck.stuck(Scenario(), ['controller_node'])
