"""The simulators of a hall as one: every answer counts, nobody moves before all have answered."""

from types import SimpleNamespace

from mambo_bringup.flight import fleet as module
from mambo_bringup.flight.fleet import Fleet
from mambo_flight.world.world_file import Hall
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import lockstep
from mambo_sim.delays import Delays
from mambo_sim.downwash import DownwashParams
from mambo_sim.world import WorldParams
import pytest


class Sim:
    """Stand-in for the node of one simulator."""

    def __init__(self, place, log):
        self.params = SimpleNamespace(simulator=SimpleNamespace(vehicle=Vehicle()))
        self.t, self.answered, self.sensed, self.missed, self.late = 0, True, 1.0, 0, 0
        self.delays, self.starved = Delays(), -1
        self.held, self.name = self, f'/mambo{place + 1}'
        self.pause = lockstep.Pause(False)
        self.east, self.calls, self._log, self.deserted = 0.0, [], log, False

    def get_logger(self):
        return SimpleNamespace(error=self._log.append, **dict.fromkeys(
            ('info', 'warning'), lambda line: self._log.append(f'{self.name}: {line}')))

    def get_namespace(self):
        return self.name

    def observe(self, row):
        row[:] = (0.0, self.east, -1.0, 0.0, 0.0, 1.0, 0.667)

    def sense(self, push):
        self.calls.append(('sense', push))

    def advance(self, push, stop):
        self.calls.append(('advance', push, stop))

    def is_deserted(self, now):
        return self.deserted

    def __getattr__(self, name):
        return lambda *given: self.calls.append((name, *given))


@pytest.fixture(autouse=True)
def seen(monkeypatch):
    """Let the hall see the stand-ins."""
    monkeypatch.setattr(module.pushed, 'observe_held', lambda held, row: held.observe(row))


def fleet(**params):
    log = []
    sims = [Sim(number, log) for number in range(2)]
    hall = Hall(WorldParams(drones=2, **params), {
        '/mambo1': (0.0, 0.0, 0.0), '/mambo2': (0.0, 3.0, 0.0)})
    return Fleet(sims, hall), sims, log


def test_all_answers_are_waited_for():
    all_of_them, sims, _ = fleet()
    assert all_of_them.answered
    sims[1].answered = False
    assert not all_of_them.answered
    all_of_them.give_up()
    assert sims[0].calls == [] and sims[1].calls[-1] == ('give_up',)


def test_the_speed_of_the_hall_is_set_with_its_first_drone():
    _, sims, _ = fleet()
    assert 'decided' not in vars(sims[0])
    assert sims[1].decided == {'speed': 'it is that of /mambo1 in the whole hall'}


def test_a_pause_of_one_is_a_pause_of_all():
    all_of_them, sims, _ = fleet()
    sims[1].pause.set(True)
    assert all_of_them.pause.paused and not all_of_them.pause.due()


def test_all_wait_longer_after_a_suspension():
    all_of_them, sims, _ = fleet()
    all_of_them.start(3.0)
    assert [sim.calls for sim in sims] == [[('start', 3.0)]] * 2


def test_one_deserted_simulator_ends_the_flight():
    all_of_them, sims, _ = fleet()
    assert not all_of_them.is_deserted(1.0)
    sims[1].deserted = True
    assert all_of_them.is_deserted(1.0)


@pytest.mark.parametrize('reaction', ['report', 'stop'])
def test_a_collision_is_logged_once_and_stops_motors_if_asked(reaction):
    all_of_them, sims, log = fleet(on_collision=reaction)
    all_of_them.sense()
    assert not log
    sims[1].east = -2.9
    for _ in range(2):
        all_of_them.sense()
        all_of_them.advance()
    assert log == ['/mambo1 and /mambo2 collided at t = 0.000 s: 0.100 m apart']
    for sim in sims:
        assert sim.calls[-1] == ('advance', None, reaction == 'stop')


def test_a_push_acts_on_sensors_and_motion_of_the_step():
    all_of_them, sims, _ = fleet(downwash=DownwashParams(enabled=True))
    assert [sim.calls for sim in sims] == [[('warm_up', 0.0)]] * 2
    all_of_them.sense()
    all_of_them.advance()
    assert [sim.calls[1:] for sim in sims] == [[('sense', 0.0), ('advance', 0.0, False)]] * 2


def step(all_of_them, replies, monkeypatch):
    """Pace a step that began at 1 s by the wall clock, answered after so many s by each drone."""
    now = 1.0

    def once(timeout):
        nonlocal now
        left = [sim for sim in all_of_them.drones if not sim.answered and replies[sim.name]]
        due = min((1.0 + replies[sim.name] for sim in left), default=now + timeout)
        now = min(now + timeout, due)
        for sim in left:
            sim.answered = now >= 1.0 + replies[sim.name]

    monkeypatch.setattr(lockstep, 'time', SimpleNamespace(monotonic=lambda: now))
    for sim in all_of_them.drones:
        sim.answered = False
        sim.delays.add(0.001)
    lockstep.wait_for_deadline(
        all_of_them, SimpleNamespace(stopping=False, once=once), 1.005, 1.0)


def test_a_step_counts_as_late_or_missed_for_the_drone_whose_command_was(monkeypatch):
    all_of_them, sims, _ = fleet()
    all_of_them.params.speed = 1.0
    for replies, late, missed in (
            ((0.001, 0.004), (0, 0), (0, 0)), ((0.001, 0.007), (0, 1), (0, 0)),
            ((0.001, None), (0, 1), (0, 1)), ((None, 0.012), (0, 2), (1, 1)),
            ((0.006, 0.007), (1, 3), (1, 1))):
        step(all_of_them, dict(zip(('/mambo1', '/mambo2'), replies, strict=True)), monkeypatch)
        assert (sims[0].late, sims[1].late) == late, replies
        assert (sims[0].missed, sims[1].missed) == missed, replies
        assert [bool(sim.calls) for sim in sims] == [count > 0 for count in missed]  # watched


def test_the_drone_whose_command_lockstep_waits_for_is_named(monkeypatch):
    all_of_them, sims, log = fleet()
    all_of_them.params.patience = 7.0
    sims[1].answered, now = False, 0.0

    def once(timeout):
        nonlocal now
        now += timeout

    monkeypatch.setattr(lockstep, 'time', SimpleNamespace(monotonic=lambda: now))
    assert not lockstep.wait_for_answer(
        all_of_them, SimpleNamespace(stopping=False, once=once))
    assert log == ['/mambo2: waiting for motor_pwm of t = 0.000 s']


def test_each_drone_says_how_its_own_commands_came(monkeypatch):
    all_of_them, sims, log = fleet()
    vars(all_of_them.params).update(mode='realtime', speed=1.0, duration=1.0)
    sims[1].missed, sims[1].late = 43, 142
    sims[1].delays.add(0.25)
    assert lockstep.run(all_of_them, SimpleNamespace(stopping=True)) == 0
    assert [line for line in log if 'flying' not in line] == [
        '/mambo1: no motor command came: is a controller running in this domain and namespace?',
        '/mambo1: flew 0.000 s in 0.000 s of wall time, 0 steps without their motor command',
        '/mambo2: flew 0.000 s in 0.000 s of wall time, 43 steps without their motor command, '
        '142 waited for a late one',
        '/mambo2: IMU sample to motor command: p50 250.00 ms, p99 250.00 ms, max 250.00 ms of 1 '
        'steps']
