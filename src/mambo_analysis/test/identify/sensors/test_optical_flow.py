"""The flow's lines: its pauses and failures, and by how much it is later than the motion."""

import dataclasses

from mambo_analysis.identify.allan import Interval
from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors import optical_flow
from mambo_analysis.identify.sensors.optical_flow import (
    flow_latency, inertial_velocity, LAGS, measure)
import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

STEP, G = 0.005, 9.81


def sway(t, seed=3, size=0.3):
    """Return the velocity (n, 2) m/s of a sway of 0.4 to 6 Hz, and its derivative."""
    rng = np.random.default_rng(seed)
    f = 2.0 * np.pi * rng.uniform(0.4, 6.0, (2, 12))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 12))
    turn = f[..., None] * t + phase[..., None]
    return (size * np.sin(turn).sum(axis=1).T / 4.0,
            size * (f[..., None] * np.cos(turn)).sum(axis=1).T / 4.0)


def flight(late=0.06, seconds=12.0, noise=0.01, height=1.2, signs=(1.0, 1.0), rate=1.0 / STEP):
    """Return a level vehicle whose accelerometer says the sway, and a flow late by so much."""
    t = np.arange(round(seconds * rate)) / rate
    accel = np.c_[sway(t)[1], np.full(len(t), -G)]
    frames = np.arange(0.0, seconds, 0.03)
    seen = sway(frames - late)[0] / height * signs
    rng = np.random.default_rng(0)
    return Recording(
        'r', Stream(t, np.zeros((len(t), 3))), Stream(t, accel),
        Stream(t[::8], np.full(len(t[::8]), height)),
        Stream(frames, seen + noise * rng.standard_normal(seen.shape)),
        pwm=Stream(t, np.full((len(t), 4), 250.0)))


def lines(recording):
    return {line[:2]: line for line in measure(recording)[0]}


@pytest.mark.parametrize('late', [0.0, 0.03, 0.12])
def test_the_delay_of_the_flow_is_found_within_its_interval(late):
    interval, share, misfit = flow_latency(flight(late))
    assert interval.value == pytest.approx(late, abs=2e-3)
    assert interval.low - 1e-3 <= late <= interval.high + 1e-3
    assert interval.high - interval.low < 0.01
    assert share > 0.9
    assert LAGS[misfit.argmin()] == pytest.approx(late, abs=0.005)


def test_a_flow_of_the_other_sign_has_no_common_motion():
    """A product below zero explains nothing: the misfit stays at one, whatever the lag."""
    _, share, misfit = flow_latency(flight(0.06, signs=(-1.0, -1.0), noise=0.0))
    assert misfit[np.abs(LAGS - 0.06).argmin()] == pytest.approx(1.0)
    good = flow_latency(flight(0.06, noise=0.0))[2]
    assert good.min() < 0.1


def test_the_scale_of_the_flow_does_not_matter_to_the_delay():
    low, high = (flow_latency(flight(0.06, height=h, noise=0.0))[0].value for h in (0.6, 1.8))
    assert low == pytest.approx(high, abs=1e-6)


def test_an_axis_that_shows_nothing_explains_nothing():
    whole = flight(0.06)
    one = Recording('r', whole.gyro, whole.accel, whole.sonar, Stream(
        whole.flow.t, whole.flow.values * [1.0, 0.0]), pwm=whole.pwm)
    interval, share, misfit = flow_latency(one)
    assert interval.value == pytest.approx(0.06, abs=2e-3)
    assert share > 0.9 and np.isfinite(misfit).all()


def test_pauses_and_how_many_values_lie_between_them():
    whole = flight()
    keep = np.ones(len(whole.flow.t), bool)
    keep[15::17] = keep[16::17] = False  # fifteen values, then two missing: 90 ms
    found = lines(Recording('r', flow=Stream(whole.flow.t[keep], whole.flow.values[keep])))
    assert found['flow', 'pause'].value == pytest.approx(90.0)
    assert found['flow', 'values from pause to pause'].value == 15.0
    assert found['flow', 'rate'].value == pytest.approx(1.0 / 0.03)
    assert ('flow', 'pause') not in lines(whole)


