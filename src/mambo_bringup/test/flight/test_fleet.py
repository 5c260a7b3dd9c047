"""The simulators of a hall as one: every answer counts, nobody moves before all have answered."""

from types import SimpleNamespace

from mambo_bringup.flight import fleet as module
from mambo_bringup.flight.fleet import Fleet
from mambo_flight.world.world_file import Hall
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import lockstep
from mambo_sim.downwash import DownwashParams
from mambo_sim.world import WorldParams
import pytest


class Sim:
    """Stand-in for the node of one simulator."""

    def __init__(self, place, log):
        self.params = SimpleNamespace(simulator=SimpleNamespace(vehicle=Vehicle()))
        self.t, self.answered, self.sensed, self.missed, self.delays = 0, True, 1.0, 0, place
        self.held, self.name = self, f'/mambo{place + 1}'
        self.pause = lockstep.Pause(False)
        self.east, self.calls, self._log, self.deserted = 0.0, [], log, False

    def get_logger(self):
        return SimpleNamespace(error=self._log.append)

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
    all_of_them.watch(7.0, 0.5)
    assert (sims[0].calls, sims[1].calls) == ([], [('watch', 7.0, 0.5)])
    assert (sims[0].missed, sims[1].missed) == (0, 1)
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
