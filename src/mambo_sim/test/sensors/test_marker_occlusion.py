"""Markers and what cameras see of them: places, noise, hiding, and what is refused."""

import dataclasses
import itertools
import math

from mambo_model.schema import ParameterError
from mambo_model.vehicle import parameters
from mambo_sim.sensors import marker_occlusion
from mambo_sim.sensors.marker_occlusion import MarkerParams
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PERIOD = 8_333_333
RHO = (1.0, 2.0, -1.5)
R = Rotation.from_euler('ZYX', [1.0, 0.2, -0.3])
Q = (R.as_quat()[3].item(), *R.as_quat()[:3].tolist())


def frames(params, n, seed=0):
    """Return points (n, 5, 3) and visibility (n, 5) of n frames."""
    p, rng = params.values(PERIOD), np.random.default_rng(seed)
    seen, out = marker_occlusion.ALL, []
    for _ in range(n):
        points, seen = marker_occlusion.reconstruct(seen, RHO, Q, rng, True, p)
        out.append((points, seen))
    return np.array([points for points, _ in out]), np.array([seen for _, seen in out])


def test_markers_are_where_the_vehicle_file_has_them():
    places = [at for _, at in parameters.markers('identified_markers')]
    assert MarkerParams().five() == tuple(places) and len(places) == 5
    assert parameters.markers('identified') == []


def test_no_two_pairs_of_markers_are_as_far_apart():
    apart = sorted(math.dist(a, b) for a, b in itertools.combinations(MarkerParams().five(), 2))
    # what tells markers apart: six times what a distance errs by, sqrt(2) of their noise
    assert np.diff(apart).min() > 6 * math.sqrt(2) * MarkerParams().noise


def test_the_symmetric_layout_looks_the_same_after_half_a_turn_of_yaw():
    five = np.array(MarkerParams(layout='symmetric').five())
    turned = five * [-1.0, -1.0, 1.0]
    np.testing.assert_allclose(turned[[2, 3, 0, 1, 4]], five, atol=1e-15)
    np.testing.assert_allclose(five, MarkerParams().five(), atol=0.013)  # close to the other
    np.testing.assert_allclose(np.linalg.norm(five, axis=1).mean(), 0.063, atol=0.002)


def test_points_are_the_markers_with_white_noise():
    params = MarkerParams(noise=0.0005)
    points, seen = frames(params, 4000)
    errors = points - (R.apply(params.five()) + RHO)
    assert seen.all()
    # 4000 samples: standard error of a deviation 1.1 %, of a correlation 0.016
    np.testing.assert_allclose(errors.std(axis=0), 0.0005, rtol=0.06)
    assert np.abs(errors.mean(axis=0)).max() < 5 * 0.0005 / math.sqrt(4000)
    correlation = np.corrcoef(errors.reshape(4000, 15).T) - np.eye(15)
    assert np.abs(correlation).max() < 0.08
    lagged = (errors[1:] * errors[:-1]).mean(axis=0) / 0.0005**2
    assert np.abs(lagged).max() < 0.08


@pytest.mark.parametrize('share, time', [(0.1, 0.1), (0.5, 0.05), (0.3, 0.5)])
def test_markers_hide_as_often_and_as_long_as_asked_for(share, time):
    n = 24_000  # 200 s
    _, seen = frames(MarkerParams(occlusion=share, occlusion_time=time), n)
    # each spell of hiding and showing lasts time / (1 - share) to correlate: so many are alike
    spells = 5 * n * PERIOD * 1e-9 * (1.0 - share) / (2.0 * time)
    error = math.sqrt(share * (1.0 - share) / spells)
    assert 1.0 - seen.mean() == pytest.approx(share, abs=4.5 * error)
    rows = [len(list(row)) for column in seen.T for key, row in itertools.groupby(column)
            if not key]
    # seen at frames, a spell lasts 1/p frames: p = (1 - share)(1 - exp(-T/(time (1 - share))))
    leave = (1.0 - share) * -math.expm1(-PERIOD * 1e-9 / (time * (1.0 - share)))
    assert np.mean(rows) == pytest.approx(1.0 / leave, rel=4.5 / math.sqrt(len(rows)))
    together = np.corrcoef(seen.T) - np.eye(5)
    assert np.abs(together).max() < 4.5 * math.sqrt(5.0 / spells)  # each hides by itself


def test_without_noise_points_are_exact_and_nothing_is_drawn():
    params, rng = MarkerParams(occlusion=0.9), np.random.default_rng(1)
    before = rng.bit_generator.state
    points, seen = marker_occlusion.reconstruct(
        (False,) * 5, RHO, Q, rng, False, params.values(PERIOD))
    assert rng.bit_generator.state == before and seen == marker_occlusion.ALL
    np.testing.assert_allclose(points, R.apply(params.five()) + RHO, atol=1e-15)


def line(*places):
    return tuple(float(x) for place in places for x in place)


@pytest.mark.parametrize('changes, message', [
    ({'positions': line(*[(0.02 * i, 0.01 * i, 0.0) for i in range(5)])}, 'on a line'),
    ({'positions': (0.058, 0.054, -0.012) + MarkerParams().positions[3:]}, 'mm apart'),
    ({'positions': (0.1, 0.2)}, '15 numbers'),
    ({'deflection': 0.04}, 'deflection'),
    ({'min_markers': 2}, 'min_markers'),
    ({'min_markers': 6}, 'min_markers'),
    ({'occlusion': 1.0}, 'occlusion'),
    ({'layout': 'random'}, 'layout'),
])
def test_markers_that_tell_no_pose_are_refused(changes, message):
    with pytest.raises(ParameterError, match=message) as error:
        dataclasses.replace(MarkerParams(), **changes)
    assert '\n' not in str(error.value)
