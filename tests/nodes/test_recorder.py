"""The recorder hears anything from anybody, and leaves a whole bag."""

import os
import struct
import time
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from mambo_bags import mcap_reader, writer
from mambo_bags.reader import bag_files, read_bag
from mambo_bags.recorder_node import RecorderNode
from mambo_bringup.domain import Domain
from mambo_bringup.flight.nodes import RECORDER
from mambo_bringup.processes import NodeProcess, parameter
from mambo_ros import cdr, messages, topics
from mambo_ros.graph import publisher_guard
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from tf2_msgs.msg import TFMessage

SECOND = 1_000_000_000  # ns
STEP = 5_000_000  # ns
FAR = 1_790_000_000 * SECOND
LARGE = 1_000_001


@pytest.fixture
def start(tmp_path):
    """Return what makes a recorder; it and its context end with the test."""
    rclpy.init()
    nodes = []

    def make(**given):
        nodes.append(RecorderNode(parameter_overrides=[
            Parameter(name, value=value)
            for name, value in {'bag': str(tmp_path / 'bag'), **given}.items()]))
        return nodes[-1], {entry.topic: entry.take for entry in nodes[-1].inputs}
    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def tf(stamp):
    frame = TransformStamped()
    frame.header.stamp = Time(sec=stamp // SECOND, nanosec=stamp % SECOND)
    return cdr.serialize(TFMessage(transforms=[frame]))


def diagnostics(stamp):
    out = DiagnosticArray()
    out.header.stamp = Time(sec=stamp // SECOND, nanosec=stamp % SECOND)
    return cdr.serialize(out)


def pwm(stamp):
    return messages.motor_pwm(stamp, (0.0,) * 4, False, 0)


def fly(take, steps, first=1):
    for k in range(first, first + steps):
        take[topics.CLOCK](messages.clock(k * STEP))
        take[topics.MOTOR_PWM](pwm(k * STEP))


def test_a_publisher_that_leaves_without_a_message_held_back_is_not_counted(start):
    node, take = start()
    commands = take[topics.MOTOR_PWM]
    node._forget(commands)
    assert not commands.refused
    commands(pwm(FAR), b'one')
    node._forget(commands)
    assert commands.refused == {publisher_guard.SECOND_PUBLISHER: 1}


def test_nobody_takes_over_from_the_nodes_of_a_flight_that_is_over(start, tmp_path, monkeypatch):
    wall = [0.0]
    monkeypatch.setattr(publisher_guard, 'time', SimpleNamespace(monotonic=lambda: wall[0]))
    node, take = start()
    clock, commands = take[topics.CLOCK], take[topics.MOTOR_PWM]
    there = {b'simulator', b'heir', b'stranger'}
    clock.publishers = commands.publishers = lambda: there

    def wait(publisher):
        """Let a publisher send garbage for a second."""
        for _ in range(10):
            wall[0] += 0.1
            commands(b'\xff' * 9, publisher)
    clock(messages.clock(1), b'simulator')
    commands(pwm(1), b'controller')
    for k in range(2, 12):  # the controller has left, the clock goes on
        wall[0] += 0.1
        clock(messages.clock(k), b'simulator')
        commands(pwm(k), b'heir')
    assert commands.first == b'heir'
    there -= {b'heir'}  # over; nobody has noticed yet that the simulator has left
    wait(b'stranger')
    there -= {b'simulator'}
    wait(b'stranger')
    for _ in range(10):
        wall[0] += 0.1
        clock(messages.clock(12), b'stranger')
    node.finish()
    bag = read_bag(tmp_path / 'bag')
    assert len(bag['/clock']) == 11 and set(bag['motor_pwm'].stamp.tolist()) <= set(range(12))
    assert commands.refused[publisher_guard.SECOND_PUBLISHER] > 20


def test_a_clock_that_has_left_before_any_flight_is_replaced(start, tmp_path, monkeypatch):
    wall = [0.0]
    monkeypatch.setattr(publisher_guard, 'time', SimpleNamespace(monotonic=lambda: wall[0]))
    node, take = start()
    clock = take[topics.CLOCK]
    clock.publishers = lambda: {b'simulator'}
    clock(messages.clock(-1), b'stranger')
    assert clock.is_deserted(1)
    wall[0] += publisher_guard.ABSENT + 0.01
    assert not clock.is_deserted(1)
    clock(messages.clock(1), b'simulator')
    take[topics.MOTOR_PWM](pwm(1), b'controller')
    node.finish()
    bag = read_bag(tmp_path / 'bag')
    assert bag['/clock'].stamp.tolist() == bag['motor_pwm'].stamp.tolist() == [1]
    assert clock.refused == {publisher_guard.SECOND_PUBLISHER: 1}


def test_what_a_publisher_sent_that_left_before_any_flight_is_not_recorded(
        start, tmp_path, monkeypatch):
    wall = [0.0]
    monkeypatch.setattr(publisher_guard, 'time', SimpleNamespace(monotonic=lambda: wall[0]))
    node, take = start()
    commands = take[topics.MOTOR_PWM]
    commands.publishers = lambda: {b'controller'}
    for _ in range(3):
        commands(pwm(7), b'stranger')
    assert commands.is_deserted(1)
    wall[0] += publisher_guard.ABSENT + 0.01
    assert not commands.is_deserted(1)
    commands(pwm(9), b'controller')
    take[topics.CLOCK](messages.clock(9))
    node.finish()
    assert read_bag(tmp_path / 'bag')['motor_pwm'].stamp.tolist() == [9]
    assert commands.refused[publisher_guard.SECOND_PUBLISHER] == 3


def test_a_bag_that_misses_messages_is_a_fault_of_its_recorder(start):
    node, take = start()
    take[topics.MOTOR_PWM](pwm(1), b'controller')
    take[topics.MOTOR_PWM].follow(1)
    assert not node.fault
    take[topics.MOTOR_PWM].follow(3)
    node.finish()
    assert node.fault == (
        f'/mambo/motor_pwm: the bag misses messages that were {publisher_guard.LOST}')


def test_samples_that_were_published_and_not_recorded_are_a_fault(start, tmp_path):
    node, take = start()
    for k in range(3):
        take[topics.CLOCK](messages.clock(k * STEP))
        take[topics.SENSOR_TICK](messages.sensor_tick(k * STEP, k + 1, 0, 0, 0))
    fly(take, 1, 3)
    node.finish()
    assert node.fault == (
        '/mambo/imu/data_raw: the bag has 0 of the 3 messages that were published')


@pytest.mark.parametrize('whole', [True, False])
def test_a_topic_of_every_step_that_ends_early_is_a_fault_but_in_a_replay(start, whole):
    node, take = start(whole=whole)
    fly(take, 2)  # a controller that ends by itself
    for k in range(3, 60):
        take[topics.CLOCK](messages.clock(k * STEP))
        if k < 5:
            take[topics.GROUND_TRUTH](pwm(k * STEP))
    node.finish()
    assert node.fault == whole * ('/mambo/ground_truth/odom: the bag has no message after '
                                  '0.020 s, and the flight went on to 0.295 s')


def test_a_stranger_s_command_before_the_first_is_not_recorded(start, tmp_path):
    """The node that decides has published its reference all the time, and no command yet."""
    node, take = start(topics=f'{topics.REFERENCE.name}, {topics.COMMAND.name}, /clock')
    own, stranger = b'of the reference', b'another process '
    take[topics.CLOCK](messages.clock(0))
    take[topics.REFERENCE](pwm(1), own)
    take[topics.COMMAND](pwm(2), stranger)
    take[topics.COMMAND](pwm(3), own[:12] + b'....')
    take[topics.COMMAND](pwm(4), stranger)
    node.finish()
    assert take[topics.COMMAND].refused == {publisher_guard.SECOND_PUBLISHER: 2}
    assert node._bag.counts['/mambo/command'] == 1 and not node.fault


HOSTILE = {
    'an empty /tf': (topics.TF, cdr.serialize(TFMessage())),
    'a /tf before time began': (topics.TF, tf(-5 * SECOND)),
    'a negative stamp': (topics.DIAGNOSTICS, diagnostics(-SECOND)),
    'a stamp of the wall clock': (topics.DIAGNOSTICS, diagnostics(FAR)),
    'a command from the future': (topics.MOTOR_PWM, pwm(FAR)),
    'a clock from the future': (topics.CLOCK, messages.clock(FAR)),
    'a clock before time began': (topics.CLOCK, messages.clock(-SECOND)),
    'nothing': (topics.IMU, b''), 'one byte': (topics.CLOCK, b'\0'),
    'a header alone': (topics.ESTIMATE, b'\0\1\0\0'),
    'another byte order': (topics.ESTIMATE, b'\0\0\0\0' + struct.pack('>iI', 3, 0)),
    'noise': (topics.REFERENCE, bytes(range(256)))}


@pytest.mark.parametrize('topic, data', HOSTILE.values(), ids=HOSTILE)
def test_any_message_is_recorded_within_the_flight_and_nothing_else_suffers(
        start, tmp_path, topic, data):
    node, take = start()
    fly(take, 600)
    take[topic](data)
    fly(take, 600, 601)
    node.finish()
    contents = mcap_reader.scan(tmp_path / 'bag/bag_0.mcap')
    assert contents.complete and contents.count == 2401
    bag = read_bag(tmp_path / 'bag')
    assert bag.start >= 0 and bag.end == 1200 * STEP
    assert data in bag[topic.name].raw
    own = bag['motor_pwm'] if topic is not topics.MOTOR_PWM else bag['/clock']
    np.testing.assert_array_equal(own.log_time, STEP * np.arange(1, 1201))
    assert node._bag.late == 0 and not node._bag._pending


def test_what_was_not_as_it_should_be_is_counted_in_one_line(start, monkeypatch):
    node, take = start()
    logged = {'info': [], 'warning': []}
    log = node.get_logger()
    for level, lines in logged.items():
        monkeypatch.setattr(log, level, lines.append, raising=False)
    monkeypatch.setattr(type(node), 'get_logger', lambda self: log)
    fly(take, 100)
    for _ in range(3):
        take[topics.TF](tf(FAR))
        take[topics.IMU](bytes(LARGE))
    node.finish()
    assert len(logged['warning']) == 2 and len(logged['info']) == 1
    assert '/tf: 3 with a stamp outside of the flight' in logged['info'][0]
    assert '/mambo/imu/data_raw: 3 of more than 1 MB, not recorded' in logged['info'][0]


def test_a_little_ahead_of_the_clock_is_not_ahead_of_the_end(start, tmp_path):
    node, take = start()
    fly(take, 600)
    take[topics.TF](tf(600 * STEP + 9 * SECOND))
    fly(take, 600, 601)
    assert node._bag.late == 0  # nor does it make the others late
    node.finish()
    assert node._bag.beyond == 1
    bag = read_bag(tmp_path / 'bag')
    assert bag.end == 1200 * STEP + writer.GRACE and len(bag['/tf']) == 1
    np.testing.assert_array_equal(bag['motor_pwm'].log_time, STEP * np.arange(1, 1201))


def test_what_comes_before_the_first_clock_waits_for_it(start, tmp_path):
    node, take = start()
    take[topics.MOTOR_PWM](pwm(STEP))
    take[topics.TF](tf(FAR))
    fly(take, 10)
    node.finish()
    bag = read_bag(tmp_path / 'bag')
    assert bag['motor_pwm'].log_time[0] == bag['/tf'].log_time[0] == STEP


def test_the_clock_is_heard_where_it_is_not_recorded(start, tmp_path):
    node, take = start(topics='motor_pwm')
    fly(take, 10)
    take[topics.MOTOR_PWM](pwm(FAR))
    node.finish()
    bag = read_bag(tmp_path / 'bag')
    assert list(bag.topics) == ['/mambo/motor_pwm'] and bag.end == 10 * STEP


def test_without_any_clock_the_machine_s_own_bounds_the_stamps(start, tmp_path):
    node, take = start(topics='motor_pwm')
    for k in range(10):
        take[topics.MOTOR_PWM](pwm(k * STEP))
    node.finish()
    bag = read_bag(tmp_path / 'bag')
    assert len(bag['motor_pwm']) == 10 and bag.end - bag.start < 60 * SECOND


def test_a_flood_from_ahead_does_not_stay_in_memory(start, tmp_path, monkeypatch):
    monkeypatch.setattr(writer, 'PENDING_LIMIT', 1_000_000)
    node, take = start()
    fly(take, 600)
    most = 0
    for k in range(200):
        take[topics.REFERENCE](pwm(600 * STEP + 9 * SECOND) + bytes(50_000))
        fly(take, 1, 601 + k)
        most = max(most, node._bag._pending_size)
    assert most < 1_100_000
    node.finish()
    contents = mcap_reader.scan(tmp_path / 'bag/bag_0.mcap')
    assert contents.complete and contents.count == 2 * 800 + 200
    bag = read_bag(tmp_path / 'bag')
    assert bag.end == 800 * STEP + writer.GRACE
    np.testing.assert_array_equal(bag['/clock'].log_time, STEP * np.arange(1, 801))


def test_a_full_disk_ends_the_recorder_with_one_line(start, tmp_path, monkeypatch):
    node, take = start()
    errors = []
    log = node.get_logger()
    monkeypatch.setattr(type(node), 'get_logger', lambda self: log)
    monkeypatch.setattr(log, 'error', errors.append, raising=False)
    fly(take, 600)
    full = os.open('/dev/full', os.O_WRONLY)
    node._bag._stream.flush()
    os.dup2(full, node._bag._stream.fileno())
    with pytest.raises(SystemExit) as ended:
        fly(take, 1200, 601)
    node.finish()
    assert ended.value.code == 1 and len(errors) == 1
    assert 'No space left on device' in errors[0] and 'recover' in errors[0]


@pytest.mark.parametrize('name', ["it's", 'a: b', ' # no comment', 'two\nlines', '"quoted" {[,]}',
                                  '\N{GRINNING FACE} \\n %YAML'])
def test_any_name_of_a_bag_comes_to_the_recorder_as_it_is(tmp_path, name):
    with Domain():
        recorder = NodeProcess(*RECORDER, ['--ros-args', *parameter('bag', tmp_path / name)])
        limit = time.monotonic() + 100.0
        while not (tmp_path / name / 'metadata.yaml').exists() and time.monotonic() < limit:
            assert recorder.exit_code is None, recorder.lines
            time.sleep(0.05)
        assert recorder.end(60.0) == 0, recorder.lines
    assert [path.name for path in tmp_path.iterdir()] == [name]
    files, _ = bag_files(tmp_path / name)
    assert files == [tmp_path / name / f'{name}_0.mcap']


def test_a_signal_while_the_recorder_begins_leaves_a_closed_bag(start, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt
    monkeypatch.setattr(writer.BagWriter, 'add_topic', interrupt)
    with pytest.raises(KeyboardInterrupt):
        start()
    assert 'state: recording' not in (tmp_path / 'bag' / 'metadata.yaml').read_text()
