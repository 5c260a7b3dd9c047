"""Rows of a sweep with components of the user: one that never ends costs one row."""

from pathlib import Path
import re

from mambo_flight import closed_loop, scenario as scenarios, supervised
from mambo_flight.sweep import command, guarded, monte_carlo, run, table
from mambo_model import components
from mambo_model.errors import InputError, JobError
import pyarrow.parquet as parquet
import pytest

PD = Path(__file__).parents[4] / 'examples/pd_controller.py'
FAULT = f'{PD}:41: the compiled step at t = 4.000 s did not end within 10 s'
LAST = 3.995  # s


def flight(controller, seed=1):
    return scenarios.scenario('hover', controller=str(controller), estimator='ground_truth',
                              duration=7.0, seed=seed, land=False)


def endless():
    """Hold Python's lock for hours, as compiled code does: a match with 2^60 branches."""
    re.match('(a|a)*$', 60 * 'a' + 'b')


@pytest.fixture
def hangs(monkeypatch):
    """Let flights with the seed 2 never end; a flight takes no time else."""
    monkeypatch.setattr(supervised, 'HUNG', 1.0)
    row = monte_carlo.metrics(monte_carlo.START, scenarios.Scenario().controller_node.vehicle)

    def metrics(given, ideal):
        if given.seed == 2 and given.sim_node.duration > 1.0:
            endless()
        return {**row, 'tracking_max': float(given.seed)}

    def alone(given, inner=False):
        assert (given.seed, given.estimator_node.estimator) == (2, 'ground_truth')
        rows = closed_loop.fly(flight('cascaded'))
        return supervised._each(rows, lambda column: column[:800]), FAULT
    monkeypatch.setattr(guarded, '_metrics', metrics)
    monkeypatch.setattr(supervised, 'fly', alone)


@pytest.mark.long
def test_flights_of_a_compiled_component_have_the_numbers_of_the_loop():
    row, = guarded.fly([flight(PD)], False)
    assert row.pop('fault') == ''
    assert repr(row) == repr(monte_carlo.fly_with_sensors(flight(PD)))


@pytest.mark.long
def test_a_worker_looks_at_files_again_for_each_sweep_and_refuses_another_file(tmp_path):
    mine = tmp_path / 'mine.py'

    def write(share):
        text = PD.read_text().replace('@jit\n', '').replace('thrust_and_torque(', (
            f'thrust_and_torque({share} * '))
        mine.write_text(text)

    def send():
        components.look_again()  # where the sweep begins
        return guarded.packed([flight(mine)])

    def largest(sweep, batch):
        row, = guarded.fly_packed(sweep, batch, True)
        assert not row['fault']
        return row['tracking_max']
    write(1.0)
    first = send()
    found = [largest('first', first)]
    write(1.1)
    for sweep in ('first', 'second'):
        with pytest.raises(InputError, match='mine.py: is not the file that the sweep began with'):
            largest(sweep, first)
    found.append(largest('third', send()))
    assert found[1] > 1.5 * found[0] > 0.0


@pytest.mark.long
def test_a_built_in_flight_is_flown_in_this_process(monkeypatch):
    monkeypatch.setattr(supervised, 'in_copy', None)
    row, = guarded.fly([flight('cascaded')], True)
    assert row['fault'] == '' and not row['shutdown']


def test_the_other_flights_go_on(hangs):
    rows = guarded.fly([flight(PD, seed) for seed in (1, 2, 3)], True)
    assert [row['fault'] for row in rows] == ['', FAULT, '']
    assert [row['shutdown'] for row in rows] == [False, True, False]
    assert rows[1]['shutdown_time'] == pytest.approx(LAST)
    assert rows[1]['shutdown_reason'] == 'controller failed'
    assert [row['tracking_max'] for row in (rows[0], rows[2])] == [1.0, 3.0]


def test_a_flight_without_a_step_has_a_row_too(hangs, monkeypatch):
    def nothing(given, inner=False):
        raise JobError('mine.py:1: the compiled step at t = 0.000 s did not end within 10 s')
    monkeypatch.setattr(supervised, 'fly', nothing)
    row, = guarded.fly([flight(PD, 2)], True)
    assert row['fault'].startswith('mine.py:1') and row['shutdown_time'] == 0.0


