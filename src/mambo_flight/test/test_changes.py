"""Parameters that change in flight: of a scenario file, in one process, of a bag."""

import os
import subprocess
import sys

from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriterError
from mambo_flight import changes, closed_loop, commanded, recording_to_bag, scenario_file
from mambo_flight.scenario import override, scenario
from mambo_model.schema import ParameterError
import numpy as np
import pytest

pytestmark = pytest.mark.long

FILE = """
title: softer, then noisy
duration: 3.0
landing: false
changes:
  - {time: 1.2, set: {controller_node.cascaded.k_p: 2, sim_node.simulator.sonar.noise: 0.1}}
  - {time: 1.5, set: {sim_node.simulator.imu.gyro_noise: [0.1, 0.1, 0.1]}}
  - {time: 1.501, set: {controller_node.cascaded.K_nu: 3.5}}
  - {time: 9.0, set: {controller_node.cascaded.K_nu: 3.0}}
"""


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """Return the scenario of the file and its flight."""
    path = tmp_path_factory.mktemp('changes') / 'mine.yaml'
    path.write_text(FILE)
    flight = scenario_file.load(str(path))[1]
    return flight, closed_loop.fly(flight, inner=True)


@pytest.fixture(scope='module')
def bag(flown, tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'changed'
    recording_to_bag.write(path, *flown)
    return path


def test_a_change_counts_from_its_step_and_no_earlier(flown):
    flight, r = flown
    plain = closed_loop.fly(override(flight, {  # compiled already, and nothing changes
        'controller_node.changes': '- {time: 0.0, set: {cascaded.k_p: 2.6}}',
        'sim_node.changes': ''}), inner=True)
    assert np.array_equal(r.pwm[:240], plain.pwm[:240]) and (r.pwm[240] != plain.pwm[240]).any()
    differences = np.diff(r.imu[:, 0])  # of white noise: sqrt(2) as large
    assert differences[250:298].std() < 0.1 < 0.12 < differences[301:].std() < 0.17


def test_times_between_steps_count_from_the_next_and_later_ones_never(flown):
    assert [(one.k, one.node) for one in changes.taken(flown[0], len(flown[1].t))] == [
        (240, 'controller_node'), (240, 'sim_node'), (300, 'sim_node'), (301, 'controller_node')]


def test_a_bag_holds_them_and_they_give_the_flight_again(flown, bag):
    again = closed_loop.fly(commanded.scenario_of(bag), inner=True)
    for name in ('truth', 'pwm', 'imu', 'sonar'):
        assert np.array_equal(getattr(flown[1], name), getattr(again, name), equal_nan=True), name


def test_the_messages_state_the_noise_that_they_have(bag):
    found = read_bag(bag, ('imu/data_raw',))['imu/data_raw']['angular_velocity_covariance'][:, 0]
    assert found[299] < 1e-3 and found[300] == 0.1 * 0.1


def test_faults_that_begin_in_flight_need_the_graph(flown):
    quiet = override(flown[0], {'sim_node.simulator.faults.changeable': True})
    recording_to_bag.check(quiet)
    with pytest.raises(BagWriterError, match=r'faults\.sonar\.kind = missing: .* needs the graph'):
        recording_to_bag.check(override(quiet, {'sim_node.changes': (
            '- {time: 1.0, set: {simulator.faults.sonar.kind: missing}}')}))


def test_wind_can_rise_and_fall_where_the_flight_says_so(flown):
    script = ('- {time: 1.0, set: {simulator.wind.velocity: [2.0, 0.0, 0.0]}}\n'
              '- {time: 2.0, set: {simulator.wind.velocity: [0.0, 0.0, 0.0]}}\n')
    with pytest.raises(ParameterError, match='start the flight with sim_node.simulator.wind.ch'):
        override(flown[0], {'sim_node.changes': script})
    windy = override(flown[0], {
        'controller_node.changes': '', 'sim_node.changes': script,
        'sim_node.simulator.wind.changeable': True})
    assert [one.params.simulator.wind.values() is None for one in changes.taken(windy)] == [
        False, False]


WINDY = """
from mambo_flight import closed_loop, scenario
found = [closed_loop.fly(scenario.scenario(
    duration=4.0, land=False, estimator='ground_truth', noise=False, overrides={
        'sim_node.simulator.wind.changeable': True, 'sim_node.changes':
            f'- {{time: 2.5, set: {{simulator.wind.velocity: [0.0, {speed}, 0.0]}}}}'}))
    for speed in (0.0, 2.0)]
aside = found[1].truth[:, 1] - found[0].truth[:, 1]
assert not aside[:501].any() and aside[501] > 0.0 and aside[-1] > 0.01, aside[[500, 501, -1]]
"""


def test_wind_that_rises_carries_the_vehicle_along_from_its_step_on():
    done = subprocess.run(  # not worth compiling
        [sys.executable, '-c', WINDY], env={**os.environ, 'NUMBA_DISABLE_JIT': '1'},
        capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(('entries', 'words'), [
    ('{time: 1, set: {a: 1}}', 'mine.yaml:3: changes: must be a list'),
    ('[{time: 1, set: {speed: 1}}]', 'mine.yaml:3: changes: speed: unknown parameter'),
    ('[{time: 1, set: {reference_node.vehicle.mass: 1}}]', 'cannot be changed in flight: it is'),
    ('[{time: 1, set: {controller_node.cascaded.k_q: 1}}]', 'k_q: unknown parameter; did'),
    ('[{time: 1, set: {controller_node.cascaded.k_p: 30.0}}]',
     'mine.yaml:3: controller_node.changes: at t = 1 s: cascaded.k_p = 30.0 m/s^2 is outside'),
    ('[{time: 1, set: {controller_node.cascaded.k_p: 3.0, controller_node.cascaded.k_p: 2.0}}]',
     'mine.yaml:3: controller_node.cascaded.k_p: duplicate key'),
    (f'[{{time: {"9" * 5000}, set: {{controller_node.cascaded.k_p: 3.0}}}}]',
     'mine.yaml:3: changes: Exceeds the limit'),
    ('[{time: 1, set: {controller_node.cascaded.k_p: 2020-01-01}}]', 'must be a number, true')])
def test_what_is_wrong_in_a_file_is_located(tmp_path, entries, words):
    path = tmp_path / 'mine.yaml'
    path.write_text(f'title: wrong\ncontroller: cascaded\nchanges: {entries}\n')
    with pytest.raises(ParameterError) as error:
        scenario_file.load(str(path))
    assert words in str(error.value) and '\n' not in str(error.value)


@pytest.mark.parametrize(('second', 'refused'), [
    ('{time: 1.199, set: {controller_node.cascaded.k_p: 3}}', True),  # of the same step
    ('{time: 1.2, set: {controller_node.cascaded.k_p: 2.0}}', False),
    ('{time: 1.2, set: {controller_node.cascaded.K_nu: 3}}', False),
    ('{time: 1.205, set: {controller_node.cascaded.k_p: 3}}', False)])
def test_two_values_at_one_time_are_refused(tmp_path, second, refused):
    path = tmp_path / 'mine.yaml'
    both = ['{time: 1.2, set: {controller_node.cascaded.k_p: 2}}', second]
    both.sort()
    path.write_text(f'title: two\nchanges: [{", ".join(both)}]\n')
    if not refused:
        scenario_file.load(str(path))
        return
    with pytest.raises(ParameterError) as error:
        scenario_file.load(str(path))
    assert str(error.value) == (
        f'{path}:2: changes: controller_node.cascaded.k_p: is set to 3 and 2 at t = 1.2 s: leave '
        'one out')


def test_a_change_after_the_end_of_the_flight_is_said():
    later = scenario(duration=5.0, overrides={
        'controller_node.changes': '- {time: 5.0, set: {cascaded.k_p: 2.6}}'})
    assert list(changes.late(override(later, {'sim_node.duration': 5.5}))) == []
    assert list(changes.late(later)) == [
        'changes of controller_node at t = 5 s or later have no effect: the flight ends at 5 s']
    assert list(changes.late(override(later, {'sim_node.duration': 0.0}))) == []  # without end


@pytest.mark.parametrize('fault, end, said', [
    ({'start': 4.0}, 5.0, ''),
    ({'start': 5.0}, 5.0, 'it begins at 5 s, and the flight ends at 5 s'),
    ({'start': 100.0}, 5.0, 'it begins at 100 s'), ({'start': 100.0}, 0.0, ''),
    ({'duration': 0.0, 'start': 1.0}, 5.0, 'its duration is 0'),
    ({'share': 0.0, 'start': 1.0}, 5.0, 'its share is 0')])
def test_a_fault_that_never_happens_is_told(fault, end, said):
    flight = override(scenario(duration=5.0), {
        'sim_node.duration': end, 'sim_node.simulator.faults.sonar.kind': 'stuck',
        **{f'sim_node.simulator.faults.sonar.{name}': x for name, x in fault.items()}})
    lines = list(changes.idle_faults(flight))
    begin = 'the fault of sim_node.simulator.faults.sonar never happens: '
    assert len(lines) == bool(said) and all(
        line.startswith(f'{begin}{said}') for line in lines), lines
    assert not list(changes.idle_faults(scenario(duration=5.0)))
