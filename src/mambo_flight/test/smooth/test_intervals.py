"""What is said of a smoothed flight."""

from hypothesis import given, strategies as st
from mambo_estimation.joint.state import ACCEL_BIAS, DRAG, GYRO_BIAS, LATENCY, SCALE, SLOPE
from mambo_flight.smooth import intervals
import numpy as np
import pytest
from smoothed_flight import made_up, moving_in, N


def test_an_interval_is_196_deviations_to_both_sides_in_the_middle_of_the_flight():
    assert intervals.middle(made_up()) == 6
    first, *_, last = intervals.intervals(made_up())
    assert first.value == 1.06
    reach = 1.959964 * np.sqrt(SCALE + 1.0)  # the made-up variance
    assert (first.low, first.high) == pytest.approx((1.06 - reach, 1.06 + reach))
    assert last.quantity.name == 'accelerometer bias z, body FLU'


@pytest.mark.parametrize(('index', 'name', 'unit'), [
    (GYRO_BIAS, 'gyro bias', 'rad/s'), (ACCEL_BIAS, 'accelerometer bias', 'm/s^2')])
def test_biases_are_those_of_the_recorded_topic_in_body_flu(index, name, unit):
    s = made_up()
    s.x[:, index + 1:index + 4] = 1.0, 2.0, 3.0  # body FRD
    found = {one.quantity.name: one for one in intervals.intervals(s)}
    for i, (axis, value) in enumerate(zip('xyz', (1.0, -2.0, -3.0))):
        one, reach = found[f'{name} {axis}, body FLU'], 1.959964 * np.sqrt(index + i + 1.0)
        assert one[1:] == pytest.approx((value, value - reach, value + reach))
        row, = (line for line in intervals.table(s).splitlines()
                if line.startswith(f'{name} {axis}, body FLU [{unit}] '))
        assert float(row.split(']')[1].split()[0]) == value


def test_path_errors_are_horizontal_and_of_steps_with_truth():
    truth = np.zeros((N, 3))
    truth[:, 2], truth[-1] = 7.0, np.nan
    rows = np.zeros((N, 24))
    rows[:, 0], rows[4, 0] = 0.3, 0.4
    path = intervals.path_error(rows, truth)
    assert (path.largest, path.end) == (0.4, 0.3)
    assert path.rms == pytest.approx(np.sqrt((9 * 0.09 + 0.16) / 10))


def test_table_compares_with_the_filter_where_there_is_a_truth():
    alone = intervals.table(made_up())
    assert 'Q at the reference height [-]' in alone and 'path' not in alone
    both = intervals.table(made_up(), np.zeros((N, 3)))
    *_, filtered, smoothed = (line.split() for line in both.splitlines())
    assert filtered == ['filter', '1.0000', '1.0000', '1.0000']
    assert smoothed == ['smoother', '0.5000', '0.5000', '0.5000']
    assert intervals.table(made_up(), np.full((N, 3), np.nan)) == alone


@pytest.mark.parametrize('index, value, told', [
    (DRAG, -0.1, True), (DRAG, -0.01, False), (LATENCY, -0.1, True), (SLOPE, -0.1, False)])
def test_what_cannot_be_negative_and_is_costs_the_intervals_their_word(index, value, told):
    s = made_up()
    s.x[:, index + 1], s.P[:, index, index] = value, 0.02 ** 2
    last = intervals.table(s).splitlines()[-1]
    name = next(one.name for one in intervals.QUANTITIES if one.index == index)
    assert last.startswith(f'note: {name} cannot be below 0, so no interval holds') is told


def drawn(rng, spread):
    """Return a smoothed flight whose errors are a multiple of their stated deviation."""
    s = made_up()
    k = intervals.middle(s)
    for quantity in intervals.QUANTITIES:
        deviation = np.sqrt(s.P[k, quantity.index, quantity.index])
        s.x[k, quantity.index + 1] += spread * deviation * rng.standard_normal()
    return s


@pytest.mark.parametrize(('spread', 'share'), [(1.0, 0.95), (2.0, 0.673), (0.5, 0.99991)])
def test_intervals_hold_in_95_of_100_and_in_no_more(spread, share):
    """Errors as stated, twice as large (too narrow) and half as large (too wide)."""
    rng, truth, held = np.random.default_rng(0), made_up(), 0
    flights, k = 300, intervals.middle(made_up())
    for _ in range(flights):
        held += sum(one.low <= one.quantity.sign * truth.x[k, one.quantity.index + 1] <= one.high
                    for one in intervals.intervals(drawn(rng, spread)))
    count = flights * len(intervals.QUANTITIES)
    # four standard deviations of a binomial count; one more for the share of 0.9999
    assert abs(held - share * count) < 4.0 * np.sqrt(count * share * (1.0 - share)) + 1.0


def test_a_variance_below_zero_by_rounding_is_an_interval_of_no_width():
    s = made_up()
    s.P[:, SCALE, SCALE] = -1e-18
    first, *_ = intervals.intervals(s)
    assert first.low == first.value == first.high


ERRORS = st.lists(st.one_of(st.just(np.nan), st.floats(-100.0, 100.0)), min_size=1, max_size=20)


@given(north=ERRORS, east=st.floats(-10.0, 10.0), last=st.floats(-100.0, 100.0))
def test_the_largest_path_error_is_at_least_the_rms_and_the_end(north, east, last):
    truth = np.stack([np.array([*north, last]), np.full(len(north) + 1, east)], axis=1)
    path = intervals.path_error(np.zeros((len(truth), 24)), truth)
    assert path.end == pytest.approx(np.hypot(last, east))
    known = np.hypot(*truth[np.isfinite(truth[:, 0])].T)
    assert path.rms == pytest.approx(np.sqrt(np.mean(known**2)))
    assert path.largest * (1.0 + 1e-12) >= max(path.rms, path.end)


@pytest.mark.parametrize(('motions', 'middle'), [
    ([(3, N)], 6), ([(0, N)], 5), ([(0, 1)], 0), ([(1, 8)], 4), ([(0, 2), (4, 9)], 6),
    ([], N - 1)])
def test_the_middle_is_that_of_the_longest_motion(motions, middle):
    moving = np.zeros(N, bool)
    for begin, end in motions:
        moving[begin:end] = True
    assert intervals.middle(moving_in(made_up(), moving)) == middle