def test_the_rate_of_a_flow_of_changes_says_so():
    changes = dataclasses.replace(flight(), changes=frozenset(['optical_flow']))
    assert 'equal readings are left out' in lines(changes)['flow', 'rate'].note
    assert lines(flight())['flow', 'rate'].note == 'pauses left out'


def test_failures_are_counted_and_left_out_of_the_noise():
    whole = flight(noise=0.01)
    values = whole.flow.values.copy()
    values[::20, 1] = np.nan
    found = lines(Recording('r', whole.gyro, whole.accel, whole.sonar,
                            Stream(whole.flow.t, values), pwm=whole.pwm))
    assert found['flow', 'failed'].value == pytest.approx(20 / 400)
    assert found['flow x', 'noise'].samples == 400 - 20
    assert np.isfinite(found['flow y', 'noise'].value)


def banded(x):
    """Return the inner part of a signal between 0.5 and 8 Hz, where it is compared."""
    return sosfiltfilt(butter(2, (0.5, 8.0), 'band', fs=200.0, output='sos'), x, axis=0)[800:3200]


def test_a_level_pushed_vehicle_has_the_integral_of_its_acceleration():
    t = np.arange(4000) * STEP
    velocity, _ = sway(t)
    found = inertial_velocity(flight(seconds=20.0))
    expected = banded(velocity)
    assert (banded(found) - expected).std() < 0.05 * expected.std()


@pytest.mark.parametrize(('axis', 'moved', 'sign'), [(1, 0, -1.0), (0, 1, 1.0)])
def test_a_tilt_pulls_the_vehicle_along_by_gravity(axis, moved, sign):
    """Nose up (q > 0) slows, right side down (p > 0) speeds up to the right: body FRD."""
    whole, t = flight(seconds=20.0), np.arange(4000) * STEP
    w, size = 2.0 * np.pi * 1.0, 0.05
    gyro = np.zeros((4000, 3))
    gyro[:, axis] = size * w * np.cos(w * t)  # the angle is size sin(w t)
    still = Recording('r', Stream(t, gyro), Stream(t, np.zeros((4000, 3))), pwm=whole.pwm)
    found = inertial_velocity(still)
    expected = banded(-sign * G * size / w * np.cos(w * t))
    assert (banded(found[:, moved]) - expected).std() < 0.05 * expected.std()
    assert np.abs(found[:, 1 - moved]).max() == 0.0


def tilting(climb, late=0.06, seconds=12.0):
    """Return a vehicle that tilts to sway and climbs at so many m/s, with a late flow."""
    t = np.arange(round(seconds / STEP)) * STEP
    w, phase = 2.0 * np.pi * np.array([0.7, 1.3, 2.9])[:, None], np.arange(3.0)[:, None]
    size = np.array([0.05, 0.03, 0.02])[:, None]
    rate = (size * w * np.cos(w * t + phase)).sum(axis=0)  # the pitch is size sin(w t + phase)

    def speed(at):
        """Return the velocity along x: its rate is -g pitch - rate v_z, and v_z is -climb."""
        return (G * size / w * np.cos(w * at + phase)
                + climb * size * np.sin(w * at + phase)).sum(axis=0)
    zero, frames = np.zeros(len(t)), np.arange(0.0, seconds, 0.03)
    height = 0.8 + climb * t
    return Recording(
        'r', Stream(t, np.c_[zero, rate, zero]), Stream(t, np.c_[zero, zero, zero - G]),
        Stream(t[::8], height[::8]), Stream(frames, np.c_[
            speed(frames - late) / (0.8 + climb * frames), 0.0 * frames]
            + 1e-4 * np.random.default_rng(0).standard_normal((len(frames), 2))),
        pwm=Stream(t, np.full((len(t), 4), 250.0))), speed(t)


@pytest.mark.parametrize('climb', [0.3, 0.0])
def test_a_climb_turns_its_velocity_into_the_horizontal(climb):
    recording, velocity = tilting(climb, seconds=20.0)
    expected = banded(velocity)
    with_it, without = (
        (banded(inertial_velocity(recording, speed)[:, 0]) - expected).std() / expected.std()
        for speed in (np.zeros((4000, 2)), None))
    assert with_it < 0.05  # as of the level vehicle above
    assert without > 0.1 if climb else without == pytest.approx(with_it)


