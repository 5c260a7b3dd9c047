"""Formations: references that keep their distance; a planner that refuses those that do not."""

from mambo_flight import scenario
from mambo_flight.world import formation
from mambo_model.errors import InputError
from mambo_model.motion.trajectory import reference_at
from mambo_model.schema import ParameterError
from mambo_sim.world import WorldParams
import numpy as np
import pytest


def base(**more):
    return scenario.scenario(**{'duration': 40.0, **more})


def paths(drones, times):
    return np.array([
        [np.array(reference_at(t, flight.reference_node.plan,
                               flight.reference_node.vehicle)[0].rho) + place for t in times]
        for flight, place in zip(drones.flights, drones.hall.places.values(), strict=True)])


@pytest.mark.parametrize('shape', ['line', 'circle'])
def test_formations_keep_their_shape(shape):
    drones = formation.hall(base(), WorldParams(drones=4, formation=shape, spacing=0.7))
    found = paths(drones, np.linspace(0.0, 40.0, 41))
    np.testing.assert_allclose(np.ptp(found - found[0], axis=1), 0.0, atol=1e-12)
    assert [flight.seed for flight in drones.flights] == [1, 2, 3, 4]
    assert list(drones.hall.places) == ['/mambo1', '/mambo2', '/mambo3', '/mambo4']


def test_a_follower_repeats_the_motion_later():
    drones = formation.hall(base(), WorldParams(
        drones=3, formation='follow', delay=2.0, spacing=3.0))
    times = np.arange(9.0, 25.0, 0.5)
    leader, second, third = (
        one - place for one, place in zip(paths(drones, times), drones.hall.places.values(),
                                          strict=True))
    np.testing.assert_allclose(second[4:], leader[:-4], atol=1e-9)
    np.testing.assert_allclose(third[8:], leader[:-8], atol=1e-9)


@pytest.mark.parametrize('n', [2, 5])
def test_an_exchange_ends_opposite_and_keeps_the_distances(n):
    params = WorldParams(drones=n, formation='exchange', spacing=0.6, turn_time=6.0)
    drones = formation.hall(base(trajectory='hover'), params)
    end = drones.flights[0].sim_node.duration
    found = paths(drones, np.linspace(0.0, end, 200))
    near = 1e-3  # m: the fitted course ends at rest to rounding only, and the landing stops it
    np.testing.assert_allclose(found[:, -1, :2], -found[:, 0, :2], atol=near)
    for one in range(n):
        gap = np.linalg.norm(found[one] - found[(one + 1) % n], axis=1)
        np.testing.assert_allclose(gap, 0.6, atol=near)
    assert drones.flights[0].reference_node.plan.landing_time == end - scenario.LANDING


def test_references_that_meet_are_refused_with_pair_and_time():
    # circles of 1 m radius, half a turn apart in time, come within 2 m of their neighbour's
    params = WorldParams(drones=2, formation='follow', delay=np.pi, spacing=2.0)
    with pytest.raises(InputError, match=(
            r'drones 1 and 2 come within 0\.\d{3} m of each other at t = \d+\.\d\d s; '
            r'world.least_separation is 0.5 m')):
        formation.hall(base(), params)
    formation.hall(base(), WorldParams(
        drones=2, formation='follow', delay=np.pi, spacing=3.0))


def test_a_delay_beyond_the_landing_is_refused():
    with pytest.raises(ParameterError, match='world.delay = 20 s: drone 3 would begin'):
        formation.hall(base(), WorldParams(
            drones=3, formation='follow', delay=20.0, least_separation=0.0))


def test_a_delay_beyond_the_end_of_a_flight_without_landing_is_refused():
    with pytest.raises(ParameterError, match=(
            'drone 2 would begin its motion at t = 25 s and end its flight at 20 s')):
        formation.hall(base(duration=20.0, land=False), WorldParams(
            drones=3, formation='follow', delay=20.0, spacing=3.0))
    formation.hall(base(duration=20.0, land=False), WorldParams(
        drones=3, formation='follow', delay=2.0, spacing=3.0))


def test_seeds_are_bounded():
    with pytest.raises(ParameterError, match='leaves no seeds for 2 drones'):
        formation.hall(base(seed=scenario.MAX_SEED), WorldParams(drones=2))


