"""Positions of a motion capture that are turned about z against its attitude."""

import dataclasses

from mambo_analysis.importers.checks import turned
from mambo_signals.motion import Motion
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

T = np.arange(0.0, 20.0, 0.02)
FRAME = 1.7  # rad, of the motion capture against the drone's own frame
PATHS = {
    'square': np.abs((T[:, None] / 4.0 + [0.0, 1.0]) % 4.0 - 2.0).clip(0.5, 1.5),
    'eight': np.stack([np.sin(0.8 * T), 0.6 * np.sin(1.6 * T)], axis=1),
    'line': np.stack([np.sin(0.8 * T), 0.3 * np.sin(0.8 * T)], axis=1),
    'circle': np.stack([np.cos(0.8 * T), np.sin(0.8 * T)], axis=1)}


def flight(path, positions=0.0, drift=0.0 * T, late=0.0):
    """Return the drone's own path and the tracked one, whose positions are turned, rad."""
    rng = np.random.default_rng(1)
    yaw = 0.3 * np.sin(0.5 * T)  # as the drone believes
    steps = np.diff(path @ (1.0, 1.0j)) * np.exp(-1j * (FRAME + drift[1:]))
    own = np.append(0.0, np.cumsum(steps + rng.normal(0.0, 1e-3, len(steps)))) + 0.02 * T
    seen = path @ (1.0, 1.0j) * np.exp(1j * positions)
    out = []
    for name, where, turn, t in (
            ('onboard/odom', own, yaw, T),
            ('optitrack/pose', seen, yaw + FRAME + drift, T + late)):
        out.append(Motion(
            name, np.round(t * 1e9).astype(np.int64),
            np.stack([where.real, where.imag, 1.0 + 0.0 * T], axis=1),
            Rotation.from_euler('z', turn[:, None]).as_quat()))
    return out


@pytest.mark.parametrize('degrees', [15.0, -30.0, 90.0, 179.0])
@pytest.mark.parametrize('path', ['square', 'eight', 'line'])
def test_a_turn_of_the_positions_is_told_with_its_angle(path, degrees):
    own, seen = flight(PATHS[path], np.radians(degrees))
    assert np.degrees(turned.angle(own, seen)) == pytest.approx(degrees, abs=2.0)
    assert f'turned by {np.degrees(turned.angle(own, seen)):+.0f} deg about z against its ' in (
        turned.describe(own, seen))


@pytest.mark.parametrize('path', PATHS)
@pytest.mark.parametrize('late', [0.0, 0.1, -0.1])
@pytest.mark.parametrize('drift', [0.0, 1.5])
def test_no_turn_is_told_of_another_frame_a_delay_or_a_heading_that_drifts(path, late, drift):
    own, seen = flight(PATHS[path], drift=drift * T / 20.0, late=late)
    assert turned.angle(own, seen) == 0.0
    assert turned.describe(own, seen) is None


def test_a_heading_that_drifts_is_less_than_a_larger_turn():
    own, seen = flight(PATHS['square'], np.radians(90.0), drift=0.4 * T / 20.0)
    assert np.degrees(turned.angle(own, seen)) == pytest.approx(90.0, abs=2.0)
    own, seen = flight(PATHS['square'], np.radians(25.0), drift=0.4 * T / 20.0)
    assert turned.angle(own, seen) == 0.0


def test_a_position_from_outside_beside_a_heading_that_drifts_is_no_turn():
    own, seen = flight(PATHS['eight'])
    turns = Rotation.from_euler('z', -0.7 * T[:, None] / 20.0)
    own = dataclasses.replace(own, quaternion=(
        turns * Rotation.from_quat(own.quaternion)).as_quat())
    assert turned.angle(own, seen) == 0.0


def test_a_delay_of_a_circle_is_no_turn():
    """A turn by 9 deg and a delay of 0.1 s, which is 5 deg of the circle."""
    own, seen = flight(PATHS['circle'], np.radians(9.0) + 0.8 * 0.1)
    assert turned.angle(own, seen) == 0.0
    own, seen = flight(PATHS['circle'], np.radians(40.0))
    assert np.degrees(turned.angle(own, seen)) == pytest.approx(40.0, abs=8.0)


def hover(seed):
    """Return two hovers of 20 s whose paths have nothing in common, 0.2 m apart."""
    rng, out = np.random.default_rng(seed), flight(PATHS['line'])
    for i, one in enumerate(out):
        way = np.cumsum(rng.normal(0.0, 0.01, (len(T), 2)), axis=0)
        out[i] = dataclasses.replace(one, position=np.column_stack([way, 1.0 + 0.0 * T]))
    return out


@pytest.mark.parametrize('what', ['hover', 'small', 'short', 'apart', 'identity', 'none', 'line'])
def test_nothing_is_told_where_the_path_does_not_tell(what):
    own, seen = flight(PATHS['eight'], np.radians(90.0))
    if what == 'hover':
        assert not any(turned.angle(*hover(seed)) for seed in range(1, 20))
        own, seen = hover(0)
    if what == 'small':
        own, seen = flight(0.01 * PATHS['eight'], np.radians(90.0))
    if what == 'short':
        own = dataclasses.replace(
            own, **{x: getattr(own, x)[:250] for x in ('stamps', 'position', 'quaternion')})
    if what == 'apart':
        seen = dataclasses.replace(seen, stamps=seen.stamps + 30_000_000_000)
    if what in ('identity', 'none'):
        q = np.full((len(T), 4), np.nan) if what == 'none' else np.tile([0.0, 0.0, 0.0, 1.0], (
            len(T), 1))
        seen = dataclasses.replace(seen, quaternion=q)
    if what == 'line':  # at one speed: less the mean nothing is left
        own, seen = flight(np.outer(T, [0.3, 0.1]), np.radians(90.0))
    assert turned.angle(own, seen) == 0.0


@pytest.mark.parametrize('path', PATHS)
@pytest.mark.parametrize('late, drift', [(0.0, 0.0), (0.1, 0.0), (0.0, 1.5)])
def test_a_path_in_another_frame_or_that_drifts_is_the_same(path, late, drift):
    own, seen = flight(PATHS[path], late=late, drift=drift * T / T[-1])
    assert turned.other_path(own, seen) == ''


@pytest.mark.parametrize('own, seen', [('eight', 'circle'), ('square', 'line')])
def test_the_path_of_another_flight_is_told(own, seen):
    ours, theirs = flight(PATHS[own])[0], flight(PATHS[seen])[1]
    assert turned.other_path(ours, theirs).startswith(
        'the path of onboard/odom is not that of optitrack/pose (correlation of the ways over 1 s')
    still = dataclasses.replace(theirs, position=0.01 * theirs.position)
    assert turned.other_path(ours, still) == ''
    unknown = dataclasses.replace(theirs, quaternion=np.nan * theirs.quaternion)
    assert turned.other_path(ours, unknown) == ''
