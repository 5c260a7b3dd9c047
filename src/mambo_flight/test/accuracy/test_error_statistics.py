"""The joint filter beside the bound, and its consistency: a fast subset of ``mambo bound``."""

import math

from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.error_statistics import measured, QUANTITIES, summary
from mambo_flight.accuracy.filter_error import evaluate, with_unknowns
import pytest

SEEDS = range(101, 107)


@pytest.fixture(scope='module', params=['circle', 'circle_rising', 'vertical_circle_large'])
def report(request):
    flight = flight_of(request.param)
    return summary([
        measured(evaluate(with_unknowns(flight, seed, True))) for seed in SEEDS])


def line(report, name):
    return next(one for one in report.lines if one.name == name)


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
