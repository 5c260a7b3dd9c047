"""Drones in one hall: as if alone without downwash, bit for bit again with it, collisions."""

from mambo_flight import closed_loop, scenario
from mambo_flight.world import formation, together
from mambo_model.schema import ParameterError
from mambo_sim.downwash import DownwashParams
from mambo_sim.world import WorldParams
import numpy as np
import pytest

pytestmark = pytest.mark.long

SECONDS = 6.0
BLOWING = DownwashParams(enabled=True)


def hover(**more):
    return scenario.scenario('hover', duration=SECONDS, land=False, **more)


def fly(params, base=None):
    drones = formation.hall(base or hover(), params)
    return drones, together.fly(drones.flights, params, list(drones.hall.places.values()))


def arrays(recording):
    return [column for column in recording if isinstance(column, np.ndarray)]


def assert_same(one, other):
    for mine, theirs in zip(arrays(one), arrays(other), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_each_drone_flies_as_if_alone():
    drones, result = fly(WorldParams(drones=3, formation='circle'))
    for flight, recording in zip(drones.flights, result.recordings, strict=True):
        assert_same(recording, closed_loop.fly(flight, inner=True))
    assert not result.collisions


@pytest.fixture(scope='module')
def stacked():
    """Return two flights, alike, of a drone that takes off 0.6 m below another's hover."""
    params = WorldParams(drones=2, downwash=BLOWING)
    flights = [
        scenario.override(hover(seed=seed), {
            'reference_node.plan.height': height, 'reference_node.plan.takeoff_time': begin})
        for seed, height, begin in ((1, 1.5, 2.0), (2, 2.1, 1.0))]
    return flights, [
        together.fly(flights, params, [(0.0, 0.0, 0.0), (0.2, 0.0, 0.0)]) for _ in range(2)]


def test_downwash_pushes_the_lower_drone_down_and_leaves_the_upper_alone(stacked):
    flights, (result, _) = stacked
    lower, upper = result.recordings
    assert_same(upper, closed_loop.fly(flights[1], inner=True))
    alone = closed_loop.fly(flights[0], inner=True)
    sunk = (lower.truth[:, 2] - alone.truth[:, 2]).max()
    assert 0.005 < sunk < 1.0
    felt = lower.imu[:, 5] - alone.imu[:, 5]
    assert np.nanmax(np.abs(felt)) > 0.05  # m/s^2
    # on average more thrust is asked for
    assert lower.thrust[-200:].mean() > alone.thrust[-200:].mean()


def test_downwash_gives_the_same_bits_again(stacked):
    for one, other in zip(*(result.recordings for result in stacked[1]), strict=True):
        assert_same(one, other)


def test_drones_that_meet_collide_and_stop_if_asked():
    # both at one place: they touch from the first step
    params = WorldParams(drones=2, on_collision='stop')
    flights = [hover(seed=seed) for seed in (1, 2)]
    result = together.fly(flights, params, [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0)])
    assert [(one.t, one.pair) for one in result.collisions] == [(0, (0, 1))]
    for recording in result.recordings:
        assert recording.truth[-1, 2] == 0.0 and not recording.truth[:, :3].any()
    flies_on = together.fly(
        flights, WorldParams(drones=2), [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0)])
    assert flies_on.collisions[0].t == 0
    assert flies_on.recordings[0].truth[-1, 2] < -1.0


def test_drones_of_unlike_durations_are_refused():
    longer = scenario.override(hover(), {'sim_node.duration': SECONDS + 1.0})
    with pytest.raises(ParameterError, match='same sim_node.duration'):
        together.fly([hover(), longer], WorldParams(drones=2), [(0.0,) * 3, (0.0, 2.0, 0.0)])


def test_unlike_drones_share_a_hall():
    """Each keeps its estimator, controller, vehicle and wind, as if it were alone."""
    flights = [
        hover(), hover(estimator='ground_truth', seed=7),
        scenario.override(hover(seed=3), {'sim_node.simulator.vehicle.mass': 0.066}),
        hover(noise=False)]
    places = [(0.0, 2.0 * number, 0.0) for number in range(len(flights))]
    result = together.fly(flights, WorldParams(drones=4), places)
    for flight, recording in zip(flights, result.recordings, strict=True):
        assert_same(recording, closed_loop.fly(flight, inner=True))


def test_the_order_of_the_drones_does_not_matter(stacked):
    flights, (result, _) = stacked
    turned = together.fly(flights[::-1], WorldParams(drones=2, downwash=BLOWING),
                          [(0.2, 0.0, 0.0), (0.0, 0.0, 0.0)])
    for one, other in zip(result.recordings, turned.recordings[::-1], strict=True):
        assert_same(one, other)


def test_beside_each_other_drones_feel_next_to_nothing():
    near = WorldParams(drones=2, spacing=1.0)
    _, without = fly(near)
    _, blowing = fly(WorldParams(drones=2, spacing=1.0, downwash=BLOWING))
    for one, other in zip(without.recordings, blowing.recordings, strict=True):
        # at 1 m beside it the jet has a thousandth of its centre-line speed
        np.testing.assert_allclose(one.truth[:, :3], other.truth[:, :3], atol=0.005)


def test_drones_that_collide_in_flight_fall_if_asked():
    # both hover above the middle: one flies over, its reference step does not know of the other
    step, stay = (scenario.scenario(name, duration=9.0, land=False, estimator='ground_truth')
                  for name in ('step', 'hover'))
    params = WorldParams(drones=2, on_collision='stop')
    result = together.fly([step, stay], params, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    (collision, *_), (one, other) = result.collisions, result.recordings
    assert collision.pair == (0, 1) and 5.0 < collision.t * 1e-9 < 9.0
    assert collision.distance < params.collision_distance
    k = int(np.searchsorted(one.t, collision.t))
    gap = one.truth[k, :3] - other.truth[k, :3] - (1.0, 0.0, 0.0)
    assert np.linalg.norm(gap) == pytest.approx(collision.distance, abs=1e-12)
    before = one.truth[k - 1, :3] - other.truth[k - 1, :3] - (1.0, 0.0, 0.0)
    assert np.linalg.norm(before) >= params.collision_distance  # noticed at the first step
    for recording in (one, other):
        fall = recording.truth[k:, 2] - recording.truth[k, 2]
        seconds = (recording.t[k:] - recording.t[k]) * 1e-9
        still = fall[seconds <= 0.2]
        # free fall, from a vertical velocity of less than 0.5 m/s
        np.testing.assert_allclose(
            still, 0.5 * 9.81 * seconds[seconds <= 0.2]**2, atol=0.1)


def test_all_drones_of_the_largest_hall_fly():
    base = scenario.scenario('hover', duration=0.05, land=False)
    drones, result = fly(WorldParams(drones=32, formation='circle', spacing=0.6), base)
    assert len(result.recordings) == len(drones.hall.places) == 32
    assert len({recording.imu[-1].tobytes() for recording in result.recordings}) == 32


def test_columns_of_a_bag_are_recorded():
    drones = formation.hall(
        scenario.scenario('hover', duration=0.05, land=False), WorldParams(drones=2))
    result = together.fly(drones.flights, WorldParams(drones=2),
                          list(drones.hall.places.values()))
    for flight, recording in zip(drones.flights, result.recordings, strict=True):
        alone = closed_loop.fly(flight, inner=True)
        for mine, its in zip(recording.inner, alone.inner, strict=True):
            np.testing.assert_array_equal(mine, its)
