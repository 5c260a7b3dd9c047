"""The lines of gyro and accelerometer: known noise at rest, known vibration in the air."""

from dataclasses import replace
import functools

from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors.imu import measure, not_measured
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest

RATE = 200.0
GYRO, ACCEL = np.array([1e-3, 2e-3, 3e-3]), np.array([0.02, 0.03, 0.04])


def resting(seed=0, n=2000, round_to=None, rate=RATE):
    rng, t = np.random.default_rng(seed), np.arange(n) / rate
    gyro, accel = (s * rng.standard_normal((n, 3)) for s in (GYRO, ACCEL))
    accel = accel - [0.0, 0.0, 9.81]
    if round_to is not None:
        accel = np.round(accel / round_to) * round_to
    return Recording('r', Stream(t, gyro), Stream(t, accel))


def flying(seed=0, n=2000, rate=RATE):
    """Return a recording in the air: white noise, and a sway of 2 Hz that is no vibration."""
    rng, t = np.random.default_rng(seed), np.arange(n) / rate
    sway = 2.0 * np.sin(2.0 * np.pi * 2.0 * t)[:, None]
    high = Stream(t[::8], np.full(len(t[::8]), 1.2))
    return Recording(
        'r', Stream(t, sway + 0.1 * rng.standard_normal((n, 3))),
        Stream(t, sway + 0.5 * rng.standard_normal((n, 3)) - [0.0, 0.0, 9.81]), sonar=high,
        pwm=Stream(t, np.full((n, 4), 250.0)))


@functools.cache
def still():
    return lines(resting())


def lines(recording):
    return {line[:2]: line for line in measure(recording)[0]}


def test_noise_at_rest_is_told_for_each_axis_of_each_sensor():
    found = still()
    for axis, name in enumerate('xyz'):
        gyro, accel = (found[f'{sensor} {name}', 'noise at rest'] for sensor in ('gyro', 'accel'))
        assert gyro.value == pytest.approx(GYRO[axis], rel=0.1) and gyro.unit == 'rad/s'
        assert accel.value == pytest.approx(ACCEL[axis], rel=0.1) and accel.unit == 'm/s^2'
    assert found['imu', 'rate'].value == pytest.approx(RATE)


@pytest.mark.parametrize(('key', 'truth', 'freedom'), [
    (('gyro y', 'noise at rest'), GYRO[1], 2000),
    (('gyro z', 'angle random walk'), GYRO[2] / np.sqrt(RATE), 150),
    (('accel x', 'velocity random walk'), ACCEL[0] / np.sqrt(RATE), 150)])
def test_intervals_at_rest_hold_white_noise_and_are_as_narrow_as_samples_allow(
        key, truth, freedom):
    """How often they cover is a matter of the Allan deviation: test_allan.py."""
    line = still()[key]
    assert line.low < truth < line.high
    # a deviation of n degrees of freedom is known to 1 / sqrt(2 n), 1.96 of it on both sides;
    # white noise averaged over 20 samples has 1.5 * 2000 / 20 of them, Riley (2008)
    free = 2.0 * 1.96 / np.sqrt(2.0 * freedom)
    assert 0.8 * free < (line.high - line.low) / truth < 1.3 * free


def test_white_noise_has_a_bias_instability_of_at_most_its_lowest_point():
    line = still()['gyro x', 'bias instability']
    assert line.note == 'at most: the curve still falls' and line.value < GYRO[0] / 10.0


def test_curves_come_by_signal_and_fall_with_the_root_of_time():
    _, curves = measure(resting())
    assert sorted(curves) == [f'{sensor} {axis}' for sensor in ('accel', 'gyro') for axis in 'xyz']
    curve = curves['accel z']
    slope = np.polyfit(np.log(curve.tau[:5]), np.log(curve.deviation[:5]), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.1)


def test_an_axis_that_never_changes_has_no_noise_line():
    whole = resting()
    gyro = whole.gyro.values.copy()
    gyro[:, 1] = 0.25
    found = lines(Recording('r', Stream(whole.gyro.t, gyro), whole.accel))
    assert ('gyro y', 'noise at rest') not in found and ('gyro x', 'noise at rest') in found


