"""Parameters that change while a node flies: answered, taken at a step, recorded, shown."""

from array import array
from dataclasses import dataclass

from mambo_model import schema
from mambo_model.motion import parameter_change
from mambo_ros.commands import change_message, live
from mambo_ros.node import MamboNode
import pytest
from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from ros_helpers import PATIENCE, serving

pytestmark = pytest.mark.usefixtures('ros')


@dataclass(frozen=True)
class Params:
    """A gain and a bias that can change, a mass that cannot."""

    gain: float = schema.quantity(1.5, '1/s', 0.0, 5.0, 'equation (1)')
    bias: tuple = schema.quantity((0.0, 0.1), 'rad/s', -1.0, 1.0, 'measured')
    mass: float = schema.quantity(1.0, 'kg', 0.1, 5.0, 'weighed')
    changes: str = schema.text('', 'a YAML list')

    def __post_init__(self):
        schema.check(self)
        parameter_change.check(self)

    def fixed(self, name):
        return '' if name in ('gain', 'bias') else parameter_change.STARTED

    def kept(self):
        return {}

    def compiled(self):
        return (self.gain, self.bias)


class Flying(MamboNode):
    """A node whose steps are numbered."""

    def __init__(self, **given):
        super().__init__('flying', Params, parameter_overrides=[
            Parameter(name, value=value) for name, value in given.items()])
        self.held, self.renewed, self.last = {}, 0, -5
        self.allow_changes(lambda: self.last + 5)
        self.records = []
        self._changed = self.records.append

    def renew(self):
        self.renewed += 1

    def step(self, t):
        self.last = t
        if t >= self.changes.due:
            self.change(t)

    def recorded(self):
        return [one for data in self.records for one in change_message.decode(data)]


@pytest.fixture
def node(monkeypatch):
    monkeypatch.setattr(live, 'set_values', lambda held, values: held.update(values=values))
    out = Flying()
    yield out
    out.destroy_node()


def ask(node, **values):
    return node.set_parameters_atomically([
        Parameter(name, value=value) for name, value in values.items()])


def test_a_change_counts_from_the_next_step_and_is_recorded_there(node):
    node.step(0)
    answer = ask(node, gain=2, bias=array('d', [0.5, -0.5]))
    assert answer == SetParametersResult(successful=True, reason='from t = 0.000 s')
    assert node.params.gain == 1.5 and not node.held and not node.records
    node.step(5)
    assert node.params == Params(2.0, (0.5, -0.5)) and node.held == {'values': (2.0, (0.5, -0.5))}
    assert node.recorded() == [
        ('flying', parameter_change.Change(5, {'gain': 2.0, 'bias': [0.5, -0.5]}))]
    assert node.renewed == 2 and node.get_parameter('gain').value == 2.0
    node.step(10)
    assert len(node.records) == 1


def test_all_are_set_or_none(node):
    answer = ask(node, gain=2.0, mass=2.0)
    assert not answer.successful and 'mass: cannot be changed in flight' in answer.reason
    node.step(0)
    assert node.params == Params() and not node.records


def test_what_another_node_decides_is_refused_with_the_reason(node):
    node.decided = {'gain': 'it is that of the first one'}
    answer = ask(node, gain=2.0)
    assert (answer.successful, answer.reason) == (
        False, 'gain: cannot be changed in flight: it is that of the first one')
    assert ask(node, bias=array('d', [0.5, -0.5])).successful


def test_a_name_is_given_once(node):
    twice = [Parameter('gain', value=value) for value in (2.0, 3.0)]
    answer = node.set_parameters_atomically(twice)
    assert (answer.successful, answer.reason) == (False, 'gain: given twice')


def test_a_request_for_nothing_changes_and_records_nothing(node):
    assert ask(node) == SetParametersResult(successful=True, reason='nothing to set')
    node.step(0)
    assert node.params == Params() and not node.records


@pytest.mark.parametrize(('values', 'words'), [
    ({'gian': 1.0}, 'gian: unknown parameter; did you mean gain'),
    ({'gain': 9.0}, 'gain = 9.0 1/s is outside [0, 5]'), ({'gain': 'x'}, 'must be a number'),
    ({'gain': None}, 'must be a number'), ({'bias': [1.0]}, 'must be 2 numbers')])
def test_a_refusal_says_why_in_one_line(node, values, words):
    answer = ask(node, **values)
    assert not answer.successful and words in answer.reason and '\n' not in answer.reason


def test_a_request_of_thousands_does_not_keep_a_node_from_its_steps(node, monkeypatch):
    now = [7.3]
    monkeypatch.setattr(live.time, 'monotonic', lambda: now[0])
    gain = [Parameter('gain', value=2.0)]
    answers = [node.set_parameters_atomically(gain) for _ in range(5000)]
    assert [one.successful for one in answers] == [True] * 50 + [False] * 4950
    assert answers[-1].reason.startswith('more than 50 changes within a second: ')
    now[0] = 8.0
    assert node.set_parameters_atomically(gain).successful


def test_a_node_without_changes_says_so_and_ros_keeps_its_own(node):
    fixed = MamboNode('fixed', Params)
    answer = ask(fixed, gain=1.0)
    assert answer.reason == 'gain: cannot be changed in flight: it is fixed when the node starts'
    assert ask(fixed, use_sim_time=True).successful
    fixed.destroy_node()


def test_the_script_is_shown_and_one_that_no_longer_fits_is_left_out(node, monkeypatch):
    scripted = Flying(changes='- {time: 0.0, set: {gain: 3.0}}\n- {time: 1.0, set: {gain: 4.0}}')
    scripted.step(0)
    assert scripted.get_parameter('gain').value == 3.0 and len(scripted.records) == 1

    def refuse(t):
        raise schema.ParameterError('gain: no')
    monkeypatch.setattr(scripted.changes, 'take', refuse)
    scripted.step(1_000_000_000)
    assert scripted.params.gain == 3.0 and len(scripted.records) == 1
    scripted.destroy_node()


def test_the_service_answers_with_time_or_reason(monkeypatch):
    monkeypatch.setattr(live, 'set_values', lambda held, values: None)
    asker = rclpy.create_node('asker')
    client = AsyncParameterClient(asker, '/mambo/flying')
    with serving(Flying()):
        assert client.wait_for_services(PATIENCE)
        for name, value, success, words in (
                ('gain', 2, True, 'from t = 0.000 s'), ('gain', 9.0, False, 'outside [0, 5]'),
                ('mass', 2.0, False, 'cannot be changed'), ('gian', 2.0, False, 'did you mean')):
            future = client.set_parameters([Parameter(name, value=value)])
            rclpy.spin_until_future_complete(asker, future, timeout_sec=PATIENCE)
            (answer,) = future.result().results
            assert answer.successful == success and words in answer.reason
    asker.destroy_node()
