"""The row of an estimate in ``map``: every number in its column, and back."""

from types import SimpleNamespace

from mambo_estimation.capture.frames import Anchor
from mambo_flight import capture_columns
from mambo_flight.capture_columns import anchor_of, capture_of, COLUMNS, unused, WIDTH
import numpy as np
import pytest

store = getattr(capture_columns.store_located, 'py_func', capture_columns.store_located)
STATE = SimpleNamespace(
    rho=(1.0, 2.0, 3.0), nu=(4.0, 5.0, 6.0), q=(0.1, 0.2, 0.3, 0.4), omega=(7.0, 8.0, 9.0))
CAPTURE = SimpleNamespace(
    located=True, anchor=Anchor(0.5, (10.0, 11.0, 12.0)), age=0.25, silence=0.125, used=17,
    refused=3, trouble=2, off=0.75, delay=0.0625)
WHERE = SimpleNamespace(
    state=STATE, pose_covariance=tuple(np.arange(100.0, 136.0)), capture=CAPTURE)


@pytest.fixture
def row():
    rows = np.full((3, WIDTH), np.nan)
    store(rows, 1, WHERE)
    assert np.isnan(rows[[0, 2]]).all()
    return rows[1]


def test_every_column_is_written(row):
    assert np.isfinite(row).all()


def test_the_state_is_position_velocity_attitude_and_rates(row):
    np.testing.assert_array_equal(
        row[COLUMNS.state:COLUMNS.covariance], [*STATE.rho, *STATE.nu, *STATE.q, *STATE.omega])


def test_the_covariance_follows_the_state(row):
    np.testing.assert_array_equal(
        row[COLUMNS.covariance:COLUMNS.anchor], WHERE.pose_covariance)


def test_the_pose_of_odom_is_read_back(row):
    assert anchor_of(row) == CAPTURE.anchor


def test_the_state_of_the_motion_capture_is_read_back(row):
    found = capture_of(row)
    for name, value in vars(CAPTURE).items():
        assert getattr(found, name) == value, name
    assert isinstance(found.used, int) and isinstance(found.located, bool)


def test_without_an_estimate_in_map_nothing_is_written():
    rows = np.full((2, WIDTH), np.nan)
    store(rows, 0, None)
    assert np.isnan(rows).all()


def test_the_longest_time_without_poses_is_told_with_its_end():
    rows = np.zeros((5, WIDTH))
    age = COLUMNS.capture + 1
    rows[:, age] = 0.0, 2.0, 0.0, 1.5, 0.1
    rows[:, age + 1] = rows[:, age]  # none came
    assert unused(np.arange(5.0), rows, 0.2) == (
        'the estimate went on without poses until t = 1.00 s: no motion capture for 2.0 s')
    rows[2, age] = 2.2  # the first that comes again is refused
    assert unused(np.arange(5.0), rows, 0.2).endswith('t = 1.00 s: no motion capture for 2.0 s')
    rows[:, age + 1] *= 0.1
    assert 'until t = 2.00 s: motion capture refused for 2.2 s' in unused(
        np.arange(5.0), rows, 0.2)
    assert not unused(np.arange(5.0), 0.4 * rows, 0.2) and not unused(np.empty(0), rows[:0], 0.2)
