"""Checks on the messages of one input, alone and in a node."""

import ast
from dataclasses import dataclass
import math
from pathlib import Path
import struct
import time

from mambo_model import schema
from mambo_model.vehicle.parameters import Vehicle
from mambo_ros import input_guard, messages, topics
from mambo_ros.graph import publisher_guard
from mambo_ros.input_guard import InputGuard
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
import pytest
from rclpy.duration import Duration
import rclpy.node
from rclpy.qos import LivelinessPolicy, QoSProfile, ReliabilityPolicy
from ros_helpers import until

STEP = 5_000_000  # ns
FUTURE = 1_795_307_261_000_000_000  # ns, a wall clock
STILL = (0.0,) * 4


class Input:
    """Motor commands as they come in, at a time of the flight; publishers in the graph."""

    def __init__(self, **bounds):
        self.used, self.now, self.present = [], 0, set()
        bounds.setdefault('now', lambda: self.now)
        self.guard = InputGuard(
            '/mambo/motor_pwm', messages.decode_motor_pwm,
            lambda t, pwm, shutdown: self.used.append((t // STEP, pwm[0])),
            check=lambda command: input_guard.finite(command[1]), **bounds)
        self.guard.publishers = lambda: self.present

    def send(self, k, publisher=b'', pwm=1.0, t=None):
        self.guard(
            messages.motor_pwm(k * STEP if t is None else t, (pwm,) * 4, False, 0), publisher)

    @property
    def steps(self):
        return [k for k, _ in self.used]

    @property
    def refused(self):
        return dict(self.guard.refused)


def test_a_stamp_of_the_future_is_refused_and_what_follows_is_not():
    one = Input()
    one.send(0)
    one.send(0, t=FUTURE)
    one.now = STEP
    one.send(1)
    assert one.steps == [0, 1]
    assert one.refused == {input_guard.AHEAD: 1}


@pytest.mark.parametrize('order', ['<', '>'])
def test_a_message_of_another_frame_is_refused(order):
    one = Input(frames=('m1/odom', 'odom', ''), now=None)
    for k, name in enumerate(['odom', 'map', 'm1/odom', 'odo', 'odom2', '', 'm2/odom', 'odom']):
        head = struct.pack(f'{order}iII', 0, k, len(name) + 1) + name.encode() + b'\0'
        message = b'\0' + bytes([order == '<']) + b'\0\0' + head
        one.guard._decode = lambda _, k=k: (k * STEP, (1.0,), False)
        one.guard(message)
    assert one.steps == [0, 2, 5, 7] and one.refused == {'frame is not m1/odom': 4}
    one.guard._decode = lambda _: (8 * STEP, (1.0,), False)
    one.guard(b'\0\1\0\0' + struct.pack('<iII', 0, 8, 0))  # without the end of a text
    assert one.steps[-1] == 8


def test_a_stamp_may_be_ahead_by_the_allowance_and_no_more():
    one = Input(ahead=STEP)
    one.send(1)
    one.send(0, t=STEP + STEP + 1)
    assert one.steps == [1] and one.refused == {input_guard.AHEAD: 1}


def test_before_a_stamp_is_refused_waiting_clock_messages_are_handled():
    clock = InputGuard('/clock', messages.decode_clock, lambda t: None)
    one = Input(now=clock, ahead=STEP)
    clock(messages.clock(0))
    clock.pull = lambda: clock(messages.clock(9 * STEP))
    one.send(10)
    one.send(0, t=12 * STEP + input_guard.LEAP)
    assert one.steps == [10] and one.refused == {input_guard.AHEAD: 1}


def test_one_message_waits_for_a_clock_that_is_late():
    clock = InputGuard('/clock', messages.decode_clock, lambda t: None)
    one = Input(now=clock, ahead=STEP)
    clock(messages.clock(0))
    one.send(1)
    one.send(5)  # gives way to the next
    one.send(4)
    assert one.steps == [1] and one.refused == {input_guard.AHEAD: 1}
    clock(messages.clock(2 * STEP))
    assert one.steps == [1]
    clock(messages.clock(3 * STEP))
    assert one.steps == [1, 4]
    one.send(5)
    clock(messages.clock(4 * STEP))
    assert one.steps == [1, 4, 5] and one.refused == {input_guard.AHEAD: 1}


def test_nobody_becomes_the_accepted_publisher_by_waiting():
    clock = InputGuard('/clock', messages.decode_clock, lambda t: None)
    one = Input(now=clock, ahead=STEP)
    clock(messages.clock(0))
    one.send(4, publisher=b'stranger')
    clock(messages.clock(4 * STEP))
    assert one.steps == [] and one.refused == {input_guard.AHEAD: 1}


@pytest.mark.parametrize('t, reason', [
    (3 * STEP, input_guard.BEHIND), (2 * STEP, input_guard.BEHIND), (-1, input_guard.NEGATIVE),
    ((2**31 - 1) * 10**9, input_guard.MALFORMED)])  # the second after it has no stamp
def test_a_stamp_that_is_not_new_is_refused(t, reason):
    one = Input()
    one.now = 4 * STEP
    one.send(3)
    one.send(0, t=t)
    assert one.steps == [3] and one.refused == {reason: 1}


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused_or_only_counted(value):
    strict, tolerant = Input(), Input(tolerant=True)
    for one in (strict, tolerant):
        one.send(0, pwm=value)
        assert one.refused == {input_guard.NOT_FINITE: 1}
    assert strict.steps == [] and tolerant.steps == [0]


def test_a_state_has_finite_numbers_only():
    assert input_guard.check_state((5, ((1.0, 2.0), (3.0,)), math.nan)) == ''
    assert input_guard.check_state((5, ((1.0, 2.0), (math.nan,)))) == input_guard.NOT_FINITE


GOOD = messages.motor_pwm(0, STILL, False, 0)


@pytest.mark.parametrize('data, reason', [
    (b'', input_guard.MALFORMED), (b'\x00', input_guard.MALFORMED),
    (GOOD[:-9], input_guard.MALFORMED),
    (b'\xff' * len(GOOD), input_guard.MALFORMED),
    (GOOD[:12] + struct.pack('<I', 0xfffffff0) + GOOD[16:], input_guard.MALFORMED),  # frame name
    (GOOD[:12] + struct.pack('<I', 5_000_000) + b'x' * 5_000_000, input_guard.TOO_LARGE)])
def test_bytes_that_are_no_message_are_refused(data, reason):
    one = Input()
    one.guard(data)
    one.send(0)
    assert one.steps == [0] and one.refused == {reason: 1}


def test_a_header_that_is_cut_off_is_malformed_where_only_the_stamp_is_read():
    from mambo_ros import cdr
    for length in range(12):
        guard = InputGuard('/x', lambda data: (cdr.stamp_ns(data),), lambda t: None)
        guard(GOOD[:length])
        assert guard.refused == {input_guard.MALFORMED: 1}


class TestClock:
    """An input that is the clock of its node."""

    @pytest.fixture
    def clock(self):
        one = Input(now=None)
        one.send(0)
        return one

    def test_one_far_stamp_does_not_block_it(self, clock):
        clock.send(0, t=FUTURE)
        clock.send(1)
        assert clock.steps == [0, 1] and clock.refused == {input_guard.AHEAD: 1}

    def test_a_leap_is_accepted_when_enough_messages_continue_from_it(self, clock):
        for k in range(input_guard.CONFIRMATIONS + 1):
            clock.send(10_000 + k)
            if k < input_guard.CONFIRMATIONS - 1:
                assert clock.steps == [0]
        assert clock.steps == [0, *range(10_000, 10_011)] and not clock.refused

    def test_messages_of_a_leap_that_ends_are_refused_and_do_not_confirm_another(self, clock):
        for k in range(input_guard.CONFIRMATIONS - 1):
            clock.send(10_000 + k)
        for k in range(input_guard.CONFIRMATIONS - 1):
            clock.send(50_000 + k)
        assert clock.steps == [0]
        clock.send(1)
        assert clock.steps == [0, 1]
        assert clock.refused == {input_guard.AHEAD: 2 * input_guard.CONFIRMATIONS - 2}

    def test_a_clock_that_runs_backwards_behind_a_leap_confirms_nothing(self, clock):
        for k in range(3 * input_guard.CONFIRMATIONS):
            clock.send(10_000 - k)
        assert clock.steps == [0]

    def test_a_leap_that_the_flight_contradicts_is_never_accepted(self, clock):
        for k in range(1, 4 * input_guard.CONFIRMATIONS):
            clock.send(k)
            clock.send(10_000 + k)
        assert clock.steps == list(range(4 * input_guard.CONFIRMATIONS))


class TestPublishers:
    """Messages are accepted by their publisher and its presence in the graph."""

    FIRST, SECOND = b'1' * 16, b'2' * 16

    @pytest.fixture
    def one(self):
        one = Input()
        one.now, one.present = 10_000 * STEP, {self.FIRST, self.SECOND}
        one.send(0, self.FIRST)
        return one

    @pytest.fixture
    def wall(self, monkeypatch):
        wall = [100.0]
        monkeypatch.setattr(publisher_guard.time, 'monotonic', lambda: wall[0])
        return wall

    def test_every_message_of_a_second_publisher_is_refused(self, one):
        for k in range(1, 20):
            one.send(k, self.SECOND, pwm=500.0)
            one.send(k, self.FIRST)
        assert one.used == [(k, 1.0) for k in range(20)]
        assert one.refused == {publisher_guard.SECOND_PUBLISHER: 19}

    def test_a_publisher_of_unusable_messages_does_not_become_the_first(self):
        one = Input()
        one.present = {self.FIRST, self.SECOND}
        one.send(0, self.SECOND, pwm=math.nan)
        one.send(0, self.SECOND, t=FUTURE)
        one.send(0, self.FIRST)
        one.now = STEP
        one.send(1, self.SECOND, pwm=500.0)
        one.send(1, self.FIRST)
        assert one.used == [(0, 1.0), (1, 1.0)]
        assert one.refused == {
            input_guard.NOT_FINITE: 1, input_guard.AHEAD: 1, publisher_guard.SECOND_PUBLISHER: 1}

    def test_a_refused_message_of_the_first_leaves_it_the_first(self, one):
        one.send(1, self.FIRST, pwm=math.nan)
        one.send(1, self.SECOND, pwm=500.0)
        one.send(2, self.FIRST)
        assert one.used == [(0, 1.0), (2, 1.0)]

    def test_another_takes_over_when_the_first_has_left_the_graph(self, one, wall):
        one.present = {self.SECOND}
        one.send(1, self.SECOND)
        assert one.steps == [0]
        wall[0] += 1.1 * publisher_guard.ABSENT
        one.send(2, self.SECOND)
        one.send(3, self.SECOND)
        assert one.steps == [0, 2, 3] and one.refused == {publisher_guard.SECOND_PUBLISHER: 1}

    @pytest.mark.parametrize('begun, steps', [(False, [3, 0, 1]), (True, [3, 4])])
    def test_one_that_left_before_the_flight_leaves_no_stamp(self, begun, steps, wall):
        one = Input()
        one.now, one.present = (10 * STEP if begun else -1), {self.FIRST, self.SECOND}
        one.send(3, self.FIRST)
        one.present = {self.SECOND}
        one.send(0, self.SECOND)
        wall[0] += 1.1 * publisher_guard.ABSENT
        for k in (0, 1, 4) if begun else (0, 1):
            one.send(k, self.SECOND)
        assert one.steps == steps

    def test_a_first_publisher_not_yet_in_the_graph_keeps_its_place(self, one, wall):
        one.present = {self.SECOND}
        one.send(1, self.SECOND)
        wall[0] += 0.9 * publisher_guard.ABSENT
        one.present = {self.FIRST, self.SECOND}
        one.send(1, self.SECOND)
        wall[0] += 10.0 * publisher_guard.ABSENT
        one.send(1, self.SECOND)
        one.send(1, self.FIRST)
        assert one.steps == [0, 1] and one.refused == {publisher_guard.SECOND_PUBLISHER: 3}

    def test_the_graph_is_not_queried_for_every_message_of_a_flood(self, one, wall):
        asked = []
        one.guard.publishers = lambda: asked.append(1) or one.present
        for _ in range(1000):
            one.send(1, self.SECOND)
            wall[0] += 0.0001
        assert len(asked) <= 2


@dataclass(frozen=True)
class NoParams:
    """Nothing to set."""


class TestInTheGraph:
    """A guarded input of a node, with real publishers."""

    @pytest.fixture
    def graph(self, ros):
        """
        Return a node with a guarded input, with its loop and lists of its messages and warnings.
        """
        made = MamboNode('listener', NoParams)
        made.used, made.warned, made.reported = [], [], []
        made.get_logger = lambda: made
        made.warning = made.warned.append
        made.guard = made.accept(
            topics.MOTOR_PWM, messages.decode_motor_pwm, lambda t, *_: made.used.append(t))
        made.outputs[0].local.append(made.reported.append)
        loop = Loop(made)
        yield made, loop
        loop.close()

    def other(self, name, reliability=ReliabilityPolicy.RELIABLE):
        outsider = rclpy.node.Node(name, namespace='mambo')
        return outsider.create_publisher(
            topics.MOTOR_PWM.msg_type, topics.MOTOR_PWM.name,
            QoSProfile(depth=100, reliability=reliability))  # the fixture ends its node

    def test_the_first_of_two_publishers_is_used_and_both_are_named(self, graph):
        node, loop = graph
        first, second = self.other('first'), self.other('second')
        until(lambda: first.get_subscription_count() and second.get_subscription_count(), 'links',
              lambda: loop.once(0.01))
        for k in range(5):
            first.publish(messages.motor_pwm(k * STEP, STILL, False, 0))
        until(lambda: len(node.used) == 5, 'the first', lambda: loop.once(0.01))
        second.publish(messages.motor_pwm(5 * STEP, STILL, False, 0))
        until(lambda: node.reported, 'the report', lambda: loop.once(0.01))
        first.publish(messages.motor_pwm(6 * STEP, STILL, False, 0))
        until(lambda: len(node.used) == 6, 'the first again', lambda: loop.once(0.01))
        assert node.used[-1] == 6 * STEP
        until(lambda: any('/mambo/first, /mambo/second' in line for line in node.warned),
              'the warning', lambda: loop.once(0.01))
        assert 'refused messages: 1 /mambo/motor_pwm from a second publisher' in node.warned
        assert b'/mambo/motor_pwm from a second publisher' in node.reported[0]

    def test_an_incompatible_publisher_is_named_with_both_policies(self, graph):
        node, loop = graph
        driver = self.other('driver', ReliabilityPolicy.BEST_EFFORT)
        until(lambda: node.warned, 'the warning', lambda: loop.once(0.01))
        assert node.warned[0].startswith(
            '/mambo/motor_pwm: /mambo/driver offers reliability best_effort, /mambo/listener '
            'requests reliable: nothing arrives; ')
        assert not driver.get_subscription_count()

    @pytest.mark.parametrize('reliability', [
        ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
    def test_no_publisher_keeps_the_loop_from_waiting(self, graph, reliability):
        node, loop = graph
        stranger = self.other('stranger', reliability)
        until(lambda: node.count_publishers(topics.MOTOR_PWM.name), 'it', lambda: loop.once(0.01))
        stranger.publish(messages.motor_pwm(STEP, STILL, False, 0))
        while loop.once(0.01):
            pass
        turns, end = 0, time.monotonic() + 0.5
        while time.monotonic() < end:
            loop.once(0.05)
            turns += 1
        assert turns < 200  # thousands if an event that nobody takes ends each wait at once

    @pytest.mark.parametrize(('policy', 'reason'), [
        ({'deadline': Duration(seconds=0.1)}, 'deadline'),
        ({'liveliness': LivelinessPolicy.MANUAL_BY_TOPIC}, 'liveliness')])
    def test_a_reader_that_asks_for_more_is_named_whatever_the_policy(self, graph, policy, reason):
        node, loop = graph
        outsider = rclpy.node.Node('viewer', namespace='mambo')
        outsider.create_subscription(
            topics.DIAGNOSTICS.msg_type, topics.DIAGNOSTICS.name, print, QoSProfile(
                depth=1, **policy))
        until(lambda: node.warned, 'the warning', lambda: loop.once(0.01))
        assert node.warned[0] == (
            f'/diagnostics: /mambo/viewer requests a stricter {reason} than /mambo/listener '
            'offers: nothing arrives; leave it out')

    def test_compatible_ends_are_not_warned_of(self, graph):
        node, loop = graph
        self.other('first')
        viewer = rclpy.node.Node('viewer', namespace='mambo')
        viewer.create_subscription(
            topics.DIAGNOSTICS.msg_type, topics.DIAGNOSTICS.name, print, QoSProfile(depth=1))
        until(lambda: node.count_subscribers(topics.DIAGNOSTICS.name), 'the viewer')
        looking = loop._peers[0]
        shown = [end.name for end in node.ends()].index(topics.DIAGNOSTICS.name)
        until(lambda: looking._counts.get(shown) and len(looking._counts) == len(node.ends()),
              'a look at all ends', lambda: loop.once(0.01))
        assert node.warned == []

    def test_an_incompatible_reader_is_named_too(self, graph):
        node, loop = graph
        outsider = rclpy.node.Node('viewer', namespace='mambo')
        from rclpy.qos import DurabilityPolicy
        outsider.create_subscription(
            topics.DIAGNOSTICS.msg_type, topics.DIAGNOSTICS.name, print,
            QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        until(lambda: node.warned, 'the warning', lambda: loop.once(0.01))
        assert '/mambo/viewer requests transient_local' in node.warned[0]

    def test_a_flood_of_large_messages_does_not_starve_the_loop(self, graph):
        node, loop = graph
        first = self.other('first')
        until(first.get_subscription_count, 'the link', lambda: loop.once(0.01))
        data = GOOD[:12] + struct.pack('<I', 2_000_000) + b'x' * 2_000_000
        for _ in range(5):
            first.publish(data)
        first.wait_for_all_acked()
        loop.once(0.1)
        assert node.guard.refused[input_guard.TOO_LARGE] <= 1
        until(lambda: node.guard.refused[input_guard.TOO_LARGE] == 5, 'all',
              lambda: loop.once(0.01))

    def test_a_best_effort_reader_receives_from_a_best_effort_publisher(self, ros):
        node, used = MamboNode('listener', NoParams), []
        node.accept(topics.MOTOR_PWM, messages.decode_motor_pwm, lambda t, *_: used.append(t),
                    reliable=False)
        loop, driver = Loop(node), self.other('driver', ReliabilityPolicy.BEST_EFFORT)
        until(driver.get_subscription_count, 'the link')
        driver.publish(messages.motor_pwm(STEP, STILL, False, 0))
        until(lambda: used, 'the message', lambda: loop.once(0.01))
        assert used == [STEP]
        loop.close()


SOURCES = [file for file in sorted((Path(__file__).parents[2]).glob('*/mambo_*/*.py'))
           if file.stem.endswith('_node') or file.parent.name == 'mambo_ros']


def assigned(tree):
    """Yield the attribute names that the classes of a node define or assign on ``self``."""
    for kind in ast.walk(tree):
        if not isinstance(kind, ast.ClassDef) or 'Node' not in ' '.join(
                ast.unparse(base) for base in kind.bases):
            continue
        for inner in ast.walk(kind):
            if isinstance(inner, ast.Attribute) and isinstance(inner.ctx, ast.Store):
                if ast.unparse(inner.value) == 'self':
                    yield inner.attr
            elif isinstance(inner, ast.FunctionDef):
                yield inner.name


@pytest.mark.parametrize('file', SOURCES, ids=lambda file: file.stem)
def test_no_node_hides_what_rclpy_keeps_in_one(ros, file):
    """``use_sim_time`` and other parameters of every node work on rclpy's own attributes."""
    node = rclpy.node.Node('plain')
    theirs = {*dir(node), *vars(node)} - {'__init__'}
    assert theirs.isdisjoint(assigned(ast.parse(file.read_text())))


@pytest.mark.long
def test_use_sim_time_can_be_set_on_a_node(ros):
    from mambo_sim.sim_node import SimNode
    node = SimNode()
    (result,) = node.set_parameters([rclpy.Parameter('use_sim_time', value=True)])
    assert result.successful and node.get_clock().ros_time_is_active


def test_the_largest_command_is_the_largest_limit_that_a_vehicle_may_have():
    assert input_guard.LARGEST_PWM == dict(schema.walk(Vehicle))['pwm_max'].metadata['high']


@pytest.mark.parametrize('command, shutdown, reason', [
    ((0.0, 1.0, 65_535.0, 300.0), False, ''),
    *[(tuple(wrong if k == motor else 300.0 for k in range(4)), False, reason)
      for motor in range(4) for wrong, reason in (
          (-1.0, input_guard.OUT_OF_LIMITS), (65_536.0, input_guard.OUT_OF_LIMITS),
          (math.nan, input_guard.NOT_FINITE), (math.inf, input_guard.NOT_FINITE))],
    ((math.nan, -1.0, 1e9, 0.0), True, '')])
def test_a_command_is_within_limits_unless_it_stops_the_motors(command, shutdown, reason):
    assert input_guard.check_pwm((0, command, shutdown)) == reason


def test_what_is_refused_of_one_that_was_never_accepted_is_no_loss():
    """A stranger before the flight: nothing of the accepted publisher is missing."""
    lost = []
    one = Input(lost=lambda: lost.append(1))
    one.guard(b'garbage', b'stranger')
    one.guard(bytes(input_guard.LARGEST + 1), b'stranger')
    one.send(0, publisher=b'true')
    assert one.steps == [0] and not lost and sum(one.refused.values()) == 2
    one.guard(b'garbage', b'true')
    assert lost == [1]
