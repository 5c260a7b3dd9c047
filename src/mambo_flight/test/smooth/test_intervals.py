"""What is said of a smoothed flight."""

from mambo_estimation.joint.state import SCALE
from mambo_flight.smooth import intervals
import numpy as np
import pytest
from smoothed_flight import made_up, N


def test_an_interval_is_196_deviations_to_both_sides_in_the_middle_of_the_flight():
    assert intervals.middle(made_up()) == 6
    first, *_, last = intervals.intervals(made_up())
    assert first.value == 1.06
    reach = 1.959964 * np.sqrt(SCALE + 1.0)  # the made-up variance
    assert (first.low, first.high) == pytest.approx((1.06 - reach, 1.06 + reach))
    assert last.quantity.name == 'accelerometer bias z'


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
    assert 'filter                             1.0000     1.0000     1.0000' in both
    assert 'smoother                           0.5000     0.5000     0.5000' in both
    assert intervals.table(made_up(), np.full((N, 3), np.nan)) == alone
