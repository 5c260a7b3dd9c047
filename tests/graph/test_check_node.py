"""The checker of nodes: the shipped ones keep every rule, and each broken one is found."""

import json
from pathlib import Path
import re
import sys

from mambo_bringup.checking import check
import pytest

HERE = Path(__file__).parent
PD = HERE.parents[1] / 'examples/nodes/pd_controller.py'
BROKEN = str(HERE / 'broken_controller.py')
BUSY = 60.0  # s that Python alone may take to start or to end on a loaded machine
FOLLOWS = {  # rules that cannot be kept by who breaks another one
    'stamps': {'use_sim_time', 'accepted', 'ready', 'backlog', 'missing input', 'order'},
    'order': {'stamps', 'answers', 'accepted', 'use_sim_time', 'backlog', 'missing input',
              'ready'},
    'values': {'accepted'}, 'answers': {'order', 'accepted'}, 'backlog': {'answers'},
    'no timers': {'answers', 'order', 'accepted'}, 'ready': {'missing input'},
    'missing input': {'answers', 'ready'}, 'start': {'accepted'}, 'real time': {'answers'}}


def broken(findings):
    return {one.rule: one.seen for one in findings if one.verdict == 'broken'}


@pytest.mark.long
def test_the_example_keeps_every_rule_in_lockstep_and_real_time(capsys, tmp_path, monkeypatch):
    out = tmp_path / 'found.json'
    monkeypatch.setattr(check, 'LEAVE', BUSY)
    code = check.main(['controller', '--json', str(out), '--', sys.executable, str(PD)])
    text = capsys.readouterr()
    found = json.loads(out.read_text())
    verdicts = {one['rule']: one['verdict'] for one in found['rules']}
    in_time = verdicts.pop('real time') == 'kept'  # or the machine is busy
    assert set(verdicts.values()) == {'kept'} and len(verdicts) == 19, text
    assert code == (0 if in_time else 1) and found['kept'] == in_time
    assert re.search('^real time .* of 200 later than 5 ms', text.out, re.MULTILINE)
    assert [(one['mode'], one['answers'] > 190) for one in found['times']] == [
        ('lockstep', True), ('real time', True)]


@pytest.mark.parametrize(('kinds', 'said'), [
    (['stamps', 'start'], {
        'stamps': 'are not those of its inputs, the first is .* the wall clock',
        'start': 'messages before the flight begins, wanted none'}),
    pytest.param(['values', 'answers', 'one publisher', 'ready', 'real time', 'SIGINT'], {
        'values': 'pwm = .*nan.*, wanted finite', 'answers': 'have several',
        'one publisher': '/mambo/other, wanted one|/mambo/my_controller, wanted one',
        'ready': 'before /mambo/reference of it was published',
        'real time': 'later than 5 ms; ', 'SIGINT': 'still there after 1 s'},
        marks=pytest.mark.long),
    pytest.param(['order', 'backlog'], {
        'order': 'stamps are not after', 'backlog': 'steps at once have no answer'},
        marks=pytest.mark.long),
    # without a backlog, whose losses leave this controller with more than one input missing
    pytest.param(['no timers', 'missing input'], {
        'no timers': 'in which time stood still, wanted none',
        'missing input': 'of the next 20 steps have no answer'}, marks=pytest.mark.long),
    pytest.param(['qos', 'subscribes'], {
        'qos': 'offers reliability best_effort', 'subscribes': '/mambo/reference is not subscr',
        'answers': '40 of 40 steps have none'}, marks=pytest.mark.long),
    (['type'], {'type': 'std_msgs/msg/String, wanted mambo_interfaces/msg/MotorPwm'}),
    (['publishes'], {'publishes': 'nobody publishes /mambo/motor_pwm; /mambo/pwm has its type'}),
], ids=lambda one: '-'.join(one) if isinstance(one, list) else '')
def test_a_broken_rule_is_named(kinds, said, monkeypatch):
    monkeypatch.setattr(check, 'LEAVE', 1.0 if 'SIGINT' in kinds else BUSY)
    findings, _ = check.check(
        ['controller'], [sys.executable, BROKEN, *kinds], patience=0.5,
        wait=20.0 if 'qos' in kinds else BUSY)  # these links are never complete
    found = broken(findings)
    for rule, text in said.items():
        assert rule in found, findings
        assert re.search(text, found[rule]), found[rule]
    follow = set().union(*(FOLLOWS.get(kind, set()) for kind in kinds))
    assert not set(found) - {'real time', *said} - follow, found


def test_what_cannot_be_checked_is_one_line(capsys):
    for words, code, text in (
            (['pilot'], 2, 'pilot'), (['controller', '--wait', '0'], 2, '--wait: 0 must be'),
            (['controller', '--', '/no/such/node'], 2, '/no/such/node: No such file'),
            (['controller', '--', sys.executable, '-c', 'raise SystemExit("bad luck")'], 1,
             'ended with exit code 1 before the check was over: bad luck')):
        try:
            found = check.main(words)
        except SystemExit as end:
            found = end.code
        error = capsys.readouterr().err
        assert found == code and error.count('\n') == 1 and text in error, error
