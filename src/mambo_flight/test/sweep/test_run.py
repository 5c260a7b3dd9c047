"""Sweeps: what a file means, and that a result depends on nothing else."""

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
import itertools
import json
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import textwrap
import time

from mambo_flight.scenario import scenario
from mambo_flight.sweep import design, plot, run as run_module, table
from mambo_flight.sweep.command import main, summary, sweep
from mambo_flight.sweep.table import SweepEndedError
from mambo_model.schema import ParameterError
import numpy as np
import pyarrow.parquet as parquet
import pytest

PD = Path(__file__).parents[4] / 'examples/pd_controller.py'
MASS = 'sim_node.simulator.vehicle.mass'
SHORT = """
title: Short flights
design: grid
samples: 5
vary:
  duration: 2.5
  landing: false
  estimator: ground_truth
  seed: {range: [1, 2]}
  sim_node.simulator.vehicle.mass: [0.063, 0.068]
  controller_node: {cascaded: {K_P: {uniform: [0.3, 0.5]}}}
"""


def file(tmp_path, text, name='sweep.yaml'):
    path = tmp_path / name
    path.write_text(textwrap.dedent(text))
    return path


def rows(tmp_path, text):
    found = design.read(file(tmp_path, text))
    names = [axis.name for axis in found.axes]
    return [dict(zip(names, row)) for row in found.rows]


@pytest.fixture
def short(tmp_path):
    return file(tmp_path, SHORT)


@pytest.fixture(scope='module')
def result(tmp_path_factory):
    """Return the Parquet file of the short sweep, flown by one process."""
    folder = tmp_path_factory.mktemp('sweep')
    sweep(file(folder, SHORT), folder / 'result.parquet', ideal=True, workers=1)
    return folder / 'result.parquet'


def test_a_grid_crosses_lists_and_ranges_and_repeats_draws(tmp_path):
    found = rows(tmp_path, SHORT)
    assert len(found) == 2 * 2 * 5
    assert {(row['seed'], row[MASS]) for row in found} == {
        (1, 0.063), (1, 0.068), (2, 0.063), (2, 0.068)}
    gains = [row['controller_node.cascaded.K_P'] for row in found]
    assert len(set(gains)) == 20 and all(0.3 <= gain <= 0.5 for gain in gains)


def test_a_random_design_draws_everything(tmp_path):
    text = f"""
    design: random
    samples: 4000
    seed: 3
    vary:
      vehicle: [identified, toolbox]
      seed: {{uniform: [5, 8]}}
      {MASS}: {{normal: [0.068, 0.001]}}
      reference_node.vehicle.mass: {{normal: [0.068, 0.001]}}
      sim_node.simulator.wind.velocity: {{uniform: [[0, -1, 0], [2, 1, 0]]}}
    """
    found = rows(tmp_path, text)
    mass = np.array([row[MASS] for row in found])
    assert abs(mass.mean() - 0.068) < 4 * 0.001 / 4000 ** 0.5  # four standard errors
    assert abs(mass.std() / 0.001 - 1.0) < 4 / 8000 ** 0.5
    winds = np.array([row['sim_node.simulator.wind.velocity'] for row in found])
    assert winds.min(axis=0) == pytest.approx((0.0, -1.0, 0.0), abs=0.01)
    assert winds.max(axis=0) == pytest.approx((2.0, 1.0, 0.0), abs=0.01)
    assert {row['seed'] for row in found} == {5, 6, 7, 8}
    assert 0.45 < np.mean([row['vehicle'] == 'toolbox' for row in found]) < 0.55
    other = np.array([row['reference_node.vehicle.mass'] for row in found])
    assert abs(np.corrcoef(mass, other)[0, 1]) < 4 / 4000 ** 0.5  # each has its own draws
    # a draw depends on the seed, its name and its number alone
    few = rows(tmp_path, text.replace('4000', '7').replace('      vehicle: [identified,', '      '
               'duration: 9\n      vehicle: [identified,'))
    assert [row[MASS] for row in few] == mass[:7].tolist()
    other = rows(tmp_path, text.replace('seed: 3', 'seed: 4'))
    assert other[0][MASS] != mass[0]


