"""The consistency of the joint filter: a fast subset of what the command flies."""

import json
import math

from mambo_flight.accuracy import consistency
from mambo_flight.accuracy.error_statistics import (
    Line, Measured, nis_limits, Report, Row, summary)
from mambo_model.errors import MamboError
import numpy as np
import pytest

# position, velocities, tilt, biases and scale of a path on which all can be observed
SEEDS, PATH, SLOPE = range(201, 209), 'circle_rising', 0.14


@pytest.fixture(scope='module')
def report():
    return summary([consistency.one(PATH, SLOPE, seed) for seed in SEEDS])


@pytest.mark.long
def test_errors_are_as_large_as_they_are_stated(report):
    for line in report.lines:
        # nine at once: 99.9 % limits, about twice as far from 1 as those of 95 %
        assert 1.0 - 1.7 * (1.0 - line.low) < line.nees < 1.0 + 2.0 * (line.high - 1.0), line.name
    for name, (low, high) in report.nis_limits.items():
        assert 1.7 * low - 0.7 * high < report.nis[name] < 1.7 * high - 0.7 * low, name


def test_mean_of_innovations_over_a_found_variance_is_within_its_limits():
    rng, w, count = np.random.default_rng(3), 0.01, 20000
    squares, variance, seen = rng.standard_normal(count) ** 2, 1.0, []
    for square in squares:
        seen.append(square / variance)
        variance += w * (square - variance)
    low, high = nis_limits(1, count)
    assert low < np.mean(seen) < high and low < 1.01 < high
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(2.0 / count))
    assert nis_limits(2, count)[1] < high  # twice as many numbers
    assert nis_limits(1, 0) == (-math.inf, math.inf)


def test_a_sensor_whose_noise_is_misjudged_is_marked():
    rng = np.random.default_rng(1)
    flights = [measured_row(1.0, rng)._replace(nis=(1.01, 1.14, math.nan)) for _ in range(100)]
    report = summary(flights)
    assert consistency.outside_nis(report) == ['flow']
    assert '1.010, 1.140*, nan' in consistency.table({('hover', 0.0): report})


@pytest.mark.long
@pytest.mark.slow
def test_no_bound_is_computed_that_nobody_asked_for(report):
    assert all(math.isnan(line.bound) for line in report.lines)


def made_up(factor, rng):
    """Return flights of a filter that states its errors too small by a factor."""
    return summary([measured_row(factor, rng) for _ in range(100)])


def measured_row(factor, rng):
    rows = tuple(Row(math.nan, 1.0, factor ** 2 * rng.chisquare(n), n)
                 for n in (2, 1, 2, 1, 2, 3, 3, 1, 1))
    return Measured(rows, (1.01, 1.005, math.nan), (1000, 1000, 0))


def test_what_is_not_honest_is_marked(capsys):
    rng = np.random.default_rng(1)
    honest, bold, shy = (made_up(factor, rng) for factor in (1.0, 1.5, 0.6))
    assert len(consistency.outside(honest)) <= 2
    assert len(consistency.outside(bold)) == len(consistency.outside(shy)) == 9
    text = consistency.table({('hover', 0.0): honest, ('circle', -0.07): bold})
    assert text.count('*') == 9 + len(consistency.outside(honest))
    assert 'of 22 outside' in text and '100 flights' in text


@pytest.mark.long
def test_command_prints_json(capsys):
    assert consistency.main(['hover', '--slopes', '0.1', '--seeds', '1', '--workers', '1',
                             '--json']) == 0
    one, = json.loads(capsys.readouterr().out)
    assert (one['scenario'], one['slope'], one['flights']) == ('hover', 0.1, 1)
    assert len(one['quantities']) == 9 and one['nis']['flow'] > 0.0


@pytest.mark.parametrize(('arguments', 'message'), [
    (['circle', '--seeds', '0'], '--seeds: 0 must be within 1 to 10000'),
    (['circle', '--slopes', '0', 'nan'], '--slopes: nan must be within -100 to 100 1/m'),
    (['circle', '--workers', '0'], '--workers: 0 must be within 1 to 1024'),
    (['nonesuch', '--seeds', '1'], 'nonesuch')])
def test_wrong_input_is_one_line(arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(consistency.main(arguments))
    error = capsys.readouterr().err
    assert end.value.code == 2 and message in error and error.count('\n') == 1


class Pool:
    """Workers of this process, which count what they are given."""

    def __init__(self, workers):
        self.workers, self.jobs = workers, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False

    def map(self, function, *columns):
        self.jobs += zip(*columns, strict=True)
        return map(function, *columns)


@pytest.fixture
def pools(monkeypatch):
    """Let every flight be made up: its error is its seed, times 100 for a negative slope."""
    made = []

    def one(name, slope, seed):
        rows = tuple(Row(math.nan, (100.0 if slope < 0.0 else 1.0) * seed**2, n, n)
                     for n in (2, 1, 2, 1, 2, 3, 3, 1, 1))
        return Measured(rows, (1.0, 1.0, math.nan))
    monkeypatch.setattr(consistency, 'one', one)
    monkeypatch.setattr(
        consistency, 'worker_pool', lambda workers: made.append(Pool(workers)) or made[-1])
    return made


def test_every_case_gets_its_own_flights(pools):
    found = consistency.consistency(['hover', 'circle'], [0.1, -0.1], range(3, 5), 7)
    assert list(found) == [('hover', 0.1), ('hover', -0.1), ('circle', 0.1), ('circle', -0.1)]
    for (_, slope), one in found.items():
        assert one.flights == 2
        scale = 10.0 if slope < 0.0 else 1.0
        assert one.lines[0].reached == pytest.approx(scale * math.sqrt((9.0 + 16.0) / 2.0))
    pool, = pools
    assert pool.workers == 7 and len(pool.jobs) == 8
    assert pool.jobs[:3] == [('hover', 0.1, 3), ('hover', 0.1, 4), ('hover', -0.1, 3)]


def test_there_are_no_more_workers_than_flights(pools):
    consistency.consistency(['hover'], [0.0], range(1, 3), 50)
    assert pools[0].workers == 2


@pytest.mark.parametrize(('names', 'slopes'), [
    (['hover', 'nonesuch'], [0.0]), (['hover'], [0.0, math.inf])])
def test_wrong_input_in_the_last_place_is_refused_before_a_worker_starts(pools, names, slopes):
    with pytest.raises(MamboError):
        consistency.consistency(names, slopes, range(1, 3), 2)
    assert not pools


@pytest.mark.parametrize(('nees', 'marked'), [
    (0.5, True), (0.7, False), (1.0, False), (1.3, False), (1.5, True), (math.nan, False)])
def test_a_quantity_is_marked_outside_of_its_limits_on_either_side(nees, marked):
    line = Line('height', 'm', math.nan, 1.0, math.nan, nees, 0.7, 1.3)
    one = Report(9, [line], {'sonar': 1.0, 'flow': 1.0, 'barometer': math.nan}, {})
    assert (consistency.outside(one) == ['height']) is marked
    text = consistency.table({('hover', 0.0): one})
    assert ('*' in text) is marked
    counted = 0 if math.isnan(nees) else 1
    assert f'{int(marked)} of {counted} outside their 95 % limits' in text
