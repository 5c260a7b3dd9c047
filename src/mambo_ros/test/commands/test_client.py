"""Commands to a flight: its answer, what is refused before anything is sent, no flight."""

import math
import time
from types import SimpleNamespace

from mambo_model.errors import InputError, JobError
from mambo_ros.commands import client, table
from mambo_ros.commands.services import Services
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor


@pytest.mark.parametrize(('name', 'arguments', 'words'), [
    ('fly', {}, 'fly: is none of takeoff, land'),
    ('takeoff', {}, 'takeoff: height is missing; it takes height'),
    ('takeoff', {'heigth': 1.0}, 'takeoff: .*heigth'),
    ('takeoff', {'height': 'x'}, "height = 'x' must be a number"),
    ('takeoff', {'height': math.nan}, 'takeoff: height = nan must be finite'),
    ('go_to', {'goal': (1, 2, -math.inf)}, 'go_to: goal = -inf must be finite'),
    ('follow', {'trajectory': 'x', 'timescale': 10**5000}, 'timescale = .* must be finite'),
    ('go_to', {'goal': (1, 2)}, 'goal = .* must be three numbers'),
    ('go_to', {'goal': 5}, 'goal = 5'), ('go_to', {'goal': '123'}, 'goal = '),
    ('go_to', {'goal': (1, 'a', 2)}, "goal = 'a' must be a"),
    ('go_to', {'goal': (0, 0, 1), 'relative': 'no'}, "relative = 'no' must be True or False"),
    ('follow', {'trajectory': 5}, 'trajectory = 5 must be the path of a course or its text'),
    ('step', {'steps': 1.5}, 'steps = 1.5 must be a whole number'),
    ('land', {'duration': -1.0}, 'duration = -1 s'), ('land', {'duration': math.nan}, 'duration'),
    ('land', {'duration': 1e12}, 'must be from 0 to 2.14748e'),
    ('step', {'steps': -1}, 'steps = -1'),
    ('set', {'parameters': {'a.b': 1, 'c.d': 2}}, 'of one node'),
    ('set', {'parameters': {'speed': 1}}, 'give NODE.PARAMETER'),
    ('set', {'parameters': {'a.b': {'c': 1}}}, 'set: ')])
def test_what_cannot_be_sent_is_refused_in_one_line(name, arguments, words):
    with pytest.raises(InputError, match=words) as error:
        client.send(name, **arguments)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('namespace', 'words'), [
    ('0', r"drone '0': namespace must not have a token that starts with a number"),
    ('/a b', 'must not contain'), ('a' * 300, 'should not exceed'), ('/a//b', 'repeated'),
    ('\udcff', 'a namespace such as /mambo'), ('a\nb', 'a namespace such as'), (7, 'such as'),
    ('a\0b', 'such as')])
def test_a_drone_that_cannot_be_is_refused_in_one_line(namespace, words):
    with pytest.raises(InputError, match=words) as error:
        client.send('stop', namespace)
    assert '\n' not in str(error.value)


def test_without_a_flight_the_wait_is_short_and_the_line_says_what_to_do(monkeypatch):
    monkeypatch.setattr(client, 'FIND', 0.2)
    monkeypatch.setattr(client.domains, 'chosen', lambda: 187)  # nobody flies there
    with pytest.raises(JobError, match=r'no flight of /mambo runs in ROS domain 187: start one '
                       r'with ./run --commanded'):
        client.send('stop')


@pytest.fixture
def ends(ros):
    """Return a node that answers commands, one that sends them, and what serves both."""
    flight = rclpy.create_node('flight', namespace='/mambo1')
    page = rclpy.create_node('page', namespace='/mambo')
    executor = SingleThreadedExecutor()
    executor.add_node(page)
    yield flight, page, executor
    executor.shutdown()


def polled(call, executor):
    """Return the answer of a call, or raise its error."""
    limit = time.monotonic() + 60.0
    while (message := call.poll(time.monotonic())) is None:
        assert time.monotonic() < limit
        executor.spin_once(0.02)
    return message


def test_a_call_finds_its_drone_and_returns_the_answer_or_the_reason(ends):
    flight, page, executor = ends
    answers = iter([(True, 'from t = 1.000 s'), (False, 'on the floor')])
    Services(flight).offer((table.LAND, lambda request: next(answers)))
    executor.add_node(flight)
    before = page.get_client_names_and_types_by_node('page', '/mambo')
    call = client.Call(page, 'land', '/mambo1')
    assert not call.sent
    assert polled(call, executor) == 'from t = 1.000 s' and call.sent
    call.close()
    call = client.Call(page, 'land', '/mambo1')
    with pytest.raises(JobError, match='on the floor'):
        polled(call, executor)
    call.close()
    assert page.get_client_names_and_types_by_node('page', '/mambo') == before


def test_a_flight_that_does_not_answer_is_given_up(ends, monkeypatch):
    flight, page, executor = ends
    Services(flight).offer((table.STOP, lambda request: (True, '')))  # nobody serves this node
    monkeypatch.setattr(client, 'ANSWER', 0.3)
    call = client.Call(page, 'stop', '/mambo1')
    with pytest.raises(JobError, match='stop: no answer within 0.3 s'):
        polled(call, executor)
    call.close()


def test_other_drones_that_fly_there_are_named():
    nodes = [('page', '/'), ('reference_node', '/mambo1'), ('reference_node', '/mambo2'),
             ('sim_node', '/mambo2')]
    call = client.Call.__new__(client.Call)
    call._namespace, call._node = '/mambo', SimpleNamespace(
        context=SimpleNamespace(get_domain_id=lambda: 5), get_name=lambda: 'page',
        get_node_names_and_namespaces=lambda: nodes)
    assert call._missing() == ('no flight of /mambo runs in ROS domain 5, but of /mambo1, /mambo2:'
                               ' choose one with --drone')


def test_a_call_without_its_service_says_what_is_there(ends, monkeypatch):
    _, page, executor = ends
    monkeypatch.setattr(client, 'FIND', 0.3)
    for drone, words in (('/mambo1', 'it takes commands if it is started with'),
                         ('/mambo2', 'no flight of /mambo2 runs in ROS domain')):
        limit = time.monotonic() + 30.0  # until the nodes know each other
        while True:
            call = client.Call(page, 'stop', drone)
            with pytest.raises(JobError) as error:
                polled(call, executor)
            call.close()
            if words in str(error.value):
                break
            assert time.monotonic() < limit, error.value
