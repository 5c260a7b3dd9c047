"""The steps of a flight, with a simulator and a graph of the test's own."""

import logging
import math
import time
from types import SimpleNamespace

from mambo_sim import lockstep
from mambo_sim.delays import Delays
from mambo_sim.parameters import SimNodeParams, STEP_NS
import pytest

PERIOD = STEP_NS * 1e-9


class Clock:
    """A wall clock that stands still until somebody waits."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


class Sim:
    """What pace needs of the simulator; the graph answers by ``reply``."""

    def __init__(self, **parameters):
        self.params = SimNodeParams(**parameters)
        self.t, self.sensed, self.missed, self.late, self.senses = 0, 0.0, 0, 0, 0
        self.starved, self.silent = -1, []
        self.answered_to, self.gave_up, self.watched, self.heard = -1, [], [], 0.0
        self.delays, self.log = Delays(), logging.getLogger('test')
        self.pause, self.drones = lockstep.Pause(self.params.paused), [self]

    def get_logger(self):
        return self.log

    @property
    def answered(self):
        return self.answered_to >= self.t

    def start(self, away=math.inf):
        self.heard = min(self.heard + away, lockstep.time.monotonic())

    def sense(self):
        self.senses, self.sensed = self.senses + 1, lockstep.time.monotonic()

    def advance(self):
        self.t += STEP_NS

    def give_up(self):
        self.gave_up.append(self.t)

    def watch(self, now, speed):
        self.watched.append((self.t, now))
        self.silent.append(now - self.heard)

    def is_deserted(self, now):
        return now - self.heard > self.params.patience


class Loop:
    """A graph that answers a step after so many s of wall time; None: never."""

    def __init__(self, sim, clock, reply=lambda t: 0.001):
        self.sim, self.clock, self.reply = sim, clock, reply
        self.stopping, self.waits = False, []

    def once(self, timeout):
        self.waits.append(timeout)
        delay = self.reply(self.sim.t)
        due = None if delay is None else self.sim.sensed + delay
        end = self.clock.now + timeout
        if not self.sim.answered and due is not None and due <= end:
            self.clock.now = max(self.clock.now, due)
            self.sim.answered_to = self.sim.t
            self.sim.heard = self.clock.now
            self.sim.delays.add(delay)
        else:
            self.clock.now = end


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(lockstep, 'time', SimpleNamespace(monotonic=clock.monotonic))
    return clock


def test_lockstep_steps_with_every_answer_whatever_it_takes(clock):
    sim = Sim(mode='lockstep', duration=0.05)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 0.3)) == 0
    assert sim.t == 50_000_000 and sim.senses == 11 and sim.missed == 0 and not sim.gave_up
    assert clock.now == pytest.approx(100.0 + 11 * 0.3)


def test_lockstep_gives_up_after_its_patience_and_says_that_it_failed(clock):
    sim = Sim(mode='lockstep', duration=1.0, patience=2.0)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 0.0 if t < 20_000_000 else None)) == 1
    assert sim.gave_up == [20_000_000] and sim.t == 20_000_000
    assert clock.now == pytest.approx(102.0, abs=0.05)


@pytest.mark.parametrize('answers', [True, False])
def test_lockstep_waits_on_after_a_suspension(clock, answers):
    sim, asleep = Sim(mode='lockstep', duration=0.02, patience=2.0), [3600.0]
    loop = Loop(sim, clock, lambda t: (0.001 if t else 3600.5) if answers else None)

    def once(timeout, held=loop.once):
        clock.now += asleep.pop() if asleep else 0.0
        held(timeout)

    loop.once = once
    assert lockstep.run(sim, loop) == (0 if answers else 1)
    assert bool(sim.gave_up) != answers
    if not answers:
        assert clock.now - 3700.0 == pytest.approx(2.0 - lockstep.LONGEST, abs=0.05)


def test_an_answer_within_the_patience_is_waited_for(clock):
    sim = Sim(mode='lockstep', duration=0.01, patience=2.0)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 1.9)) == 0
    assert not sim.gave_up


def test_waiting_in_lockstep_is_said_every_five_seconds(clock, caplog):
    sim = Sim(mode='lockstep', duration=0.005, patience=60.0)
    with caplog.at_level(logging.WARNING):
        assert lockstep.run(sim, Loop(sim, clock, lambda t: 12.0)) == 0
    logged = [record.message for record in caplog.records]
    assert logged.count('waiting for motor_pwm of t = 0.000 s') == 2 and len(logged) == 4


def test_somebody_who_stops_the_flight_ends_it_without_a_failure(clock, caplog):
    sim = Sim(mode='lockstep', duration=1.0)
    loop = Loop(sim, clock, lambda t: None)
    loop.once = lambda timeout: setattr(loop, 'stopping', True)
    with caplog.at_level('INFO'):
        assert lockstep.run(sim, loop) == 0 and sim.t == 0 and not sim.gave_up
    assert 'flew 0.000 s' in caplog.text and 'nan' not in caplog.text  # no delay to state


@pytest.mark.parametrize(('speed', 'took'), [(1.0, 0.2), (2.0, 0.1), (0.5, 0.4)])
def test_real_time_keeps_pace_with_the_wall_clock(clock, speed, took):
    sim = Sim(mode='realtime', duration=0.2, speed=speed)
    assert lockstep.run(sim, Loop(sim, clock)) == 0
    assert sim.missed == 0 and not sim.watched
    assert clock.now - 100.0 == pytest.approx(took + PERIOD / speed, abs=1e-6)


def test_an_answer_that_is_too_late_is_missed_and_watched(clock):
    """One answer of forty does not come in time: that step flies on with the command before."""
    late = 50_000_000
    sim = Sim(mode='realtime', duration=0.2)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 0.0151 if t == late else 0.001)) == 0
    assert sim.missed == 1 and sim.late == 0 and [t for t, _ in sim.watched] == [late]
    assert sim.watched[0][1] == pytest.approx(
        100.0 + late * 1e-9 + PERIOD + lockstep.BEHIND, abs=1e-6)
    assert clock.now - 100.0 == pytest.approx(0.205, abs=1e-6)  # the delay is made up for


@pytest.mark.parametrize('speed', [1.0, 2.0])
@pytest.mark.parametrize(('reply', 'late'), [
    (0.9 * PERIOD, 0), (0.0051, 1), (0.007, 1), (0.0149, 1)])
def test_a_late_answer_is_waited_for_and_counted(clock, caplog, speed, reply, late):
    caplog.set_level('INFO')
    at = 50_000_000
    sim = Sim(mode='realtime', duration=0.2, speed=speed)
    reply -= (PERIOD - PERIOD / speed)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: reply if t == at else 0.001)) == 0
    assert sim.missed == 0 and sim.late == late and not sim.watched
    assert clock.now - 100.0 == pytest.approx((0.2 + PERIOD) / speed, abs=1e-6)  # made up for
    assert ('steps without their motor command, 1 waited for a late one' in caplog.text) == late


def test_a_speed_that_changes_in_flight_counts_from_then_on(clock, caplog):
    caplog.set_level('INFO')
    sim = Sim(mode='realtime', duration=2.0)
    sense = sim.sense

    def faster():
        if sim.t == 1_000_000_000:
            sim.params = SimNodeParams(mode='realtime', duration=2.0, speed=4.0)
        sense()

    sim.sense = faster
    assert lockstep.run(sim, Loop(sim, clock)) == 0 and sim.missed == 0
    assert clock.now - 100.0 == pytest.approx(1.0 + 1.0 / 4.0, abs=2 * PERIOD)
    said = next(record.message for record in caplog.records if 'of wall time' in record.message)
    assert float(said.split(' s in ')[1].split()[0]) == pytest.approx(1.25, abs=2 * PERIOD)


def test_a_step_that_began_late_leaves_its_period_for_the_answer(clock):
    """The machine was busy for 20 ms: the next steps follow as soon as they are answered."""
    sim = Sim(mode='realtime', duration=0.1)
    loop, sense = Loop(sim, clock, lambda t: 0.002), sim.sense

    def busy():
        clock.now += 0.02 * (sim.t == 50_000_000)
        sense()

    sim.sense = busy
    assert lockstep.run(sim, loop) == 0
    assert sim.missed == 0 and sim.late == 0  # though each began after its own deadline
    assert clock.now - 100.0 == pytest.approx(0.105, abs=1e-6)  # and the delay is made up for


@pytest.mark.parametrize('where', ['sense', 'once', 'advance'])
@pytest.mark.parametrize('dead', [False, True])
def test_time_in_which_the_process_does_not_run_is_left_out(clock, caplog, where, dead):
    """It is suspended for 20 s: the flight goes on from there, at its pace."""
    caplog.set_level('INFO')
    sim, at = Sim(mode='realtime', duration=0.2), 50_000_000
    loop = Loop(sim, clock, lambda t: None if t == at or dead and t > at else 0.001)
    held, asleep = getattr(loop if where == 'once' else sim, where), [20.0]

    def suspended(*given):
        if sim.t == at and asleep:
            clock.now += asleep.pop()
        held(*given)

    setattr(loop if where == 'once' else sim, where, suspended)
    assert lockstep.run(sim, loop) == 0 and not asleep
    assert sim.missed == len(sim.silent) == (31 if dead else 1)
    assert min(sim.silent) >= 0.0
    assert max(sim.silent) == pytest.approx(31 * PERIOD if dead else PERIOD, abs=0.02)
    assert clock.now - 100.0 == pytest.approx(20.0 + 0.2 + PERIOD, abs=0.02)
    assert 'did not run for 20.0 s before t = 0.05' in caplog.text
    assert 'did not run for 20.0 s in all: it went on from where it was' in caplog.text
    assert 'behind the wall clock' not in caplog.text


def test_a_wait_for_the_next_step_that_ends_late_is_no_late_answer(clock):
    sim = Sim(mode='realtime', duration=0.1)
    loop = Loop(sim, clock)
    once = loop.once

    def slept(timeout):
        answered = sim.answered
        once(timeout)
        clock.now += 1e-4 * answered  # as long as the machine takes to wake it

    loop.once = slept
    assert lockstep.run(sim, loop) == 0 and sim.missed == sim.late == 0


def test_a_controller_that_is_too_slow_uses_its_delay_up(clock):
    """It takes 0.1 ms too long at every step: after 10 ms of delay no step waits any more."""
    sim = Sim(mode='realtime', duration=1.0)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 0.0051)) == 0
    assert sim.late == pytest.approx(100, abs=1) and sim.late + sim.missed == 201
    assert clock.now - 100.0 == pytest.approx(1.0 + PERIOD + lockstep.BEHIND, abs=1e-3)


@pytest.mark.parametrize(('mode', 'speed', 'busy', 'said'), [
    ('realtime', 2.0, 0.01, 'fell 0.39 s behind the wall clock: the controller or the machine '
     'is too slow for speed 2'), ('realtime', 1.0, 0.002, ''), ('lockstep', 1.0, 0.01, '')])
def test_a_flight_in_real_time_says_how_far_it_fell_behind(
        clock, caplog, mode, speed, busy, said):
    sim = Sim(mode=mode, duration=0.2, speed=speed)
    sense = sim.sense

    def work():
        clock.now += busy
        sense()

    sim.sense = work
    assert lockstep.run(sim, Loop(sim, clock, lambda t: 0.002)) == 0
    warnings = [record.message for record in caplog.records if record.levelname == 'WARNING']
    assert warnings == ([said] if said else []) and sim.missed == 0


def test_without_a_controller_the_pace_is_kept_and_the_reason_said(clock, caplog):
    sim = Sim(mode='realtime', duration=4.0, patience=10.0)
    sense = sim.sense

    def work():
        clock.now += 0.02 * (sim.t % 50_000_000 == 0)
        sense()

    sim.sense = work
    assert lockstep.run(sim, Loop(sim, clock, lambda t: None)) == 0
    assert clock.now - 100.0 == pytest.approx(4.005, abs=0.03)
    assert [record.message for record in caplog.records if record.levelname == 'WARNING'] == [
        'no motor command came: is a controller running in this domain and namespace?']


def test_a_graph_that_is_silent_in_real_time_is_given_up_at_the_end(clock):
    sim = Sim(mode='realtime', duration=5.0, patience=1.0)
    assert lockstep.run(sim, Loop(sim, clock, lambda t: None)) == 1
    assert len(sim.gave_up) == 1 and sim.t * 1e-9 == pytest.approx(1.0, abs=2 * PERIOD)
    assert sim.missed == len(sim.watched) == sim.senses


def test_without_a_duration_a_flight_lasts_until_it_is_stopped(clock):
    sim = Sim(mode='realtime', duration=0.0)
    loop = Loop(sim, clock)
    once = loop.once

    def until(timeout):
        once(timeout)
        loop.stopping = sim.t >= 300_000_000

    loop.once = until
    assert lockstep.run(sim, loop) == 0 and sim.t >= 300_000_000


@pytest.mark.parametrize(('arguments', 'want'), [
    ((0, -1, 0.2), (0, 'flying')), ((3, -1, 0.2), (1, '3 steps without their motor command')),
    ((3, 1_500_000_000, 0.2),
     (2, 'motors stopped at t = 1.500 s: no motor command for 0.2 s')),
    ((0, 0, 1.0), (2, 'motors stopped at t = 0.000 s: no motor command for 1 s'))])
def test_the_worst_is_what_the_diagnostics_say(arguments, want):
    assert lockstep.status(*arguments) == want


def test_the_clock_is_the_monotonic_one():
    assert lockstep.time is time


class Paused(Loop):
    """A graph in which somebody acts at wall times: {s since the start: action}."""

    def __init__(self, sim, clock, actions):
        super().__init__(sim, clock)
        self.actions, self.began = dict(actions), clock.now

    def once(self, timeout):
        for due in [due for due in self.actions if self.clock.now >= self.began + due]:
            self.actions.pop(due)()
        super().once(timeout)


def test_a_paused_flight_waits_makes_single_steps_and_goes_on(clock, caplog):
    sim, at = Sim(mode='lockstep', duration=0.1, paused=True), []
    with caplog.at_level(logging.INFO):
        loop = Paused(sim, clock, {
            2.5: lambda: at.append(sim.senses), 3.0: lambda: sim.pause.step(0, sim.t),
            4.0: lambda: at.append(sim.senses), 5.0: lambda: sim.pause.step(5, sim.t),
            6.0: lambda: at.append(sim.senses), 7.0: lambda: sim.pause.set(False)})
        assert lockstep.run(sim, loop) == 0
    assert at == [0, 1, 6] and sim.senses == 21 and not sim.gave_up
    assert 'paused before t = 0.000 s' in caplog.text  # the runner sees a flight that lives
    assert 'paused before t = 0.030 s' in caplog.text


def test_a_pause_does_not_count_as_delay_in_real_time(clock):
    sim = Sim(mode='realtime', duration=0.05)
    loop = Paused(sim, clock, {
        0.02: lambda: sim.pause.set(True), 9.0: lambda: sim.pause.set(False)})
    assert lockstep.run(sim, loop) == 0
    assert sim.missed == 0 and not sim.gave_up
    assert 109.0 + 0.03 <= clock.now <= 109.0 + 0.03 + 2 * PERIOD + 0.02  # at its old pace


def test_a_paused_flight_can_be_ended(clock):
    sim = Sim(mode='lockstep', duration=1.0, paused=True)
    loop = Loop(sim, clock)
    loop.once = lambda timeout: setattr(loop, 'stopping', True)
    assert lockstep.run(sim, loop) == 0 and sim.senses == 0


def test_steps_are_for_a_paused_flight_and_have_a_limit():
    pause = lockstep.Pause(False)
    assert pause.due() and pause.step(1, 0) == (False, 'the simulation is not paused')
    assert pause.set(True) == 'paused'
    assert pause.step(3, 10 * STEP_NS) == (True, 'to t = 0.060 s')
    ending = lockstep.Pause(True, 0.1)
    assert ending.step(20, 0) == (True, 'to t = 0.095 s')
    assert ending.step(9000, 0) == (True, 'to t = 0.100 s, the end of the flight')
    assert pause.step(lockstep.MOST_STEPS, 0)[0] is False
    assert [pause.due() for _ in range(4)] == [True, True, True, False]
    pause.step(3, 0)
    pause.set(True)  # forgets the steps
    assert not pause.due()
