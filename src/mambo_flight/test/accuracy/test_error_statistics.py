"""The joint filter beside the bound, and its consistency: a fast subset of ``mambo bound``."""

import math
from types import SimpleNamespace

from mambo_estimation.joint.state import ATTITUDE, SIZE, VELOCITY
from mambo_flight.accuracy import error_statistics
from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.error_statistics import (
    measured, Measured, QUANTITIES, Report, Row, summary, table)
from mambo_flight.accuracy.filter_error import DT, evaluate, FilterError, SETTLED, with_unknowns
import numpy as np
import pytest
from scipy.stats import chi2

SEEDS = range(101, 107)


@pytest.fixture(scope='module', params=['circle', 'circle_rising', 'vertical_circle_large'])
def report(request):
    flight = flight_of(request.param)
    return summary([
        measured(evaluate(with_unknowns(flight, seed, True))) for seed in SEEDS])


def line(report, name):
    return next(one for one in report.lines if one.name == name)


@pytest.mark.long
def test_errors_are_near_the_bound(report):
    # over six flights a ratio of deviations scatters by a quarter
    assert line(report, 'drift at the end').ratio < 2.0
    assert line(report, 'horizontal velocity').ratio < 1.5
    assert line(report, 'vertical velocity').ratio < 2.0
    assert line(report, 'tilt').ratio < 1.5
    assert line(report, 'drift at the end').reached < 0.16  # a tenth of 1.6 m


@pytest.mark.parametrize('name', [q.name for q in QUANTITIES])
def test_no_error_is_larger_than_it_is_stated(report, name):
    one = line(report, name)
    # thirty of these at once, and a slope that is drawn evenly: beyond 95 % by a quarter
    assert one.nees < 1.25 * one.high
    assert 0.0 < one.bound < math.inf


def test_innovations_are_as_large_as_expected(report):
    assert report.nis['flow'] == pytest.approx(1.0, abs=0.1)
    assert report.nis['sonar'] == pytest.approx(1.0, abs=0.1)


START = 7
N = START + round(SETTLED / DT) + 4  # four steps after the filter has settled


def known_error(bound=None):
    """Return a flight with errors of 2, variances of 16 and, before it settles, wild errors."""
    error = np.full((N, SIZE), 2.0)
    error[:-4] = 1e6
    nu = np.full((N, 3), 3.0)
    nu[:-4] = 1e6
    made = SimpleNamespace(
        P=np.tile(16.0 * np.eye(SIZE), (N, 1, 1)), twist=np.tile(9.0 * np.eye(3), (N, 1, 1)),
        ratios=np.full((N, 3), np.nan))
    limit = None if bound is None else np.tile(bound * np.eye(SIZE), (N, 1, 1))
    return FilterError(START, error, nu, made, limit)


def test_nees_is_the_error_squared_by_the_inverse_covariance():
    P = np.array([[4.0, 1.0], [1.0, 2.0]])
    error = np.array([1.0, 3.0])
    assert error_statistics._nees(error, P) == pytest.approx(error @ np.linalg.inv(P) @ error)


def test_nees_of_a_state_without_variance_is_unknown():
    assert math.isnan(error_statistics._nees(np.ones(2), np.diag([1.0, 0.0])))


@pytest.mark.parametrize(('index', 'components'), list(enumerate((2, 1, 2, 1, 2, 3, 3, 1, 1))))
def test_every_quantity_is_measured_after_it_has_settled(index, components):
    row = QUANTITIES[index].measure(known_error(bound=0.25))
    assert row.components == components and row.bound == 0.25
    velocity = 'velocity' in QUANTITIES[index].name
    assert row.reached == (9.0 if velocity else 4.0)
    assert row.nees == pytest.approx(components * (1.0 if velocity else 0.25))


def test_each_quantity_reads_its_own_components():
    """An error in one component of the state shows in one quantity alone."""
    for component, name in ((0, 'drift at the end'), (1, 'drift at the end'), (2, 'height'),
                            (ATTITUDE, 'tilt'), (ATTITUDE + 1, 'tilt')):
        one = known_error()
        one.error[:], one.nu[:] = 0.0, 0.0
        one.error[:, component] = 1.0
        changed = [q.name for q in QUANTITIES if q.measure(one).reached > 0.0]
        assert changed == [name], component


def test_yaw_and_velocity_of_the_state_are_not_compared():
    """Yaw cannot be observed; the velocity that counts is the published one, in body axes."""
    one = known_error()
    one.error[:], one.nu[:] = 0.0, 0.0
    one.error[:, VELOCITY:VELOCITY + 3], one.error[:, ATTITUDE + 2] = 1.0, 1.0
    assert not any(q.measure(one).reached for q in QUANTITIES)


