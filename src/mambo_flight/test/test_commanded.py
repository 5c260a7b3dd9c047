"""Commanded flights in one process: from a file, recorded, and flown again to the last bit."""

from mambo_bags.reader import read_bag
from mambo_control.commanded import script
from mambo_flight import closed_loop, commanded, fly, recording_to_bag, scenario_file
from mambo_flight.scenario import override, scenario
from mambo_flight.world import formation, world_file
from mambo_model.errors import InputError
from mambo_model.motion import flight_command as fc
from mambo_model.motion.trajectory import GROUND, LANDED, LANDING, TAKEOFF, TRACK
from mambo_model.schema import ParameterError
from mambo_sim.world import WorldParams
import numpy as np
import pytest

FILE = """
title: up, aside, along a course, down
duration: 20.0
estimator: ground_truth
commands:
  - {time: 1.0, takeoff: {height: 1.0}}
  - {time: 4.0, go_to: {goal: [1.0, -0.5, 1.0], yaw: 0.5}}
  - {time: 6.0, velocity: {velocity: [0.0, 0.5, 0.0], duration: 0.5}}
  - {time: 9.0, follow: {file: course.csv, relative: true}}
  - {time: 14.0, land: {}}
"""
COURSE = 't,x,y,height\n0,0,0,1\n2,0.5,0,1\n4,0.5,0.5,1.2\n'


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp('commanded')
    (folder / 'course.csv').write_text(COURSE)
    (folder / 'mine.yaml').write_text(FILE)
    return folder / 'mine.yaml'


@pytest.fixture(scope='module')
def flown(file):
    """Return the scenario of the file and its flight."""
    flight = scenario_file.load(str(file))[1]
    return flight, closed_loop.fly(flight, inner=True)


