"""Outcome of a flight: what is read from the lines of stand-in nodes."""

import os

from mambo_bringup import processes, run, stuck
from mambo_bringup.flight import runner
from mambo_bringup.flight.outcome import Progress
from mambo_bringup.flight.runner import fly, fly_several
from mambo_flight.scenario import override
from mambo_flight.world.world_file import Hall
from mambo_sim.world import WorldParams
import pytest
from stand_in_nodes import FLEW, NODES, QUIET, short


def test_what_the_simulator_says_is_the_outcome(graph, tmp_path):
    graph(sim_node=FLEW)
    outcome = fly(short(), tmp_path / 'bag')
    assert (outcome.bag, outcome.flown, outcome.took) == (tmp_path / 'bag', 3.0, 1.5)
    assert outcome.real_time_factor == 2.0 and not outcome.stopped
    assert outcome.missed == 2 and outcome.late == 3
    assert outcome.delay == 'IMU sample to motor command: p50 1.00 ms'


def test_many_steps_without_a_command_in_time_are_told_with_what_to_do(graph, tmp_path, capsys):
    graph(sim_node=FLEW)  # 3 s, 600 steps
    outcome = fly(short(), tmp_path / 'bag')
    for missed, told in ((29, ''), (60, 'warning: 10% of the steps had no motor command in time'),
                         (601, 'warning: 100% of the steps')):
        outcome.missed = missed
        run._print_outcome(outcome, tmp_path / 'bag', no_report=True)
        out = capsys.readouterr().out
        assert f'{missed} steps without their motor command, 3 waited for a late one' in out
        lines = [line for line in out.splitlines() if 'in time' in line]
        assert bool(lines) == bool(told) and ''.join(lines).startswith(told)
    assert '--speed' in lines[0]


def test_what_nodes_used_is_told_in_cores_the_greediest_first(graph, tmp_path):
    graph(sim_node=FLEW + "print('used 0.60 s of CPU and 120 MB')",
          estimator_node="signal.signal(signal.SIGINT, lambda *_: sys.exit(print("
                         "'used 0.90 s of CPU and 90 MB')))\n" + QUIET)
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.used == {'sim_node': (0.6, 120), 'estimator_node': (0.9, 90)}
    assert outcome.spent() == (
        'CPU: 1.00 cores: estimator 0.60, sim 0.40; memory: 120 MB at most')  # in 1.5 s


def test_more_cpu_than_the_cores_have_in_a_short_flight_is_told_in_seconds(graph, tmp_path):
    """Most of it was used before the flight."""
    seconds = 1.5 * len(os.sched_getaffinity(0)) + 0.1
    graph(sim_node=FLEW + f"print('used {seconds:.2f} s of CPU and 120 MB')")
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.spent() == f'CPU: {seconds:.2f} s: sim {seconds:.2f}; memory: 120 MB at most'


def test_what_nodes_used_in_a_flight_with_a_pause_is_told_in_seconds(graph, tmp_path):
    """The wall time is without the pause, in which the nodes used CPU."""
    graph(sim_node="print('[INFO] [1.0] [mambo.sim_node]: paused before t = 1.000 s')\n" + FLEW
          + "print('used 6.00 s of CPU and 120 MB')")
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.spent() == 'CPU: 6.00 s: sim 6.00; memory: 120 MB at most'


def test_what_nodes_refused_is_of_the_outcome_the_last_count_of_each(graph, tmp_path, capsys):
    says = "print('[WARN] [1.0] [mambo.%s]: refused messages: %d /mambo/motor_pwm not finite')\n"
    graph(sim_node=FLEW + says % ('sim_node', 1) + says % ('sim_node', 35))
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.refused == {'sim_node': '35 /mambo/motor_pwm not finite'}
    run._print_outcome(outcome, tmp_path / 'bag', no_report=True)
    assert ('warning: sim_node refused messages: 35 /mambo/motor_pwm not finite'
            in capsys.readouterr().out.splitlines())


def test_what_the_simulator_remarks_is_printed(graph, tmp_path, capsys):
    pwm = 'motor_pwm of t = 1.000 s is 900, above pwm_max of the vehicle: it and later ones are '
    lines = [f'{pwm}limited to 500', 'fell 2.34 s behind the wall clock: the controller or the '
             'machine is too slow for speed 1',
             'did not run for 20.1 s in all: it went on from where it was']
    graph(sim_node=''.join(
        f"print('[WARN] [1.0] [mambo.sim_node]: {line}')\n" for line in lines) + FLEW)
    outcome = fly(short(), tmp_path / 'bag')
    assert outcome.remarks == lines
    run._print_outcome(outcome, tmp_path / 'bag', no_report=True)
    assert [f'warning: {line}' for line in lines] == [
        line for line in capsys.readouterr().out.splitlines() if line.startswith('warning')]


