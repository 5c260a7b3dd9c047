"""Nodes as children: started, watched, ended in order, never left behind."""

import fcntl
import mmap
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time

from mambo_bringup import processes, watchdog
from mambo_bringup.node_group import NodeGroup
from mambo_bringup.processes import executable, FlightError, Interrupts, NodeProcess, watch
import pytest

PATIENCE = 60.0  # s; what is waited for takes a fraction of a second on an idle machine
COOPERATIVE = """
import signal, sys, time
def leave(*_):
    print('asked to leave', flush=True)
    sys.exit(0)
signal.signal(signal.SIGINT, leave)
print('up', *sys.argv[1:], flush=True)
while True:
    time.sleep(0.01)
"""
HANGING = COOPERATIVE.replace('sys.exit(0)', 'pass').replace(
    'signal.signal(', 'signal.signal(signal.SIGTERM, leave); signal.signal(')


def until(condition, what):
    limit = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < limit, f'waited {PATIENCE:g} s for {what}'
        time.sleep(0.01)


def script(path, text):
    path.write_text(f'#!/usr/bin/env python3\n{text}')
    path.chmod(0o755)
    return path


def alive(pid):
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except OSError:
        return False


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Return what starts a program as if it were an installed node."""
    monkeypatch.setattr(processes, 'executable', lambda package, name: tmp_path / name)
    started = []

    def begin(text, *arguments, name='node', on_line=None):
        script(tmp_path / name, text)
        started.append(NodeProcess('some_package', name, list(arguments), on_line))
        return started[-1]
    yield begin
    for process in started:
        process.end(0.0)


@pytest.mark.parametrize('package, name', [
    ('mambo_nowhere', 'sim_node'), ('mambo_sim', 'no_such_node')])
def test_what_is_not_installed_is_named_in_one_line(package, name):
    with pytest.raises(FlightError) as refusal:
        executable(package, name)
    assert str(refusal.value) == (
        f'{package} {name} is not installed: run colcon build, then source env.bash')


def test_an_installed_node_is_found(tmp_path, monkeypatch):
    (tmp_path / 'share/ament_index/resource_index/packages').mkdir(parents=True)
    (tmp_path / 'share/ament_index/resource_index/packages/here').write_text('')
    (tmp_path / 'lib/here').mkdir(parents=True)
    wanted = script(tmp_path / 'lib/here/node', '')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert executable('here', 'node') == wanted
    with pytest.raises(FlightError, match='here other is not installed'):
        executable('here', 'other')


def test_a_node_ends_when_interrupted(start):
    heard = []
    process = start(COOPERATIVE, '--flag', 'x', on_line=heard.append)
    assert process.exit_code is None
    until(lambda: heard == ['up --flag x'], 'the first line')
    assert process.end(PATIENCE) == 0
    assert list(process.lines) == heard == ['up --flag x', 'asked to leave']
    assert process.exit_code == 0


def test_a_line_without_an_end_is_taken_in_parts_of_bounded_length(start):
    process = start('print("x" * 3_000_000, end="")')
    assert process.wait(PATIENCE) == 0
    assert {len(line) for line in process.lines} <= {processes._LINE, 3_000_000 % processes._LINE}
    assert sum(map(len, process.lines)) == 3_000_000


def test_a_node_that_does_not_listen_is_killed(start):
    process = start(HANGING)
    until(lambda: process.lines, 'the first line')
    began = time.monotonic()
    assert process.end(0.3) == -signal.SIGKILL
    assert time.monotonic() - began < PATIENCE
    assert not alive(process._process.pid)


def test_to_end_what_has_ended_keeps_its_exit_code(start):
    process = start('raise SystemExit(3)')
    assert process.wait(PATIENCE) == 3
    process.interrupt()
    assert process.end(0.0) == 3


@pytest.mark.parametrize(('text', 'shell', 'code'), [
    (COOPERATIVE, '{node}; true', 0),  # the shell waits for it
    (HANGING, '{node} & wait', -signal.SIGKILL),  # the shell ends when asked, the node does not
    (HANGING, '{node} & exit 3', 3)])  # the shell does not wait
def test_all_that_a_command_of_the_user_has_started_is_ended(tmp_path, text, shell, code):
    node = script(tmp_path / 'node', text)
    process = NodeProcess('', 'bash', [], command=['bash', '-c', shell.format(node=node)])
    try:
        until(lambda: 'up' in process.lines, 'the node')
        left = processes.session(process.pid)
        assert process.exit_code is None and process.wait(0.05) is None
        found = process.end(0.5)
    finally:
        for one in processes.session(process.pid):
            os.kill(one, signal.SIGKILL)
    assert found in (code, 130, -signal.SIGINT) and 'asked to leave' in process.lines
    assert left and not any(map(alive, left))


def test_waiting_can_be_in_vain(start):
    process = start(COOPERATIVE)
    assert process.wait(0.05) is None


def test_an_interrupt_of_the_terminal_does_not_reach_the_nodes(start):
    process = start(COOPERATIVE)
    until(lambda: process.lines, 'the first line')
    assert os.getpgid(process._process.pid) != os.getpgid(0)


@pytest.mark.parametrize('lines, printed', [
    ([], 'no output'),
    (['all is well', ''], 'all is well'),
    (['[ERROR] [1.0] [sim]: no motor_pwm', '[INFO] [2.0] [sim]: flew 3 s'],
     'sim: no motor_pwm'),  # the node that said it, without time and severity
    (['Traceback (most recent call last):', '  File "x.py", line 1', '    raise ValueError("a")',
      'ValueError: a'], 'ValueError: a'),
    (['ValueError: a', '', 'During handling of the above exception, another occurred:',
      'KeyError: b'], 'KeyError: b'),
    (['SimNode: vehicle: Vehicle.mass = -1.0 kg is outside [0.01, 1]'],
     'SimNode: vehicle: Vehicle.mass = -1.0 kg is outside [0.01, 1]'),
    (['ValueError: a', '\x1b[31;1m[READER\x1b[31;1m Error] \x1b[37mno reader\x1b[m'],
     'ValueError: a'),  # not what the middleware prints, if there is anything else
    (['\x1b[31;1m[READER\x1b[31;1m sim_node: [Errno 24] Too many open files',
      'Error] \x1b[37mno reader\x1b[m'], 'sim_node: [Errno 24] Too many open files'),
    (['\x1b[31;1mError] \x1b[37mno reader\x1b[m'], '\x1b[31;1mError] \x1b[37mno reader\x1b[m'),
])
def test_the_last_error_is_the_most_informative_line(start, lines, printed):
    process = start(f'for line in {lines!r}:\n    print(line)')
    process.wait(PATIENCE)
    assert process.last_error() == printed


@pytest.mark.parametrize('number, why', [('SIGABRT', '; few threads'), ('SIGKILL', '')])
def test_a_library_that_gives_up_may_lack_what_is_limited(start, number, why, monkeypatch):
    monkeypatch.setattr(processes, 'low_limits', lambda: '; few threads')
    process = start(f'import os, signal\nos.kill(os.getpid(), signal.{number})')
    process.wait(PATIENCE)
    assert process.trouble() == f'{process.label} was ended by {number}{why}'


def test_a_node_in_a_hurry_goes_before_others(start):
    process = start(COOPERATIVE)
    try:
        os.sched_setscheduler(process._process.pid, os.SCHED_RR, os.sched_param(1))
        os.sched_setscheduler(process._process.pid, os.SCHED_OTHER, os.sched_param(0))
    except PermissionError:
        pytest.skip('this user may not ask for it')
    process.raise_priority()
    assert os.sched_getscheduler(process._process.pid) == os.SCHED_RR
    process.end(PATIENCE)
    process.raise_priority()  # too late, and no harm


def test_a_folder_for_files_of_the_moment_that_no_node_can_name_is_named(tmp_path, monkeypatch):
    folder = tmp_path / 't\udcfc'
    folder.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(folder))
    with pytest.raises(processes.FlightInputError) as error, NodeGroup('recorder'):
        pass
    assert str(error.value) == (rf'{tmp_path}/t\xfc is not UTF-8, and no node can open it: set '
                                'TMPDIR to another folder')
    assert not list(folder.iterdir())


def test_bytes_that_are_no_text_do_not_stop_the_reading(start):
    process = start('import os\nos.write(1, b"\\xff\\nError: seen\\n")')
    process.wait(PATIENCE)
    assert process.last_error() == 'Error: seen'


def test_only_the_last_lines_are_kept(start):
    process = start('for i in range(1000):\n    print(i)')
    process.wait(PATIENCE)
    assert list(process.lines) == [str(i) for i in range(800, 1000)]


def test_the_flight_is_over_when_the_owner_of_time_has_ended(start):
    other = start(COOPERATIVE, name='other')
    owner = start('pass', name='owner')
    watch([other, owner], Interrupts())
    assert owner.exit_code == 0 and other.exit_code is None


def test_the_flight_is_over_when_another_node_dies(start):
    other = start('raise SystemExit(1)', name='other')
    owner = start(COOPERATIVE, name='owner')
    watch([other, owner], Interrupts())
    assert other.exit_code == 1 and owner.exit_code is None


@pytest.fixture
def run_group(tmp_path, monkeypatch):
    """Return a function that starts programs as nodes of a group; the last one owns time."""
    monkeypatch.setattr(processes, 'executable', lambda package, name: tmp_path / name)
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    log = tmp_path / 'log'

    def fly(act, **programs):
        with NodeGroup('recorder') as group:
            for name, text in programs.items():
                script(tmp_path / name, text.replace(
                    "print('asked to leave', flush=True)",
                    f"open({str(log)!r}, 'a').write({name!r} + ' ')"))
                group.start('some_package', name, [])
            until(lambda: all(child.lines for child in group.children), 'all nodes')
            act({child.name: child for child in group.children})
            group.watch()
        return group, log.read_text().split() if log.exists() else []
    return fly


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_owner_of_time_first_and_the_recorder_last(run_group, number):
    ended, order = run_group(lambda nodes: os.kill(os.getpid(), number),
                            recorder=COOPERATIVE, other=COOPERATIVE, owner=COOPERATIVE)
    assert (ended.interrupts.first, ended.fault) == (number, '')
    assert order == ['owner', 'other', 'recorder']
    assert not ended.folder.exists()


@pytest.mark.parametrize('number, message', [
    (signal.SIGKILL, 'other was ended by SIGKILL'), (signal.SIGHUP, 'other was ended by SIGHUP'),
    (signal.SIGSTOP, 'other was stopped by SIGSTOP'),
    (signal.SIGINT, 'other ended before the flight was over')])
def test_a_signal_to_a_node_ends_the_flight_and_is_named(run_group, number, message):
    began = time.monotonic()
    ended, order = run_group(lambda nodes: os.kill(nodes['other'].pid, number),
                            recorder=COOPERATIVE, other=COOPERATIVE, owner=COOPERATIVE)
    assert ended.fault == message
    assert order[-1] == 'recorder'
    assert not any(alive(child.pid) for child in ended.children)
    assert time.monotonic() - began < PATIENCE


def test_one_of_several_owners_of_time_that_is_ended_ends_the_flight(start):
    first = start("print('ended by SIGTERM')", name='first')
    second = start(COOPERATIVE, name='second')
    assert watch([first, second], Interrupts(), 2) == 'first was ended by SIGTERM'
    assert second.exit_code is None


def test_a_node_names_the_signal_that_ended_it(run_group):
    polite = COOPERATIVE.replace("print('asked to leave', flush=True)",
                              "print('ended by SIGTERM', flush=True)").replace('SIGINT', 'SIGTERM')
    ended, _ = run_group(lambda nodes: os.kill(nodes['other'].pid, signal.SIGTERM),
                    other=polite, owner=COOPERATIVE)
    assert ended.fault == 'other was ended by SIGTERM'


def test_a_second_signal_ends_hanging_nodes_at_once(run_group):
    def twice(nodes):
        os.kill(os.getpid(), signal.SIGINT)
        threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    ended, _ = run_group(twice, other=HANGING, owner=COOPERATIVE)
    assert time.monotonic() - began < 5.0  # 9 s where nobody hurries
    assert ended.fault == 'other did not exit when interrupted, ended by SIGKILL'


@pytest.mark.long
def test_a_suspended_runner_is_told_to_end(tmp_path):
    script(tmp_path / 'node', COOPERATIVE)
    runner = subprocess.Popen([sys.executable, '-c', f"""
