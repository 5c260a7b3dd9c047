"""Requests to set parameters have a bounded size and known types."""

from dataclasses import dataclass
import time

from mambo_model import schema
from mambo_ros.commands.bounded_service import MOST, WAITING
from mambo_ros.node import MamboNode
import pytest
from rcl_interfaces.msg import Parameter as Message, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
import rclpy
from rclpy.parameter import Parameter
from ros_helpers import PATIENCE, serving

pytestmark = pytest.mark.usefixtures('ros')


@dataclass(frozen=True)
class Params:
    """One number."""

    gain: float = schema.quantity(1.5, '1/s', 0.0, 5.0, 'equation (1)')


@pytest.mark.parametrize('kind, name', [
    (SetParameters, 'set_parameters'), (SetParametersAtomically, 'set_parameters_atomically')])
@pytest.mark.parametrize('count, refused', [(2, False), (MOST, False), (MOST + 1, True)])
def test_too_many_at_once_are_refused_unread(kind, name, count, refused):
    """Too many are refused; the rest reaches the node, whose parameter is fixed."""
    node, asking = MamboNode('one', Params), rclpy.create_node('asking')
    with serving(node):
        client = asking.create_client(kind, f'/mambo/one/{name}')
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(kind.Request(parameters=[
            Parameter('gain', value=2.0).to_parameter_msg()] * count))
        rclpy.spin_until_future_complete(asking, future, timeout_sec=PATIENCE)
        answer = future.result()
    asking.destroy_node()
    results = answer.results if kind is SetParameters else [answer.result]
    assert len(results) == (count if kind is SetParameters else 1)
    assert not any(one.successful for one in results)
    assert all(('in one request' in one.reason) == refused for one in results)


@pytest.mark.parametrize('kind, name', [
    (SetParameters, 'set_parameters'), (SetParametersAtomically, 'set_parameters_atomically')])
def test_a_type_that_ros_does_not_have_is_refused(kind, name):
    node, asking = MamboNode('one', Params), rclpy.create_node('asking')
    fixed = Parameter('gain', value=2.0).to_parameter_msg()
    with serving(node):
        client = asking.create_client(kind, f'/mambo/one/{name}')
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(kind.Request(parameters=[
            fixed, Message(name='gain', value=ParameterValue(type=77)), fixed]))
        rclpy.spin_until_future_complete(asking, future, timeout_sec=PATIENCE)
        answer = future.result()
    asking.destroy_node()
    results = answer.results if kind is SetParameters else [answer.result]
    assert len(results) == (3 if kind is SetParameters else 1)
    assert not any(one.successful for one in results)
    assert [one.reason for one in results if 'type 77' in one.reason] == [
        'gain: type 77 is none of rcl_interfaces/ParameterType']


def test_few_requests_wait():
    """What waits takes memory: of many that nobody has read yet, the last are answered."""
    node, asking = MamboNode('one', Params), rclpy.create_node('asking')
    client = asking.create_client(SetParameters, '/mambo/one/set_parameters')
    assert client.wait_for_service(PATIENCE)
    futures = [client.call_async(SetParameters.Request()) for _ in range(5 * WAITING)]
    time.sleep(0.5)  # for all to arrive
    with serving(node):
        limit = time.monotonic() + PATIENCE
        while not futures[-1].done() and time.monotonic() < limit:
            rclpy.spin_once(asking, timeout_sec=0.05)
    asking.destroy_node()
    assert futures[-1].done()
    assert 1 <= sum(future.done() for future in futures) <= WAITING
