"""Compiled code of a user that never ends: the flight does, with a line and what was flown."""

from pathlib import Path
import time

from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, fly, scenario as scenarios, supervised
from mambo_model.errors import JobError
import numpy as np
import pytest

PD = Path(__file__).parents[3] / 'examples/pd_controller.py'


def flight(controller):
    return scenarios.scenario(
        'hover', controller=str(controller), estimator='ground_truth', duration=7.0, land=False)


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


@pytest.mark.slow
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


def test_an_error_of_the_copy_is_that_of_the_flight(monkeypatch):
    def fail(scenario, out):
        if len(out.t):
            raise JobError('the disk is full')
    monkeypatch.setattr(closed_loop, 'run', fail)
    with pytest.raises(JobError, match='the disk is full'):
        supervised.fly(flight(PD))