import pathlib
from mambo_bringup import processes
from mambo_bringup.node_group import NodeGroup
processes.executable = lambda package, name: pathlib.Path({str(tmp_path)!r}) / name
with NodeGroup('recorder') as group:
    group.start('some_package', 'node', [])
    print(group.folder, flush=True)
    group.watch()
print(group.interrupts.first.name)
"""], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': ''})
    folder = runner.stdout.readline().strip()
    runner.send_signal(signal.SIGSTOP)
    out, err = runner.communicate(timeout=PATIENCE)
    assert (out, err) == ('SIGTERM\n', 'suspended for 4 s: the flight ends\n')
    assert not Path(folder).exists()


@pytest.mark.long
def test_after_a_killed_runner_neither_nodes_nor_its_folder_remain(tmp_path):
    script(tmp_path / 'node', COOPERATIVE)
    runner = subprocess.Popen([sys.executable, '-c', f"""
import pathlib, time
from mambo_bringup import processes
from mambo_bringup.node_group import NodeGroup
processes.executable = lambda package, name: pathlib.Path({str(tmp_path)!r}) / name
with NodeGroup('recorder') as group:
    child = group.start('some_package', 'node', [])
    print(group.folder, child.pid, flush=True)
    group.watch()
"""], stdout=subprocess.PIPE, text=True, env={**os.environ, 'ROS_DOMAIN_ID': ''})
    folder, pid = runner.stdout.readline().split()
    os.kill(int(pid), signal.SIGSTOP)  # so that the kernel's interrupt is not heard
    runner.kill()
    runner.communicate(timeout=PATIENCE)
    until(lambda: not alive(pid) and not Path(folder).exists(), 'the watchdog')


def test_a_flight_that_does_not_begin_ends_with_one_line(start):
    owner = start('import time; time.sleep(60)', name='sim_node')
    began = time.monotonic()
    assert watch([owner], Interrupts(), late=lambda _: 'sim_node', limit=0.3) == (
        'sim_node did not begin within 0.3 s')
    assert time.monotonic() - began < PATIENCE
    timer = threading.Timer(0.6, owner.send, [signal.SIGKILL])
    timer.start()
    assert watch([owner], Interrupts(), late=lambda _: '', limit=0.3) == (
        'sim_node was ended by SIGKILL')


def test_shared_memory_of_the_living_stays_and_of_the_dead_goes(tmp_path, monkeypatch):
    monkeypatch.setattr(watchdog, '_SHARED', tmp_path)
    monkeypatch.setattr(watchdog, '_mapped', lambda: {'fastrtps_9', 'fastrtps_port6'})
    living = ['fastrtps_9', 'fastrtps_port1', 'fastrtps_port1_el', 'fastrtps_port6', 'other_el',
              'sem.fastrtps_port1_mutex', 'sem.fastrtps_port6_mutex']
    dead = ['fastrtps_2', 'fastrtps_2_el', 'fastrtps_8', 'fastrtps_port3', 'fastrtps_port3_el',
            'sem.fastrtps_port3_mutex', 'sem.fastrtps_port4_mutex', 'fastrtps_port7',
            'sem.fastrtps_port7_mutex']

    def make(times):
        for name in (*living, *dead):
            (tmp_path / name).touch()
            os.utime(tmp_path / name, times)
    make((1.0, 1.0))
    with (tmp_path / 'fastrtps_port1_el').open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert watchdog.sweep() is False
        assert sorted(file.name for file in tmp_path.iterdir()) == living
        make(None)
        assert watchdog.sweep() is True  # may be just being made
        make((time.time() + 3600.0,) * 2)
        assert watchdog.sweep() is False  # made before the clock was set back
        assert sorted(file.name for file in tmp_path.iterdir()) == living
        make(None)
        assert watchdog.sweep() is True
        assert sorted(file.name for file in tmp_path.iterdir()) == sorted([*living, *dead])


@pytest.mark.parametrize('killed', [False, True])
def test_shared_memory_is_removed_by_the_runner_where_the_watchdog_was_killed(
        monkeypatch, killed):
    swept = []
    monkeypatch.setattr(watchdog, 'sweep', lambda: swept.append(1) and False)
    guard = watchdog.Watchdog()
    if killed:
        guard._process.kill()
        guard._process.wait()
    guard.release()
    assert bool(swept) is killed


def test_shared_memory_that_a_process_has_mapped_is_found():
    with tempfile.NamedTemporaryFile(dir='/dev/shm', prefix='mambo_test_') as file:
        file.write(bytes(4096))
        file.flush()
        name = Path(file.name).name
        assert name not in watchdog._mapped()
        with mmap.mmap(file.fileno(), 4096):
            assert name in watchdog._mapped()


def test_signals_mean_afterwards_what_they_meant_before():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.long
def test_children_end_in_order_when_their_parent_is_killed(tmp_path):
    log = tmp_path / 'log'
    script(tmp_path / 'node', COOPERATIVE.replace(
        "print('asked to leave', flush=True)", f"open({str(log)!r}, 'w').write('left')"))
    parent = subprocess.Popen(
        [sys.executable, '-c', f"""
