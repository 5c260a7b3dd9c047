"""The only controller of a flight publishes garbage: the flight ends in time, with one line."""

import os
from pathlib import Path
import re
import sys
import time

from ament_index_python.packages import get_package_prefix
from mambo_bags.reader import read_bag
from mambo_bringup import processes, run
from mambo_bringup.flight.nodes import COMPOSED, FLIGHT_NODES
import pytest

PATIENCE = 2.0  # s
BUSY = 600.0  # s that compiling, the start and the end may take on a loaded machine
GARBAGE = Path(__file__).with_name('garbage_controller.py')


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Have the runner start the garbage controller in place of ours."""
    monkeypatch.setattr(run, 'load', lambda modules: None)
    monkeypatch.setattr(processes, '_LOADED', set())  # a copy of this process would be ours
    replaced = {COMPOSED, ('mambo_control', 'controller_node')}
    for package, name in {*FLIGHT_NODES, COMPOSED}:
        if package in {package for package, _ in replaced}:
            script = tmp_path / 'prefix' / 'lib' / package / name
            script.parent.mkdir(parents=True, exist_ok=True)
            if (package, name) in replaced:
                script.write_text(f'#!{sys.executable}\n{GARBAGE.read_text()}')
                script.chmod(0o755)
            else:
                script.symlink_to(Path(get_package_prefix(package)) / 'lib' / package / name)
            marker = tmp_path / 'prefix/share/ament_index/resource_index/packages' / package
            marker.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()
    monkeypatch.setenv(
        'AMENT_PREFIX_PATH', f"{tmp_path / 'prefix'}{os.pathsep}{os.environ['AMENT_PREFIX_PATH']}")


CASES = [
    (kind, how, mode) for kind, how, mode in [
        ('future', 'separate', 'lockstep'), ('nan', 'separate', 'realtime'),
        ('short', 'composed', 'realtime'), ('noise', 'composed', 'lockstep'),
        ('future-late', 'composed', 'realtime'), ('nan-late', 'composed', 'lockstep'),
        ('infinite', 'composed', 'realtime'), ('huge-late', 'composed', 'realtime'),
        ('old-late', 'composed', 'lockstep'), ('negative-late', 'separate', 'realtime')]]

REPORTED = ('short', 'huge-late')  # messages that are not their type, in the page too


@pytest.mark.long
@pytest.mark.parametrize('kind, how, mode', CASES)
def test_a_flight_whose_only_controller_publishes_garbage_ends(
        tmp_path, prefix, monkeypatch, capsys, kind, how, mode):
    monkeypatch.setenv('MAMBO_GARBAGE', kind)
    bag, began = tmp_path / 'bag', time.monotonic()
    code = run.main([
        '--mode', mode, '--duration', '20', '--no-landing', '--output', str(bag),
        '--set', f'sim_node.patience={PATIENCE}',
        *([] if kind in REPORTED else ['--no-report']),
        '--composed' if how == 'composed' else '--processes'])
    took = time.monotonic() - began
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if line.startswith('run: ')]
    assert code == 1 and took < BUSY, (out, err)
    assert len(lines) == 1 and 'no motor_pwm' in lines[0], (out, err)
    assert 'Traceback' not in out + err
    # 400 steps of 2 s of patience; by the wall clock some more or less
    noted = re.search(r'note: (39[89]|40[012]) of ', out) is not None
    assert noted == (bag / 'index.html').exists() == (kind in REPORTED)
    recorded = read_bag(bag)
    assert 'state: recording' not in (bag / 'metadata.yaml').read_text()
    truth = recorded['ground_truth/odom']
    if not kind.endswith('-late'):
        assert abs(truth['pose.pose.position.z']).max() < 0.01
    (stopped,) = {
        status.message for report in recorded['/diagnostics'].objects()
        for status in report.status if status.name == 'sim_node' and status.level == 2}
    assert stopped.startswith('motors stopped at t = ')


@pytest.mark.long
def test_a_node_that_fails_at_the_start_is_named_and_not_the_empty_bag(
        tmp_path, prefix, monkeypatch, capsys):
    monkeypatch.setenv('MAMBO_GARBAGE', 'unknown')  # its constructor raises
    code = run.main([
        '--processes', '--duration', '5', '--no-report', '--output', str(tmp_path / 'bag')])
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith('run: ')]
    assert code == 1 and len(lines) == 1 and 'controller_node' in lines[0]
    assert 'no messages' not in lines[0]