def test_innovations_count_from_take_off_per_dimension_of_the_sample():
    one = known_error()
    one.made.ratios[:START] = 100.0
    one.made.ratios[START::2, 0], one.made.ratios[START:, 1] = 0.5, 3.0
    sonar, flow, barometer = measured(one).nis
    assert (sonar, flow) == (0.5, 1.5) and math.isnan(barometer)


def two_flights():
    """Return a summary of errors 3 and 4 at a bound of 2.5, NEES 1 and 3, for each quantity."""
    def flight(error, nees):
        return Measured(tuple(Row(6.25, error ** 2, nees, 2) for _ in QUANTITIES), (1.0, 2.0, 0.5))
    return summary([flight(3.0, 1.0), flight(4.0, 3.0)])


def test_a_summary_is_the_root_of_the_mean_squares_in_the_unit_of_the_quantity():
    report = two_flights()
    assert report.flights == 2 and report.nis == {'sonar': 1.0, 'flow': 2.0, 'barometer': 0.5}
    for found, quantity in zip(report.lines, QUANTITIES, strict=True):
        assert found.bound == pytest.approx(2.5 * quantity.factor)
        assert found.reached == pytest.approx(math.sqrt(12.5) * quantity.factor)
        assert found.ratio == pytest.approx(math.sqrt(2.0))


def test_nees_is_per_component_between_limits_of_chi_squared():
    first = two_flights().lines[0]
    assert first.nees == pytest.approx(1.0)  # 1 + 3 over 2 flights of 2 components
    assert first.low == pytest.approx(chi2.ppf(0.025, 4) / 4)
    assert first.high == pytest.approx(chi2.ppf(0.975, 4) / 4)


def test_without_a_bound_there_is_no_ratio():
    rows = tuple(Row(math.nan, 1.0, 1.0, 1) for _ in QUANTITIES)
    assert all(math.isnan(one.ratio) for one in summary([Measured(rows, (1.0,) * 3)]).lines)


def test_the_table_has_a_line_for_each_quantity_and_the_sensors_that_were_used():
    report = two_flights()
    lines = table(report).splitlines()
    assert len(lines) == len(QUANTITIES) + 2
    assert lines[1].split() == [
        'drift', 'at', 'the', 'end', '[m]', '2.5', '3.536', '1.41', '1.00', '0.12', 'to', '2.79']
    assert lines[-1] == '2 flights; mean NIS: sonar 1.00, flow 2.00, barometer 0.50'
    silent = Report(2, report.lines, {'sonar': 1.0, 'barometer': math.nan}, {})
    assert table(silent).endswith('mean NIS: sonar 1.00')


NINE = (2, 1, 2, 1, 2, 3, 3, 1, 1)


def of_errors(rng, spread, flights):
    """Return a report of errors that are a multiple of their stated deviation."""
    return summary([Measured(tuple(
        Row(1.0, spread**2, spread**2 * rng.chisquare(n), n) for n in NINE), (1.0, 1.0, 1.0))
        for _ in range(flights)])


@pytest.mark.parametrize(('spread', 'low', 'high'), [(1.0, 0.9, 0.99), (1.4, 0.0, 0.2),
                                                     (0.7, 0.0, 0.2)])
def test_limits_hold_honest_errors_in_95_of_100_and_no_others(spread, low, high):
    """100 reports of 40 flights; errors stated as too small or too large are outside."""
    rng = np.random.default_rng(7)
    lines = [one for _ in range(100) for one in of_errors(rng, spread, 40).lines]
    inside = np.mean([one.low <= one.nees <= one.high for one in lines])
    assert low <= inside <= high


def test_limits_close_on_1_with_more_flights():
    rng = np.random.default_rng(8)
    widths = [max(one.high - one.low for one in of_errors(rng, 1.0, n).lines)
              for n in (5, 50, 500)]
    assert widths[0] > 2.5 * widths[1] > 6.0 * widths[2]  # by the root of the number


@pytest.mark.parametrize('factor', [0.5, 1.0, 3.0])
def test_the_ratio_is_of_deviations_not_of_variances(factor):
    one = summary([Measured(tuple(Row(0.04, 0.04 * factor**2, 1.0, n) for n in NINE), (1.0,) * 3)])
    assert [line.ratio for line in one.lines] == pytest.approx([factor] * 9)