HALL = """
for drone, missed, late, delay in ((1, 0, 7, 2.5), (2, 60, 142, 3.5)):
    at = f'[WARN] [1.0] [mambo{drone}'
    print(f'{at}.sim_node]: flew 3.000 s in 1.500 s of wall time, {missed} steps without their '
          f'motor command, {late} waited for a late one')
    print(f'{at}.sim_node]: IMU sample to motor command: p50 {delay:.2f} ms of 600 steps')
    print(f'{at}.sim_node]: motor_pwm of t = {drone}.000 s is 900, above pwm_max of the vehicle: '
          'it and later ones are limited to 500')
    print(f'{at}.controller_node]: refused messages: {drone} /estimate/odom not finite')
    print(f'{at}.reference_node]: {drone} commands of the scenario refused in flight, first land')
print('[WARN] [1.0] [mambo1.sim_node]: did not run for 0.7 s in all: it went on from where it was')
print('used 1.50 s of CPU and 120 MB')
"""


def test_what_one_process_says_of_several_drones_is_said_of_the_drone_that_it_is_of(
        graph, tmp_path, capsys):
    """The wall clock and the process are of all drones, and so is what is said of them."""
    waits = FLEW.partition('print')[0]  # for the five others
    graph(composed_node=waits + HALL, hall_capture_node=QUIET)
    spaces = {f'/mambo{number}': tmp_path / f'{number}' for number in (1, 2)}
    hall = Hall(WorldParams(drones=2), {'/mambo1': (0.0, 0.0, 0.0), '/mambo2': (0.0, 3.0, 0.0)})
    outcomes = fly_several(dict.fromkeys(spaces, short()), spaces, hall=hall)
    for number, outcome in enumerate(outcomes, 1):
        run._print_outcome(outcome, tmp_path, no_report=True)
        said = capsys.readouterr().out
        missed, late, delay = ((0, 7, 2.5), (60, 142, 3.5))[number - 1]
        assert (f'{missed} steps without their motor command, {late} waited for a late one\n'
                f'IMU sample to motor command: p50 {delay:.2f} ms of 600 steps\n') in said
        assert ('10% of the steps had no motor command in time' in said) == (number == 2)
        assert outcome.remarks == [f'motor_pwm of t = {number}.000 s is 900, above pwm_max of the '
                                   'vehicle: it and later ones are limited to 500']
        assert outcome.refused == {'controller_node': f'{number} /estimate/odom not finite'}
        assert outcome.dropped == [
            f'{number} commands of the scenario refused in flight, first land']
        assert 'did not run' not in said and 'CPU' not in said
    run._print_hall(outcomes[0])
    assert capsys.readouterr().out == (
        'all drones:\nwarning: did not run for 0.7 s in all: it went on from where it was\n'
        'CPU: 1.00 cores: composed 1.00; memory: 120 MB at most\n')


def test_when_time_is_real_all_but_the_recorder_go_before_others(graph, tmp_path, monkeypatch):
    hurried = []
    monkeypatch.setattr(
        processes.NodeProcess, 'raise_priority', lambda process: hurried.append(process.name))
    graph(sim_node="print('[INFO] [1.0] [mambo.sim_node]: flying in lockstep mode')" + FLEW)
    fly(short(), tmp_path / 'first')
    assert not hurried
    graph(sim_node="print('[INFO] [1.0] [mambo.sim_node]: flying in realtime mode')" + FLEW)
    fly(short(), tmp_path / 'second')
    assert sorted(hurried) == sorted(set(NODES) - {'recorder_node'})


def test_a_flight_that_does_not_begin_says_what_it_waits_for_where_no_bar_is_seen(capsys):
    one = Progress(3.0)
    assert all(one.waits(seconds) for seconds in (0.0, 9.9, 10.0, 12.0))
    one.line('[WARN] [1.0] [mambo.sim_node]: waiting for node /mambo/estimator_node')
    assert all(one.waits(seconds) for seconds in (19.0, 20.0, 39.0))
    assert capsys.readouterr().err.splitlines() == [
        'starting (compiles once): 10 s so far',
        'waiting for node /mambo/estimator_node: 20 s so far']
    one.line('[INFO] [1.0] [mambo.sim_node]: flying in lockstep mode')
    assert not one.waits(1000.0)
    assert capsys.readouterr().err == ''


def test_the_drone_that_does_not_begin_is_named(graph, tmp_path, monkeypatch):
    graph(sim_node=QUIET)
    monkeypatch.setattr(runner, '_LOADING', 0.5)
    flight = override(short(), {'sim_node.start_patience': 1.0})
    with pytest.raises(processes.FlightError, match='sim_node did not begin within 2 s'):
        fly(flight, tmp_path / 'bag')


def test_a_simulator_that_stands_still_before_the_flight_is_killed(graph, tmp_path, monkeypatch):
    graph(sim_node=QUIET)
    monkeypatch.setattr(stuck, 'ASLEEP', 1.0)
    with pytest.raises(processes.FlightError, match='sim_node did nothing for 1 s'):
        fly(short(), tmp_path / 'bag')
