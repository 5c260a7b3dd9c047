"""
A signal to any process of ``./run``, in any mode, at any time: over soon, said, nothing left.

A seeded sample; ``MAMBO_PROCESS_FAULTS=60`` tries so many instead.
"""

from itertools import product
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from mambo_bags.reader import read_bag
from mambo_bags.recover import recover
import pytest

SIGNALS = ('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGKILL', 'SIGSTOP')
NODES = ('recorder_node', 'optitrack_node', 'estimator_node', 'reference_node', 'controller_node',
         'sim_node')
HOW = {'lockstep': [], 'realtime': ['--mode', 'realtime'],
       'composed': ['--composed', '--mode', 'realtime'], 'drones': ['--drones', '2']}
PHASES = ('start', 'flight', 'end', 'report')
WITHIN = 15.0  # s
BUSY = 240.0  # s that a loaded machine may take to get as far
FLOWN = 250_000  # bytes of a bag with more in it than schemas and scenario


def cases():
    """Yield every signal, target, mode and phase there is."""
    for number, how, phase in product(SIGNALS, HOW, PHASES):
        nodes = ('composed_node',) if how == 'composed' else NODES
        for target in ('runner', *(nodes if phase != 'report' else ())):
            if (number, target, phase) != ('SIGSTOP', 'runner', 'report'):  # nothing else runs
                yield number, target, how, phase


COUNT = int(os.environ.get('MAMBO_PROCESS_FAULTS', '8'))
CHOSEN = list(dict.fromkeys([
    ('SIGINT', 'composed_node', 'composed', 'start'),  # once a success
    *random.Random(5).sample(sorted(cases()), COUNT)]))


def processes(text):
    """Return {number: name} of the processes whose command line contains a text."""
    found = {}
    for entry in Path('/proc').iterdir():
        try:
            if entry.name.isdigit() and text in (entry / 'cmdline').read_text():
                state = (entry / 'stat').read_text().rpartition(')')[2].split()[0]
                if state != 'Z':
                    found[int(entry.name)] = (entry / 'comm').read_text().strip()
        except OSError:
            pass
    return found


def nodes(run, bag):
    return {pid: name for pid, name in processes(str(bag)).items() if pid != run.pid}


def reached(phase, run, bag, target):
    """Return whether a flight has come to a phase, and its target is there."""
    there = nodes(run, bag).values()
    files = list(bag.rglob('*.mcap'))
    begun = bool(files) and all(file.stat().st_size > FLOWN for file in files)
    if phase == 'start':
        return bool(there) if target == 'runner' else target in there
    if phase == 'flight':
        return begun and len(there) > 0
    over = begun and not {'sim_node', 'composed_node'} & set(there)
    return over and (phase == 'end' or not there)


def wait(condition, seconds):
    limit = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > limit:
            return False
        time.sleep(0.01)
    return True


@pytest.mark.parametrize('number, target, how, phase', CHOSEN)
def test_a_signal_ends_the_flight_and_leaves_nothing(tmp_path, number, target, how, phase):
    bag, temporary = tmp_path / 'bag', tmp_path / 'tmp'
    temporary.mkdir()
    short = phase in ('end', 'report')
    run = subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.flight', '--no-landing', '--output', str(bag),
         '--duration', '4' if short else '200',
         *(['--no-report'] if phase != 'report' else []), *HOW[how]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, 'TMPDIR': str(temporary)})  # where no lock of another flight is seen
    try:
        assert wait(lambda: reached(phase, run, bag, target) or run.poll() is not None, BUSY)
        struck = [pid for pid, name in nodes(run, bag).items() if name == target]
        pids = [run.pid] if target == 'runner' else struck[:1]
        if run.poll() is not None or not pids:
            assert run.wait(BUSY) == 0, run.communicate()
            pytest.skip('it was over before')
        os.kill(pids[0], getattr(signal, number))
        began = time.monotonic()
        out, err = run.communicate(timeout=BUSY)
        assert wait(lambda: not processes(str(bag)), WITHIN)
        took = time.monotonic() - began
    finally:
        run.kill()
    assert took < WITHIN
    lines = err.strip().splitlines()
    assert 'Traceback' not in err
    whole = phase in ('end', 'report') and target != 'runner'  # all was flown
    if (number, target) == ('SIGKILL', 'runner'):
        assert run.returncode == -signal.SIGKILL
    elif not (whole and run.returncode == 0):
        assert run.returncode > 0, (out, err)
        assert lines and lines[-1].startswith('run: '), err
    assert wait(lambda: not [path for path in temporary.iterdir() if path.is_dir()], WITHIN)
    for file in bag.rglob('*.mcap') if phase != 'start' else ():
        path = file.parent
        if 'state: recording' in (path / 'metadata.yaml').read_text():  # not closed
            path = tmp_path / f'recovered_{path.name}'
            recover(file.parent, path)
        assert any('imu/data_raw' in name for name in read_bag(path).topics)