@pytest.fixture(scope='module')
def bag(flown, tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'commanded'
    recording_to_bag.write(path, *flown)
    return path


def test_the_vehicle_does_what_the_commands_say(flown):
    _, r = flown
    phases = [phase for phase, before in zip(r.phase, [-1, *r.phase]) if phase != before]
    assert phases == [GROUND, TAKEOFF, TRACK, LANDING, LANDED]
    assert not r.truth[:200, :3].any() and not r.stopped.any()
    assert np.abs(r.truth[:, :3] - r.reference[:, :3]).max() < 0.2
    at_goal = np.searchsorted(r.t, 6 * 10**9)
    np.testing.assert_allclose(r.reference[at_goal, :3], (1.0, 0.5, -1.0), atol=1e-9)
    assert r.pwm[-1].max() == 0.0 and abs(r.truth[-1, 2]) < 0.05


def test_a_bag_holds_the_commands_and_they_give_the_flight_again(flown, bag):
    flight, r = flown
    recorded = commanded.commands_of(bag)
    assert recorded == script.parse(flight.reference_node.commands.script)
    assert [fc.NAMES[c.kind] for c in recorded] == [
        'takeoff', 'go_to', 'velocity', 'follow', 'land']
    again = closed_loop.fly(commanded.scenario_of(bag), inner=True)  # compiled already
    for name in ('reference', 'truth', 'pwm', 'phase'):
        assert np.array_equal(getattr(r, name), getattr(again, name)), name


def test_a_drone_of_a_hall_is_flown_again_alone(flown, bag, tmp_path):
    """Only reference and commands are of the recorded drone for certain."""
    flight, r = flown
    hall = formation.hall(flight, WorldParams(drones=2)).hall
    for space in hall.places:
        recording_to_bag.write(
            tmp_path / space[1:], flight, r, space, world_file.to_text(hall))
    two = tmp_path / 'mambo2'
    again = commanded.scenario_of(two)
    assert again == commanded.scenario_of(bag)
    line, = commanded.alone(two)
    assert line.startswith(f'{two}: /mambo2 shared its hall with other drones; they are absent')
    assert list(commanded.alone(bag)) == list(commanded.beyond(two, again)) == []
    with pytest.raises(InputError, match=f'a folder of bags.* such as {tmp_path}/mambo1'):
        commanded.scenario_of(tmp_path)


def test_a_flight_that_goes_on_after_its_recording_is_told(bag):
    flight = commanded.scenario_of(bag)
    end = flight.sim_node.duration
    assert list(commanded.beyond(bag, flight)) == []
    assert list(commanded.beyond(bag, override(flight, {'sim_node.duration': end + 3.0}))) == [
        f'{bag} ends at {end:.3f} s, and this flight at {end + 3.0:g} s: it has no command after '
        'the end of the recording, neither one of its scenario nor another']


def test_a_flight_without_commands_has_no_topic_of_them():
    plain = scenario(duration=1.0, land=False)
    assert {topic.name for topic in recording_to_bag.recorded(plain)} == {
        topic.name for topic in recording_to_bag.recorded(
            override(plain, {'reference_node.commands.enabled': True}))} - {'command'}


def test_other_bags_are_refused_in_one_line(flown, tmp_path):
    plain = override(flown[0], {'reference_node.commands.enabled': False})
    recording_to_bag.write(tmp_path / 'plain', plain, flown[1])
    assert 'command' not in ' '.join(read_bag(tmp_path / 'plain').attachments)
    with pytest.raises(InputError, match='is not a commanded flight, and no parameter changed'):
        commanded.scenario_of(tmp_path / 'plain')


HIGH = """title: high
flights:
  one: {commands: [{time: 1.0, takeoff: {height: 4.0}}]}
  other: {commands: [{time: 1.0, takeoff: {height: 3.5}}]}
"""


@pytest.mark.parametrize(('text', 'name'), [
    (HIGH, ''), (HIGH, ':other'),
    ('/mambo/reference_node:\n  ros__parameters:\n    commands: {enabled: true, '
     "script: '[{time: 1, takeoff: {height: 4}}]'}\n", '')])
def test_commands_are_judged_by_the_limits_of_the_command_line(tmp_path, capsys, text, name):
    file = tmp_path / 'high.yaml'
    file.write_text(text)
    words = [f'{file}{name}', '--print-scenario']
    assert fly.main(words) == 2
    assert 'm is outside [0.5, 3] m' in capsys.readouterr().err
    for ceiling, code in ((5, 0), (3.2, 2)):
        assert fly.main([*words, '--set', f'reference_node.commands.ceiling={ceiling}']) == code
        out, err = capsys.readouterr()
        assert 'ceiling: 5.0' in out if code == 0 else 'm is outside [0.5, 3.2] m' in err


def test_limits_of_the_command_line_may_also_be_lower_or_wrong(tmp_path, capsys):
    file = tmp_path / 'up.yaml'
    file.write_text(UP)
    for given, said in (
            ('commands.ceiling=0.8', 'height = 1 m is outside [0.5, 0.8] m'),
            ('commands.ceiling=5000', 'reference_node.commands.ceiling = 5000'),
            ('commands.ceilin=5', 'reference_node.commands.ceilin: unknown parameter'),
            ('vehicle.mass=0.2', 'takeoff')):
        assert fly.main([str(file), '--print-scenario', '--set', f'reference_node.{given}']) == 2
        err = capsys.readouterr().err
        assert said in err and err.count('\n') == 1


@pytest.mark.parametrize(('commands', 'words'), [
    ('{time: 1, takeoff: {height: 1}}', 'must be a list'),
    ('[{time: 1, takeof: {height: 1}}]', 'mine.yaml:2: commands: command 1: takeof'),
    ('[{time: 1, land: {}}]', 'mine.yaml: reference_node: land at t = 1 s'),
    ('[{time: 1, follow: {file: 3}}]', 'file must be the path'),
    ('[{time: 1, follow: {file: none.csv}}]', 'none.csv: No such file')])
def test_what_is_wrong_in_a_file_is_located(tmp_path, commands, words):
    path = tmp_path / 'mine.yaml'
    path.write_text(f'title: wrong\ncommands: {commands}\n')
    with pytest.raises(ParameterError) as error:
        scenario_file.load(str(path))
    assert words in str(error.value) and '\n' not in str(error.value)


UP = 'title: up\ncommands: [{time: 1, takeoff: {height: 1.0}}]\n'


@pytest.mark.parametrize(('lines', 'words'), [
    ('trajectory: circle', 'mine.yaml:3: trajectory: has no effect, as the flight is made by'),
    ('landing: false', 'mine.yaml:3: landing: has no effect'),
    ('parameters: {reference_node.plan.scale_rate: 0.5}',
     'mine.yaml:3: reference_node.plan.scale_rate: has no effect')])
def test_what_sets_a_flight_plan_is_refused(tmp_path, lines, words):
    path = tmp_path / 'mine.yaml'
    path.write_text(f'{UP}{lines}\n')
    with pytest.raises(ParameterError, match=words):
        scenario_file.load(str(path))
    path.write_text(f'{UP}duration: 20\nseed: 2\n')
    assert scenario_file.load(str(path))[1].reference_node.commands.enabled


def test_a_flight_plan_of_other_flights_in_the_file_stays(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('title: two\ntrajectory: hover\nflights:\n  still: {}\n'
                    '  up: {commands: [{time: 1, takeoff: {height: 1.0}}]}\n')
    asked = {'trajectory': scenario_file.Place('circle', '--trajectory')}
    found = scenario_file.load(f'{path}:still', asked)[1]
    assert found.reference_node.plan.trajectory == 'circle'
    assert scenario_file.load(f'{path}:up')[1].reference_node.commands.enabled
    with pytest.raises(ParameterError, match='^--trajectory: has no effect, as the flight is'):
        scenario_file.load(f'{path}:up', asked)


@pytest.mark.parametrize('words', [
    ['--trajectory', 'circle'], ['--stretch', '2'], ['--no-landing'],
    ['--set', 'reference_node.plan.scale_rate=0.5']])
def test_an_option_that_commands_leave_without_effect_is_refused(tmp_path, capsys, words):
    path = tmp_path / 'mine.yaml'
    path.write_text(UP)
    assert fly.main([str(path), *words, '--print-scenario']) == 2
    out, err = capsys.readouterr()
    assert not out and err.startswith(f'fly: {words[0]}') and 'is made by commands' in err


def test_a_vehicle_in_a_hand_takes_no_commands():
    with pytest.raises(ParameterError, match='a hand carries takes no commands'):
        override(scenario(carried=True), {'reference_node.commands.enabled': True})


def test_a_command_after_the_end_of_the_flight_is_said():
    flight = scenario(duration=5.0, overrides={
        'reference_node.commands.enabled': True,
        'reference_node.commands.script': '- {time: 6.0, takeoff: {height: 1.0}}'})
    assert list(commanded.late(flight)) == [
        'commands at t = 6 s or later have no effect: the flight ends at 5 s']
    assert list(commanded.late(override(flight, {'sim_node.duration': 6.5}))) == []
    assert list(commanded.late(override(flight, {'sim_node.duration': 0.0}))) == []  # no end


def test_a_course_to_follow_is_a_file_or_its_text(tmp_path, monkeypatch):
    from mambo_ros.commands import client
    monkeypatch.setattr(client, 'send', lambda name, drone, trajectory: trajectory)
    file = tmp_path / 'course.csv'
    file.write_text('t,x,y,height\n0,0,0,1\n5,1,0,1\n')
    text = commanded.send('follow', trajectory=str(file))
    assert text == commanded.send('follow', trajectory=file) == commanded.course_text(file)
    assert commanded.send('follow', trajectory=text) == text
    with pytest.raises(InputError, match='nope'):
        commanded.send('follow', trajectory='nope')


LOW = {
    'a low take-off': '- {time: 1.0, takeoff: {height: %(low)g}}',
    'a stop of a take-off': '- {time: 1.0, takeoff: {height: 1.0}}\n- {time: 1.35, stop: {}}',
    'a low goal': '- {time: 1.0, takeoff: {height: 1.0}}\n'
                  '- {time: 5.0, go_to: {goal: [0.5, 0.0, %(low)g]}}'}


@pytest.mark.parametrize('estimator', ['joint', 'kalman'])
@pytest.mark.parametrize('commands', LOW.values(), ids=LOW)
def test_a_hover_at_the_lowest_flight_stays_there(commands, estimator):
    """Lower, where the sonar is blind, every third or more sinks to the floor."""
    for seed in range(1, 6):
        plain = scenario(duration=40.0, land=False, seed=seed, estimator=estimator)
        low = plain.reference_node.commands.lowest
        r = closed_loop.fly(override(plain, {
            'reference_node.commands.enabled': True,
            'reference_node.commands.script': commands % {'low': low}}))
        hover = r.t > 10 * 10**9
        assert -r.reference[-1, 2] == pytest.approx(low)
        assert np.abs(r.truth[hover, 2] - r.reference[hover, 2]).max() < 0.05


TWICE = """
- {time: 1.0, takeoff: {height: 1.0}}
- {time: 4.0, land: {}}
- {time: 38.0, takeoff: {height: 1.0}}
- {time: 44.0, land: {}}
"""


@pytest.mark.parametrize('noise', [True, False])
@pytest.mark.parametrize('estimator, controller', [
    ('joint', 'flatness_drag'), ('joint', 'cascaded'), ('kalman', 'cascaded')])
def test_a_vehicle_that_has_waited_on_the_floor_takes_off_again(estimator, controller, noise):
    """Its estimate drifted by metres meanwhile: 6 of 20 and 20 of 20 flights ended early."""
    for seed in range(1, 7 if noise else 2):
        plain = scenario(duration=52.0, land=False, seed=seed, estimator=estimator,
                         controller=controller, noise=noise)
        r = closed_loop.fly(override(plain, {
            'reference_node.commands.enabled': True, 'reference_node.commands.script': TWICE}))
        assert not r.stopped.any() and not r.reason.any()
        assert np.abs(r.truth[:, :3] - r.reference[:, :3]).max() < 0.25
        waits = (r.t > 12 * 10**9) & (r.t < 38 * 10**9)
        lost = (r.truth - r.estimate)[waits][:, :3]
        assert np.ptp(lost, axis=0).max() < 0.02  # the barometer moves the height a little
        assert np.abs(lost).max() < 0.2
        assert (np.abs(lost) < 4.0 * np.sqrt(r.pose_variance[waits][:, :3])).all()


@pytest.mark.parametrize('estimator', ['joint', 'kalman'])
def test_a_gyro_that_was_stuck_while_it_aligned_is_no_danger(estimator):
    """Its 100 equal samples were taken for an exact bias: flights ended up to 80 m away."""
    for seed in range(1, 5):
        plain = scenario(duration=15.0, land=False, seed=seed, estimator=estimator)
        fault = 'sim_node.simulator.faults.gyro'
        r = closed_loop.fly(override(plain, {
            f'{fault}.kind': 'stuck', f'{fault}.start': 0.0, f'{fault}.duration': 0.5,
            'reference_node.commands.enabled': True,
            'reference_node.commands.script': '- {time: 1.0, takeoff: {height: 1.5}}'}))
        assert not r.reason.any()
        assert np.abs(r.truth[:, :3] - r.reference[:, :3]).max() < 0.5
