"""The flight runner: it starts stand-in nodes, watches and ends them."""

import signal
import subprocess
import sys
import time

from mambo_bringup.flight import runner
from mambo_bringup.flight.runner import fly
from mambo_bringup.processes import FlightError
from mambo_flight.scenario import from_yaml, override
import pytest
from stand_in_nodes import COPY, FLEW, NODES, QUIET, short

PATIENCE = 60.0  # s


def test_every_node_gets_the_scenario_and_the_simulator_waits_for_all(graph, tmp_path):
    graph(sim_node=COPY + FLEW, controller_node=COPY + QUIET)
    fly(short(), tmp_path / 'bag')
    for name in ('sim_node', 'controller_node'):
        given = from_yaml((tmp_path / f'{name}.yaml').read_text())
        assert set(given.sim_node.wait_for.split(',')) == set(NODES) - {'sim_node'}
        assert override(given, {'sim_node.wait_for': ''}) == short()


@pytest.mark.parametrize('name', ['sim_node', 'estimator_node', 'recorder_node'])
def test_a_node_that_dies_ends_the_flight_and_is_named_with_its_complaint(graph, tmp_path, name):
    graph(**{name: 'raise ValueError("out of paint")'})
    with pytest.raises(FlightError) as error:
        fly(short(), tmp_path / 'bag')
    assert str(error.value) == f'{name} ended with exit code 1: ValueError: out of paint'


def test_a_simulator_that_ends_without_a_word_has_not_flown(graph, tmp_path):
    """A component of the user may end the process with exit code 0."""
    graph(sim_node='import os; os._exit(0)')
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.fault == 'sim_node ended before the flight was over'
    assert not outcome.whole and not outcome.closed


def test_the_users_code_in_a_process_that_ends_without_a_word_is_named(
        graph, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, 'guests', lambda flight, names: f'mine.py may have ended {names}')
    graph(estimator_node='import os; os._exit(0)')
    with pytest.raises(FlightError) as error:
        fly(short(), tmp_path / 'bag')
    assert str(error.value) == ("estimator_node ended before the flight was over; mine.py may "
                                "have ended ['estimator_node']")


def test_a_missing_node_ends_the_flight_before_it_begins(tmp_path, monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    with pytest.raises(FlightError, match='recorder_node is not installed'):
        fly(short(), tmp_path / 'bag')


def test_an_existing_bag_is_never_touched(graph, tmp_path):
    graph()
    (tmp_path / 'bag').mkdir()
    with pytest.raises(FlightError, match='bag exists: give another --output or remove it'):
        fly(short(), tmp_path / 'bag')


def test_a_bag_that_no_node_can_open_is_refused_before_any_node(graph, tmp_path):
    graph()
    with pytest.raises(FlightError, match='is not UTF-8, and no node can open it: give another'):
        fly(short(), tmp_path / 'd\udcfc/bag')
    assert not list(tmp_path.glob('*.up'))


def test_an_interrupt_of_the_runner_ends_every_node_in_order(graph, tmp_path):
    graph()
    runner = subprocess.Popen([sys.executable, '-c', f"""
import pathlib
from mambo_bringup import processes
from mambo_bringup.flight.runner import fly
from mambo_flight.scenario import scenario
folder = pathlib.Path({str(tmp_path)!r})
processes.executable = lambda package, name: folder / name
print(fly(scenario(duration=3.0), folder / 'bag').stopped.name)
"""], stdout=subprocess.PIPE, text=True)
    limit = time.monotonic() + PATIENCE
    while len(list(tmp_path.glob('*.up'))) < len(NODES) and time.monotonic() < limit:
        time.sleep(0.01)
    runner.send_signal(signal.SIGINT)
    out, _ = runner.communicate(timeout=PATIENCE)
    assert (runner.returncode, out) == (0, 'SIGINT\n')