def test_values_ranges_and_vectors(tmp_path):
    found = rows(tmp_path, """
    vary:
      duration: {range: [10, 20, 3]}
      sim_node.simulator.wind: {velocity: [[0, 0, 0], [1, 0, 0]], gust: [0.1, 0.1, 0]}
    """)
    assert [row['duration'] for row in found] == [10.0, 10.0, 15.0, 15.0, 20.0, 20.0]
    assert found[1]['sim_node.simulator.wind.velocity'] == (1.0, 0.0, 0.0)
    assert {row['sim_node.simulator.wind.gust'] for row in found} == {(0.1, 0.1, 0.0)}


def test_flights_are_the_scenarios_with_these_values(tmp_path):
    path = file(tmp_path, """
    scenario: fig_5_11
    vary:
      believed: [toolbox, identified]
      seed: 9
      sim_node.simulator.imu.accel_noise: [0.1, 0.2, 0.3]
    """)
    flights = design.Flights(design.read(path))
    first, second = flights[0], flights[1]
    assert first.reference_node.plan.trajectory == 'circle_rising'
    assert (first.controller_node.vehicle.mass, second.controller_node.vehicle.mass) == (
        0.063, 0.068)
    assert first.sim_node.simulator.seed == first.optitrack_node.seed == 9
    assert first.sim_node.simulator.imu.accel_noise == (0.1, 0.2, 0.3)


@pytest.mark.parametrize('line, text, message', [
    (2, 'vary:\n  colour: 1', 'colour: unknown parameter'),
    (2, 'vary:\n  sim_node.simulator.vehicle.mas: 0.1', 'did you mean'),
    (2, f'vary:\n  {MASS}: [0.068, -1]', 'outside'),
    (2, f'vary:\n  {MASS}: [0.068, heavy]', "'heavy' is not a number"),
    (2, f'vary:\n  {MASS}: {{triangle: [1, 2]}}', 'must have one of normal, range, uniform'),
    (2, f'vary:\n  {MASS}: {{uniform: [0.07, 0.06]}}', 'low, high'),
    (2, f'vary:\n  {MASS}: {{normal: [0.068, -0.1]}}', '>= 0'),
    (2, f'vary:\n  {MASS}: {{normal: [0.068, 9.0]}}', 'drawn: '),
    (2, f'vary:\n  {MASS}: {{range: [0.06, 0.07]}}', 'count'),
    (2, 'vary:\n  seed: {range: [1, 2, 3]}', 'whole numbers'),
    (2, 'vary:\n  vehicle: {uniform: [1, 2]}', 'give a list'),
    (2, 'vary:\n  seed: []', 'empty list'),
    (3, 'vary:\n  sim_node:\n    simulator.seed: [1]\n    simulator: {seed: 2}', 'duplicate key'),
    (1, 'design: cube', 'design'),
    (1, 'samples: 0', 'samples'),
    (1, 'colour: red', 'colour: unknown parameter'),
    (2, 'vary:\n  vehicle: [identified, eagle]', 'eagle'),
    (2, 'vary:\n  sim_node.simulator.plant.physics_rate: [1001]', 'multiple'),
    (2, 'vary:\n  duration: 1\n  duration: 2', 'duplicate key'),
])
def test_a_wrong_file_is_refused_by_file_line_and_key(tmp_path, capsys, line, text, message):
    path = file(tmp_path, text)
    code = main([str(path), '--out', str(tmp_path / 'r.parquet'), '--ideal'])
    error = capsys.readouterr().err
    assert code == 2 and error.count('\n') == 1
    assert f'{path}:' in error and message in error
    if 'duplicate key' not in error:
        assert f'{path}:{line}: ' in error
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('text, message', [
    ('design: random', 'samples'), ('scenario: fig_99', 'fig_99'),
    ('vary:\n  seed: {range: [1, 100000]}\n  duration: {range: [1, 9, 1000]}', 'more than')])