def test_a_sweep_writes_its_table_and_names_the_fault(tmp_path, capsys, monkeypatch):
    row = monte_carlo.fly_with_sensors(flight('cascaded'))
    monkeypatch.setattr(run, 'fly', lambda flights, ideal: [
        {**row, 'fault': FAULT if f.seed > 1 else ''} for f in flights])
    file, out = tmp_path / 'sweep.yaml', tmp_path / 'out.parquet'
    file.write_text('vary:\n  trajectory: hover\n  seed: [1, 2, 3]\n')
    assert command.main([str(file), '-o', str(out), '--workers', '1']) == 1
    assert capsys.readouterr().err == (
        f'sweep: a component failed in 2 of 3 flights, the first is flight 1: {FAULT}\n')
    assert parquet.read_table(out)['fault'].to_pylist() == ['', FAULT, FAULT]


def test_a_sweep_is_not_continued_with_another_controller(tmp_path, capsys, monkeypatch):
    mine, out, file = (tmp_path / name for name in ('mine.py', 'out.parquet', 'sweep.yaml'))
    (tmp_path / 'helper.py').write_text('SHARE = 1.0\n')
    text = f'{PD.read_text()}\nfrom helper import SHARE\n'.replace('@jit\n', '')
    file.write_text('scenario: mine.yaml\nvary:\n  seed: [1, 2]\n')
    (tmp_path / 'mine.yaml').write_text('title: mine\ntrajectory: hover\ncontroller: mine.py\n')
    row = {**monte_carlo.fly_with_sensors(flight('cascaded')), 'fault': ''}
    flown = []

    def fly(flights, ideal):
        flown.extend(flights)
        if len(flown) == 2:
            raise table.SweepEndedError('ended')
        return [row for _ in flights]
    monkeypatch.setattr(run, 'fly', fly)
    monkeypatch.setattr(run, 'BATCH', 1)

    def sweep(share=1.0, code=text):
        (tmp_path / 'helper.py').write_text(f'SHARE = {share}\n')
        mine.write_text(code)
        components.look_again()  # as a new process does
        found = command.main([str(file), '-o', str(out), '--workers', '1'])
        return found, capsys.readouterr().err
    assert sweep() == (1, 'sweep: ended\n') and len(flown) == 2
    for change in ({'share': 0.5}, {'code': text.replace('thrust, ', '0.9 * thrust, ')}):
        code, said = sweep(**change)
        assert code == 2 and 'not begun by this sweep file' in said and len(flown) == 2
    code, said = sweep()
    assert code == 0 and len(flown) == 3
    assert f'out.parquet.rows: 1 finished flight is kept; data files that {mine} reads' in said


@pytest.mark.long
def test_what_a_plain_controller_keeps_outside_of_its_memory_is_not_of_another_flight(tmp_path):
    path = tmp_path / 'keeps.py'
    path.write_text(PD.read_text().replace('@jit\n', '').replace(
        '    v = rotate(state.q, state.nu)\n',
        '    COUNT.append(0)\n    v = rotate(state.q, state.nu)\n').replace(
        'thrust_and_torque(thrust,', 'thrust_and_torque((1.0 + 1e-4 * len(COUNT)) * thrust,')
        + '\nCOUNT = []\n')
    rows = guarded.fly([flight(path), flight(path)], True)
    assert repr(rows[0]) == repr(rows[1]) and rows[0]['fault'] == ''
    assert repr(guarded._metrics(flight(path), True)) != repr(
        {name: value for name, value in rows[1].items() if name != 'fault'})  # the same module


@pytest.mark.long
def test_a_plain_component_that_raises_is_named_in_its_row(tmp_path):
    step = '    v = rotate(state.q, state.nu)\n'
    path = tmp_path / 'plain.py'
    path.write_text(PD.read_text().replace('@jit\n', '').replace(
        step, f'    if memory.steps == 300:\n        raise ValueError("bad day")\n{step}'))
    row, = guarded.fly([flight(path)], False)
    assert row['fault'].startswith(f'{path}:') and 'ValueError: bad day' in row['fault']
