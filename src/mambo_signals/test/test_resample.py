"""Signals at other instants: straight lines between neighbours, and nothing made up."""

from hypothesis import given, strategies as st
from mambo_signals import resample
import numpy as np
import pytest
from scipy.interpolate import interp1d

STAMPS = st.lists(st.integers(0, 10**12), min_size=2, max_size=30, unique=True).map(sorted)


def test_interpolation_equals_scipys_inside():
    rng = np.random.default_rng(2)
    source = np.cumsum(rng.integers(1, 10, 200)) * 1_000_000
    values = rng.normal(size=(200, 3))
    stamps = rng.integers(source[0], source[-1], 500)
    ours = resample.interpolate(stamps, source, values, 10**9)
    np.testing.assert_allclose(ours, interp1d(source, values, axis=0)(stamps), atol=1e-12)


@given(STAMPS, st.integers(0, 10**11), st.data())
def test_an_interpolated_value_lies_between_its_neighbours(source, gap, data):
    """And has none where there are no two neighbours that are near enough."""
    values = np.array(data.draw(st.lists(
        st.floats(-1e6, 1e6), min_size=len(source), max_size=len(source))))
    at = data.draw(st.integers(source[0] - 10, source[-1] + 10))
    out = resample.interpolate(np.array([at]), np.array(source), values[:, None], gap)[0, 0]
    if at in source:
        assert out == values[source.index(at)]
        return
    after = int(np.searchsorted(source, at))
    if not 0 < after < len(source) or source[after] - source[after - 1] > gap:
        assert np.isnan(out)
    else:
        low, high = sorted(values[after - 1:after + 1])
        assert low - 1e-9 <= out <= high + 1e-9


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), STAMPS)
def test_a_straight_line_stays_one(slope, start, source):
    source = np.array(source)
    at = np.linspace(source[0], source[-1], 50).astype(np.int64)
    line = start + slope * 1e-9 * source
    out = resample.interpolate(at, source, line[:, None], 10**12)
    np.testing.assert_allclose(out[:, 0], start + slope * 1e-9 * at, atol=1e-9)


def test_a_sample_at_the_very_stamp_is_returned_to_the_bit():
    values = np.array([[0.1], [0.2], [0.3]])
    out = resample.interpolate(np.array([10, 20, 30]), np.array([10, 20, 30]), values, 1)
    np.testing.assert_array_equal(out, values)


def test_there_are_no_values_outside_and_in_gaps():
    out = resample.interpolate(
        np.array([5, 10, 15, 60, 100, 105]), np.array([10, 20, 100]),
        np.array([[1.0], [2.0], [10.0]]), gap=20)
    np.testing.assert_array_equal(out[:, 0], [np.nan, 1.0, 1.5, np.nan, 10.0, np.nan])
    empty = resample.interpolate(np.array([1, 2]), np.array([], int), np.empty((0, 3)), 1)
    assert empty.shape == (2, 3) and np.isnan(empty).all()


def test_unsorted_source_is_sorted_first():
    out = resample.interpolate(np.array([15]), np.array([20, 10]), np.array([[2.0], [1.0]]), 99)
    assert out[0, 0] == 1.5


def test_a_value_that_is_missing_is_missing_on_both_sides():
    values = np.array([[0.0], [np.nan], [2.0], [3.0]])
    at = np.array([5, 10, 15, 20, 25])
    out = resample.interpolate(at, np.array([0, 10, 20, 30]), values, 99)
    np.testing.assert_array_equal(out[:, 0], [np.nan, np.nan, np.nan, 2.0, 2.5])


def test_nothing_is_known_inside_a_gap():
    t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(4.0, 6.0, 0.01)])
    at = np.arange(0.005, 6.0, 0.01)
    out = resample.columns_at(at, t, np.column_stack([t, 2.0 * t]))
    gone = np.isnan(out).any(axis=1)
    assert gone[(at > 2.0) & (at < 4.0)].all() and not gone[(at < 1.98)].any()
    np.testing.assert_allclose(out[~gone], np.column_stack([at, 2.0 * at])[~gone], atol=1e-12)


@pytest.mark.parametrize(('lost', 'bridged'), [(0, True), (1, True), (2, True), (3, False)])
def test_up_to_two_lost_frames_are_bridged(lost, bridged):
    """With n frames lost a step takes n + 1 periods; one of more than 3.5 is a gap."""
    t = np.delete(np.arange(0.0, 1.0, 0.01), range(50, 50 + lost))
    at = np.array([0.1, 0.495, 0.55, 0.9])
    assert resample.gaps(t).any() != bridged
    assert resample.inside_gaps(t, at).tolist() == [False, not bridged, False, False]
    stamps = np.rint(t * 1e9).astype(np.int64)
    out = resample.interpolate(np.array([495_000_000]), stamps, t[:, None],
                               resample.longest_step(stamps))
    assert np.isfinite(out).all() == bridged


