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
    end(children)


def end(children):
    """End the scripts that were started, or the next flight would hear two."""
    for child in children:
        child.kill()
        child.wait()


def fly(bag, *arguments):
    return run.main([
        '--without', 'controller', '--duration', '9', '--trajectory', 'hover', '--no-report',
        '--output', str(bag), *arguments])


def check_flight(path, out):
    """Check a flight of the example and what was printed; return its bag."""
    assert re.search(r'export ROS_DOMAIN_ID=\d+', out.out)
    bag = read_bag(path)
    height = bag['ground_truth/odom'].position[:, 2]
    assert 1.4 < height[-1] < 1.6 and height.max() < 1.7
    np.testing.assert_array_equal(bag['motor_pwm'].stamp % 5_000_000, 0)
    return bag


@pytest.mark.long
def test_a_controller_of_yours_flies_in_real_time(tmp_path, started_when_invited, capsys):
    children = started_when_invited(PD)
    for speed in (1.0, 0.5, 0.25, 0.1):
        bag = tmp_path / str(speed)
        code = fly(bag, '--mode', 'realtime', '--set', f'sim_node.speed={speed}')
        out = capsys.readouterr()
        end(children)
        late = re.search(r'(\d+) steps without their motor command', out.out)
        if int(late[1]) < 100:  # of 1801; else the machine is too busy for this speed: slower
            break
    assert code == 0, out
    check_flight(bag, out)


@pytest.mark.long
def test_a_controller_of_yours_flies_in_lockstep_twice_the_same(
        tmp_path, started_when_invited, capsys):
    children, files = started_when_invited(PD), []
    for name in 'ab':
        code = fly(tmp_path / name)
        out = capsys.readouterr()
        assert code == 0, out
        bag = check_flight(tmp_path / name, out)
        assert len(bag['motor_pwm']) == len(bag['ground_truth/odom'])
        files.append(next((tmp_path / name).glob('*.mcap')).read_bytes())
        end(children)
    assert files[0] == files[1]


@pytest.mark.long
def test_a_controller_that_never_comes_is_named(tmp_path, capsys):
    code = fly(tmp_path / 'bag', '--set', 'sim_node.start_patience=10.0')  # the others need 3 s
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith('run: ')]
    assert code == 1 and len(lines) == 1
    assert 'without a publisher of /mambo/motor_pwm' in lines[0]


def test_without_needs_separate_processes(tmp_path, capsys):
    assert fly(tmp_path / 'bag', '--composed') == 2
    assert '--without and --composed' in capsys.readouterr().err
