"""Errors against motion capture, on flights with a known answer."""

from types import SimpleNamespace

from hovering import hovering
from mambo_analysis.capture import captured
from mambo_analysis.capture.captured import airborne, errors, mocap_truth, Odometry
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import loop, make_capture, rocking

LOST = (8.0, 10.0)  # s, a gap of 2 s


def test_a_gap_of_the_motion_capture_is_no_truth(tmp_path):
    truth = mocap_truth(make_capture(tmp_path / 'b', {300}, LOST))
    t = truth.stamp * 1e-9
    lost = (t > LOST[0] + 0.01) & (t < LOST[1] - 0.01)
    assert np.isnan(truth.position[lost]).all() and np.isnan(truth.velocity[lost]).all()
    position, velocity = loop(t)
    exact = Odometry(truth.stamp, position, rocking(t).inv().apply(velocity),
                     rocking(t).as_quat())
    off = errors(exact, truth)
    assert off.horizontal < 2e-3 and off.height < 2e-3  # interpolated it is 1 m and more
    assert off.velocity < 0.03 and off.tilt < 0.1


def test_errors_may_end_before_the_landing(tmp_path):
    truth = mocap_truth(make_capture(tmp_path / 'b', {300}, LOST))
    start, end = airborne(truth)
    t = truth.stamp * 1e-9
    moved = truth.position + np.where(t[:, None] > start + 3.0, 1.0, 0.0)
    off = truth._replace(position=moved)
    assert errors(off, truth, 2.0).horizontal < 1e-9 < 0.1 < errors(off, truth).horizontal
    assert errors(off, truth, 2.0).duration <= 2.0 < end - start


def test_take_off_and_landing_are_those_of_the_height():
    start, end = airborne(hovering())
    assert start == pytest.approx(2.0, abs=0.1) and end == pytest.approx(18.0, abs=0.1)
    aloft = hovering()
    part = Odometry(*(column[500:1500] for column in aloft))
    cut = part._replace(position=part.position + [[0.0, 0.0, 1.0]] * np.sin(
        part.stamp[:, None] * 1e-9))
    assert airborne(cut) == (5.0, 14.99)  # in the air throughout: the ends of the recording


def test_a_constant_offset_and_a_yaw_are_no_errors():
    """Position and yaw are aligned at take-off."""
    truth = hovering()
    t = truth.stamp[:, None] * 1e-9
    path = truth.position + np.hstack([np.sin(t), 0.5 * np.sin(2.0 * t), 0.0 * t]) * (t > 3.0)
    truth = truth._replace(position=path)
    yaw = Rotation.from_euler('z', 1.2)
    moved = Odometry(truth.stamp, yaw.apply(path) + [5.0, -3.0, 0.7], truth.velocity,
                     np.tile(yaw.as_quat(), (len(t), 1)))
    off = errors(moved, truth)
    assert max(off.horizontal, off.drift, off.height, off.velocity, off.tilt) < 1e-6
    assert off.duration == pytest.approx(16.0, abs=0.2)


def test_each_error_is_that_of_its_quantity():
    truth = hovering()
    t = truth.stamp * 1e-9
    late = (t > 3.0)[:, None]
    estimate = truth._replace(position=truth.position + late * [0.03, 0.04, 0.2],
                              velocity=truth.velocity + [0.3, 0.0, 9.0])
    off = errors(estimate, truth)
    share = np.sqrt(np.mean(late[(t >= airborne(truth)[0]) & (t <= airborne(truth)[1])]))
    assert off.horizontal == pytest.approx(0.05 * share, rel=1e-6)
    assert off.drift == pytest.approx(0.05) and off.height == pytest.approx(0.2 * share)
    assert off.velocity == pytest.approx(0.3)  # the vertical component does not count


def test_a_constant_tilt_of_the_markers_is_no_error_but_a_change_is():
    truth = hovering()
    tilted = truth._replace(orientation=np.tile(
        Rotation.from_euler('y', 3.0, degrees=True).as_quat(), (len(truth.stamp), 1)))
    assert errors(tilted, truth).tilt == pytest.approx(0.0, abs=1e-6)
    half = tilted.orientation.copy()
    half[:1000] = truth.orientation[:1000]
    t = truth.stamp * 1e-9
    inside = (t >= airborne(truth)[0]) & (t <= airborne(truth)[1])
    expected = 3.0 * np.sqrt(np.mean(t[inside] >= 10.0))
    found = errors(truth._replace(orientation=half), truth).tilt
    assert found == pytest.approx(expected, rel=0.01)


def test_with_the_height_of_the_markers_known_heights_are_compared_as_they_are():
    truth = hovering()
    above = truth._replace(position=truth.position + [0.0, 0.0, 0.07])
    assert errors(truth, above, markers=0.07).height == pytest.approx(0.0, abs=1e-12)
    assert errors(truth, above).height == pytest.approx(0.0, abs=1e-12)
    first = truth.position.copy()
    first[np.flatnonzero(truth.stamp * 1e-9 >= airborne(truth)[0])[0], 2] += 0.05
    wrong = truth._replace(position=first)  # one bad sample, at take-off
    assert errors(wrong, above).height > 0.045
    assert errors(wrong, above, markers=0.07).height < 0.002


def test_the_tilt_is_aligned_at_rest_not_by_one_sample_at_take_off():
    truth = hovering()
    turned = truth.orientation.copy()
    turned[np.flatnonzero(truth.stamp * 1e-9 >= airborne(truth)[0])[0]] = (
        Rotation.from_euler('x', 5.0, degrees=True).as_quat())
    assert errors(truth._replace(orientation=turned), truth).tilt < 0.2


def test_the_height_of_the_markers_is_that_of_the_import_or_unknown():
    assert captured.range_offset(SimpleNamespace(
        metadata={'import': {'range_minus_mocap_z_m': '-0.07'}})) == 0.07
    assert np.isnan(captured.range_offset(SimpleNamespace(metadata={})))


def test_a_replayed_estimate_is_z_up(monkeypatch):
    state = np.array([[1.0, 2.0, -3.0, 0.1, 0.2, -0.3, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    monkeypatch.setattr(captured.offline_replay, 'estimate', lambda bag, params: SimpleNamespace(
        t=np.array([7]), state=state))
    found = captured.replayed(None, None)
    assert found.stamp.tolist() == [7]
    np.testing.assert_allclose(found.position, [[1.0, -2.0, 3.0]])
    np.testing.assert_allclose(found.velocity, [[0.1, -0.2, 0.3]])
    np.testing.assert_allclose(np.abs(found.orientation), [[0.0, 0.0, 0.0, 1.0]])
