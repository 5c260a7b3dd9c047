"""Barometer against the table of the standard atmosphere and its own inverse."""

import math

from mambo_estimation.measurements import barometer
import pytest

V = barometer.BarometerParams().values()


@pytest.mark.parametrize(('pressure', 'height'), [  # ISO 2533, geopotential height
    (101325.0, 0.0), (100129.4, 100.0), (89874.57, 1000.0), (79495.22, 2000.0)])
def test_height_is_that_of_the_standard_atmosphere(pressure, height):
    assert barometer.measured_height(pressure) == pytest.approx(height, abs=0.05)


def test_prediction_undoes_the_measurement():
    for h in (-50.0, 0.0, 1.5, 300.0):
        assert barometer.measured_height(barometer.predict(h)[0]) == pytest.approx(h, abs=1e-8)


def test_jacobian_matches_central_differences_and_pressure_falls_with_height():
    h, eps = 20.0, 1e-2
    _, slope = barometer.predict(h)
    # error of the difference: third derivative eps^2 and 1e5 Pa * 1e-16 / eps, below 1e-8
    assert slope == pytest.approx(
        (barometer.predict(h + eps)[0] - barometer.predict(h - eps)[0]) / (2 * eps), abs=1e-7)
    assert -12.1 < slope < -11.9  # 12 Pa per metre near the ground


@pytest.mark.parametrize('bad', [math.nan, math.inf, 0.0, -1.0, 2e5])
def test_impossible_pressures_are_refused(bad):
    assert not barometer.is_valid(bad, V) and barometer.is_valid(1e5, V)
