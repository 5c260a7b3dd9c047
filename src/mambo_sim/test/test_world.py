"""The hall: places, collisions with time and pair, and pushes that do not depend on order."""

import math

from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim.downwash import DownwashParams
from mambo_sim.world import Collision, places, World, WorldParams
import numpy as np
import pytest

THRUST = 0.667


def world(*positions, **params):
    """Return a hall with drones that hover where their places are, in their own frames at 0."""
    n = len(positions)
    out = World(WorldParams(drones=n, **params), positions, [Vehicle()] * n)
    out.seen[:, 5], out.seen[:, 6], out.seen[:, 2] = 1.0, THRUST, -1.0
    return out


def test_a_collision_is_noticed_once_with_time_pair_and_distance():
    hall = world((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 0.0))
    hall.look(0)
    assert not hall.collisions
    hall.seen[2, 1] = -0.9  # 0.1 m beside the second
    hall.look(5_000_000)
    hall.look(10_000_000)
    assert [(one.t, one.pair) for one in hall.collisions] == [(5_000_000, (1, 2))]
    assert hall.collisions[0].distance == pytest.approx(0.1)
    assert hall.stopped == [False] * 3
    hall.seen[2, 1] = 0.0
    hall.look(15_000_000)
    hall.seen[2, 1] = -0.9
    hall.look(20_000_000)
    assert [one.t for one in hall.collisions] == [5_000_000, 20_000_000]


def test_a_collision_stops_both_if_asked():
    hall = world((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 0.0), on_collision='stop')
    hall.seen[0, 1] = 0.95
    hall.look(0)
    assert hall.stopped == [True, True, False]


def test_a_collision_is_one_line():
    line = Collision(1_500_000_000, (0, 2), 0.1234).describe(['/a', '/b', '/c'])
    assert line == '/a and /c collided at t = 1.500 s: 0.123 m apart'


def test_pushes_are_none_without_downwash_and_zero_on_the_floor():
    above = ((0.0, 0.0, 0.0), (0.0, 0.0, -0.6))
    assert world(*above).look(0) == [None, None]
    hall = world(*above, downwash=DownwashParams(enabled=True))
    lower, upper = hall.look(0)
    assert lower > 0.0 and upper == 0.0
    hall.seen[0, 2] = 0.0
    assert hall.look(0) == [0.0, 0.0]


def test_the_order_of_the_drones_does_not_matter():
    spots = ((0.0, 0.0, 0.0), (0.05, 0.0, -0.6), (0.0, 0.1, -0.3))
    on = {'downwash': DownwashParams(enabled=True)}
    assert world(*spots, **on).look(0) == world(*spots[::-1], **on).look(0)[::-1]


@pytest.mark.parametrize('formation', ['circle', 'exchange'])
def test_neighbours_on_a_circle_have_the_spacing(formation):
    spots = np.array(places(WorldParams(drones=5, formation=formation, spacing=0.8)))
    gaps = np.linalg.norm(spots - np.roll(spots, 1, axis=0), axis=1)
    np.testing.assert_allclose(gaps, 0.8)
    np.testing.assert_allclose(spots.mean(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize('formation', ['line', 'follow'])
def test_a_line_is_centred_and_has_the_spacing(formation):
    spots = places(WorldParams(drones=4, formation=formation, spacing=0.6))
    np.testing.assert_allclose([y for _, y, _ in spots], [-0.9, -0.3, 0.3, 0.9])
    assert {x for x, _, _ in spots} == {z for _, _, z in spots} == {0.0}


@pytest.mark.parametrize('wrong', [
    {'drones': 0}, {'drones': 33}, {'drones': 2, 'spacing': 0.3},
    {'drones': 2, 'spacing': math.nan}, {'formation': 'heap'},
    {'drones': 2, 'least_separation': 0.0, 'collision_distance': 4.0}])
def test_worlds_that_cannot_be_flown_are_refused(wrong):
    with pytest.raises(ParameterError):
        WorldParams(**wrong)
