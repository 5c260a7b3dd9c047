"""Courses by name, in scenarios, scenario files, the closed loop and bags."""

import dataclasses
import hashlib
from pathlib import Path

from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, fly, scenario as scenarios, scenario_file
from mambo_flight.course import course_file
from mambo_flight.scenario_file import Place
from mambo_flight.sweep import design, monte_carlo
from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import Course
from mambo_model.motion.trajectory import LANDED, reference_at, TRACK
from mambo_model.schema import ParameterError
import numpy as np
import pytest

LINE = Course(np.array([6.0]), np.zeros((1, 4, 8)))  # 1.5 m to the south at 1.2 m, rest to rest
LINE.coefficients[0, 2, 0] = -1.2
LINE.coefficients[0, 0, 4:] = -1.5 * np.array([35.0, -84.0, 70.0, -20.0]) / 6.0 ** np.arange(4, 8)


@pytest.fixture
def line(tmp_path):
    path = tmp_path / 'line.csv'
    path.write_text(uav_trajectories.to_text(LINE))
    return path


def settings(**given):
    return scenario_file.from_settings({
        name: Place(value, f'--{name}') for name, value in given.items()})


def test_a_file_is_flown_to_its_end_and_landed(line):
    flight = settings(trajectory=str(line), estimator='ground_truth')
    plan = flight.reference_node.plan
    assert plan.trajectory == 'course'
    sha256 = hashlib.sha256(line.read_bytes()).hexdigest()
    assert plan.course == f'# line.csv, sha256 {sha256}\n{line.read_text()}'
    # take-off and approach 8 s, the course, at least 1 s of rest, 9 s of landing
    assert (flight.sim_node.duration, plan.landing_time) == (24.0, 15.0)
    out = closed_loop.fly(flight)
    assert not out.reason.any() and set(out.phase) == set(range(5))
    assert out.truth[-1, :3] == pytest.approx([-1.5, 0.0, 0.0], abs=0.05)
    for k in range(0, len(out.t), 97):
        ref, phase = reference_at(out.t[k] * 1e-9, plan, flight.reference_node.vehicle)
        assert tuple(out.reference[k, :3]) == ref.rho and out.phase[k] == phase


@pytest.mark.parametrize(('given', 'duration'), [
    ({'duration': 60.0}, 60.0), ({'landing': False}, 19.0), ({'takeoff': 'none'}, 19.0)])
def test_a_duration_is_that_of_the_user_or_long_enough(line, given, duration):
    assert settings(trajectory=str(line), **given).sim_node.duration == duration


def test_a_scenario_file_names_a_course_beside_it_and_may_change_it(line):
    path = line.with_name('mine.yaml')
    path.write_text('title: slowly\ntrajectory: line.csv\n'
                    'parameters: {reference_node: {plan: {scale_rate: 0.5, height: 2}}}\n')
    _, flight = scenario_file.load(str(path))
    plan = flight.reference_node.plan
    assert plan.flown_course().total == 12.0 and plan.hover() == (0.0, 0.0, -2.0)
    assert flight.sim_node.duration == 30.0
    again = scenarios.from_yaml(scenarios.commented_yaml(flight))
    assert again == flight == scenarios.from_yaml(scenarios.to_yaml(flight))


@pytest.mark.long
def test_a_hand_carries_along_a_course(line):
    flight = settings(trajectory=str(line), carried=True, estimator='ground_truth')
    assert flight.sim_node.simulator.hand.plan == flight.reference_node.plan
    out = closed_loop.fly(flight)
    on = out.phase == TRACK
    # the simulator's time and the reference's differ by rounding
    np.testing.assert_allclose(out.truth[on, :3], out.reference[on, :3], rtol=0.0, atol=1e-13)


@pytest.mark.long
def test_a_sweep_varies_the_course_and_its_speed(line):
    path = line.with_name('sweep.yaml')
    path.write_text('title: lines\nvary:\n'
                    '  trajectory: [hover, line.csv]\n'
                    '  reference_node.plan.scale_rate: [1.0, 0.8]\n')
    flights = design.Flights(design.read(path))
    plans = [flights[i].reference_node.plan for i in range(4)]
    assert [plan.trajectory for plan in plans] == ['hover', 'hover', 'course', 'course']
    assert [plan.flown_course().total for plan in plans[2:]] == pytest.approx([6.0, 7.5])
    first, second = monte_carlo.fly_many([flights[2], flights[3]])
    assert 0.0 < second['tracking_rms'] < first['tracking_rms'] < 0.2


def test_a_bag_keeps_the_course_and_gives_the_same_flight(line, tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert fly.main(['--trajectory', str(line), '-o', str(bag)]) == 0
    assert 'line: 24.00 s flown' in capsys.readouterr().out
    line.unlink()  # the bag is enough
    flight = scenarios.from_yaml(str(read_bag(bag, topics=()).attachments['scenario.yaml']))
    again = tmp_path / 'again'
    written = tmp_path / 'written.yaml'
    written.write_text(scenarios.commented_yaml(flight))
    assert fly.main([str(written), '-o', str(again)]) == 0
    first, second = (next(one.glob('*.mcap')).read_bytes() for one in (bag, again))
    assert first == second
    other = dataclasses.replace(flight.reference_node.plan, scale_amplitude=0.9)
    assert scenarios.override(flight, {
        'reference_node.plan.scale_amplitude': 0.9}).reference_node.plan == other


def test_flight_ends_where_the_course_does(line):
    out = closed_loop.fly(settings(trajectory=str(line), estimator='ground_truth'))
    assert out.phase[-1] == LANDED and not out.pwm[-1].any()


@pytest.mark.parametrize(('name', 'message'), [
    ('spiral', r"--trajectory: trajectory 'spiral' is unknown: give a file \(.csv, .yaml, .yml\)"),
    ('no.csv', '--trajectory: no.csv: No such file or directory')])
def test_what_is_no_trajectory_is_refused(name, message):
    with pytest.raises(ParameterError, match=message):
        settings(trajectory=name)


def test_the_command_needs_something_to_fly(capsys, tmp_path):
    assert fly.main(['-o', str(tmp_path / 'bag')]) == 2
    assert capsys.readouterr().err == (
        'fly: give a SCENARIO or one of --trajectory, --controller, --estimator\n')


def test_names_of_files_are_told_from_names_of_trajectories():
    assert not course_file.is_course('circle')
    assert all(map(course_file.is_course, ('a.csv', 'b/c.YAML', 'd.yml', 'e.py', 'e.py:f')))
    course_file.check_name('circle')
    assert course_file.plan('circle', Path('/none')) == {'trajectory': 'circle'}
