"""The watchdog and the answers of the simulator's node, without a graph."""

import logging
from types import SimpleNamespace

from mambo_sim import sim_node
from mambo_sim.delays import Delays
from mambo_sim.lockstep import Limit
from mambo_sim.parameters import STEP_NS
from mambo_sim.sim_node import SimNode
from mambo_sim.simulator import SimulatorParams
import pytest

TURNING, STILL = (200.0,) * 4, (0.0,) * 4


@pytest.fixture
def wall(monkeypatch):
    wall = SimpleNamespace(now=50.0)
    monkeypatch.setattr(sim_node, 'time', SimpleNamespace(monotonic=lambda: wall.now))
    return wall


@pytest.fixture
def sim(wall):
    """Return the node's own methods on a node that has no graph."""
    class Bare(SimNode):
        def __init__(self):
            self._tick, self._answered, self._last_command = 0, -1, wall.now
            self._pwm, self._shutdown, self._limit = TURNING, False, Limit(self)
            self.starved, self._starved_after, self.missed = -1, 0.0, 0
            self.sensed, self.delays, self.reports = wall.now, Delays(), []

        params = SimpleNamespace(motor_timeout=0.2, patience=5.0, mode='realtime',
                                 simulator=SimulatorParams())
        commands = SimpleNamespace(refused={'stale': 2})

        def get_logger(self):
            return logging.getLogger('sim_node')

        def _report(self, t):
            self.reports.append(t)

    return Bare()


def test_the_watchdog_stops_turning_motors_once_after_its_time(sim, wall, caplog):
    sim._tick = 40
    sim.watch(wall.now + 0.19, 1.0)
    assert sim.starved == -1 and not sim.reports
    sim.watch(wall.now + 0.21, 1.0)
    assert sim.starved == sim.reports[0] == 40 * STEP_NS and sim._starved_after == 0.2
    assert 'no motor_pwm for 0.2 s: motors stopped at t = 0.200 s' in caplog.text
    sim._tick = 80
    sim.watch(wall.now + 9.0, 1.0)  # for good: the first time counts, and is said once
    assert sim.starved == 40 * STEP_NS and len(sim.reports) == 1


@pytest.mark.parametrize(('speed', 'wall_time'), [(0.1, 2.0), (1.0, 0.2), (10.0, 0.2)])
def test_in_slow_motion_the_failsafe_has_as_much_flight_time_before_the_watchdog(
        sim, wall, speed, wall_time):
    sim.watch(wall.now + wall_time - 0.01, speed)
    assert sim.starved == -1
    sim.watch(wall.now + wall_time + 0.01, speed)
    assert sim.starved == 0 and sim._starved_after == wall_time


def test_a_timeout_of_zero_is_no_watchdog(sim, wall):
    sim.params = SimpleNamespace(motor_timeout=0.0, patience=5.0)
    sim.watch(wall.now + 1e6, 1.0)
    assert sim.starved == -1 and not sim.reports


@pytest.mark.parametrize(('pwm', 'shutdown', 'stops'), [
    (STILL, False, False), (TURNING, True, False), ((0.0, 0.0, 0.0, 1.0), False, True)])
def test_only_motors_that_turn_are_stopped(sim, wall, pwm, shutdown, stops):
    sim._pwm, sim._shutdown = pwm, shutdown
    sim.watch(wall.now + 1.0, 1.0)
    assert (sim.starved >= 0) == stops


def test_a_command_sets_the_watchdog_back(sim, wall):
    wall.now += 0.15
    sim._on_pwm(0, TURNING, False)
    sim.watch(wall.now + 0.15, 1.0)
    assert sim.starved == -1


def test_time_in_which_nothing_ran_is_no_silence(sim, wall):
    wall.now += 20.0
    sim.start(19.9)
    sim.watch(wall.now + 0.05, 1.0)
    assert sim.starved == -1
    sim.watch(wall.now + 0.15, 1.0)
    assert sim.starved == 0
    sim.start(50.0)  # of which nothing was heard
    assert sim._last_command == wall.now
    wall.now += 7.0
    sim.start()
    assert sim._last_command == wall.now


def test_the_answer_of_a_step_counts_and_its_delay(sim, wall):
    sim._tick = 10
    assert not sim.answered
    wall.now += 0.002
    sim._on_pwm(10 * STEP_NS, TURNING, False)
    assert sim.answered and sim.delays.count == 1
    assert sim.delays.longest == pytest.approx(0.002, abs=1e-9)


def test_a_late_answer_moves_the_motors_but_is_not_that_of_the_step(sim, wall):
    """The command for the step before is the newest there is; its delay is that of no sample."""
    sim._tick = 10
    sim._on_pwm(9 * STEP_NS, (150.0,) * 4, False)
    assert not sim.answered and sim._pwm == (150.0,) * 4 and sim.delays.count == 0


def test_a_shutdown_is_no_thrust(sim):
    sim._on_pwm(0, TURNING, True)
    assert sim._pwm == STILL and sim._shutdown


def test_the_first_command_above_the_largest_pwm_is_told(sim, caplog):
    sim._on_pwm(0, (500.0,) * 4, False)
    sim._on_pwm(STEP_NS, (900.0,) * 4, True)  # shut down
    assert not caplog.records
    for k in (2, 3):
        sim._on_pwm(k * STEP_NS, (1.0, 2.0, 65535.0, 501.0), False)
    assert [record.message for record in caplog.records] == [
        'motor_pwm of t = 0.010 s is 65535, above pwm_max of the vehicle: it and later ones are '
        'limited to 500']


def test_giving_up_stops_the_motors_and_says_what_was_refused(sim, caplog):
    sim._tick = 200
    sim.give_up()
    assert sim.starved == sim.reports[0] == 10**9 and sim._starved_after == 5.0
    assert 'no motor_pwm for t = 1.000 s within 5 s: motors stopped; refused: 2 stale' in (
        caplog.text)


def test_the_first_stop_is_the_one_that_is_told(sim, wall):
    sim._tick = 40
    sim.watch(wall.now + 0.3, 1.0)
    sim._tick = 2000
    sim.give_up()
    assert sim.starved == 40 * STEP_NS and sim._starved_after == 0.2


def test_a_deserted_simulator_has_heard_nothing_for_its_patience(sim, wall):
    assert not sim.is_deserted(wall.now + 4.9) and sim.is_deserted(wall.now + 5.1)
    wall.now += 10.0
    sim.start()
    assert not sim.is_deserted(wall.now + 4.9)


@pytest.mark.parametrize(('shutdown', 'starved', 'stops'), [
    (False, -1, False), (True, -1, True), (False, 0, True)])
def test_stopped_motors_stay_stopped_as_time_goes_on(sim, monkeypatch, shutdown, starved, stops):
    done = []
    monkeypatch.setattr(sim_node.pushed, 'advance_held', lambda *given: done.append(given))
    sim.held, sim._shutdown, sim.starved = 'held', shutdown, starved
    sim.advance()
    assert done == [('held', TURNING, stops, None)] and sim.t == STEP_NS
