"""The height of twelve real flights stays with their sonar, however bad that is."""

from pathlib import Path

from mambo_analysis.compare.estimate import answered, parameters, READ
from mambo_analysis.compare.verdict import verdict
from mambo_analysis.importers.minidrone import import_minidrone
from mambo_bags.reader import read_bag
from mambo_flight import offline_replay
from mambo_thesis.recordings.validate_flights import height_errors
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

FLIGHTS = Path(__file__).parents[3] / 'shared/data/rolling_spider_flights'
LOGS = sorted(FLIGHTS.glob('*.mat'))


def off_the_sonar(steps, found):
    """Return height less the median of the ranges within 0.25 s, at each that is valid, m."""
    upright = Rotation.from_quat(found.state[:, [7, 8, 9, 6]]).as_matrix()[:, 2, 2]
    at = np.flatnonzero((steps.sonar >= 0.46) & (steps.sonar <= 4.0) & (upright > 0.7))
    t, heights = steps.t[at] * 1e-9, steps.sonar[at] * upright[at]
    usual = [np.median(heights[np.abs(t - now) <= 0.25]) for now in t]
    return found.estimator[at, 1] - usual


@pytest.mark.skipif(not LOGS, reason='real recordings are not beside the checkout')
@pytest.mark.parametrize('log', LOGS, ids=lambda log: log.stem)
def test_the_height_stays_with_the_sonar(log, tmp_path):
    import_minidrone(log, tmp_path / 'bag')
    bag = read_bag(tmp_path / 'bag', READ)
    steps = offline_replay.steps(bag)
    found = offline_replay.run(steps, parameters(bag).filter)
    height = found.estimator[:, 1]
    # No flight was higher than 3 m; without the vote and the floor four end at -3 to -23 m.
    assert -0.11 < height.min() and height.max() < 3.0
    # In the worst one the sonar jumps between 0.45 and 2 m.
    assert np.sqrt(np.mean(off_the_sonar(steps, found) ** 2)) < 0.6
    assert 'height diverged' not in verdict(bag, answered(bag, found))


@pytest.mark.long
@pytest.mark.skipif(not LOGS, reason='real recordings are not beside the checkout')
@pytest.mark.parametrize('log', LOGS, ids=lambda log: log.stem)
def test_the_joint_filter_is_within_0_3_m_of_the_sonar(log, tmp_path):
    _, joint = height_errors(log, tmp_path)
    assert -0.11 < joint.lowest and joint.highest < 3.0
    if not log.stem.startswith('1a_y_rest'):  # on its side: the sonar sees no floor
        assert joint.rms_error < 0.3