@pytest.mark.parametrize(('change', 'says'), [
    ({'gyro': 0.0}, 'gyro x, y, z has one value throughout'),
    ({'accel': 0.0}, 'accel x, y, z has one value throughout'),
    ({'gyro': [1.0, 0.0, 1.0]}, 'gyro y has one value throughout'),
    ({'accel': 1.0 / 9.81}, r'the median acceleration is .* at rest or in flight it is 9.81'),
    ({'accel': 100.0}, 'the median acceleration is')])
def test_an_imu_that_cannot_be_one_is_refused(change, says):
    whole = flying()
    spoilt = replace(whole, **{name: Stream(whole.gyro.t, getattr(whole, name).values * factor)
                               for name, factor in change.items()})
    with pytest.raises(BagError, match=f'^r: imu/data_raw: .*{says}'):
        measure(spoilt)


def test_samples_that_hold_the_one_before_are_no_samples():
    whole = resting()
    for times, refused in ((1, False), (2, True), (5, True)):
        t = whole.gyro.t[0] + np.arange(times * len(whole.gyro.t)) * 0.005
        held = Recording('r', *(Stream(t, np.repeat(stream.values, times, axis=0))
                                for stream in (whole.gyro, whole.accel)))
        if refused:
            with pytest.raises(BagError, match='% of the samples repeat the one before, as of a'):
                measure(held)
        else:
            measure(held)


def test_vibration_is_what_is_above_15_hz():
    found = lines(flying())
    left = np.sqrt((RATE / 2.0 - 15.0) / (RATE / 2.0))  # of white noise
    assert found['gyro x', 'vibration in flight'].value == pytest.approx(0.1 * left, rel=0.1)
    assert found['accel z', 'vibration in flight'].value == pytest.approx(0.5 * left, rel=0.1)
    assert ('gyro x', 'noise at rest') not in found


def test_an_imu_below_60_hz_or_on_the_ground_tells_no_vibration():
    assert ('gyro x', 'vibration in flight') not in lines(flying(rate=50.0))
    whole = flying()
    grounded = Recording('r', whole.gyro, whole.accel, sonar=whole.sonar)
    assert ('gyro x', 'vibration in flight') not in lines(grounded)


def test_the_resolution_is_that_of_the_axis_that_knows_it_best():
    found = lines(resting(round_to=0.01))['accel', 'resolution']
    assert found.value == pytest.approx(0.01, rel=1e-6)
    assert ('gyro', 'resolution') not in lines(resting())


def test_few_levels_do_not_tell_the_resolution_where_another_axis_has_more():
    """Of 0.0010642 with five decimals an axis of three levels shows 0.00106, to no digit more."""
    whole = resting()
    gyro = np.round(np.round(whole.gyro.values * [0.35, 1.0, 3.0] / 0.0010642) * 0.0010642, 5)
    few = lines(Recording('r', Stream(whole.gyro.t, gyro[:, [0, 0, 0]]), whole.accel))
    assert few['gyro', 'resolution'].value == pytest.approx(0.00106)
    found = lines(Recording('r', Stream(whole.gyro.t, gyro), whole.accel))['gyro', 'resolution']
    assert found.low < 0.0010642 < found.high


NOISES = ('noise at rest', 'angle random walk', 'bias instability', 'bias random walk')


@pytest.mark.parametrize('steps', [0.1, 0.25, 0.35])
def test_noise_below_half_a_step_has_no_number(steps):
    """Wherever between two steps the bias is: half-way readings vary by half a step."""
    whole, step = resting(n=4000), 0.001 / steps
    gyro = whole.gyro.values * (0.001 / GYRO) + step * np.array([0.0, 0.3, 0.5])
    rounded = np.round(gyro / step) * step
    found = lines(Recording('r', Stream(whole.gyro.t, rounded), whole.accel))
    assert found['gyro', 'resolution'].value == pytest.approx(step)
    told = [found[f'gyro {axis}', quantity] for axis in 'xyz' for quantity in NOISES
            if (f'gyro {axis}', quantity) in found]
    assert len(told) >= 4
    for line in told:
        assert np.isnan(line.value) and line.note == (
            f'not to be told: hidden by steps of {step:.3g}')
    assert not np.isnan(found['accel x', 'noise at rest'].value)


