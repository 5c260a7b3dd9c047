"""Who races over what: the same vehicles and wind for everybody, courses that can be flown."""

import itertools
from pathlib import Path

from mambo_flight.course import feasibility
from mambo_flight.race.comparison import (
    Comparison, CONDITIONS, COURSES, DURATION, enter, ENTRANTS, GUST, lemniscate, Start, STATES)
from mambo_flight.scenario import override, scenario
from mambo_model.errors import InputError, MamboError
from mambo_model.motion.trajectory import reference_at
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

PD = Path(__file__).parents[4] / 'examples/pd_controller.py'


def true(flight):
    sim = flight.sim_node.simulator
    return sim.vehicle, sim.wind, sim.seed


def test_every_entrant_flies_the_same_vehicles_in_the_same_wind():
    comparison = Comparison(
        enter(('indi', 'geometric')), ('circle', 'step'), ('everything',), 3, 'true')
    flights = [comparison[number] for number in range(len(comparison))]
    assert len(flights) == 12
    for (a, one), (b, other) in itertools.combinations(zip(comparison.starts, flights), 2):
        assert (true(one) == true(other)) == (a.draw == b.draw)
        # nobody is told: all believe in the same vehicle
        assert one.controller_node.vehicle == other.controller_node.vehicle == Vehicle()
    assert comparison.starts[0] == Start('indi', 'circle', 'everything', 0)


def test_what_is_wrong_is_what_the_condition_says():
    known, = (f for f in [Comparison(enter(('indi',)), ('circle',), ('known',), 9, 'true')[0]])
    assert true(known)[0] == Vehicle() and known.sim_node.simulator.wind.values() is None
    comparison = Comparison(enter(('indi',)), ('circle',), ('twenty_percent',), 4, 'true')
    vehicles = [true(comparison[k])[0] for k in range(4)]
    assert {(round(v.mass / 0.068, 9), round(v.drag_coefficient / 0.22, 9)) for v in vehicles} == {
        (1.2, 1.2), (1.2, 0.8), (0.8, 1.2), (0.8, 0.8)}
    assert true(comparison[0])[1].gust == (GUST,) * 3
    drawn = [CONDITIONS['everything'](draw) for draw in range(300)]
    mass = np.array([d['sim_node.simulator.vehicle.mass'] for d in drawn]) / 0.068
    lag = np.array([d['sim_node.simulator.vehicle.motor_time_constant'] for d in drawn])
    # a uniform draw of 300 leaves 1 % of its range at either end once in e^3
    assert 0.8 <= mass.min() < 0.81 and 1.19 < mass.max() <= 1.2
    assert 0.0 <= lag.min() < 0.001 and 0.029 < lag.max() <= 0.03


def test_a_flight_where_nothing_is_drawn_is_flown_once():
    assert len(Comparison(enter(('indi',)), COURSES, ('known',), 50, 'true')) == len(COURSES)
    noisy = Comparison(enter(('indi',)), COURSES, ('known',), 50, 'estimated')
    assert len(noisy) == 50 * len(COURSES)


def test_a_controller_from_a_file_races_under_its_own_name():
    entrants = enter(['indi', f'{PD}', 'toolbox'])
    assert list(entrants) == ['indi', 'pd_controller', 'toolbox']
    assert 'sha256' in entrants['pd_controller'].title
    comparison = Comparison(entrants, ('circle',), ('everything',), 2, 'true')
    assert [start.entrant for start in comparison.starts[::2]] == list(entrants)
    assert comparison[2].controller_node.controller == str(PD)
    assert true(comparison[3]) == true(comparison[1])


@pytest.mark.parametrize(('names', 'said'), [
    (['foo'], "controller 'foo' is unknown: give a file"),
    (['indi', 'indi'], 'indi: indi is given twice'),
    ([f'{PD}', f'{PD}'], 'pd_controller is given twice'),
    (['none.py'], 'none.py: No such file')])
def test_who_cannot_race_is_refused_in_one_line(names, said):
    with pytest.raises(InputError, match=said) as error:
        enter(names)
    assert '\n' not in str(error.value)