import pathlib, time
from mambo_bringup import processes
processes.executable = lambda package, name: pathlib.Path({str(tmp_path / 'node')!r})
child = processes.NodeProcess('some_package', 'node', [])
while not child.lines:
    time.sleep(0.01)
print(child._process.pid, flush=True)
time.sleep({PATIENCE})
"""], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    assert alive(pid)
    parent.kill()
    parent.communicate(timeout=PATIENCE)
    until(lambda: not alive(pid), 'the end of the child')
    assert log.read_text() == 'left'  # it was asked, not killed


NODE = """
import os, signal, sys, time
def main():
    print('up', *sys.argv, os.getsid(0) == os.getpid(), os.environ['PYTHONUNBUFFERED'])
    print('last_error', file=sys.stderr)
    if 'leave' in sys.argv:
        sys.exit(3)
    if 'load' in sys.argv:
        time.sleep(60.0)
    signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
    print('ready')
    while True:
        signal.pause()
"""
COPIES = """
import pathlib, sys
{before}
from mambo_bringup.processes import Interrupts, load, NodeProcess
here = pathlib.Path(__file__).parent
sys.path.insert(0, str(here))
load(['loaded.some_node'])
(here / 'loaded/some_node.py').unlink()
first, second = (NodeProcess('loaded', 'some_node', [word]) for word in ('stay', 'leave'))
print(second.wait(20.0), list(second.lines))
while len(first.lines) < 3:
    pass