@pytest.mark.parametrize('steps', [0.55, 1.0, 3.0])
def test_noise_of_a_step_is_told_without_what_rounding_adds(steps):
    whole, step = resting(n=4000), 0.001 / steps
    gyro = whole.gyro.values * (0.001 / GYRO) + step * np.array([0.0, 0.3, 0.5])
    rounded = np.round(gyro / step) * step
    found = lines(Recording('r', Stream(whole.gyro.t, rounded), whole.accel))
    for axis in 'xyz':
        noise = found[f'gyro {axis}', 'noise at rest']
        assert noise.low < 0.001 < noise.high < 1.1 * noise.low
        density = found[f'gyro {axis}', 'angle random walk']
        assert density.low < 0.001 / np.sqrt(RATE) < density.high


def test_the_bias_instability_is_told_without_what_rounding_adds():
    """Of white noise and a walk the lowest point has half of its variance from either."""
    t, rng = np.arange(4000) / RATE, np.random.default_rng(0)
    white, walk = 0.001 * rng.standard_normal((2, 4000, 3))
    x = white + np.cumsum(walk, axis=0) / 10.0
    still = Stream(t, 0.02 * rng.standard_normal((4000, 3)) - [0.0, 0.0, 9.81])
    exact, rounded = (lines(Recording('r', Stream(t, gyro), still)) for gyro in (
        x, np.round(x / 0.0018) * 0.0018))
    keys = [(f'gyro {axis}', 'bias instability') for axis in 'xyz']
    assert all(told[key].note == '' for told in (exact, rounded) for key in keys)
    # rounding adds 27 % to the white variance, 6.5 % to this; 375 degrees of freedom for each axis
    assert np.mean([rounded[key].value / exact[key].value for key in keys]) == pytest.approx(
        1.0, abs=0.03)


def test_vibration_below_the_resolution_has_no_number():
    whole = flying()
    quiet = 0.003 * np.random.default_rng(1).standard_normal(whole.gyro.values.shape)
    exact, fine, coarse = (
        lines(replace(whole, gyro=Stream(whole.gyro.t, x)))['gyro x', 'vibration in flight']
        for x in (quiet, *(np.round(quiet / step) * step for step in (0.003, 0.01))))
    # rounding to a step of the same size adds 4 %, and its scatter that of 2000 samples, 2.6 %
    assert fine.value == pytest.approx(exact.value, rel=0.06)
    assert fine.low < 0.003 * np.sqrt(85.0 / 100.0) < fine.high
    assert np.isnan(coarse.value) and coarse.note == 'not to be told: hidden by steps of 0.01'


def test_one_sensor_alone_or_forty_samples_less_one_tell_nothing():
    whole = resting()
    assert measure(Recording('r', gyro=whole.gyro)) == ([], {})
    assert measure(Recording('r', accel=whole.accel)) == ([], {})
    assert measure(resting(n=39)) == ([], {})


def test_what_is_not_measured_is_said_with_the_reason():
    whole = flying()
    assert not_measured(resting()) == ['vibration in flight: without motor_pwm, when it flies is '
                                       'not known']
    assert not_measured(whole) == ['noise at rest: never at rest for 2 s']
    for change, says in (
            ({'sonar': None}, 'without sonar/range, when it flies is not known'),
            ({'pwm': None}, 'without motor_pwm, when it flies is not known'),
            ({'pwm': whole.pwm._replace(values=0.0 * whole.pwm.values)},
             'less than 1 s in the air, by motor_pwm and a sonar above 0.5 m')):
        assert not_measured(replace(whole, **change))[1:] == [f'vibration in flight: {says}']
    assert not_measured(flying(rate=50.0))[1:] == [
        'vibration in flight: the IMU has 50 Hz, less than 60']
    assert not_measured(resting(n=39)) == [
        'gyro and accelerometer: no imu/data_raw of 40 samples or more that have all six values']
