"""A process that never goes on: named, killed, its bag closed."""

import os
from pathlib import Path
import shutil
import signal
from types import SimpleNamespace

from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_bringup import stuck
from mambo_flight.scenario import Scenario
from mambo_model.components import Component
import pytest


@pytest.fixture
def component(monkeypatch, tmp_path):
    """Return a function that has the controller node fly a component."""
    def choose(compiled):
        path = tmp_path / 'mine.py'
        found = Component('mine', object, len, len, compiled, path=path)
        monkeypatch.setattr(stuck, 'own_components', lambda params: (
            [found] if params == Scenario().controller_node else []))
        return path
    return choose


def test_a_killed_node_names_its_compiled_step(component):
    path = component(True)
    assert stuck.stuck(Scenario(), ['controller_node', 'estimator_node', 'recorder_node']) == (
        f'controller_node had to be killed: the compiled step of {path} may never end')


@pytest.mark.parametrize('killed', [[], ['estimator_node'], ['recorder_node'], ['sim_node']])
def test_other_nodes_say_nothing(component, killed):
    component(True)
    assert not stuck.stuck(Scenario(), killed)


def test_plain_python_can_be_interrupted(component):
    component(False)
    assert not stuck.stuck(Scenario(), ['controller_node'])


def test_composed_nodes_stand_for_all_of_them(monkeypatch, tmp_path):
    found = Component('mine', object, len, len, True, path=tmp_path / 'mine.py')
    monkeypatch.setattr(stuck, 'own_components', lambda params: [found])
    assert 'composed_node had to be killed: the compiled step of ' in stuck.stuck(
        Scenario(), ['composed_node'])


@pytest.mark.parametrize('compiled', [False, True])
def test_who_runs_in_a_process_that_ended_without_a_reason_is_named(component, compiled):
    path = component(compiled)
    assert stuck.guests(Scenario(), ['controller_node', 'sim_node', 'recorder_node']) == (
        f'{path}, or code that it calls, may have ended controller_node')
    assert stuck.guests(Scenario(), ['sim_node']) == ''


class Child:
    """A process that takes signals."""

    label = name = 'composed_node'

    def __init__(self):
        self.signals, self.worked = [], 0.0

    def cpu(self):
        return self.worked

    def send(self, number):
        self.signals.append(number)


@pytest.fixture
def clock(monkeypatch):
    """Return the wall time, as a list of one number that the test changes."""
    now = [100.0]
    monkeypatch.setattr(stuck.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(stuck, 'own_compiled', lambda flight: ['a component'])
    return now


def test_composed_nodes_that_stand_still_are_killed(clock):
    child = Child()
    silence, limit = stuck.Silence(Scenario(), child), 40.0  # 30 s of patience, and 10
    for lines in (1, 2, 3):
        clock[0] += 0.9 * limit
        assert silence.kill(True, False, lines) == ''  # each line counts anew
    clock[0] += 1.1 * limit
    assert silence.kill(True, False, 3) == 'composed_node did nothing for 40 s'
    assert child.signals == [signal.SIGKILL]


def test_a_process_that_loads_or_closes_its_bag_is_left_alone(clock):
    child = Child()
    silence = stuck.Silence(Scenario(), child)
    for _ in range(20):
        clock[0] += 1.1 * stuck.ASLEEP
        child.worked += 1.1 * stuck.AWAKE
        assert silence.kill(False, False, 5) == ''
    clock[0] += 1.0
    assert silence.kill(True, False, 6) == ''
    clock[0] += 1000.0
    assert silence.kill(True, True, 6) == '' and not child.signals


def test_a_process_that_neither_begins_nor_works_is_killed(clock, monkeypatch):
    monkeypatch.setattr(stuck, 'own_compiled', lambda flight: [])
    child = Child()
    silence = stuck.Silence(Scenario(), child)
    for count in range(3):  # it waits for others
        clock[0] += 0.9 * stuck.ASLEEP
        assert silence.kill(False, False, count) == ''
    clock[0] += 1.1 * stuck.ASLEEP
    child.worked = 0.9 * stuck.AWAKE  # what threads of the middleware take
    assert silence.kill(False, False, 2) == 'composed_node did nothing for 60 s'
    assert child.signals == [signal.SIGKILL]


def test_built_in_nodes_are_left_alone(clock, monkeypatch):
    monkeypatch.setattr(stuck, 'own_compiled', lambda flight: [])
    silence = stuck.Silence(Scenario(), Child())
    clock[0] += 1000.0
    assert silence.kill(True, False, 0) == ''


def test_the_bag_of_a_killed_recorder_is_closed_in_its_place(tmp_path):
    bag = tmp_path / 'bag'
    shutil.copytree(Path(__file__).parents[3] / 'bags/circle_short', bag)
    file = next(bag.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[:file.stat().st_size // 2])  # the index is at the end
    (bag / 'metadata.yaml').unlink(missing_ok=True)
    assert not stuck.is_closed(bag)
    assert stuck.closed_again(bag) and stuck.is_closed(bag)
    assert len(read_bag(bag)['motor_pwm']) > 100
    assert list(tmp_path.iterdir()) == [bag]


@pytest.mark.parametrize('said, pid, own', [
    ([], os.getpid(), True), ([], 1, False),
    (['recorder_node: bag: {bag} exists: give another name or remove it (a bag is never '
      'overwritten)'], os.getpid(), False),
    (['recorder_node: bag: {bag}2 exists: give another name or remove it (a bag is never '
      'overwritten)'], os.getpid(), True)])
def test_a_bag_that_another_flight_records_is_not_taken_for_ones_own(tmp_path, said, pid, own):
    bag = tmp_path / 'bag'
    node = SimpleNamespace(pid=pid, lines=[line.format(bag=bag) for line in said])
    assert not stuck.is_own(bag, [node])
    with BagWriter(bag) as writer:
        assert stuck.is_own(bag, iter([node])) is own
        writer.add_topic('/mambo/motor_pwm', 'mambo_interfaces/msg/MotorPwm')


def test_a_bag_on_a_full_disk_is_left_as_it_is(tmp_path, small_disk):
    bag = tmp_path / 'bag'
    shutil.copytree(Path(__file__).parents[3] / 'bags/circle_short', bag)
    small_disk(10_000)
    assert not stuck.closed_again(bag)
    assert list(tmp_path.iterdir()) == [bag] and len(list(bag.glob('*.mcap'))) == 1


def test_an_empty_bag_is_not_closed(tmp_path):
    (tmp_path / 'bag').mkdir()
    assert not stuck.closed_again(tmp_path / 'bag')
    assert list(tmp_path.iterdir()) == [tmp_path / 'bag']


def test_a_bag_that_would_take_long_is_left_to_the_user(tmp_path, monkeypatch):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag/bag_0.mcap').write_bytes(bytes(100))
    monkeypatch.setattr(stuck, 'LARGEST', 99)
    monkeypatch.setattr(stuck, 'recover', lambda *_: pytest.fail('tried'))
    assert not stuck.closed_again(tmp_path / 'bag')


def test_the_metadata_says_whether_a_bag_is_closed(tmp_path):
    assert not stuck.is_closed(tmp_path)
    for text, closed in (('custom_data:\n    state: recording\n', False),
                         ('custom_data: null\n', True)):
        (tmp_path / 'metadata.yaml').write_text(text)
        assert stuck.is_closed(tmp_path) is closed
