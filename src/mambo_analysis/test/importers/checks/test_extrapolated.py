"""Ends of tables that were extrapolated: found in noise, not where a sensor rests."""

from mambo_analysis.importers.checks import extrapolated
import numpy as np
import pytest

T = 1.7e9 + 0.01 * np.arange(400.0)
NOISE = np.random.default_rng(1).standard_normal((400, 3))


def continued(values, begin, columns=(0, 1, 2)):
    """Return values that go on as a line from an index on, in some columns."""
    out, columns = values.copy(), list(columns)
    step = (values[begin] - values[begin - 1])[columns]
    out[begin:, columns] = values[begin, columns] + np.arange(len(out) - begin)[:, None] * step
    return out


@pytest.mark.parametrize('begin', [21, 200, 379])
@pytest.mark.parametrize('t', [T, T + 0.004 * np.sin(np.arange(400.0))], ids=['even', 'uneven'])
def test_the_last_measured_value_is_found(begin, t):
    line = continued(NOISE, begin)
    if t is not T:  # the line is one over time
        line[begin:] = line[begin] + (t[begin:] - t[begin])[:, None] * [1.0, -20.0, 3.0]
    found = extrapolated.begin(t, line)
    assert found in (begin - 1, begin)


def test_what_was_measured_has_none():
    assert extrapolated.begin(T, NOISE) is None
    assert extrapolated.begin(T[:9], NOISE[:9]) is None
    assert extrapolated.begin(T, np.zeros((400, 3))) is None
    assert extrapolated.begin(T, continued(NOISE, 385)) is None  # 15 values


def test_a_sensor_that_rests_has_none():
    level = NOISE.copy()
    level[200:] = level[200]
    assert extrapolated.begin(T, level) is None
    level[200:, 1] += np.arange(200)  # a simulated flight straight ahead
    assert extrapolated.begin(T, level) is None


def test_pieces_of_interpolation_have_none():
    knots = np.arange(0, 415, 15)
    slow = np.column_stack([np.interp(np.arange(400), knots, NOISE[:28, k]) for k in range(3)])
    assert extrapolated.begin(T, slow) is None
    longer = continued(slow, 375)
    assert extrapolated.begin(T, longer) == 360  # the last piece and its continuation


def test_pieces_as_long_as_the_last_one_have_none():
    values = np.column_stack([
        np.interp(np.arange(1200), np.arange(0, 1230, 30), np.resize(NOISE[:, k], 41))
        for k in range(3)])
    assert extrapolated.begin(1.7e9 + 0.01 * np.arange(1200.0), values) is None


def test_columns_that_bend_at_other_times_are_lines_between_all_of_them():
    slow = np.column_stack([np.interp(np.arange(400), np.arange(k, 430, 15), np.resize(
        NOISE[:, k // 5], len(range(k, 430, 15)))) for k in (0, 5, 10)])
    assert extrapolated.begin(T, continued(slow, 375)) in (370, 374)


def test_a_simulation_without_noise_has_none():
    assert extrapolated.begin(T, np.arange(400.0)[:, None] * [1.0, 2.0, 3.0]) is None
    assert extrapolated.begin(T, continued(NOISE, 5)) is None
