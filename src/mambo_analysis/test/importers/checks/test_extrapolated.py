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


@pytest.mark.parametrize('written', [
    *(lambda x, digits=digits: x.round(digits) for digits in (2, 3, 4, 6)),
    lambda x: np.radians(np.degrees(x).round(3)), lambda x: 9.80665 * x.round(4),
    lambda x: x.astype(np.float32).astype(np.float64)],
    ids=['2 digits', '3', '4', '6', 'degrees', 'g', 'single precision'])
@pytest.mark.parametrize('slope', [1.0, 0.03])
def test_the_last_digit_bends_no_line(written, slope):
    line = NOISE.copy()
    line[200:] = line[200] + 0.01 * np.arange(200)[:, None] * [slope, -slope, 2.0 * slope]
    found = extrapolated.begin(T, written(line))
    assert found is not None and 195 <= found <= 200
    assert extrapolated.begin(T, written(NOISE)) is None


@pytest.mark.parametrize('t', [
    np.sort(T + 0.003 * np.random.default_rng(2).standard_normal(400)),
    (T - T[0]).astype(np.float32).astype(np.float64)], ids=['arrival', 'single precision'])
def test_times_of_arrival_bend_no_line(t):
    line = continued(NOISE, 200)  # even on the sensor's own clock
    found = extrapolated.begin(t, line)
    assert found is not None and 195 <= found <= 201


def test_rounded_times_of_an_uneven_table_bend_no_line():
    t = T + 0.004 * np.sin(np.arange(400.0))
    line = NOISE.copy()
    line[200:] = line[200] + (t[200:] - t[200])[:, None] * [1.0, -20.0, 3.0]
    found = extrapolated.begin(t.round(3), line)
    assert found is not None and 195 <= found <= 200


@pytest.mark.parametrize('digits', [0, 1])
def test_noise_of_few_digits_has_none(digits):
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal((400, 3))
        assert extrapolated.begin(T, (0.3 * noise).round(digits)) is None
        slow = 0.003 * np.cumsum(noise, axis=0)  # many values between two digits
        assert extrapolated.begin(T, slow.round(digits)) is None


@pytest.mark.parametrize('values, digit', [
    ([0.25, -1.5, 3.75], 0.0), ([0.1, 0.123, 5.0], 1e-3), ([1.0, 2.0, 7.1], 0.1),
    (9.80665 * np.array([0.1234, 0.9, -1.0]), 9.80665e-4),
    (np.radians([0.123, 10.0, -1.0]), np.radians(1e-3)),
    (np.random.default_rng(0).standard_normal(50), 0.0)])
def test_the_last_digit_is_found(values, digit):
    values = np.array(values)
    single = (values == values.astype(np.float32)).all()
    assert extrapolated.last_digit(values) == pytest.approx(
        np.spacing(np.float32(np.abs(values).max())) if single else digit)


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


def test_beside_another_topic_that_was_continued_any_line_counts():
    level = NOISE.copy()
    level[200:] = level[200]
    assert extrapolated.begin_since(T, level, T[250]) == 250
    assert extrapolated.begin_since(T, level, T[150]) == 200
    assert extrapolated.begin_since(T, level, T[390]) is None  # nine rows
    assert extrapolated.begin_since(T, NOISE, T[250]) is None
    knots = np.interp(np.arange(400), [0, 100, 200, 340, 400], [0.0, 3.0, -1.0, 2.0, 5.0])
    line = np.column_stack([knots, 2.0 * knots, -knots])
    assert extrapolated.begin(T, line) is None  # no longer than the pieces before
    assert extrapolated.begin_since(T, line, T[341]) == 341
    assert extrapolated.begin_since(T[:15], line[:15], T[3]) is None