def test_the_ends_of_a_gap_are_known_and_what_lies_beyond_the_samples_is_not():
    t = np.array([0.0, 1.0, 2.0, 10.0, 11.0, 12.0])
    at = np.array([-1e-9, 0.0, 2.0, 2.0 + 1e-9, 10.0 - 1e-9, 10.0, 12.0, 12.0 + 1e-9])
    lost = [True, False, False, True, True, False, False, True]
    assert resample.inside_gaps(t, at).tolist() == lost
    assert not resample.inside_gaps(t, at[1:-1], periods=9.0).any()


def test_the_error_of_a_bridged_gap_is_that_of_the_docstring():
    """A straight line over dt is off by a dt^2 / 8 at most: 2 mm at 10 m/s^2 over 40 ms."""
    t = np.array([0.0, 0.04])
    at = np.linspace(0.0, 0.04, 101)
    off = 0.5 * 10.0 * at ** 2 - resample.columns_at(at, t, 0.5 * 10.0 * t[:, None] ** 2)[:, 0]
    assert np.abs(off).max() == pytest.approx(10.0 * 0.04 ** 2 / 8.0, rel=1e-9)


@pytest.mark.parametrize(('known', 'run'), [
    ([], (0, 0)), ([0, 0], (0, 0)), ([1], (0, 1)), ([1, 1, 0, 1], (0, 2)),
    ([0, 1, 0, 1, 1, 1], (3, 6)), ([1, 1, 0, 1, 1], (0, 2))])
def test_the_longest_run(known, run):
    found = resample.longest_run(np.array(known, bool))
    assert (found.start, found.stop) == run


@pytest.mark.parametrize(('known', 'found'), [
    ([], []), ([0, 0], []), ([1], [[0, 1]]), ([1, 1, 0, 1], [[0, 2], [3, 4]]),
    ([0, 1, 1, 0, 1, 0], [[1, 3], [4, 5]])])
def test_all_runs(known, found):
    assert resample.runs(np.array(known, bool)).tolist() == found


@pytest.mark.parametrize(('values', 'found'), [
    ([[1, 2]], [[0, 1]]), ([[1, 2], [1, 2]], [[0, 2]]),
    ([[1, 2], [1, 3], [1, 3], [0, 3]], [[0, 1], [1, 3], [3, 4]])])
def test_all_runs_of_equal_rows(values, found):
    assert resample.constant_runs(np.array(values, float)).tolist() == found


def test_usual_period_is_that_of_most_gaps():
    frames = np.delete(np.arange(50) * 8_333_333, [10, 11, 30])
    assert resample.median_period(frames) == 8_333_333
    assert resample.median_period(np.random.default_rng(0).permutation(frames)) == 8_333_333
    assert resample.median_period(np.repeat(frames, 2)) == 8_333_333  # repeated stamps
    assert resample.longest_step(frames) == round(3.5 * 8_333_333)
    for few in (np.array([], np.int64), np.array([5]), np.array([5, 5])):
        assert np.isnan(resample.median_period(few)) and resample.longest_step(few) == 0


def test_a_grid_of_whole_periods_lies_within_the_signal():
    stamps = np.array([7, 20, 33, 101])
    grid, out = resample.resampled(stamps, stamps[:, None] * 2.0, 10, 20)
    assert grid.tolist() == [10, 20, 30, 40, 50, 60, 70, 80, 90, 100]
    np.testing.assert_allclose(out[:3, 0], [20.0, 40.0, 60.0])
    assert np.isnan(out[3:, 0]).all()
    grid, out = resample.resampled(np.empty(0, np.int64), np.empty((0, 3)), 10, 20)
    assert grid.shape == (0,) and out.shape == (0, 3)


@pytest.mark.long
def test_a_signal_that_ends_years_later_has_no_rows():
    stamps = np.array([0, 10, 2**31 * 10**9])
    grid, out = resample.resampled(stamps, np.ones((3, 2)), 5_000_000, 20)
    assert len(grid) == 0 and out.shape == (0, 2)
    stamps[2] = resample.MOST * 10
    assert len(resample.resampled(stamps, np.ones((3, 1)), 10, 20)[0]) == resample.MOST + 1


def test_quaternions_get_one_sign_and_invalid_ones_become_nan():
    rng = np.random.default_rng(3)
    angle = np.linspace(0.0, 12.0, 200)  # twice round: the scalar part goes through zero
    q = np.column_stack([np.zeros(200), np.zeros(200), np.sin(angle / 2), np.cos(angle / 2)])
    mixed = q * np.where(rng.random(200) < 0.5, -1.0, 1.0)[:, None]
    mixed[[20, 90]] = [[0.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0]]
    mixed[150] *= 1.05  # rounded on the way: made unit
    out = resample.continuous_quaternions(mixed)
    good = np.isfinite(out).all(axis=1)
    assert np.flatnonzero(~good).tolist() == [20, 90]
    np.testing.assert_allclose(np.linalg.norm(out[good], axis=1), 1.0)
    assert ((out[good][1:] * out[good][:-1]).sum(axis=1) > 0.9).all()
    np.testing.assert_allclose(np.abs((out[good] * q[good]).sum(axis=1)), 1.0, atol=1e-12)
    assert resample.continuous_quaternions(np.empty((0, 4))).shape == (0, 4)
