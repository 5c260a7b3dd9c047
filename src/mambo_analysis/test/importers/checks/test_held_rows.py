"""Rows that hold the position before are found while a vehicle moves; at rest rows only repeat."""

from mambo_analysis.importers.checks import held_rows
import numpy as np
import pytest

T = np.arange(1200) / 120.0
PATH = np.column_stack([np.sin(2.2 * T), np.cos(2.2 * T), 1.0 + 0.1 * T])
NOISE = 2e-4 * np.random.default_rng(3).standard_normal(PATH.shape)
POSITION = PATH + NOISE


def repeated(rows):
    """Return positions that hold so many rows each, one number for each of them."""
    first = np.cumsum(np.r_[0, rows])
    return POSITION[np.repeat(first[:-1], rows)[:len(T)]]


@pytest.mark.parametrize('rows', [np.full(600, 2), np.full(400, 3), np.tile([2, 3], 240)])
def test_rows_that_hold_the_one_before_are_found_but_at_the_ends(rows):
    wanted = np.ones(len(T), bool)
    wanted[np.cumsum(np.r_[0, rows[:-1]])] = False
    found = held_rows.held(T, repeated(rows))
    assert (found[10:-10] == wanted[10:-10]).all() and not (found & ~wanted).any()
    line, = held_rows.describe('optitrack/pose', T, repeated(rows), 'mend it')
    assert line == (
        f'optitrack/pose: {found.sum()} of 1200 positions repeat the one before while the vehicle '
        'moves, as of a table that is faster than the motion capture: mend it')


@pytest.mark.parametrize('case', ['new', 'rest', 'rounded', 'few', 'empty'])
def test_positions_that_repeat_without_being_held_are_not_told(case):
    t, position = T, {
        'new': POSITION, 'rest': np.tile(PATH[0], (len(T), 1)),
        'rounded': np.round(PATH * [0.05, 0.05, 1.0], 3), 'few': POSITION.copy(),
        'empty': np.empty((0, 3))}[case]
    if case == 'rest':
        position[600:] += 0.05
    elif case == 'few':
        position[100::110] = position[99:-1:110]
    elif case == 'empty':
        t = np.empty(0)
    assert held_rows.held(t, position).sum() == (10 if case == 'few' else 0)
    assert not held_rows.describe('optitrack/pose', t, position, 'mend it')
