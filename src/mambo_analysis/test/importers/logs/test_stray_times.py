"""Times out of order: the fewest rows are left out, times that stay behind are refused."""

from itertools import combinations
from pathlib import Path

from mambo_analysis.importers.logs import stray_times
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest


def rows(t):
    """Return what is said of times, with the indices that are left out."""
    stray, lines = stray_times.stray_rows(
        Path('log.csv'), 't', np.asarray(t, float), 'row {}'.format)
    return np.flatnonzero(stray).tolist(), lines


def test_the_fewest_rows_are_left_out():
    random = np.random.default_rng(1)
    for _ in range(200):
        t = random.integers(0, 6, 7).astype(float)
        stray = stray_times.out_of_order(t)
        assert (np.diff(t[~stray]) >= 0.0).all()
        for kept in combinations(range(7), 8 - stray.sum()):  # one row more
            assert (np.diff(t[list(kept)]) < 0.0).any()


def test_of_two_rows_in_each_others_place_the_later_one_is_left_out():
    assert stray_times.out_of_order(np.array([1.0, 3.0, 2.0, 4.0])).tolist() == [
        False, False, True, False]
    assert stray_times.out_of_order(np.array([1.0, 3.0, 2.0])).tolist() == [False, False, True]


def test_times_in_order_are_all_kept():
    assert rows([3.0]) == rows([1.0, 1.0, 2.0]) == ([], [])


def test_a_few_are_told_with_their_times():
    t = np.arange(500.0)
    t[[100, 101, 200, 300, 499]] = [7.5, 8.5, 1e9, 0.0, 450.0]
    stray, (line,) = rows(t)
    assert stray == [100, 101, 200, 300, 499]
    assert line == (
        't: 5 of 500 rows are out of order and left out: 7.5 after 99 and before 102 in row 100; '
        '8.5 after 99 and before 102 in row 101; 1000000000 after 199 and before 201 in row 200; '
        'and 2 more')


@pytest.mark.parametrize('where', [[10, 20, 30, 40, 50, 60], [10, 11, 12]])
def test_many_or_a_run_of_them_are_refused(where):
    t = np.arange(500.0)
    t[where] = 1.0
    with pytest.raises(BagError, match=(
            'log.csv: row 10: the time in column t does not increase: 1 after 9; '
            f'{len(where)} of 500 rows are out of order: import each part alone')):
        rows(t)
