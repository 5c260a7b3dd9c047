"""A controller or a vehicle that hears nothing more: nodes in this process, without a graph."""

import logging
import math
import time
from types import SimpleNamespace

from mambo_control import failsafe
from mambo_control.controller_node import ControllerNode
from mambo_control.reference_node import ReferenceNode
from mambo_estimation.estimator_node import EstimatorNode
from mambo_model.compiled import memory_of
from mambo_model.motion import trajectory
from mambo_model.motion.flatness import from_flat_output
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.parameters import Vehicle
from mambo_ros import cdr, messages, topics
from mambo_ros.graph import publisher_guard
from mambo_sim import lockstep, sim_node
from mambo_sim.sim_node import SimNode
import pytest
import rclpy
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

MAMBO, ZERO, STEP = Vehicle(), (0.0, 0.0, 0.0), 5_000_000
HOVERING = State((0.0, 0.0, -1.5), ZERO, (1.0, 0.0, 0.0, 0.0), ZERO)
POINT = from_flat_output(
    (0.0, 0.0, -1.5), ZERO, ZERO, ZERO, ZERO, MAMBO.mass, MAMBO.inertia, MAMBO.gravity)


class Controller:
    """A controller node whose inputs and output belong to this test."""

    def __init__(self, *parameters):
        self.node = ControllerNode(parameter_overrides=parameters)
        self.answers = []
        self.node._pwm = self.answers.append
        self.node.count_publishers = lambda topic: topic.removeprefix('/mambo/') in self.publish
        self.publish = {'estimate/odom', 'reference'}

    def estimate(self, k, variance=0.0):
        covariance = (variance,) * 36
        self.hear(topics.ESTIMATE, messages.estimate(k * STEP, HOVERING, covariance, covariance))

    def reference(self, k):
        self.hear(topics.REFERENCE, messages.reference(k * STEP, POINT, trajectory.TRACK))

    def hear(self, topic, data):
        (guard,) = [entry.take for entry in self.node.inputs if entry.topic is topic]
        guard(data)

    @property
    def stamps(self):
        return [messages.decode_motor_pwm(data)[0] // STEP for data in self.answers]


@pytest.fixture
def controller(ros):
    one = Controller()
    yield one
    one.node.destroy_node()


def test_a_pair_is_answered_whichever_comes_first(controller):
    controller.estimate(0)
    assert controller.stamps == []
    controller.reference(0)
    controller.reference(1)
    controller.estimate(1)
    controller.estimate(1)  # said twice
    controller.reference(0)  # and late
    assert controller.stamps == [0, 1]


@pytest.mark.parametrize(('estimate', 'used'), [('odom', b'odom'), ('map', b'map')])
def test_an_estimate_or_reference_in_another_frame_is_refused(ros, estimate, used):
    controller = Controller(Parameter('estimate', value=estimate))
    topic, make = ((topics.ESTIMATE, messages.estimate) if estimate == 'odom' else
                   (topics.LOCATED, messages.located))
    ours = make(0, HOVERING, (0.0,) * 36, (0.0,) * 36)
    controller.reference(0)
    controller.hear(topic, ours.replace(used, b'm1' + b'_' * (len(used) - 2)))
    assert controller.stamps == []
    controller.hear(topic, ours)
    assert controller.stamps == [0]
    assert list(controller.node.refused().values()) == [1]
    assert f'frame is not {estimate}' in str(controller.node.refused())
    point = messages.reference(STEP, POINT, trajectory.TRACK)
    controller.hear(topics.REFERENCE, point.replace(b'odom', b'odon'))
    assert sum(controller.node.refused().values()) == 2
    controller.node.destroy_node()


def test_a_setpoint_in_another_frame_is_refused(ros):
    node = ReferenceNode(parameter_overrides=[
        Parameter('commands.enabled', value=True), Parameter('wire.frame_prefix', value='m1/')])
    (guard,) = [entry.take for entry in node.inputs if entry.topic is topics.SETPOINT]
    ours = messages.reference(0, POINT, trajectory.TRACK)
    guard(ours.replace(b'odom', b'map_'))
    assert dict(guard.refused) == {'frame is not m1/odom': 1}
    guard(ours)
    assert guard.refused['frame is not m1/odom'] == 1
    node.destroy_node()


def test_while_references_are_missing_estimates_are_answered_at_once_until_one_comes(controller):
    controller.estimate(0)
    controller.reference(0)
    for k in range(1, 21):
        controller.estimate(k)
    assert controller.stamps == [0]  # within the patience
    controller.estimate(21)
    assert controller.stamps[-1] == 21
    controller.estimate(22)
    controller.reference(1)  # long past
    controller.estimate(23)
    assert controller.stamps[-1] == 23
    controller.reference(24)
    assert controller.stamps[-1] == 23
    controller.estimate(24)
    controller.estimate(25)  # the reference is back: it is waited for
    assert controller.stamps[-1] == 24
    controller.reference(25)
    assert controller.stamps == [0, *range(21, 26)]


@pytest.mark.parametrize('first', ['estimate', 'reference'])
@pytest.mark.parametrize('late', [22, 38])
def test_a_stream_that_stops_for_less_than_0_2_s_ends_no_flight(controller, first, late):
    second = {'estimate': 'reference', 'reference': 'estimate'}[first]
    controller.estimate(0)
    controller.reference(0)
    for k in range(1, 100):
        getattr(controller, first)(k)
        for stamp in (range(1, k + 1) if k == late else [k] if k > late else ()):
            getattr(controller, second)(stamp)
        assert controller.node.stage in (failsafe.FLYING, failsafe.HOLDING)
    assert controller.node.stage == failsafe.FLYING and controller.stamps[-1] == 99


@pytest.mark.parametrize('still', ['estimate', 'reference'])
def test_a_stream_that_is_ahead_by_the_patience_is_answered_alone(controller, still):
    controller.estimate(0)
    controller.reference(0)
    for k in range(1, 100):
        getattr(controller, still)(k)
    # 0.1 s of patience are 20 steps: 79 is as old as that when 99 comes
    assert controller.stamps == (
        [0, *range(21, 100)] if still == 'estimate' else list(range(80)))
    assert controller.node.stage == (
        failsafe.LANDING if still == 'estimate' else failsafe.DESCENDING_BLIND)
    pwm, shutdown = messages.decode_motor_pwm(controller.answers[-1])[1:]
    assert not shutdown and all(MAMBO.pwm_min <= x <= MAMBO.pwm_max for x in pwm)


@pytest.mark.parametrize('first', ['estimate', 'reference'])
def test_a_stream_that_is_read_late_is_not_taken_for_lost(controller, first):
    """A node that hangs finds both streams waiting, and reads one of them first."""
    controller.estimate(0)
    controller.reference(0)
    second = {'estimate': 'reference', 'reference': 'estimate'}[first]
    unread = list(range(1, 100))

    def pull():
        while unread:
            getattr(controller, second)(unread.pop(0))
    guard = controller.node._streams[('reference', 'estimate').index(second)]
    guard.pull = pull
    for k in range(1, 100):
        getattr(controller, first)(k)
    pull()
    assert controller.stamps == list(range(100))
    assert controller.node.stage == failsafe.FLYING


def test_what_a_publisher_sent_before_it_left_is_answered(controller):
    controller.estimate(0)
    controller.reference(0)
    for k in range(1, 5):
        controller.reference(k)
    unread = list(range(1, 5))
    controller.node._streams[1].pull = lambda: [
        controller.estimate(unread.pop(0)) for _ in range(len(unread))]
    controller.publish = {'reference'}
    controller.node._look()
    assert controller.stamps == [0, 1, 2, 3, 4]
    assert controller.node.stage == failsafe.FLYING


def test_a_single_gap_is_answered_when_it_is_overdue_and_no_later_pair_has_come(controller):
    for k in range(5):
        controller.estimate(k)
        if k != 2:
            controller.reference(k)
    assert controller.stamps == [0, 1, 3, 4]
    assert controller.node.stage == failsafe.FLYING


def test_a_stream_that_nobody_publishes_any_more_is_not_waited_for(controller):
    controller.reference(0)
    controller.publish = {'reference'}
    controller.node._look()
    assert controller.stamps == []  # nobody has been there yet
    controller.estimate(0)
    controller.reference(1)
    assert controller.stamps == [0]
    controller.node._look()
    assert controller.stamps == [0, 1]
    controller.reference(2)  # at once from now on: a simulator in lockstep waits for it
    assert controller.stamps == [0, 1, 2]
    controller.publish = {'estimate/odom', 'reference'}
    controller.node._look()
    controller.reference(3)
    assert controller.stamps == [0, 1, 2]


def test_the_look_for_lost_streams_does_not_depend_on_the_wall_clock(controller):
    """A timer of the wall clock is silent for as long as that clock is set back."""
    (timer,) = controller.node.timers
    assert timer.clock.clock_type == ClockType.STEADY_TIME


@pytest.mark.parametrize('lost', ['estimate/odom', 'reference'])
def test_a_stream_under_another_name_is_not_taken_for_lost(lost):
    rclpy.init(args=['--ros-args', '-r', f'{lost}:=/elsewhere'],
               signal_handler_options=SignalHandlerOptions.NO)
    controller = Controller()
    controller.publish = {'estimate/odom', 'reference', '/elsewhere'} - {lost}
    controller.estimate(0)
    controller.reference(0)
    controller.node._look()
    first, second = ((controller.reference, controller.estimate)
                     if lost == 'estimate/odom' else (controller.estimate, controller.reference))
    first(1)
    controller.node._look()
    assert controller.stamps == [0]
    second(1)
    assert controller.stamps == [0, 1] and controller.node.stage == failsafe.FLYING
    controller.node.destroy_node()
    rclpy.try_shutdown()


def test_a_command_before_the_first_sample_has_no_delay(ros):
    sim = SimNode()
    sim.commands(messages.motor_pwm(0, (0.0,) * 4, False, 0))
    assert sim.delays.count == 0
    sim.sense()
    sim.advance()
    sim.sense()
    sim.commands(messages.motor_pwm(STEP, (0.0,) * 4, False, 0))
    assert sim.delays.count == 1 and sim.delays.longest < 10.0  # s, not since the machine began
    sim.destroy_node()


def test_variances_of_the_message_reach_the_failsafe(controller):
    for k in range(30):
        controller.estimate(k, 1e9 if k else 0.0)
        controller.reference(k)
    assert controller.node.stage == failsafe.DESCENDING_BLIND


class TestWatchdog:
    """Motors that turn stop when no command comes."""

    @pytest.fixture
    def sim(self, ros):
        node = SimNode(parameter_overrides=[
            Parameter('mode', value='realtime'), Parameter('motor_timeout', value=0.5)])
        node._sent, node._diagnostics = [], lambda data: node._sent.append(data)
        yield node
        node.destroy_node()

    def command(self, sim, pwm, shutdown=False):
        sim.commands(messages.motor_pwm(sim.t, (pwm,) * 4, shutdown, 0))
        return sim._last_command

    def rise(self, sim, steps):
        for _ in range(steps):
            sim.advance()
        return -memory_of(sim.held).plant.body.rho[2]

    def test_it_stops_turning_motors_for_good_and_says_so(self, sim):
        heard = self.command(sim, 400.0)
        assert self.rise(sim, 100) > 0.5
        sim.watch(heard + 0.49, 1.0)
        assert sim.starved == -1 and not sim._sent
        sim.watch(heard + 0.51, 1.0)
        assert sim.starved == sim.t == 100 * STEP
        assert b'motors stopped at t = 0.500 s: no motor command for 0.5 s' in sim._sent[0]
        self.command(sim, 400.0)
        assert self.rise(sim, 400) == 0.0  # fallen
        sim.watch(math.inf, 1.0)
        assert len(sim._sent) == 1

    @pytest.mark.parametrize('pwm, shutdown', [(0.0, False), (400.0, True)])
    def test_motors_that_stand_still_are_left_alone(self, sim, pwm, shutdown):
        heard = self.command(sim, pwm, shutdown)
        sim.watch(heard + 100.0, 1.0)
        assert sim.starved == -1


class TestGarbage:
    """Commands that cannot be used, as often as the simulator looks."""

    FUTURE = 1_795_307_261_000_000_000  # ns, a wall clock
    GARBAGE = {
        'stamp ahead of the flight': messages.motor_pwm(FUTURE, (400.0,) * 4, False, 0),
        'not finite': messages.motor_pwm(5 * STEP, (math.nan,) * 4, False, 0),
        'out of limits': messages.motor_pwm(5 * STEP, (-1.0, 1e9, 0.0, 0.0), False, 0),
        'malformed': b'\xff' * 60}

    def sim(self, **parameters):
        node = SimNode(parameter_overrides=[
            Parameter(name.replace('__', '.'), value=value) for name, value in parameters.items()])
        node.logged = []
        node._diagnostics = lambda data: None
        node.get_logger = lambda: SimpleNamespace(
            info=node.logged.append, warning=node.logged.append, error=node.logged.append)
        return node

    def loop(self, sim, good=5):
        """Return a loop in which every look finds a command; those of the first steps are good."""
        def once(timeout):
            if sim.t < good * STEP:
                sim.commands(messages.motor_pwm(sim.t, (400.0,) * 4, False, 0))
            else:
                for data in self.GARBAGE.values():
                    sim.commands(data)
                time.sleep(0.001)
            return True
        return SimpleNamespace(stopping=False, once=once, turn=lambda: None)

    def test_in_lockstep_they_end_the_flight_within_its_patience_and_with_one_line(self, ros):
        sim = self.sim(mode='lockstep', patience=1.0, duration=3.0)
        began = time.monotonic()
        assert sim_node.fly(sim, self.loop(sim)) == 1
        assert time.monotonic() - began < 30.0  # 1 s, on a busy machine some more
        (line,) = [line for line in sim.logged if line.startswith('no motor_pwm')]
        assert line.startswith(
            'no motor_pwm for t = 0.025 s within 1 s: motors stopped; refused: ')
        assert all(reason in line for reason in self.GARBAGE)
        assert sim.starved == 5 * STEP
        sim.destroy_node()

    def test_in_real_time_the_watchdog_stops_the_motors(self, ros):
        sim = self.sim(mode='realtime', motor_timeout=0.2, duration=1.5)
        sim_node.fly(sim, self.loop(sim))
        assert 5 * STEP < sim.starved < 0.5e9
        assert memory_of(sim.held).plant.body.rho[2] == 0.0  # on the floor, not in the air
        assert min(sim.commands.refused.values()) > 10
        sim.destroy_node()

    def test_a_shutdown_is_obeyed_whatever_its_numbers_are(self, ros):
        sim = self.sim()
        sim.commands(messages.motor_pwm(0, (math.nan,) * 4, True, 0))
        assert sim._shutdown and sim._pwm == (0.0,) * 4
        sim.destroy_node()


def test_a_controller_is_not_silenced_by_stamps_of_the_future(controller):
    clock = (topics.CLOCK, messages.clock)
    for k in range(3):
        for topic, make in (
                (topics.ESTIMATE, lambda t: messages.estimate(
                    t, HOVERING, (0.0,) * 36, (0.0,) * 36)),
                (topics.REFERENCE, lambda t: messages.reference(t, POINT, trajectory.TRACK)),
                clock):
            if k:
                controller.hear(topic, make(TestGarbage.FUTURE))
        controller.hear(topics.CLOCK, messages.clock(k * STEP))
        controller.estimate(k)
        controller.reference(k)
    assert controller.stamps == [0, 1, 2]
    assert set(controller.node.refused().values()) == {2}


def test_before_the_clock_has_begun_only_the_first_step_is_answered(controller):
    controller.publish = {'estimate/odom', 'reference', '/clock'}
    for k in range(100):
        controller.reference(k)
    assert controller.stamps == []
    controller.estimate(0)
    assert controller.stamps == [0]
    controller.hear(topics.CLOCK, messages.clock(STEP))
    controller.estimate(1)
    assert controller.stamps == [0, 1]


@pytest.mark.parametrize('begun', [False, True])
def test_a_reference_from_before_the_flight_is_forgotten_with_its_publisher(
        controller, monkeypatch, begun):
    monkeypatch.setattr(publisher_guard, 'ABSENT', -1.0)
    (guard,) = [entry.take for entry in controller.node.inputs if entry.topic is topics.REFERENCE]
    guard.publishers = set
    if begun:
        controller.hear(topics.CLOCK, messages.clock(300 * STEP))
    for k in range(100, 200):
        guard(messages.reference(k * STEP, POINT, trajectory.TRACK), b'a stranger')
    assert controller.stamps == list(range(100, 180))  # for these the patience is over
    assert controller.node.stage == failsafe.DESCENDING_BLIND
    assert not guard.is_deserted(0)
    controller.answers.clear()
    for k in range(3):
        controller.hear(topics.CLOCK, messages.clock(k * STEP))
        controller.estimate(k)
        controller.reference(k)
    assert controller.stamps == ([] if begun else [0, 1, 2])
    assert controller.node.stage == (failsafe.DESCENDING_BLIND if begun else failsafe.FLYING)


class TestEstimator:
    """An estimator whose sensors send what cannot be used."""

    def estimator(self, **parameters):
        node, estimates = EstimatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters.items()]), []
        node._estimate = lambda data: estimates.append(cdr.stamp_ns(data) // STEP)

        def hear(topic, data):
            (guard,) = [entry.take for entry in node.inputs if entry.topic is topic]
            guard(data)
        return node, estimates, hear

    def imu(self, t):
        return messages.imu(t, ZERO, (0.0, 0.0, -9.8), ZERO, ZERO)

    def test_an_unreadable_sample_counts_for_the_watermark(self, ros):
        node, estimates, hear = self.estimator()
        for k in range(3):
            hear(topics.IMU, self.imu(k * STEP))
            hear(topics.SONAR, b'\xff' * 9)
            hear(topics.SENSOR_TICK, messages.sensor_tick(k * STEP, k + 1, k + 1, 0, 0))
        assert estimates == [0, 1, 2]
        assert node.refused() == {'/mambo/sonar/range malformed': 3}
        node.destroy_node()

    def test_a_watermark_or_a_driver_of_the_future_silences_nothing(self, ros):
        future = TestGarbage.FUTURE
        for parameters, ticks in (({}, True), ({'synchronise': 'arrival'}, False)):
            node, estimates, hear = self.estimator(**parameters)
            for k in range(3):
                hear(topics.IMU, self.imu(k * STEP))
                if ticks:
                    hear(topics.SENSOR_TICK, messages.sensor_tick(k * STEP, k + 1, 0, 0, 0))
                    hear(topics.SENSOR_TICK, messages.sensor_tick(future, k + 1, 0, 0, 0))
                else:
                    hear(topics.IMU, self.imu(future))
            assert estimates == [0, 1, 2]
            assert set(node.refused().values()) == {2}  # the last one may yet be continued from
            hear(topics.IMU, self.imu(3 * STEP))
            if ticks:
                hear(topics.SENSOR_TICK, messages.sensor_tick(3 * STEP, 4, 0, 0, 0))
            assert estimates == [0, 1, 2, 3]
            assert set(node.refused().values()) == {3}
            node.destroy_node()

    def test_its_sensors_are_subscribed_best_effort_if_asked_for(self, ros):
        node, _, _ = self.estimator(sensor_reliability='best_effort', synchronise='arrival')
        assert not any(entry.reliable for entry in node.inputs)
        assert all(entry.reliable for entry in self.estimator()[0].inputs)
        node.destroy_node()


class TestPace:
    """Steps in real time, on a machine that is busy elsewhere now and then."""

    @pytest.fixture
    def fly(self, monkeypatch):
        """Return what paces one step, with a clock that the waiting for messages moves."""
        def step(sensed, deadline, answer, stalled=0.0):
            sim = SimpleNamespace(
                sensed=sensed, answered=False, missed=0, late=0, params=SimpleNamespace(speed=1.0),
                now=sensed, watch=lambda now, speed: None, starved=-1,
                t=0, delays=SimpleNamespace(count=1), start=lambda away: None,
                get_logger=logging.getLogger)
            sim.drones = [sim]

            def once(timeout):
                nonlocal stalled
                if stalled:
                    sim.now, stalled = sim.now + stalled, 0.0
                    return
                after = sim.now + timeout + 1e-9  # a wait is never too short
                sim.now = min(after, answer) if sim.now < answer else after
                sim.answered = sim.now >= answer
            monkeypatch.setattr(lockstep.time, 'monotonic', lambda: sim.now)
            loop = SimpleNamespace(stopping=False, once=once)
            lockstep.wait_for_deadline(sim, loop, deadline, sensed)
            return sim.now, sim.missed
        return step

    def test_a_step_in_time_lasts_until_the_next_one_is_due(self, fly):
        assert fly(sensed=1.0, deadline=1.005, answer=1.001) == (pytest.approx(1.005), 0)

    def test_a_late_answer_is_waited_for_until_the_flight_is_behind_the_clock(self, fly):
        assert fly(sensed=1.0, deadline=1.005, answer=1.014) == (1.014, 0)
        assert fly(sensed=1.0, deadline=1.005, answer=1.016) == (pytest.approx(1.015), 1)

    def test_a_step_that_began_late_ends_with_its_answer(self, fly):
        assert fly(sensed=1.1, deadline=1.005, answer=1.101) == (1.101, 0)

    def test_a_late_step_too_waits_a_period_and_no_longer(self, fly):
        assert fly(sensed=1.1, deadline=1.005, answer=1.2) == (pytest.approx(1.105), 1)

    def test_an_answer_that_came_while_the_simulator_slept_is_not_missed(self, fly):
        assert fly(1.0, deadline=1.005, answer=1.001, stalled=0.5) == (pytest.approx(1.5), 0)
