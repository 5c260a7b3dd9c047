"""Fit: the variance of unit weight by numpy, its bounds, and how it fades."""

from mambo_estimation import fit
import numpy as np
import pytest


def test_an_innovation_moves_the_fit_by_its_weight():
    assert fit.updated(0.5, 2.0, 4.0, 0.1) == pytest.approx(0.5 + 0.1 * (2.0 - 0.5))


def test_an_innovation_beyond_the_gate_counts_as_one_at_the_gate():
    assert fit.updated(1.0, 1e6, 4.0, 0.1) == pytest.approx(1.0 + 0.1 * (16.0 - 1.0))
    assert fit.updated(1.0, 15.9, 4.0, 0.1) == pytest.approx(1.0 + 0.1 * (15.9 - 1.0))


@pytest.mark.parametrize('scale', [0.2, 1.0, 1.5])
def test_it_is_the_variance_of_unit_weight(scale):
    rng = np.random.default_rng(1)
    innovations, found = scale * rng.standard_normal(40000), 1.0
    kept = []
    for one in innovations.tolist():
        found = fit.updated(found, one * one, 6.0, 0.01)
        kept.append(found)
    # 200 independent means of 200 squares, deviation sqrt(2 / 40000): five of them
    assert np.mean(kept[1000:]) == pytest.approx(scale ** 2, rel=0.036)


@pytest.mark.parametrize(('found', 'scaled'), [(0.3, 0.3), (0.05, 0.1), (4.0, 4.0)])
def test_just_after_an_innovation_it_scales_and_never_by_less_than_is_believed(found, scaled):
    assert fit.faded(found, 0.1, 0.0) == pytest.approx(scaled)


@pytest.mark.parametrize('found', [0.3, 4.0])
def test_it_fades_to_the_covariance_of_the_filter(found):
    assert fit.faded(found, 0.1, 0.5) == pytest.approx(1.0 + (found - 1.0) * np.exp(-1.0))
    assert fit.faded(found, 0.1, np.inf) == 1.0
