"""Compiled code of a user that never ends: the flight does, with a line and what was flown."""

import os
from pathlib import Path
import signal
import time

from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, fly, scenario as scenarios, supervised
from mambo_flight.world import together
from mambo_model.errors import JobError
from mambo_sim.world import WorldParams
import numpy as np
import pytest

PD = Path(__file__).parents[3] / 'examples/pd_controller.py'


def flight(controller):
    return scenarios.scenario(
        'hover', controller=str(controller), estimator='ground_truth', duration=7.0, land=False)


@pytest.mark.long
@pytest.mark.slow
def test_a_compiled_controller_flies_the_numbers_of_the_closed_loop(faulty):
    scenario = flight(faulty)
    out, fault = supervised.fly(scenario, inner=True)
    again = closed_loop.fly(scenario, inner=True)
    assert fault == ''
    assert out.located is again.located is None
    for one, two in zip(
            (*out[:-2], *out.inner), (*again[:-2], *again.inner), strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_fault_of_an_earlier_flight_is_not_of_this_one(monkeypatch):
    faults = ['an old one']
    monkeypatch.setattr(supervised.slots, 'latest_fault', lambda: faults.pop() if faults else '')
    monkeypatch.setattr(supervised.closed_loop, 'fly', lambda flight, inner: 'what was flown')
    assert supervised.fly(flight('cascaded')) == ('what was flown', '')


def test_a_component_that_goes_to_another_folder_does_not_take_the_command_there(
        monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(supervised.closed_loop, 'fly', lambda flight, inner: os.chdir('/'))
    supervised.fly(flight('cascaded'))
    assert Path.cwd() == tmp_path


@pytest.mark.long
def test_a_step_that_never_ends_leaves_what_was_flown_in_a_closed_bag(
        faulty, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(supervised, 'HUNG', 5.0)  # more than a busy machine lets it wait
    bag, began = tmp_path / 'bag', time.monotonic()
    assert fly.main(['--controller', str(faulty), '--trajectory', 'hover', '--estimator',
                     'ground_truth', '--duration', '7', '--no-landing', '-o', str(bag),
                     '--set', 'controller_node.faulty.hangs=600']) == 1
    text, lines = capsys.readouterr(), faulty.read_text().splitlines()
    line = next(i for i, text in enumerate(lines, 1) if '@jit' in text and 'def step' in lines[i])
    assert text.err == (f'fly: hover: {faulty}:{line}: the compiled step at t = 4.000 s did not '
                        'end within 5 s\n')
    assert len(read_bag(bag)['motor_pwm']) == 800  # from t = 0, 200 steps of it on the ground
    assert time.monotonic() - began < 300.0


@pytest.mark.long
@pytest.mark.slow
def test_a_step_that_never_ends_leaves_closed_bags_of_all_drones_of_a_hall(
        faulty, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(supervised, 'HUNG', 5.0)
    hall = ['--controller', str(faulty), '--trajectory', 'hover', '--estimator', 'ground_truth',
            '--duration', '7', '--no-landing', '--drones', '2']
    bags = tmp_path / 'bags'
    assert fly.main([*hall, '-o', str(bags), '--set', 'controller_node.faulty.hangs=600']) == 1
    assert 'the compiled step at t = 4.000 s did not end within 5 s' in capsys.readouterr().err
    for space in ('mambo1', 'mambo2'):
        assert len(read_bag(bags / space)['motor_pwm']) == 800
    # and without it, the numbers of the flight in one process
    flights = [flight(faulty)] * 2
    world, places = WorldParams(drones=2), [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)]
    (out, *_), fault = supervised.fly_together(flights, world, places)
    again = together.fly(flights, world, places).recordings
    assert fault == ''
    for one, two in zip(out, again, strict=True):
        np.testing.assert_array_equal(one.truth, two.truth)


def test_a_fault_of_code_in_a_hall_and_every_drone_that_failed_is_told(
        tmp_path, capsys, monkeypatch):
    mine = tmp_path / 'mine.py'
    mine.write_text(PD.read_text().replace('@jit\n', '').replace(
        '    v = rotate(',
        '    if memory.steps == 300:\n        raise ValueError("boom")\n    v = rotate('))
    arguments = ['--trajectory', 'hover', '--duration', '6', '--no-landing', '--drones', '2',
                 '--controller', str(mine), '--estimator', 'ground_truth',
                 '-o', str(tmp_path / 'bags')]
    assert fly.main(arguments) == 1
    said = capsys.readouterr().err.splitlines()
    line = mine.read_text().splitlines().index('        raise ValueError("boom")') + 1
    assert said[-1] == f'fly: hover: {mine}:{line}: ValueError: boom'
    assert [line.split(': ')[1] for line in said[:-1] if line.startswith('hover: ')] == [
        '/mambo1', '/mambo2']


def test_an_error_of_the_copy_is_that_of_the_flight(monkeypatch):
    def fail(scenario, out):
        if len(out.t):
            raise JobError('the disk is full')
    monkeypatch.setattr(closed_loop, 'run', fail)
    with pytest.raises(JobError, match='the disk is full'):
        supervised.fly(flight(PD))


def test_results_of_a_copy_come_in_their_order_and_whole():
    def work(give):
        for size in (0, 1, 200_000, 3):  # more than a pipe holds at once
            give(np.arange(size))
    found, ended = supervised.in_copy(work)
    assert ended and [len(part) for part in found] == [0, 1, 200_000, 3]
    assert found[2][-1] == 199_999


def test_what_a_copy_changes_stays_in_the_copy():
    kept = [1]
    found, ended = supervised.in_copy(lambda give: give(kept.append(2) or list(kept)))
    assert (found, ended, kept) == ([[1, 2]], True, [1])


@pytest.mark.parametrize('error', [JobError('no space'), ValueError('a value'), KeyError('x')])
def test_the_error_of_the_work_is_raised_here(error):
    def work(give):
        give('before')
        raise error
    with pytest.raises(type(error)) as raised:
        supervised.in_copy(work)
    assert str(raised.value) == str(error)


def test_a_copy_that_is_killed_from_outside_is_an_error():
    def work(give):
        os.kill(os.getpid(), signal.SIGKILL)
    with pytest.raises(JobError, match='the process of the flight was killed'):
        supervised.in_copy(work)


def hang(give):
    """Stop without Python running: no signal, no thread, as compiled code does."""
    give('first')
    os.kill(os.getpid(), signal.SIGSTOP)


def test_a_copy_that_stops_advancing_is_killed_and_its_results_stay(monkeypatch):
    monkeypatch.setattr(supervised, 'HUNG', 0.5)
    began = time.monotonic()
    assert supervised.in_copy(hang) == (['first'], False)
    assert 0.5 <= time.monotonic() - began < 30.0


def test_progress_keeps_a_copy_alive(monkeypatch):
    """Rows that are still written count, though Python in the copy stands still."""
    monkeypatch.setattr(supervised, 'HUNG', 0.4)
    calls, began = [], time.monotonic()

    def progress():
        calls.append(0)
        return min(time.monotonic() - began, 1.2)  # advances for 1.2 s
    assert supervised.in_copy(hang, progress) == (['first'], False)
    assert time.monotonic() - began >= 1.6 and len(calls) > 3


@pytest.mark.long
def test_slow_python_code_is_not_taken_for_a_step_that_hangs(monkeypatch):
    monkeypatch.setattr(supervised, 'HUNG', 2.0)
    assert supervised.in_copy(lambda give: time.sleep(3.0) or give('done')) == (['done'], True)