print(pathlib.Path(f'/proc/{{first._process.pid}}/comm').read_text().strip())
print(first.end(20.0), first.end(20.0), first.lines[-1])
third = NodeProcess('loaded', 'some_node', ['stay'])
third._process.kill()
print(third.end(20.0))
stopped = NodeProcess('loaded', 'some_node', ['stay'])
while len(stopped.lines) < 3:
    pass
stopped._process.send_signal(19)
print(stopped.wait(0.5), stopped.end(20.0))
with Interrupts():
    fourth = NodeProcess('loaded', 'some_node', ['load'])
while not fourth.lines:
    pass
print(fourth.end(20.0))
"""


def copies(folder, before=''):
    (folder / 'loaded').mkdir()
    (folder / 'loaded/__init__.py').write_text('')
    (folder / 'loaded/some_node.py').write_text(NODE)
    (folder / 'run.py').write_text(COPIES.format(before=before))
    return subprocess.run(
        [sys.executable, folder / 'run.py'], text=True, capture_output=True, timeout=PATIENCE)


@pytest.mark.long
def test_a_node_that_is_loaded_begins_as_a_copy_and_ends_like_any_other(tmp_path):
    done = copies(tmp_path)
    assert done.stdout.splitlines() == [
        "3 ['up some_node leave True 1', 'last_error']", 'some_node', '0 0 ready', '-9',
        'None 0', '-2'
    ], done.stderr


def test_a_failed_fork_restores_the_signal_handlers(monkeypatch):
    def refuse():
        raise BlockingIOError('no more processes')
    monkeypatch.setattr(os, 'fork', refuse)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with pytest.raises(BlockingIOError):
        processes._Copy('module', [])
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


@pytest.mark.long
def test_a_process_that_has_ros_is_not_copied(tmp_path):
    done = copies(tmp_path, 'import rclpy')
    assert done.returncode == 1
    assert 'loaded some_node is not installed' in done.stderr


@pytest.mark.parametrize(('step', 'told'), [(-5.0, True), (-0.3, False), (60.0, False)])
def test_a_clock_that_was_set_back_while_nodes_ran_is_told(monkeypatch, capsys, step, told):
    clock = time.time
    with NodeGroup('recorder'):
        monkeypatch.setattr(time, 'time', lambda: clock() + step)
    said = capsys.readouterr().err
    assert said.startswith('warning: the clock of this machine was set back by 5.0 s') == told
    assert bool(said) == told
