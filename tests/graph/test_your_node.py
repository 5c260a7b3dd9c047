"""A flight in which one node is somebody else's."""

import os
from pathlib import Path
import re
import subprocess
import sys

from mambo_bags.reader import read_bag
from mambo_bringup import run
from mambo_bringup.flight import runner
import numpy as np
import pytest

PD = Path(__file__).parents[2] / 'examples/nodes/pd_controller.py'


@pytest.fixture
def started_when_invited(monkeypatch):
    """Start a script when the runner says in which domain it waits; return the list of it."""
    children = []

    def invite(script):
        invitation = runner._invitation

        def start(without, namespaces, domain):
            children.append(subprocess.Popen(
                [sys.executable, script], env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
                stderr=subprocess.PIPE, text=True))
            return invitation(without, namespaces, domain)
        monkeypatch.setattr(runner, '_invitation', start)
        return children
    yield invite
    for child in children:
        child.kill()
        child.wait()


def fly(bag, *arguments):
    return run.main([
        '--without', 'controller', '--duration', '12', '--trajectory', 'hover', '--no-report',
        '--output', str(bag), *arguments])


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_a_controller_of_yours_flies(tmp_path, started_when_invited, capsys, mode):
    started_when_invited(PD)
    code = fly(tmp_path / 'bag', '--mode', mode)
    out = capsys.readouterr()
    assert code == 0, out
    assert re.search(r'export ROS_DOMAIN_ID=\d+', out.out)
    bag = read_bag(tmp_path / 'bag')
    height = bag['ground_truth/odom'].position[:, 2]
    assert 1.4 < height[-1] < 1.6 and height.max() < 1.7
    if mode == 'lockstep':
        assert len(bag['motor_pwm']) == len(bag['ground_truth/odom'])
    np.testing.assert_array_equal(bag['motor_pwm'].stamp % 5_000_000, 0)


def test_two_flights_with_a_controller_of_yours_are_equal(
        tmp_path, started_when_invited, capsys):
    children, bags = started_when_invited(PD), []
    for name in 'ab':
        assert fly(tmp_path / name) == 0, capsys.readouterr()
        bags.append(next((tmp_path / name).glob('*.mcap')).read_bytes())
        for child in children:  # or the next flight would hear two
            child.kill()
            child.wait()
    assert bags[0] == bags[1]


def test_a_controller_that_never_comes_is_named(tmp_path, capsys):
    code = fly(tmp_path / 'bag', '--set', 'sim_node.start_patience=10.0')  # the others need 3 s
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith('run: ')]
    assert code == 1 and len(lines) == 1
    assert 'without a publisher of /mambo/motor_pwm' in lines[0]


def test_without_needs_separate_processes(tmp_path, capsys):
    assert fly(tmp_path / 'bag', '--composed') == 2
    assert '--without and --composed' in capsys.readouterr().err
