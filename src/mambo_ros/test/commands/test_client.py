"""Requests to a flight: what they hold, what is refused before anything is sent, no flight."""

import math

from mambo_model.errors import InputError, JobError
from mambo_ros.commands import client, table
import pytest


def test_every_service_has_its_command():
    served = {one for one in vars(table).values() if isinstance(one, table.Service)}
    assert {kind.service for kind in client.COMMANDS.values()} == served


def test_arguments_become_the_fields_of_the_request():
    made = client.COMMANDS['go_to'].request((1, -2, 3), yaw=0.5, relative=True, duration=2.25)
    assert (made.goal.x, made.goal.y, made.goal.z, made.yaw) == (1.0, -2.0, 3.0, 0.5)
    assert made.relative and (made.duration.sec, made.duration.nanosec) == (2, 250_000_000)
    assert client.COMMANDS['takeoff'].request(height=1).height == 1.0
    assert client.COMMANDS['land'].request().duration.sec == 0
    made = client.COMMANDS['follow'].request('text', timescale=2)
    assert (made.trajectory, made.timescale, made.relative) == ('text', 2.0, False)
    assert client.COMMANDS['pause'].request().data and not client.COMMANDS['resume'].request().data
    assert client.COMMANDS['step'].request(5).steps == 5


@pytest.mark.parametrize(('name', 'arguments', 'words'), [
    ('fly', {}, 'fly: is none of takeoff, land'),
    ('takeoff', {}, "takeoff: .*'height'"), ('takeoff', {'heigth': 1.0}, 'takeoff: .*heigth'),
    ('takeoff', {'height': 'x'}, 'takeoff: '), ('go_to', {'goal': (1, 2)}, 'go_to: '),
    ('land', {'duration': -1.0}, 'duration = -1 s'), ('land', {'duration': math.nan}, 'duration'),
    ('land', {'duration': 1e12}, 'duration'), ('step', {'steps': -1}, 'steps = -1'),
    ('set', {'parameters': {'a.b': 1, 'c.d': 2}}, 'of one node'),
    ('set', {'parameters': {'speed': 1}}, 'give NODE.PARAMETER'),
    ('set', {'parameters': {'a.b': {'c': 1}}}, 'set: ')])
def test_what_cannot_be_sent_is_refused_in_one_line(name, arguments, words):
    with pytest.raises(InputError, match=words) as error:
        client.send(name, **arguments)
    assert '\n' not in str(error.value)


def test_without_a_flight_the_wait_is_short_and_the_line_says_what_to_do(monkeypatch):
    monkeypatch.setattr(client, 'FIND', 0.2)
    monkeypatch.setattr(client.domains, 'chosen', lambda: 187)  # nobody flies there
    with pytest.raises(JobError, match=r'no flight of /mambo runs in ROS domain 187: start one '
                       r'with ./run --commanded'):
        client.send('stop')