def test_what_has_no_line_is_refused_by_file(tmp_path, text, message):
    with pytest.raises(ParameterError, match=message):
        design.Flights(design.read(file(tmp_path, text)))[0]


def test_the_result_is_tidy(result):
    found = parquet.read_table(result)
    data = found.to_pydict()
    assert found.num_rows == 20 and data['flight'] == list(range(20))
    assert data['controller_node.cascaded.K_P'] and set(data[MASS]) == {0.063, 0.068}
    assert {'tracking_rms', 'tracking_rms_x', 'estimation_final', 'saturated_share',
            'shutdown_reason', 'pwm_max'} <= set(data)
    assert len(set(data['tracking_rms'])) > 4  # the gains are really flown
    heavy = [x for x, mass in zip(data['tracking_rms_z'], data[MASS]) if mass == 0.068]
    light = [x for x, mass in zip(data['tracking_rms_z'], data[MASS]) if mass == 0.063]
    assert max(heavy) < min(light)  # the controller believes in 68 g
    assert result.with_suffix('.png').read_bytes().startswith(b'\x89PNG')
    assert sorted(path.name for path in result.parent.iterdir()) == [
        'result.parquet', 'result.png', 'result_map.png', 'sweep.yaml']
    assert '0 of 20 flights were shut down' in summary(data)


HEADER = b'{"sweep": "head"}\n'
ROW = b'{"flight": 4, "x": 1.5}\n'


@pytest.mark.parametrize('damage', [
    b'{"flight": 5, "x": ', b'{"x": 2.0}\n', b'{"flight": "5", "x": 2.0}\n', b'[5]\n', b'\xff\n',
    b'{"flight": 5, "y": 2.0}\n', b'{"flight": true, "x": 2.0}\n', b'[' * 100_000 + b'\n'])
def test_rows_up_to_a_damaged_one_are_kept_and_the_rest_is_flown_again(tmp_path, damage):
    path = tmp_path / 'rows'
    path.write_bytes(HEADER + ROW + damage + ROW.replace(b'4', b'6'))
    journal = table.Journal(path, 'head')
    assert journal.rows == {4: {'x': 1.5}}
    journal.close()
    assert path.read_bytes() == HEADER + ROW


@pytest.mark.parametrize('data', [b'', HEADER[:9], HEADER[:-1]])
def test_a_journal_that_was_cut_off_at_once_begins_again(tmp_path, data):
    path = tmp_path / 'rows'
    path.write_bytes(data)
    table.Journal(path, 'head').close()
    assert path.read_bytes() == HEADER


@pytest.mark.parametrize('data', [
    b'precious', b'\n', b'{"sweep": "another"}\n', b'{"flight": 1}\n', bytes(40)])
def test_a_file_that_is_no_journal_of_this_sweep_is_left_as_it_is(tmp_path, data):
    path = tmp_path / 'rows'
    path.write_bytes(data)
    with pytest.raises(table.SweepError, match='rows: not begun by this sweep file'):
        table.Journal(path, 'head')
    assert path.read_bytes() == data


def test_two_workers_give_the_same_file(short, result, tmp_path):
    sweep(short, tmp_path / 'r.parquet', ideal=True, workers=2)
    assert (tmp_path / 'r.parquet').read_bytes() == result.read_bytes()


def test_an_interrupted_sweep_goes_on_where_it_was(short, result, tmp_path, monkeypatch):
    out = tmp_path / 'r.parquet'
    flown = []

    def stopping(journal, number, row, add=table.Journal.add):
        if len(flown) == 3:
            raise KeyboardInterrupt
        flown.append(number)
        add(journal, number, row)
    with monkeypatch.context() as patch:
        patch.setattr(table.Journal, 'add', stopping)
        with pytest.raises(KeyboardInterrupt):
            sweep(short, out, ideal=True, workers=1)
    kept = tmp_path / 'r.parquet.rows'
    assert not out.exists() and len(kept.read_text().splitlines()) == 1 + 3
    kept.write_bytes(kept.read_bytes()[:-20])  # the last line was cut off
    again = []

    def counting(journal, number, row, add=table.Journal.add):
        again.append(number)
        add(journal, number, row)
    monkeypatch.setattr(table.Journal, 'add', counting)
    sweep(short, out, ideal=True, workers=1)
    assert flown[:2] == [0, 1] and again == list(range(2, 20))
    assert out.read_bytes() == result.read_bytes() and not kept.exists()