def test_one_drone_keeps_its_name():
    assert formation.namespaces(1) == ['/mambo']
    assert formation.namespaces(2) == ['/mambo1', '/mambo2']


def test_an_exchange_without_landing_ends_at_rest_in_the_air():
    drones = formation.hall(
        base(trajectory='hover', land=False),
        WorldParams(drones=3, formation='exchange', spacing=1.0))
    plan = drones.flights[1].reference_node.plan
    end = drones.flights[1].sim_node.duration
    last, _ = reference_at(end, plan, drones.flights[1].reference_node.vehicle)
    assert plan.landing_time == 0.0 and last.rho[2] == pytest.approx(-1.5, abs=1e-3)
    np.testing.assert_allclose(last.v, 0.0, atol=1e-3)


def test_an_exchange_takes_the_height_and_time_that_are_asked_for():
    flight = scenario.override(base(trajectory='hover'), {'reference_node.plan.height': 2.0})
    slow, fast = (
        formation.hall(flight, WorldParams(drones=2, formation='exchange', turn_time=seconds))
        for seconds in (20.0, 5.0))
    assert slow.flights[0].sim_node.duration == fast.flights[0].sim_node.duration + 15.0
    heights = paths(slow, np.linspace(8.0, 28.0, 40))[:, :, 2]
    np.testing.assert_allclose(heights, -2.0, atol=1e-6)


def exchanged(flight, timed=False, **more):
    drones = formation.hall(flight, WorldParams(drones=2, formation='exchange', **more), timed)
    return drones.flights[0].sim_node.duration, drones.flights[0].reference_node.plan.landing_time


def test_an_exchange_hovers_for_the_rest_of_a_longer_flight():
    hover = base(trajectory='hover', duration=60.0)
    assert exchanged(hover) == (60.0, 60.0 - scenario.LANDING)
    needed, _ = exchanged(base(trajectory='hover'))
    assert exchanged(base(trajectory='hover'), timed=True)[0] == 40.0 > needed
    params = WorldParams(drones=2, formation='exchange')
    found = paths(formation.hall(hover, params), np.linspace(needed, 50.0, 5))
    np.testing.assert_allclose(found[:, :, :2], -found[::-1, :, :2], atol=1e-3)
    np.testing.assert_allclose(np.ptp(found, axis=1), 0.0, atol=1e-3)


@pytest.mark.parametrize('land, needed', [(False, 17.0), (True, 26.0)])
def test_an_exchange_does_not_fit_in_a_shorter_flight(land, needed):
    short, enough = (base(trajectory='hover', land=land, duration=seconds)
                     for seconds in (needed - 1.0, needed))
    with pytest.raises(ParameterError, match=(
            f'duration = {needed - 1.0:g} s: an exchange with world.turn_time = 8 s needs '
            f'{needed:g} s{", landing included" if land else ""}: ')):
        exchanged(short)
    assert exchanged(enough)[0] == needed


def test_an_exchange_refuses_a_trajectory_that_it_does_not_fly():
    with pytest.raises(ParameterError, match='trajectory: step has no effect, as the formation'):
        exchanged(base(trajectory='step'))


def test_an_exchange_too_fast_for_the_vehicle_is_told():
    def told(**more):
        return list(formation.remarks(formation.hall(
            base(trajectory='hover'), WorldParams(drones=3, formation='exchange', **more))))

    assert told() == []
    line, = told(spacing=50.0, turn_time=8.0)
    assert 'cannot fly its half turn in world.turn_time = 8 s: ' in line and '\n' not in line
    assert line.endswith('; lengthen the turn')
    assert told(spacing=50.0, turn_time=60.0) == []


@pytest.mark.parametrize('least', [2.9, 3.1])
def test_the_least_separation_decides(least):
    drones = formation.hall(base(), WorldParams(drones=2, least_separation=2.0))
    places = list(drones.hall.places.values())
    if least < 3.0:
        formation.check(drones.flights, places, least)
        return
    with pytest.raises(InputError, match=r'within 3.000 m of each other at t = 0.00 s'):
        formation.check(drones.flights, places, least)
