"""Parameters: given from outside, refused by name, described and served."""

from dataclasses import dataclass

from mambo_model import schema
from mambo_model.vehicle.parameters import Vehicle
from mambo_ros.node import MamboNode
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from ros_helpers import PATIENCE, serving

pytestmark = pytest.mark.usefixtures('ros')


@dataclass(frozen=True)
class Rates:
    """A nested group."""

    limit: float = schema.quantity(2.0, 'rad/s', 0.5, 10.0, 'table 7')
    bias: tuple = schema.quantity((0.0, 0.1), 'rad/s', -1.0, 1.0, 'measured')

    def __post_init__(self):
        schema.check(self)


@dataclass(frozen=True)
class Params:
    """One parameter of every kind."""

    gain: float = schema.quantity(1.5, '1/s', 0.0, 5.0, 'equation (1)')
    count: int = schema.quantity(3, '-', 1, 9, 'design choice')
    law: str = schema.choice('linear', ('linear', 'power'), 'section 2')
    noisy: bool = schema.flag(True, 'off for tests')
    label: str = schema.text('', 'free text')
    rates: Rates = schema.group(Rates)

    def __post_init__(self):
        schema.check(self)


def node(**given):
    """Return a node with parameters given as on a command line, dots written as __."""
    overrides = [Parameter(name.replace('__', '.'), value=value) for name, value in given.items()]
    return MamboNode('probe', Params, parameter_overrides=overrides)


def test_nothing_given_means_the_defaults():
    probe = node()
    assert probe.params == Params()
    assert probe.get_parameter('rates.bias').value == [0.0, 0.1]


def test_what_is_given_arrives_in_the_dataclass_and_in_ros():
    probe = node(gain=2.5, count=4, law='power', noisy=False, label='x', rates__bias=[0.5, -0.5])
    assert probe.params == Params(2.5, 4, 'power', False, 'x', Rates(bias=(0.5, -0.5)))
    assert probe.get_parameter('gain').value == 2.5
    assert probe.get_parameter('law').value == 'power'
    assert probe.get_parameter('rates.bias').value == [0.5, -0.5]


def test_a_whole_number_is_a_number():
    probe = node(gain=2, rates__bias=[1, 0])
    assert probe.params.gain == 2.0 and isinstance(probe.params.gain, float)
    assert all(isinstance(element, float) for element in probe.params.rates.bias)
    assert probe.get_parameter('gain').type_ == Parameter.Type.DOUBLE
    assert probe.get_parameter('rates.bias').type_ == Parameter.Type.DOUBLE_ARRAY


@pytest.mark.parametrize('given, complaint', [
    ({'gian': 1.0}, r'gian: unknown parameter; did you mean gain\?'),
    ({'rates__limt': 1.0}, r'rates\.limt: unknown parameter; did you mean .*rates\.limit'),
    ({'zzz': 1.0}, 'zzz: unknown parameter; known: count, gain, label'),
    ({'gain': 5.5}, r'gain = 5\.5 1/s is outside \[0, 5\]'),
    ({'gain': float('nan')}, 'gain = nan'),
    ({'gain': 'high'}, "gain = 'high' must be a number"),
    ({'gain': True}, 'gain = True must be a number'),
    ({'gain': [1.0]}, r'gain = \(1\.0,\) must be a number'),
    ({'count': 10}, r'count = 10 - is outside \[1, 9\]'),
    ({'count': 3.0}, r'count = 3\.0 must be a whole number'),
    ({'law': 'cubic'}, "law = 'cubic' is not one of linear, power"),
    ({'noisy': 1}, 'noisy = 1 must be true or false'),
    ({'label': 7}, 'label = 7 must be text'),
    ({'rates__limit': 0.1}, r'rates.*limit = 0\.1 rad/s is outside \[0\.5, 10\]'),
    ({'rates__bias': [0.1]}, r'bias = \(0\.1,\) must be 2 numbers'),
    ({'rates__bias': [0.1, 1.1]}, 'bias = .* is outside'),
    ({'rates__bias': [True, False]}, 'bias = .* must be a number'),
    ({'rates__bias': 0.1}, r'bias = 0\.1 must be 2 numbers'),
])
def test_a_wrong_parameter_is_refused_by_name(given, complaint):
    with pytest.raises(schema.ParameterError, match=complaint) as refusal:
        node(**given)
    assert '\n' not in str(refusal.value)


def test_sim_time_is_no_unknown_parameter():
    assert node(use_sim_time=True).params == Params()