def test_a_journal_that_was_cut_off_can_be_gone_on_with_again_and_again(tmp_path):
    path, whole = tmp_path / 'rows', {0: {'x': 0.1 + 0.2, 'why': 'a'},
                                       1: {'x': math.nan, 'why': ''}}
    for number, row in whole.items():
        journal = table.Journal(path, 'head')
        journal.add(number, row)
        journal.close()
        with path.open('ab') as stream:
            stream.write(b'{"flight": 7, "x": 1')
    journal = table.Journal(path, 'head')
    assert repr(journal.rows) == repr(whole)  # every bit, NaN too
    journal.remove()
    assert not path.exists()


def test_rows_of_another_sweep_are_not_taken_for_its_own(short, tmp_path, capsys):
    out = tmp_path / 'r.parquet'
    journal = tmp_path / 'r.parquet.rows'
    journal.write_text(json.dumps({'sweep': 'another'}) + '\n')
    assert main([str(short), '--out', str(out), '--ideal']) == 2
    assert 'not begun by this sweep file' in capsys.readouterr().err
    journal.unlink()
    out.write_text('mine')
    assert main([str(short), '--out', str(out), '--ideal']) == 2
    assert 'exists' in capsys.readouterr().err and out.read_text() == 'mine'
    assert not journal.exists()


def test_the_digest_knows_sensors_values_and_base(tmp_path):
    def digest(text, ideal=True):
        flights = design.Flights(design.read(file(tmp_path, text)))
        flights[0]
        return table.digest(flights, ideal)
    texts = [SHORT, SHORT.replace('0.063', '0.064'), SHORT.replace('2.5', '2.6'),
             SHORT.replace('title:', 'scenario: fig_5_11\ntitle:'),
             SHORT.replace('vary:', 'seed: 1\nvary:')]
    found = [digest(text) for text in texts] + [digest(SHORT, ideal=False)]
    assert len(set(found)) == len(found) and digest(SHORT) == found[0]


def test_percentiles_and_bins():
    percent, values = plot.percentiles(np.array([3.0, np.nan, 1.0, 2.0, 4.0]))
    assert values.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert percent.tolist() == [12.5, 37.5, 62.5, 87.5]
    x = np.linspace(0.0, 1.0, 120)
    parts = plot.bins(x, 2.0 * x)
    assert len(parts) == 12 and sum(len(y) for _, y in parts) == 120
    assert all(y.mean() == pytest.approx(2.0 * middle) for middle, y in parts)
    assert plot.bins(np.array([1.0, 2.0, 1.0]), np.array([5.0, 6.0, 7.0]))[0][1].tolist() == [5, 7]


def test_without_dask_one_line_says_what_to_install(short, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    out = tmp_path / 'r.parquet'
    assert main([str(short), '--out', str(out), '--ideal', '--dask', 'tcp://x:1']) == 2
    error = capsys.readouterr().err
    assert 'requirements/dask.txt' in error and error.count('\n') == 1


LONG = SHORT.replace('2.5', '20').replace('samples: 5', 'samples: 600')


def start(path, out, *options):
    """Start a sweep in a process; return it once it has finished some flights."""
    run = subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.starting', 'mambo', 'sweep', str(path), '--ideal',
         '--out', str(out), *options], stderr=subprocess.PIPE, text=True, start_new_session=True)
    journal, begun = out.with_name(f'{out.name}.rows'), time.monotonic()
    before = len(journal.read_text().splitlines()) if journal.exists() else 0
    while time.monotonic() < begun + 60.0 and run.poll() is None and not (
            journal.exists() and len(journal.read_text().splitlines()) > before + 10):
        time.sleep(0.01)
    assert run.poll() is None, 'over before it could be disturbed'
    return run