@pytest.mark.parametrize('axis, sign', [(1, -1.0), (0, -1.0)])
def test_a_tilted_vehicle_moves_along_its_z(axis, sign):
    """At level speed v, v_z is v times the tilt a: its part of the rate is -v a da/dt."""
    t = np.arange(4000) * STEP
    angle, speed = 0.1 * np.hanning(4000) * np.sin(2.0 * np.pi * 0.8 * t), 1.5
    gyro = np.zeros((4000, 3))
    gyro[:, axis] = np.gradient(angle, STEP)
    level = flight(seconds=20.0)
    one = Recording('r', Stream(t, gyro), level.accel, level.sonar)
    along = np.zeros((4000, 2))
    along[:, 1 - axis] = speed
    found = (inertial_velocity(one, along) - inertial_velocity(one))[:, 1 - axis]
    expected = banded(sign * speed * angle**2 / 2.0)
    assert (banded(found) - expected).std() < 0.1 * expected.std()  # a is high-pass filtered


def test_the_interval_knows_that_a_climb_moves_the_delay():
    recording, _ = tilting(0.3)
    (value, low, high), share, _ = flow_latency(recording)
    assert share > 0.9 and abs(value - 0.06) > 0.015  # w / g = 0.03 s, taken as level
    assert low <= 0.062 and high >= 0.058


def test_what_cannot_be_told_is_said_and_not_guessed():
    whole = flight()
    rng = np.random.default_rng(8)
    noise = Stream(whole.flow.t, 0.1 * rng.standard_normal(whole.flow.values.shape))
    line = lines(Recording('r', whole.gyro, whole.accel, whole.sonar, noise, pwm=whole.pwm))[
        'flow', 'latency']
    assert np.isnan([line.value, line.low, line.high]).all()
    assert line.note == 'not to be told from this flight'
    assert 'R^2' in lines(whole)['flow', 'latency'].note


@pytest.mark.parametrize('without', ['gyro', 'accel', 'sonar', 'pwm'])
def test_without_one_of_the_sensors_there_is_no_delay(without):
    whole = flight()
    streams = {name: getattr(whole, name) for name in ('gyro', 'accel', 'sonar', 'flow', 'pwm')}
    streams[without] = None
    found, curve = measure(Recording('r', **streams))
    assert curve is None
    assert ('flow', 'latency') not in {line[:2] for line in found}


def test_a_short_flight_a_slow_imu_and_few_values_tell_no_delay():
    assert measure(flight(seconds=3.5))[1] is None
    assert measure(flight(rate=25.0))[1] is None
    assert measure(Recording('r')) == ([], None)
    short = flight(seconds=1.1)
    assert measure(short) == ([], None) and len(short.flow.t) < 40


def test_between_two_lags_the_lowest_point_is_that_of_a_parabola():
    for lowest in (0.0, 0.0312, 0.1987):
        assert optical_flow.lowest((LAGS - lowest)**2, LAGS) == pytest.approx(lowest, abs=1e-9)
    falling = -(LAGS + 1.0)**2  # to the end
    assert optical_flow.lowest(falling, LAGS) == pytest.approx(LAGS[-2])


@pytest.mark.parametrize(('found', 'share', 'told'), [
    (Interval(0.1, 0.09, 0.11), 0.31, True), (Interval(0.1, 0.09, 0.11), 0.29, False),
    (Interval(0.1, -0.06, 0.26), 0.9, False), (Interval(0.2, 0.15, 0.26), 0.9, False)])
def test_a_delay_is_told_by_common_motion_within_the_lags(monkeypatch, found, share, told):
    monkeypatch.setattr(
        optical_flow, 'flow_latency', lambda _: (found, share, np.ones(len(LAGS))))
    line = lines(flight(seconds=2.0))['flow', 'latency']
    assert np.isfinite(line.value) == told
    assert line.note == (f'R^2 {share:.2f}' if told else 'not to be told from this flight')
