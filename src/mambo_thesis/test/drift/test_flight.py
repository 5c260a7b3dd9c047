"""A flight as evidence: motion by Optitrack at each sample of the flow, gaps left out."""

from drift_flights import flown, write
from mambo_analysis.identify.recording import Stream
from mambo_bags.mcap_reader import BagError
from mambo_thesis.drift import flight as drift_flight, identify_drift
from mambo_thesis.drift.flight import read
from mambo_thesis.drift.mechanisms import flow
from mambo_thesis.drift.paths import DRAG_RATE, PATHS, perfect
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

def test_poses_upside_down_are_counted_and_change_nothing(tmp_path, capsys):
    bags = [write(tmp_path / name, {'slope': 0.07}, flipped=where)
            for name, where in (('whole', ()), ('flipped', range(900, 912)))]
    (whole, flipped), _ = read(bags, lag=0.03)
    assert (whole.impossible, flipped.impossible) == (0, 12)
    assert len(flipped.flow) > len(whole.flow) - 20
    assert np.abs(flipped.track.omega).max() < 1.01 * np.abs(whole.track.omega).max()
    assert identify_drift.main([str(bags[1])]) == 0
    assert 'optitrack/pose: 12 poses left out' in capsys.readouterr().out


def test_the_lag_is_found_behind_a_flow_that_is_not_linear(tmp_path):
    # 3 sigma of eight seeds
    assert read([write(tmp_path / 'bag', {'cubic': 0.1})])[1] == pytest.approx(0.03, abs=0.004)


def posed(rate=120.0, seconds=10.0, noise=0.0, lost=None, path='C.4'):
    """Return poses along a path, some of them lost."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    if lost is not None:
        t = t[(t < lost[0]) | (t > lost[1])]
    track = perfect(PATHS[path], t, drag_rate=DRAG_RATE)
    rng = np.random.default_rng(0)
    return drift_flight.Poses(t, track.position + noise * rng.normal(size=(len(t), 3)),
                              Rotation.from_matrix(track.R))


def sensed(t, lag=0.0):
    track = perfect(PATHS['C.4'], t - lag, drag_rate=DRAG_RATE)
    return track, Stream(t, flow(track, track.height, {}))


def test_velocity_is_the_derivative_and_does_not_shift_in_time():
    found = drift_flight.smoothed(posed())
    exact = perfect(PATHS['C.4'], found.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(found.velocity[found.known], exact.velocity[found.known], atol=2e-4)
    np.testing.assert_allclose(found.position[found.known], exact.position[found.known], atol=1e-5)


def test_the_noise_of_the_velocity_is_told_from_what_the_cubic_leaves():
    found = drift_flight.smoothed(posed(noise=1e-3))
    exact = perfect(PATHS['C.4'], found.t, drag_rate=DRAG_RATE)
    error = (found.velocity - exact.velocity)[found.known]
    assert found.noise == pytest.approx(error.std(), rel=0.25)


def test_a_gap_of_the_poses_has_no_velocity():
    found = drift_flight.smoothed(posed(lost=(4.0, 6.0)))
    inside = (found.t > 4.1) & (found.t < 5.9)
    assert not found.known[inside].any() and found.known[~inside].mean() > 0.9


@pytest.mark.parametrize(('poses', 'wanted'), [
    (posed(seconds=0.5), '60 poses of Optitrack: 1 s and 30 of them are needed'),
    (posed(rate=10.0, seconds=2.0), '20 poses of Optitrack')])
def test_too_few_poses_are_refused(poses, wanted):
    with pytest.raises(BagError, match=wanted):
        drift_flight.smoothed(poses)


def test_the_white_noise_of_rates_is_told_from_motion():
    t = np.arange(4000) * 0.005
    slow = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), t])
    noise = 0.01 * np.random.default_rng(0).standard_normal((4000, 3))
    assert drift_flight.rate_noise(slow + noise) == pytest.approx(0.01, rel=0.05)
    assert drift_flight.rate_noise(slow) < 1e-5


def test_a_bias_of_the_gyro_is_taken_from_the_poses():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    track, seen = sensed(t)
    fine = np.arange(0.0, 9.9, 0.005)
    gyro = Stream(fine, perfect(PATHS['C.4'], fine, drag_rate=DRAG_RATE).omega + [
        0.05, -0.03, 0.02])
    found = drift_flight.assemble('f', posed(), seen, gyro)
    exact = perfect(PATHS['C.4'], found.track.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(found.track.omega[:, :2], exact.omega[:, :2], atol=2e-3)


def test_the_motion_is_that_at_the_sample_or_its_lag_before():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    found = drift_flight.assemble('f', posed(), Stream(t, sensed(t, 0.05)[1].values), lag=0.05)
    np.testing.assert_allclose(found.flow, flow(found.track, found.track.height, {}), atol=1e-3)
    late = drift_flight.assemble('f', posed(), Stream(t, sensed(t, 0.05)[1].values))
    assert np.abs(late.flow - flow(late.track, late.track.height, {})).max() > 0.02


def test_samples_without_a_value_low_or_in_a_gap_are_left_out():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    values = sensed(t)[1].values.copy()
    values[::10] = np.nan
    found = drift_flight.assemble('f', posed(lost=(4.0, 5.0)), Stream(t, values), min_height=1.0)
    assert found.track.height.min() > 1.0
    assert not ((found.track.t > 4.0) & (found.track.t < 5.0)).any()
    assert not np.isin(found.track.t, t[::10]).any()
    with pytest.raises(BagError, match='f: [0-9]+ samples of optical flow above 9 m; 100 are'):
        drift_flight.assemble('f', posed(), Stream(t, values), min_height=9.0)
    with pytest.raises(BagError, match='f: [0-9]+ samples of optical flow have a pose'):
        drift_flight.assemble('f', posed(), Stream(t[:50], values[:50]))


def test_height_before_is_the_height_so_much_earlier():
    f = flown('C.4', {}, 0)
    expected = perfect(PATHS['C.4'], f.track.t - 0.1, drag_rate=DRAG_RATE).height
    np.testing.assert_allclose(f.height_before(0.1), expected, atol=1e-4)
    assert f.height_before(0.0) is f.track.height or (
        f.height_before(0.0) == f.track.height).all()
