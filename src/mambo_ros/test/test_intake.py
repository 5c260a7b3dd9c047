"""What a node accepts: the guard of one input, and the nodes that have one."""

import ast
from dataclasses import dataclass
import math
from pathlib import Path
import struct

from mambo_ros import intake, messages, topics
from mambo_ros.intake import Intake
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
import pytest
import rclpy.node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_helpers import until

STEP = 5_000_000  # ns
FUTURE = 1_795_307_261_000_000_000  # ns, a wall clock
STILL = (0.0,) * 4


class Input:
    """Motor commands as they come in, at a time of the flight; publishers in the graph."""

    def __init__(self, **bounds):
        self.used, self.now, self.present = [], 0, set()
        bounds.setdefault('now', lambda: self.now)
        self.guard = Intake(
            '/mambo/motor_pwm', messages.decode_motor_pwm,
            lambda t, pwm, shutdown: self.used.append((t // STEP, pwm[0])),
            check=lambda command: intake.finite(command[1]), **bounds)
        self.guard.publishers = lambda: self.present

    def say(self, k, publisher=b'', pwm=1.0, t=None):
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
    one.say(0)
    one.say(0, t=FUTURE)
    one.now = STEP
    one.say(1)
    assert one.steps == [0, 1]
    assert one.refused == {intake.AHEAD: 1}


def test_a_stamp_may_be_ahead_by_what_is_allowed_and_no_more():
    one = Input(ahead=STEP)
    one.say(1)
    one.say(0, t=STEP + STEP + 1)
    assert one.steps == [1] and one.refused == {intake.AHEAD: 1}


def test_a_message_that_overtook_the_clock_has_it_looked_for_before_it_is_refused():
    clock = Intake('/clock', messages.decode_clock, lambda t: None)
    one = Input(now=clock, ahead=STEP)
    clock(messages.clock(0))
    clock.pull = lambda: clock(messages.clock(9 * STEP))
    one.say(10)
    one.say(11)
    assert one.steps == [10] and one.refused == {intake.AHEAD: 1}


@pytest.mark.parametrize('t, reason', [
    (3 * STEP, intake.BEHIND), (2 * STEP, intake.BEHIND), (-1, intake.NEGATIVE)])
def test_a_stamp_that_is_not_new_is_refused(t, reason):
    one = Input()
    one.now = 4 * STEP
    one.say(3)
    one.say(0, t=t)
    assert one.steps == [3] and one.refused == {reason: 1}


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused_or_only_counted(value):
    strict, tolerant = Input(), Input(tolerant=True)
    for one in (strict, tolerant):
        one.say(0, pwm=value)
        assert one.refused == {intake.NOT_FINITE: 1}
    assert strict.steps == [] and tolerant.steps == [0]


GOOD = messages.motor_pwm(0, STILL, False, 0)


@pytest.mark.parametrize('data, reason', [
    (b'', intake.MALFORMED), (b'\x00', intake.MALFORMED), (GOOD[:-9], intake.MALFORMED),
    (b'\xff' * len(GOOD), intake.MALFORMED),
    (GOOD[:12] + struct.pack('<I', 0xfffffff0) + GOOD[16:], intake.MALFORMED),  # frame name
    (GOOD[:12] + struct.pack('<I', 5_000_000) + b'x' * 5_000_000, intake.TOO_LARGE)])
def test_bytes_that_are_no_message_are_refused(data, reason):
    one = Input()
    one.guard(data)
    one.say(0)
    assert one.steps == [0] and one.refused == {reason: 1}


def test_a_header_that_is_cut_off_is_malformed_where_only_the_stamp_is_read():
    from mambo_ros import cdr
    for length in range(12):
        guard = Intake('/x', lambda data: (cdr.stamp_ns(data),), lambda t: None)
        guard(GOOD[:length])
        assert guard.refused == {intake.MALFORMED: 1}


class TestClock:
    """An input that is the clock of its node."""

    @pytest.fixture
    def clock(self):
        one = Input(now=None)
        one.say(0)
        return one

    def test_one_far_stamp_does_not_silence_it(self, clock):
        clock.say(0, t=FUTURE)
        clock.say(1)
        assert clock.steps == [0, 1] and clock.refused == {intake.AHEAD: 1}

    def test_a_leap_is_believed_when_enough_goes_on_from_there(self, clock):
        for k in range(intake.BELIEVED + 1):
            clock.say(10_000 + k)
        assert clock.steps == [0, 10_009, 10_010]

    def test_a_leap_that_the_flight_contradicts_is_never_believed(self, clock):
        for k in range(1, 4 * intake.BELIEVED):
            clock.say(k)
            clock.say(10_000 + k)
        assert clock.steps == list(range(4 * intake.BELIEVED))


class TestPublishers:
    """Who publishes decides, and who is still in the graph."""

    FIRST, SECOND = b'1' * 16, b'2' * 16

    @pytest.fixture
    def one(self):
        one = Input()
        one.now, one.present = 10_000 * STEP, {self.FIRST, self.SECOND}
        one.say(0, self.FIRST)
        return one

    @pytest.fixture
    def wall(self, monkeypatch):
        wall = [100.0]
        monkeypatch.setattr(intake.time, 'monotonic', lambda: wall[0])
        return wall

    def test_a_second_publisher_is_refused_whatever_it_says(self, one):
        for k in range(1, 20):
            one.say(k, self.SECOND, pwm=500.0)
            one.say(k, self.FIRST)
        assert one.used == [(k, 1.0) for k in range(20)]
        assert one.refused == {intake.STRANGER: 19}

    def test_who_has_said_nothing_of_use_is_not_the_first(self):
        one = Input()
        one.present = {self.FIRST, self.SECOND}
        one.say(0, self.SECOND, pwm=math.nan)
        one.say(0, self.SECOND, t=FUTURE)
        one.say(0, self.FIRST)
        one.now = STEP
        one.say(1, self.SECOND, pwm=500.0)
        one.say(1, self.FIRST)
        assert one.used == [(0, 1.0), (1, 1.0)]
        assert one.refused == {intake.NOT_FINITE: 1, intake.AHEAD: 1, intake.STRANGER: 1}

    def test_a_refused_message_of_the_first_leaves_it_the_first(self, one):
        one.say(1, self.FIRST, pwm=math.nan)
        one.say(1, self.SECOND, pwm=500.0)
        one.say(2, self.FIRST)
        assert one.used == [(0, 1.0), (2, 1.0)]

    def test_another_takes_over_when_the_first_has_left_the_graph(self, one, wall):
        one.present = {self.SECOND}
        one.say(1, self.SECOND)
        assert one.steps == [0]
        wall[0] += 1.1 * intake.ABSENT
        one.say(2, self.SECOND)
        one.say(3, self.SECOND)
        assert one.steps == [0, 2, 3] and one.refused == {intake.STRANGER: 1}

    def test_a_first_that_the_graph_does_not_know_yet_keeps_its_place(self, one, wall):
        one.present = {self.SECOND}
        one.say(1, self.SECOND)
        wall[0] += 0.9 * intake.ABSENT
        one.present = {self.FIRST, self.SECOND}
        one.say(1, self.SECOND)
        wall[0] += 10.0 * intake.ABSENT
        one.say(1, self.SECOND)
        one.say(1, self.FIRST)
        assert one.steps == [0, 1] and one.refused == {intake.STRANGER: 3}

    def test_the_graph_is_not_asked_for_every_message_of_a_flood(self, one, wall):
        asked = []
        one.guard.publishers = lambda: asked.append(1) or one.present
        for _ in range(1000):
            one.say(1, self.SECOND)
            wall[0] += 0.0001
        assert len(asked) <= 2


@dataclass(frozen=True)
class NoParams:
    """Nothing to set."""


class TestInTheGraph:
    """A guarded input of a node, with real publishers."""

    @pytest.fixture
    def graph(self, ros):
        """Return a node with a guarded input, its loop, and what it used, warned and reported."""
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
        stranger = rclpy.node.Node(name, namespace='mambo')
        return stranger.create_publisher(
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

    def test_a_publisher_that_cannot_be_heard_is_named_with_both_policies(self, graph):
        node, loop = graph
        driver = self.other('driver', ReliabilityPolicy.BEST_EFFORT)
        until(lambda: node.warned, 'the warning', lambda: loop.once(0.01))
        assert node.warned[0].startswith(
            '/mambo/motor_pwm: /mambo/driver offers reliability best_effort, /mambo/listener asks '
            'for reliable: nothing arrives; ')
        assert not driver.get_subscription_count()

    def test_a_reader_that_hears_nothing_of_ours_is_named_too(self, graph):
        node, loop = graph
        stranger = rclpy.node.Node('viewer', namespace='mambo')
        from rclpy.qos import DurabilityPolicy
        stranger.create_subscription(
            topics.DIAGNOSTICS.msg_type, topics.DIAGNOSTICS.name, print,
            QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        until(lambda: node.warned, 'the warning', lambda: loop.once(0.01))
        assert '/mambo/viewer asks for transient_local' in node.warned[0]

    def test_a_flood_of_large_messages_leaves_the_loop_its_turns(self, graph):
        node, loop = graph
        first = self.other('first')
        until(first.get_subscription_count, 'the link', lambda: loop.once(0.01))
        data = GOOD[:12] + struct.pack('<I', 2_000_000) + b'x' * 2_000_000
        for _ in range(5):
            first.publish(data)
        first.wait_for_all_acked()
        loop.once(0.1)
        assert node.guard.refused[intake.TOO_LARGE] <= 1
        until(lambda: node.guard.refused[intake.TOO_LARGE] == 5, 'all', lambda: loop.once(0.01))

    def test_a_best_effort_publisher_is_heard_by_who_asks_for_no_more(self, ros):
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
    """Yield the names that the methods of a node's classes assign on ``self``, or define."""
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


def test_use_sim_time_can_be_set_on_a_node(ros):
    from mambo_sim.sim_node import SimNode
    node = SimNode()
    (result,) = node.set_parameters([rclpy.Parameter('use_sim_time', value=True)])
    assert result.successful and node.get_clock().ros_time_is_active
