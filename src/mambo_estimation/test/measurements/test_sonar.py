"""Sonar: a ray against the floor, the tilt that shortens it, and readings that say little."""

import math

from mambo_estimation.measurements import sonar
from mambo_model.schema import ParameterError
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

V = sonar.SonarParams().values()


@pytest.mark.parametrize('seed', range(10))
def test_range_is_the_length_of_the_ray_along_the_body_axis(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
    height, ray = rng.uniform(0.5, 3.0), R @ [0.0, 0.0, 1.0]
    hit = np.array([0.0, 0.0, -height]) + ray * height / ray[2]  # on the plane z = 0
    expected, _, _ = sonar.predict(height, R[2, 2])
    assert expected == pytest.approx(np.linalg.norm(hit - [0.0, 0.0, -height]), rel=1e-12)
    measured, _ = sonar.measured_height(expected, R[2, 2], 0.0, V)
    assert measured == pytest.approx(height, rel=1e-12)


def test_two_metres_of_range_at_sixty_degrees_are_one_metre_of_height():
    measured, _ = sonar.measured_height(2.0, math.cos(math.radians(60)), 0.0, V)
    assert measured == pytest.approx(1.0)


def test_jacobian_matches_central_differences():
    h, c, eps = 1.5, 0.9, 1e-6
    _, by_height, by_cosine = sonar.predict(h, c)
    # error of the difference: eps^2 and rounding / eps, both below 1e-9
    assert by_height == pytest.approx(
        (sonar.predict(h + eps, c)[0] - sonar.predict(h - eps, c)[0]) / (2 * eps), abs=1e-8)
    assert by_cosine == pytest.approx(
        (sonar.predict(h, c + eps)[0] - sonar.predict(h, c - eps)[0]) / (2 * eps), abs=1e-8)


@pytest.mark.parametrize('tilt', [0.0, 0.1, 0.4])
def test_variance_holds_range_noise_and_tilt_error(tilt):
    slant, std, eps = 1.7, 0.03, 1e-6
    _, variance = sonar.measured_height(slant, math.cos(tilt), std ** 2, V)
    by_range = math.cos(tilt)
    by_tilt = slant * (math.cos(tilt + eps) - math.cos(tilt - eps)) / (2 * eps)
    assert variance == pytest.approx((by_range * V.noise) ** 2 + (by_tilt * std) ** 2, rel=1e-6)


@pytest.mark.parametrize('bad', [math.nan, -0.1, 4.01, math.inf])
def test_impossible_ranges_are_refused(bad):
    assert not sonar.is_valid(bad, 1.0, V)


def test_range_at_a_large_tilt_is_refused():
    assert sonar.is_valid(1.0, 0.71, V) and not sonar.is_valid(1.0, 0.69, V)


def test_reading_below_the_shortest_range_only_bounds_the_height():
    assert sonar.is_near(0.45, V) and not sonar.is_near(0.47, V)
    assert sonar.nearest_height(0.2, 1.0, V) == 0.2
    assert sonar.nearest_height(0.9, 0.8, V) == pytest.approx(0.8 * V.min_range)
    assert sonar.nearest_height(-0.3, 1.0, V) == 0.0


def test_wrong_parameter_names_itself():
    with pytest.raises(ParameterError, match=r'^noise = 0.0 m is outside'):
        sonar.SonarParams(noise=0.0)