def test_a_parameter_file_is_read_as_ros_reads_it(tmp_path):
    file = tmp_path / 'params.yaml'
    file.write_text(
        '/mambo/probe:\n  ros__parameters:\n    gain: 1e-1\n    rates:\n      bias: [0.5, 1.0]\n'
        '/**:\n  ros__parameters:\n    count: 7\n/other/probe:\n  ros__parameters:\n    gain: 5\n')
    rclpy.shutdown()
    rclpy.init(args=['--ros-args', '--params-file', str(file), '-p', 'label:=hall'],
               signal_handler_options=SignalHandlerOptions.NO)
    assert node().params == Params(gain=0.1, count=7, label='hall', rates=Rates(bias=(0.5, 1.0)))


def test_a_description_has_unit_range_and_source():
    probe = node()
    gain, count = probe.describe_parameter('gain'), probe.describe_parameter('count')
    assert gain.description == '[1/s] source: equation (1)'
    assert gain.additional_constraints == '[0, 5] 1/s'
    assert [(r.from_value, r.to_value) for r in gain.floating_point_range] == [(0.0, 5.0)]
    assert [(r.from_value, r.to_value) for r in count.integer_range] == [(1, 9)]
    law, noisy = probe.describe_parameter('law'), probe.describe_parameter('noisy')
    assert law.description == 'one of: linear, power; source: section 2'
    assert noisy.description == 'source: off for tests'
    bias = probe.describe_parameter('rates.bias')
    assert bias.additional_constraints == '[-1, 1] rad/s'  # ROS has no range for arrays
    assert bias.type == ParameterType.PARAMETER_DOUBLE_ARRAY


@dataclass(frozen=True)
class Believing:
    """A node that knows a vehicle."""

    vehicle: Vehicle = schema.group(Vehicle)


def test_a_parameter_says_what_it_is():
    probe = MamboNode('probe', Believing)
    assert probe.describe_parameter('vehicle.mass').description == (
        'mass of the vehicle; [kg] source: weighed, thesis sec. 4.4')
    assert probe.describe_parameter('vehicle.battery.enabled').description.startswith(
        'whether the battery drains and sags; source: ')


def test_parameters_of_the_vehicle_all_have_a_source():
    probe = MamboNode('probe', Vehicle)
    for name, _ in schema.walk(Vehicle):
        about = probe.describe_parameter(name)
        assert about.read_only
        assert 'source: ' in about.description and not about.description.endswith('source: ')


def ask(future, executor):
    executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
    assert future.done(), 'the service did not answer'
    return future.result()


def test_parameter_services_answer_while_the_loop_runs():
    asker = Node('asker')
    executor = SingleThreadedExecutor()
    executor.add_node(asker)
    client = AsyncParameterClient(asker, '/mambo/probe')
    with serving(node(gain=2)):
        assert client.wait_for_services(PATIENCE)
        names = ask(client.list_parameters([], 10), executor).result.names
        assert {name for name, _ in schema.walk(Params)} <= set(names)
        gain, bias = ask(client.get_parameters(['gain', 'rates.bias']), executor).values
        assert gain.double_value == 2.0
        assert list(bias.double_array_value) == [0.0, 0.1]
        (about,) = ask(client.describe_parameters(['gain']), executor).descriptors
        assert about.description == '[1/s] source: equation (1)'
        (answer,) = ask(client.set_parameters([Parameter('gain', value=1.0)]), executor).results
        assert not answer.successful and 'gain' in answer.reason  # fixed when the node started
        (gain,) = ask(client.get_parameters(['gain']), executor).values
        assert gain.double_value == 2.0
    executor.shutdown()
    asker.destroy_node()


NONE_SUCH = ParameterMessage(name='use_sim_time', value=ParameterValue(type=99))


@pytest.mark.parametrize('service, kind', [
    ('set_parameters', SetParameters), ('set_parameters_atomically', SetParametersAtomically)])
def test_a_request_that_rclpy_cannot_answer_does_not_end_the_node(service, kind):
    served = MamboNode('served', Params)
    asker = rclpy.create_node('asker', namespace='mambo')
    client = asker.create_client(kind, f'served/{service}')
    with serving(served) as loop:
        assert client.wait_for_service(PATIENCE)
        for _ in range(3):  # the node is there for the next one, too
            answer = client.call_async(kind.Request(parameters=[NONE_SUCH]))
            rclpy.spin_until_future_complete(asker, answer, timeout_sec=PATIENCE)
            assert answer.done()
        assert not loop.stopping
