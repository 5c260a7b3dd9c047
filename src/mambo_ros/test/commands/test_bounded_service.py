"""Requests to set parameters have a bounded size and known types."""

from dataclasses import dataclass
import time

from mambo_model import schema
from mambo_ros.commands.bounded_service import LARGEST, MOST, MOST_PREFIXES, WAITING
from mambo_ros.node import MamboNode
import pytest
from rcl_interfaces.msg import Parameter as Message, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters, GetParameters, GetParameterTypes, ListParameters, SetParameters,
    SetParametersAtomically)
import rclpy
from rclpy.parameter import Parameter
from ros_helpers import PATIENCE, serving

pytestmark = pytest.mark.usefixtures('ros')


@dataclass(frozen=True)
class Params:
    """One number."""

    gain: float = schema.quantity(1.5, '1/s', 0.0, 5.0, 'equation (1)')


def answer_of(kind, name, request):
    """Ask the service of a node whose parameter is fixed."""
    node, asking = MamboNode('one', Params), rclpy.create_node('asking')
    with serving(node):
        client = asking.create_client(kind, f'/mambo/one/{name}')
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(request)
        rclpy.spin_until_future_complete(asking, future, timeout_sec=PATIENCE)
    asking.destroy_node()
    return future.result()


@pytest.mark.parametrize('kind, name', [
    (SetParameters, 'set_parameters'), (SetParametersAtomically, 'set_parameters_atomically')])
@pytest.mark.parametrize('count, refused', [(2, False), (MOST, False), (MOST + 1, True)])
def test_too_many_at_once_are_refused_unread(kind, name, count, refused):
    """Too many are refused; the rest reaches the node, whose parameter is fixed."""
    answer = answer_of(kind, name, kind.Request(parameters=[
        Parameter('gain', value=2.0).to_parameter_msg()] * count))
    results = answer.results if kind is SetParameters else [answer.result]
    assert len(results) == (min(count, MOST) if kind is SetParameters else 1)
    assert not any(one.successful for one in results)
    assert all(('in one request' in one.reason) == refused for one in results)


@pytest.mark.parametrize('kind, name', [
    (SetParameters, 'set_parameters'), (SetParametersAtomically, 'set_parameters_atomically')])
def test_a_type_that_ros_does_not_have_is_refused(kind, name):
    fixed = Parameter('gain', value=2.0).to_parameter_msg()
    answer = answer_of(kind, name, kind.Request(parameters=[
        fixed, Message(name='gain', value=ParameterValue(type=77)), fixed]))
    results = answer.results if kind is SetParameters else [answer.result]
    assert len(results) == (3 if kind is SetParameters else 1)
    assert not any(one.successful for one in results)
    assert [one.reason for one in results if 'type 77' in one.reason] == [
        'gain: type 77 is none of rcl_interfaces/ParameterType']


@pytest.mark.parametrize('value', [
    'x' * (LARGEST + 1), [1.0] * (LARGEST + 1), [1] * (LARGEST + 1), [True] * (LARGEST + 1),
    [b'x'] * (LARGEST + 1), ['x'] * (LARGEST + 1)], ids=lambda value: type(value[0]).__name__)
def test_a_large_value_is_refused_unread(value):
    answer = answer_of(SetParameters, 'set_parameters', SetParameters.Request(parameters=[
        Parameter('gain', value=2.0).to_parameter_msg(),
        Parameter('gain', value=value).to_parameter_msg()]))
    assert [one.reason for one in answer.results] == [
        f'more than {LARGEST} characters and numbers in one request'] * 2


@pytest.mark.parametrize('kind, name, field, most', [
    (GetParameters, 'get_parameters', 'values', MOST),
    (GetParameterTypes, 'get_parameter_types', 'types', MOST),
    (DescribeParameters, 'describe_parameters', 'descriptors', MOST)])
def test_few_names_are_answered_and_many_are_not_read(kind, name, field, most):
    for names, answers in ((['gain'], 1), (['gain'] * most, most), (['gain'] * (most + 1), 0),
                           (['gain' + 'x' * LARGEST], 0), ([], 0)):
        assert len(getattr(answer_of(kind, name, kind.Request(names=names)), field)) == answers


def test_a_list_of_parameters_for_few_prefixes():
    for prefixes, names in ((MOST_PREFIXES, ['gain']), (MOST_PREFIXES + 1, [])):
        request = ListParameters.Request(prefixes=['gain'] * prefixes, depth=1)
        assert answer_of(ListParameters, 'list_parameters', request).result.names == names


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
