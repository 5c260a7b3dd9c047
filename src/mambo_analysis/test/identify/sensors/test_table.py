"""Lines of measurements: rates without pauses, columns that align, and what recordings share."""

from mambo_analysis.identify.allan import Interval
from mambo_analysis.identify.recording import Stream
from mambo_analysis.identify.sensors.table import entry, Measured, summary, table, timing
import numpy as np
import pytest


def stream(gaps):
    t = np.r_[0.0, np.cumsum(gaps)]
    return Stream(t, np.zeros(len(t)))


def test_an_entry_is_plain_numbers():
    line = entry('gyro', 'noise', 'rad/s', Interval(np.float64(2.0), np.float32(1.0), 3), 7.0, 'n')
    assert line == ('gyro', 'noise', 'rad/s', 2.0, 1.0, 3.0, 7, 'n')
    assert type(line.value) is type(line.high) is float and type(line.samples) is int


def test_a_rate_leaves_out_pauses_and_the_interval_does_not():
    gaps = np.tile([0.03] * 9 + [0.11], 10)
    interval, rate = timing('flow', stream(gaps))
    assert (interval.sensor, interval.quantity, interval.unit) == ('flow', 'interval', 'ms')
    assert interval.value == pytest.approx(30.0) and interval.samples == 100
    assert interval.note == '30 to 110'
    assert rate.value == pytest.approx(1.0 / 0.03) and rate.samples == 90


def test_a_gap_is_a_pause_from_18_tenths_of_the_usual_on():
    for factor, rate in ((1.7, 100 / (90 + 10 * 1.7) / 0.03), (1.9, 1.0 / 0.03)):
        gaps = np.tile([0.03] * 9 + [factor * 0.03], 10)
        assert timing('s', stream(gaps))[1].value == pytest.approx(rate)


def test_the_rate_of_a_jittering_clock_is_inside_its_interval_and_the_interval_small():
    inside = widths = 0
    for seed in range(100):
        gaps = 0.02 + 0.002 * np.random.default_rng(seed).standard_normal(200)
        rate = timing('s', stream(gaps))[1]
        inside += rate.low <= 50.0 <= rate.high
        widths += (rate.high - rate.low) / 100
    assert 88 <= inside <= 100  # of 95: two and a half standard deviations
    # the mean of 200 gaps is known to 0.7 %/sqrt(1), twice 1.96 (t: 2.26) of 50 * 0.1 / sqrt(200)
    assert widths == pytest.approx(2.0 * 2.26 * 50.0 * 0.1 / np.sqrt(200), rel=0.15)


def test_a_few_values_have_no_rate():
    assert timing('s', stream(np.full(19, 0.1))) == []
    assert len(timing('s', stream(np.full(20, 0.1)))) == 2


def test_columns_stand_below_their_headings():
    lines = [Measured('gyro x', 'noise at rest', 'rad/s', 0.0012347, 0.001, 0.002, 4000),
             Measured('sonar', 'smallest', 'm', 0.434, 0.434, 0.434, 12, '3 times'),
             Measured('flow', 'latency', 'ms', np.nan, np.nan, np.nan, 5, 'unknown')]
    head, gyro, sonar, flow = table(lines).splitlines()
    for title, cells in (('quantity', ('noise at rest', 'smallest', 'latency')),
                         ('value', ('0.001235', '0.434', '-')), ('unit', ('rad/s', 'm', 'ms')),
                         ('samples', ('4000', '12', '5'))):
        at = head.index(title)
        assert [row[at:at + len(cell)] for row, cell in zip((gyro, sonar, flow), cells)] == [
            *cells]
    assert '0.001 to 0.002' in gyro
    assert ' to ' not in sonar and sonar.endswith('3 times')   # an exact value has no interval
    assert 'nan' not in flow and flow.endswith('unknown')
    assert all(row == row.rstrip() for row in (head, gyro, sonar, flow))


def test_recordings_are_summed_up_by_median_and_extremes_of_what_they_know():
    found = [[Measured('sonar', 'noise', 'm', value, 0.0, 9.0, 100),
              Measured('flow', 'latency', 'ms', late, 0.0, 9.0, 5)]
             for value, late in ((0.3, np.nan), (0.1, 120.0), (0.2, np.nan))]
    noise, latency = summary(found)
    assert noise == ('sonar', 'noise', 'm', 0.2, 0.1, 0.3, 3, '')
    assert latency == ('flow', 'latency', 'ms', 120.0, 120.0, 120.0, 1, '')


def test_the_same_quantity_in_another_unit_is_another_line():
    lines = [[Measured('s', 'noise', unit, 1.0, 1.0, 1.0, 1)] for unit in ('m', 'Pa')]
    assert [line.unit for line in summary(lines)] == ['m', 'Pa']


@pytest.mark.parametrize('value, low, high, said', [
    (5.0, 5.0, 5.0, 'none'), (5.0, 4.9, 5.1, '4.9 to 5.1'), (np.nan, 1.0, 1.0, '')])
def test_an_interval_without_width_says_so(value, low, high, said):
    line = Measured('imu', 'interval', 'ms', value, low, high, 100)
    head, row = table([line]).splitlines()
    place = head.index('95 % interval')
    assert row[place:].startswith(f'{said}  ') and row[place:].split()[-2:] == ['ms', '100']
    assert row[head.index('value'):].split()[0] == ('5' if value == 5.0 else '-')