def test_a_file_with_the_name_of_an_entrant_is_refused(tmp_path):
    (tmp_path / 'feedforward.py').write_text(PD.read_text())
    with pytest.raises(InputError, match='feedforward is already the name of another controller'):
        enter([str(tmp_path / 'feedforward.py')])


def test_a_draw_changes_what_it_would_change_in_a_flight_built_from_nothing():
    for state in STATES:
        comparison = Comparison(
            enter(('feedforward',)), ('lemniscate',), ('everything',), 3, state)
        base = scenario(controller='cascaded', duration=DURATION, seed=3, land=False)
        assert comparison[2] == override(base, {
            'reference_node.plan.trajectory': 'course',
            'reference_node.plan.course': comparison[0].reference_node.plan.course,
            'controller_node.cascaded.drag_feedforward': True,
            **STATES[state], **CONDITIONS['everything'](2)})


def test_an_aided_controller_answers_the_estimate_in_map():
    flight = Comparison(enter(('indi',)), ('circle',), ('known',), 1, 'aided')[0]
    assert flight.estimator_node.aided and flight.controller_node.estimate == 'map'


def test_settings_of_an_entrant_reach_its_controller():
    flight = Comparison(enter(('feedforward',)), ('circle',), ('known',), 1, 'true')[0]
    assert flight.controller_node.controller == 'cascaded'
    assert flight.controller_node.law.drag_feedforward
    plain = Comparison(enter(('cascaded',)), ('circle',), ('known',), 1, 'true')[0]
    assert not plain.controller_node.law.drag_feedforward
    assert set(ENTRANTS) >= {'extended', 'flatness_drag', 'geometric', 'indi'}


@pytest.mark.parametrize('course', ['lemniscate', 'minimum_snap'])
def test_the_vehicle_can_fly_the_courses(course):
    plan = Comparison(enter(('indi',)), (course,), ('known',), 1, 'true')[0].reference_node.plan
    assert feasibility.check(plan.flown_course(), Vehicle()) is None
    speeds = [np.linalg.norm(reference_at(float(t), plan, Vehicle())[0].v)
              for t in np.arange(5.0, DURATION, 0.1)]
    assert 0.5 < max(speeds) < 3.0


def test_drawn_vehicles_depend_on_the_number_of_the_draw_alone():
    condition = CONDITIONS['everything']
    assert [condition(k) for k in range(5)] == [condition(k) for k in range(5)]
    assert len({str(condition(k)) for k in range(50)}) == 50


def test_errors_of_exactly_20_percent_come_in_turns():
    condition = CONDITIONS['twenty_percent']
    assert [condition(k) for k in range(4)] == [condition(k) for k in range(4, 8)]


@pytest.mark.parametrize(('names', 'message'), [
    (['indi', 'indi'], 'indi: indi is given twice'),
    (['nonesuch'], 'nonesuch'), ([str(PD), str(PD)], 'pd_controller is given twice')])
def test_a_name_that_is_unknown_or_given_twice_is_refused(names, message):
    with pytest.raises(MamboError, match=message):
        enter(names)


def test_the_lemniscate_closes_after_8_seconds_and_crosses_itself_once_between():
    for t in (0.0, 1.3, 5.0):
        assert lemniscate(t + 8.0) == pytest.approx(lemniscate(t), abs=1e-12)
    assert lemniscate(4.0) == pytest.approx(lemniscate(0.0), abs=1e-12)
    north, east, down = np.array([lemniscate(t) for t in np.linspace(0.0, 8.0, 801)]).T
    assert np.ptp(north) == pytest.approx(2.0) and np.ptp(east) == pytest.approx(1.0, abs=1e-4)
    assert (down == -1.5).all()


def test_a_flight_is_built_once_for_all_its_draws(monkeypatch):
    comparison = Comparison(enter(('indi',)), ('circle',), ('twenty_percent',), 4, 'true')
    built = []
    base = Comparison._base
    monkeypatch.setattr(
        Comparison, '_base', lambda self, *key: built.append(key) or base(self, *key))
    seeds = [comparison[k].sim_node.simulator.seed for k in range(4)]
    assert built == [('indi', 'circle')] and seeds == [1, 2, 3, 4]