def workers(run):
    """Return the processes of a sweep that fly."""
    children = Path(f'/proc/{run.pid}/task/{run.pid}/children').read_text().split()
    return [int(pid) for pid in children
            if b'spawn_main' in Path(f'/proc/{pid}/cmdline').read_bytes()]


def test_a_killed_worker_names_the_files_whose_code_it_ran(tmp_path):
    mine = tmp_path / 'mine.py'
    mine.write_text(PD.read_text().replace('@jit\n', ''))
    flight = scenario(controller=str(mine), duration=1.0)
    gone = Future()
    gone.set_exception(BrokenProcessPool())
    with pytest.raises(SweepEndedError, match='killed, perhaps by code of .*mine.py;'):
        run_module._result(gone, [flight, scenario(duration=1.0)])
    with pytest.raises(SweepEndedError, match='a worker was killed; finished'):
        run_module._result(gone, [scenario(duration=1.0)])
    lost = Future()  # as Dask says it
    lost.set_exception(type('KilledWorker', (Exception,), {})('task on 4 workers'))
    with pytest.raises(SweepEndedError, match='killed, perhaps by code of .*mine.py;'):
        run_module._result(lost, [flight])


def test_a_worker_killed_before_a_batch_is_submitted_is_told_alike():
    class Broken:
        def submit(self, *_):
            raise BrokenProcessPool

    flights = [scenario(duration=1.0)]
    with pytest.raises(SweepEndedError, match='a worker was killed; finished'):
        run_module._spread(flights, [0], True, Broken(), 1, None, None)


def test_a_sweep_without_a_worker_ends_with_what_is_finished(monkeypatch):
    monkeypatch.setattr(run_module, 'LOOK', 0.01)
    monkeypatch.setattr(run_module, 'WORKERLESS', 0.1)
    waiting, answers = Future(), itertools.chain([True] * 3, itertools.repeat(False))
    with pytest.raises(SweepEndedError, match='the scheduler has had no worker for 0.1 s; finish'):
        run_module._next_done([waiting], lambda: next(answers))
    assert not list(itertools.takewhile(bool, answers))
    back = itertools.cycle([False, True])  # a worker that comes and goes

    def alive():
        if next(back):
            waiting.set_result([])
        return True
    assert run_module._next_done([waiting], alive) == {waiting}


@pytest.mark.long
def test_a_killed_worker_and_ctrl_c_cost_one_line_and_no_finished_flight(tmp_path):
    path, out = file(tmp_path, LONG), tmp_path / 'r.parquet'
    run = start(path, out, '--workers', '2')
    os.kill(workers(run)[0], signal.SIGKILL)
    _, error = run.communicate(timeout=60.0)
    assert run.returncode == 1 and error.count('\n') == 1 and 'a worker was killed' in error
    kept = len((tmp_path / 'r.parquet.rows').read_text().splitlines())
    run = start(path, out, '--workers', '2')
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does
    _, error = run.communicate(timeout=60.0)
    assert (run.returncode, error) == (130, (
        f'mambo sweep: {out}.rows: {kept - 1} finished flights are kept\n'
        f'mambo: ended by SIGINT; {table.KEPT}\n'))
    assert len((tmp_path / 'r.parquet.rows').read_text().splitlines()) > kept > 10
    assert not out.exists()


@pytest.mark.long
def test_a_dask_cluster_gives_the_same_file_although_a_worker_dies(tmp_path):
    pytest.importorskip('distributed', reason='Dask is not installed: requirements/dask.txt')
    from distributed import Client, LocalCluster
    path = file(tmp_path, LONG.replace('samples: 600', 'samples: 150'))  # seconds after the kill
    sweep(path, tmp_path / 'here.parquet', ideal=True, workers=1)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            pids = client.run(os.getpid)
        run = start(path, tmp_path / 'there.parquet', '--dask', cluster.scheduler_address)
        os.kill(next(iter(pids.values())), signal.SIGKILL)
        _, error = run.communicate(timeout=120.0)
    assert run.returncode == 0, error
    assert (tmp_path / 'there.parquet').read_bytes() == (
        tmp_path / 'here.parquet').read_bytes()
