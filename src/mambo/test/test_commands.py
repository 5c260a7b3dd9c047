"""Commands from a script: what is sent, what is raised, and a recorded flight flown again."""

from pathlib import Path

import mambo
from mambo_flight import commanded
from mambo_ros.commands import client
import pytest


def test_a_command_is_sent_with_its_arguments(monkeypatch, tmp_path):
    sent = []
    monkeypatch.setattr(client, 'send', lambda *args, **more: sent.append((args, more)) or 'sent')
    assert mambo.command('takeoff', height=1.0) == 'sent'
    mambo.command('stop', drone='/mambo2')
    course = tmp_path / 'course.csv'
    course.write_text('t,x,y,height\n0,0,0,1\n2,0.5,0,1\n')
    mambo.command('follow', trajectory=course)
    assert sent[:2] == [(('takeoff', '/mambo'), {'height': 1.0}), (('stop', '/mambo2'), {})]
    assert sent[2][1]['trajectory'].startswith('duration,')


def test_what_cannot_be_sent_is_one_line():
    with pytest.raises(mambo.InputError, match='dance: is none of takeoff'):
        mambo.command('dance')


def test_another_bag_is_refused(tmp_path):
    with pytest.raises(mambo.InputError):
        mambo.recorded_commands(tmp_path / 'none')


def test_an_open_bag_is_as_good_as_its_path():
    path, said = Path(__file__).parents[3] / 'bags/circle_short', []
    for bag in (path, mambo.open_bag(path)):
        with pytest.raises(mambo.InputError, match='circle_short') as error:
            mambo.recorded_commands(bag)
        said.append(str(error.value))
    assert said[0] == said[1]


def test_commands_of_a_drone_of_a_hall_come_with_a_warning(monkeypatch, tmp_path):
    monkeypatch.setattr(commanded, 'scenario_of', lambda bag: 'its scenario')
    monkeypatch.setattr(commanded, 'alone', lambda bag: iter(['the others are absent']))
    with pytest.warns(UserWarning, match='the others are absent'):
        assert mambo.recorded_commands(tmp_path) == 'its scenario'
