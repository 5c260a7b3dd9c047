"""The commands to a running flight, as they are typed: what is sent, what is printed."""

from importlib import import_module

from mambo_bringup import mambo
from mambo_bringup.commanding import sending
from mambo_model.errors import JobError
import pytest

MODULES = {name: entry.module for name, entry in mambo.GROUPS['Command a running flight'].items()}


@pytest.fixture
def sent(monkeypatch):
    """Return what would be sent."""
    out = []

    def record(name, drone, **arguments):
        out.append((name, drone, arguments))
        return 'from t = 1.000 s'
    monkeypatch.setattr(sending, 'send', record)
    return out


def typed(line):
    name, *words = line.split()
    return import_module(MODULES[name]).main(words)


@pytest.mark.parametrize(('line', 'name', 'arguments'), [
    ('takeoff', 'takeoff', {'height': 1.0, 'duration': 0.0}),
    ('takeoff --height 0.8 --duration 3', 'takeoff', {'height': 0.8, 'duration': 3.0}),
    ('land', 'land', {'height': 0.0, 'duration': 0.0}),
    ('go-to 1 -0.5 1.2 --yaw -0.3', 'go_to', {
        'goal': (1.0, -0.5, 1.2), 'yaw': -0.3, 'relative': False, 'duration': 0.0}),
    ('stop', 'stop', {}), ('pause', 'pause', {}), ('resume', 'resume', {}),
    ('set sim_node.speed=2 sim_node.changes=[1,2]', 'set', {
        'parameters': {'sim_node.speed': 2, 'sim_node.changes': [1, 2]}}),
    ('step', 'step', {'steps': 1}), ('step 20', 'step', {'steps': 20})])
def test_a_line_sends_one_command_and_prints_the_answer(sent, capsys, line, name, arguments):
    assert typed(f'{line} --drone /mambo2') == 0
    assert sent == [(name, '/mambo2', arguments)]
    assert capsys.readouterr().out == f'{name}: from t = 1.000 s\n'


def test_a_course_is_sent_as_polynomials(monkeypatch, tmp_path):
    from mambo_ros.commands import client
    seen = []
    monkeypatch.setattr(client, 'send', lambda *args, **more: seen.append((args, more)) or 'sent')
    path = tmp_path / 'course.csv'
    path.write_text('t,x,y,height\n0,0,0,1\n2,0.5,0,1\n')
    assert typed(f'follow {path} --relative --timescale 2') == 0
    (args, more), = seen
    assert args == ('follow', '/mambo') and more.pop('trajectory').startswith('duration,x^0')
    assert more == {'timescale': 2.0, 'relative': True, 'duration': 0.0}


@pytest.mark.parametrize('line', [
    'takeoff --height -1', 'takeoff --height x', 'go-to 1 2', 'step 0', 'stop now',
    'land --duration 1e9', 'set', 'set sim_node.speed', 'set =3', 'set a.b=[1',
    'set a.b=1 a.c=2 a.b=1'])
def test_what_is_typed_wrong_is_one_line(sent, capsys, line):
    with pytest.raises(SystemExit) as end:
        typed(line)
    assert end.value.code == 2 and not sent
    assert capsys.readouterr().err.count('\n') == 1


def test_a_refusal_is_one_line_and_exit_code_1(monkeypatch, capsys):
    def refuse(*_, **__):
        raise JobError('the vehicle is on the floor: take off first')
    monkeypatch.setattr(sending, 'send', refuse)
    assert typed('land') == 1
    assert 'land: the vehicle is on the floor: take off first\n' in capsys.readouterr().err
