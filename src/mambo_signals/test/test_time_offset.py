"""Offsets, poses and flights that were put in are found again; what says nothing is refused."""

from contextlib import nullcontext

from mambo_bags.reader import read_bag
from mambo_signals import time_offset as align
from mambo_signals.resample import interpolate, longest_step
from mambo_signals.time_offset import (
    AlignError, equalised, find_flight, flight_by_acceleration, flight_by_height,
    flight_by_position, flight_by_thrust, most_precise, Offset, pose_offset, refuse_uncertain,
    registration, time_offset, UncertainError)
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from synthetic import LANDING, make_flight, Maker

STEP = 1e-3


def motion(seed, duration=40.0, smooth=0.25):
    """Return times and a random path of 0.5 m RMS without repetition, in steps of 1 ms."""
    rng = np.random.default_rng(seed)
    path = gaussian_filter1d(rng.standard_normal(round(duration / STEP)), smooth / STEP)
    return np.arange(len(path)) * STEP, 0.5 * path / path.std()


def pair(seed, rates=(200.0, 120.0), noise=(0.01, 0.005), gaps=4):
    """Return two recordings of one motion, and the offset between their clocks."""
    rng = np.random.default_rng(1000 + seed)
    t, x = motion(seed)
    offset = rng.uniform(-5.0, 5.0)
    ta, tb = np.arange(3.0, 37.0, 1.0 / rates[0]), np.arange(0.0, 39.0, 1.0 / rates[1])
    tb = tb + rng.uniform(0.0, 1e-3, len(tb))  # stamps of a busy machine
    a = np.interp(ta, t, x) + noise[0] * rng.standard_normal(len(ta))
    b = np.interp(tb, t, x) + noise[1] * rng.standard_normal(len(tb)) + 0.3  # another zero
    for gap in rng.uniform(3.0, 36.0, gaps):
        b[(tb > gap) & (tb < gap + 0.7)] = np.nan
    return ta, a, tb - offset, b, offset


@pytest.mark.parametrize('rates', [(200.0, 120.0), (120.0, 200.0), (200.0, 25.0), (100.0, 100.0)])
@pytest.mark.parametrize('seed', range(5))
def test_a_known_offset_is_recovered_to_2_ms(rates, seed):
    *signals, offset = pair(seed, rates)
    found = time_offset(*signals)
    assert abs(found.offset - offset) < 0.002
    assert found.quality > 0.99
    assert found.bias == pytest.approx(-0.3, abs=0.02)  # of a against b: their zeros differ


@pytest.mark.long
def test_the_standard_error_is_that_of_many_trials():
    z = []
    for seed in range(60):
        *signals, offset = pair(seed, gaps=2)
        found = time_offset(*signals)
        z.append((found.offset - offset) / found.sigma)
    # 60 trials: the rms of z is known to 9 %; correlated residuals make it a little more than 1
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4
    assert np.mean(np.abs(z) < 1.96) > 0.86  # 95 % less three binomial sigma


def test_the_offset_is_what_to_add_to_the_second_clock():
    t, x = motion(0)
    found = time_offset(t, x, t - 2.5, x)  # the second clock is 2.5 s behind
    assert found.offset == pytest.approx(2.5, abs=1e-5)
    back = time_offset(t - 2.5, x, t, x)
    assert back.offset == pytest.approx(-2.5, abs=1e-5)


def test_a_factor_and_a_bias_do_not_matter():
    t, x = motion(3)
    found = time_offset(t, 7.0 * x - 100.0, t + 1.0, x)
    assert found.offset == pytest.approx(-1.0, abs=1e-5)
    assert found.factor == pytest.approx(7.0, rel=1e-3)
    assert found.bias == pytest.approx(-100.0, abs=0.01)


def test_a_periodic_motion_is_ambiguous_until_limits_are_given():
    t = np.arange(0.0, 40.0, 0.005)
    circle = np.sin(t)
    with pytest.raises(AlignError, match='repeat.*give limits'):
        time_offset(t, circle, t - 0.7, circle)
    found = time_offset(t, circle, t - 0.7, circle, limits=(-2.0, 2.0))
    assert found.offset == pytest.approx(0.7, abs=1e-4)


def test_signals_that_do_not_determine_it_are_refused():
    rng = np.random.default_rng(0)
    t, x = motion(1)
    still = np.full(len(t), 1.5)
    for a, b, why in (
            (x, motion(2)[1], 'no offset aligns'),
            (rng.standard_normal(len(t)), rng.standard_normal(len(t)), 'no offset aligns'),
            (x, -x, 'no offset aligns'), (x, still, 'one of them is constant'),
            (x, np.full(len(t), np.nan), '0 finite samples')):
        with pytest.raises(AlignError, match=why):
            time_offset(t, a, t, b)
    with pytest.raises(AlignError, match='run backwards at'):
        time_offset(t, x, t[::-1], x)
    with pytest.raises(AlignError, match='not n of each'):
        time_offset(t, x, t[:-1], x)
    with pytest.raises(AlignError, match='at the end of the search|no offset aligns'):
        time_offset(t, x, t - 3.0, x, limits=(-1.0, 1.0))


def write_poses(path, times, position, yaw, namespace_topic='optitrack/pose'):
    """Write poses as a bag and return its messages."""
    maker = Maker(path, [namespace_topic])
    for stamp, p, q in zip(np.rint(times * 1e9).astype(int).tolist(), position,
                           Rotation.from_euler('z', yaw[:, None]).as_quat()):
        maker.write(namespace_topic, stamp, pose=maker.pose(p, q))
    maker.writer.close()
    return read_bag(path)[namespace_topic]


def test_two_pose_recordings_in_different_frames(tmp_path):
    t = np.arange(2.0, 30.0, 0.01)
    grid = motion(0)[0]

    def at(times):
        return np.column_stack([np.interp(times, grid, motion(seed)[1]) for seed in (4, 5, 6)])

    yaw = np.interp(t, grid, motion(7)[1])
    a = write_poses(tmp_path / 'a', t, at(t), yaw)
    turn = Rotation.from_euler('z', 1.1)
    later = t[::2] + 0.0042
    b = write_poses(tmp_path / 'b', later + 3.0, turn.apply(at(later)) + [5.0, 6.0, 7.0],
                    np.interp(later, grid, motion(7)[1]) + 1.1)
    best, each = pose_offset(a, b)
    assert set(each) == {'height', 'speed', 'yaw_rate'}
    for offset in (best, *each.values()):
        assert offset.offset == pytest.approx(-3.0, abs=0.002)
    with pytest.raises(AlignError, match='height: .*speed: .*yaw_rate: '):
        pose_offset(a, b, limits=(50.0, 51.0))
    times, pa = a.t, a.position
    moved = b.stamp + round(best.offset * 1e9)
    pb = interpolate(a.stamp, moved, b.position, longest_step(moved))
    found = registration(pa, pb)
    assert found.yaw == pytest.approx(-1.1, abs=1e-3)
    inside = (times > 2.1) & (times < 29.9)
    np.testing.assert_allclose(found.apply(pb[inside]), pa[inside], atol=0.005)
    assert np.isnan(pb[0]).all()  # b begins later


def test_yaw_and_translation_are_recovered():
    rng = np.random.default_rng(2)
    b = rng.standard_normal((300, 3))
    turn = Rotation.from_euler('z', -2.0)
    a = turn.apply(b) + [1.0, -2.0, 0.5] + 0.01 * rng.standard_normal((300, 3))
    a[7] = np.nan
    found = registration(a, b)
    assert found.yaw == pytest.approx(-2.0, abs=4.0 * found.sigma_yaw)
    assert 1e-4 < found.sigma_yaw < 2e-3  # 0.01 / sqrt(600), independent errors
    np.testing.assert_allclose(found.translation, [1.0, -2.0, 0.5], atol=0.005)
    assert found.rms == pytest.approx(0.01 * np.sqrt(3.0), rel=0.1)
    np.testing.assert_allclose(found.apply(b)[8:], a[8:], atol=0.05)


def test_the_yaw_is_the_one_with_the_least_squares():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 40, 3))
    a = b + 0.2 * a
    found = registration(a, b)

    def left(yaw):
        turned = Rotation.from_euler('z', yaw).apply(b)
        return np.square(a - a.mean(0) - turned + turned.mean(0)).sum()

    assert left(found.yaw) < min(left(found.yaw + d) for d in (-1e-3, 1e-3))


def test_a_hover_gives_no_yaw_but_can_be_equalised():
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 10.0, 0.01)
    a, b = 0.01 * rng.standard_normal((2, len(t), 3)) + [[[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0]]]
    with pytest.raises(AlignError, match='too small or too different'):
        registration(a, b)
    with pytest.raises(AlignError, match='a registration needs two'):
        registration(a[:1], b[:1])
    found = equalised(t, a, b, 6.0)
    np.testing.assert_allclose(found.translation, [1.0, 2.0, 3.0], atol=0.03)
    with pytest.raises(AlignError, match='no common positions'):
        equalised(t, a, b, 20.0)


@pytest.mark.parametrize('seed', range(6))
def test_a_slow_wander_of_a_hover_gives_no_yaw(seed):
    """Pushed alike for some seconds, but apart from that at will: few samples are independent."""
    common, *own = (0.01 * np.column_stack([motion(3 * seed + k, 5.0, 0.7)[1],
                                            motion(99 + 3 * seed + k, 5.0, 0.7)[1]])[::10]
                    for k in range(3))
    a, b = (np.column_stack([common + 0.7 * one, 0.0 * one[:, 0]]) for one in own)
    with pytest.raises(AlignError, match='too small or too different'):
        registration(a, b)


@pytest.mark.long
def test_the_standard_error_of_a_yaw_is_that_of_errors_that_last():
    """Errors of 2 cm that last 0.25 s beside a path of 1 m: 40 yaws scatter as is said."""
    t = motion(0)[0][::20]
    b = np.column_stack([np.sin(t), np.cos(t), 0.0 * t])
    found = [registration(b + 0.04 * np.column_stack(
        [motion(100 + 2 * k)[1][::20], motion(101 + 2 * k)[1][::20], 0.0 * t]), b)
        for k in range(40)]
    scatter = np.std([one.yaw for one in found])
    # the RMS of 40 is known to 11 %; a Newey-West estimate with these lags is up to 20 % low
    assert np.sqrt(np.mean([one.sigma_yaw ** 2 for one in found])) == pytest.approx(
        scatter, rel=0.4)


def test_equalised_paths_agree_at_the_instant_and_drift_elsewhere():
    t = np.arange(0.0, 20.0, 0.01)
    truth = np.column_stack([np.sin(t), np.cos(t), 1.5 + 0.0 * t])
    drifting = truth + np.outer(t, [0.1, 0.0, 0.0])
    error = equalised(t, truth, drifting, 6.0).apply(drifting) - truth
    np.testing.assert_allclose(error[:, 0], 0.1 * (t - 6.0), atol=1e-9)
    given = equalised(t, truth, Rotation.from_euler('z', 0.4).apply(drifting), 6.0, yaw=-0.4)
    np.testing.assert_allclose(given.apply(Rotation.from_euler('z', 0.4).apply(drifting)) - truth,
                               error, atol=1e-9)


def height_of(t, takeoff, landing, ground=(0.0, 0.0)):
    """Return a height that leaves and reaches the ground at given times, 1 m/s."""
    t = np.asarray(t)
    up = np.clip(np.minimum(t - takeoff, landing - t), 0.0, 1.5)
    return up + np.where(t < 0.5 * (takeoff + landing), *ground)


@pytest.mark.parametrize('noise', [0.0, 0.003])
@pytest.mark.parametrize('ground', [(0.0, 0.0), (-3.0, -3.0)])
def test_take_off_and_landing_by_height(noise, ground):
    t = np.arange(0.0, 30.0, 0.01)
    z = height_of(t, 4.0, 25.0, ground) + noise * np.random.default_rng(0).standard_normal(len(t))
    z[500:520] = np.nan
    found = flight_by_height(t, z)
    # 2 cm of height count as standing: at 1 m/s that is 20 ms, and noise adds as much
    assert found.takeoff == pytest.approx(4.0, abs=0.05)
    assert found.landing == pytest.approx(25.0, abs=0.05)


def test_a_place_to_land_may_be_lower_and_ends_in_the_air_are_not_made_up():
    t = np.arange(0.0, 30.0, 0.01)
    z = height_of(t, 4.0, 25.0, (0.09, 0.0))
    assert flight_by_height(t, z).takeoff == pytest.approx(4.0, abs=0.05)
    flying = (t > 8.0) & (t < 20.0)
    waving = z + 0.4 * np.sin(t)
    assert flight_by_height(t[flying], waving[flying])[:2] == (None, None)
    assert flight_by_height(t[t > 4.5], z[t > 4.5]).takeoff is None  # begins in the climb
    assert flight_by_height(t[t < 20], z[t < 20]).landing is None
    with pytest.raises(AlignError, match='never leaves the ground'):
        flight_by_height(t, 0.01 * np.sin(t))


@pytest.mark.parametrize('ground, drift, hover, takeoff', [
    (0.7, 0.0, 0.0, 4.0),      # stands 0.7 m above the zero of a hall
    (0.0, 0.05, 0.0, 4.0),     # the own estimate of a standing drone moves
    (0.7, 0.0, 0.02, None),    # hovers, and climbs
    (0.7, 0.05, 0.0, None)])   # drifts in the air, and climbs
def test_a_climb_of_a_vehicle_that_does_not_stand_is_no_take_off(ground, drift, hover, takeoff):
    t = np.arange(0.0, 20.0, 0.01)
    noise = 2e-4 * np.random.default_rng(0).standard_normal((len(t), 3))
    path = noise + np.column_stack([
        drift * t, hover * np.sin(3.0 * t), ground + np.clip(t - 4.0, 0.0, 1.5)])
    path[250:260] = np.nan
    assert flight_by_height(t, path[:, 2]).takeoff == pytest.approx(4.0, abs=0.05)
    found = flight_by_position(t, path)
    assert found.takeoff == (None if takeoff is None else pytest.approx(takeoff, abs=0.05))
    assert found.landing is None


@pytest.mark.parametrize('noise, rest, stands', [
    (1e-4, 4.0, True), (1e-3, 4.0, True),   # noise of a capture is smoothed
    (1e-4, 0.8, True), (1e-4, 0.3, False),  # a rest that is too short tells nothing
    (2e-2, 4.0, False)])                    # no capture: the position is not known so well
def test_a_rest_is_found_if_it_lasts_and_the_noise_is_that_of_a_capture(noise, rest, stands):
    t = np.arange(0.0, 20.0, 0.01)
    path = noise * np.random.default_rng(0).standard_normal((len(t), 3))
    path[:, 2] += 0.7 + np.clip(t - rest, 0.0, 1.5)
    assert (flight_by_position(t, path).takeoff is not None) == stands


def test_take_off_and_landing_by_thrust_and_by_acceleration():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 20.0, 0.005)
    flying = (t >= 3.0) & (t < 16.0)
    idle = (t >= 1.0) & ~flying & (t < 17.0)
    pwm = np.where(flying, 247.0 + 20.0 * rng.standard_normal(len(t)), np.where(idle, 100.0, 0.0))
    found = flight_by_thrust(t, pwm)
    assert (found.takeoff, found.landing) == pytest.approx((3.0, 16.0), abs=0.01)
    shaking = np.where(flying, 1.0, 0.02)[:, None] * rng.standard_normal((len(t), 3))
    found = flight_by_acceleration(t, shaking + [0.0, 0.0, 9.81])
    assert found.takeoff == pytest.approx(3.0, abs=0.3)  # the shaking is averaged over 0.1 s
    assert found.landing == pytest.approx(16.0, abs=0.3)
    for signal in (0.02, 1.0):
        with pytest.raises(AlignError, match='does not separate rest from flight'):
            flight_by_acceleration(t, signal * rng.standard_normal(len(t)))
    with pytest.raises(AlignError, match='never run'):
        flight_by_thrust(t, np.zeros(len(t)))


@pytest.mark.long
def test_a_flight_is_detected_in_the_best_signal_of_a_bag(tmp_path):
    left = ('reference', 'estimator/state', 'sensor_tick', 'optical_flow', 'barometer/pressure')
    bag = read_bag(make_flight(tmp_path / 'a', 21.0, leave_out=left))
    found = find_flight(bag)
    # 1 s, then up by a smooth step that reaches 2 cm after 0.2 s; down over 4 s from 16 s
    assert found.source == 'ground_truth/odom'
    assert found.takeoff == pytest.approx(1.2, abs=0.1)
    assert found.landing == pytest.approx(LANDING + 4.0, abs=0.1)
    bag = read_bag(make_flight(tmp_path / 'b', 3.0, leave_out=(
        *left, 'ground_truth/odom', 'estimate/odom', 'optitrack/pose', 'sonar/range',
        'motor_pwm')))
    with pytest.raises(AlignError, match='no flight found; imu/data_raw: '):
        find_flight(bag)


def colored(seed, count=4000, rho=0.7):
    """Return AR(1) scores of unit innovation; the variance of their sum is known."""
    rng = np.random.default_rng(seed)
    return lfilter([1.0], [1.0, -rho], rng.standard_normal(count + 200))[200:]


@pytest.mark.parametrize(('least', 'lags'), [(1, None), (40, 40), (10**6, 1000)])
def test_the_variance_of_correlated_scores_is_that_of_newey_and_west(least, lags):
    """By another hand: the autocovariance at every lag, times the triangle of Bartlett."""
    x = colored(0)
    x = x - x.mean()
    gamma = np.correlate(x, x, 'full')[len(x) - 1:]
    if lags is None:  # Andrews 1991, eq. 6.2 and 6.4, of an AR(1)
        rho = gamma[1] / gamma[0]
        alpha = 4.0 * rho ** 2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
        lags = int(1.1447 * (alpha * len(x)) ** (1.0 / 3.0))
        assert 20 < lags < 60
    bartlett = np.bartlett(2 * lags + 3)[lags + 1:-1]
    assert bartlett[0] == 1.0 and len(bartlett) == lags + 1
    want = gamma[0] + 2.0 * (bartlett[1:] * gamma[1:lags + 1]).sum()
    assert align._long_run_variance(x, least) == pytest.approx(want, rel=1e-9)


def test_the_variance_of_correlated_scores_is_that_of_their_sum():
    """Of AR(1) scores the sum varies by n / (1 - rho)^2: neither more nor less is promised."""
    rho, count = 0.7, 4000
    true = count / (1.0 - rho) ** 2
    found = [align._long_run_variance(colored(seed), 1) / true for seed in range(40)]
    # 25 lags of the triangle take off a tenth, and one run scatters by some 12 %
    assert 0.8 < np.mean(found) < 1.05
    assert np.std(found) < 0.3
    sums = [colored(seed).sum() ** 2 / true for seed in range(200)]
    assert np.mean(sums) == pytest.approx(1.0, abs=0.3)  # 3 sigma of 200 chi-square


def test_constant_scores_have_no_variance_and_rough_ones_keep_theirs():
    assert align._long_run_variance(np.zeros(100), 3) == 0.0
    assert align._long_run_variance(np.full(100, 7.0), 3) == 0.0
    rough = np.tile([1.0, -1.0], 500)  # what is lost by the next sample: never less than 1 / n
    assert 0.0 < align._long_run_variance(rough, 1) <= 1000.0


def test_the_standard_error_is_neither_too_wide_nor_too_narrow():
    z = []
    for seed in range(30):
        *signals, offset = pair(500 + seed, (100.0, 100.0), (0.003, 0.003), 0)
        found = time_offset(*signals)
        z.append((found.offset - offset) / found.sigma)
    # of 30 trials the rms is known to 13 %: three of these either way
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


def one(offset, sigma):
    return Offset(offset, sigma, 0.99, 0.0, 1.0, 30.0)


def test_the_signal_of_the_smallest_error_gives_the_offset():
    name, best = most_precise({'height': one(1.0, 0.01), 'speed': one(1.002, 0.002)})
    assert name == 'speed' and best.offset == 1.002 and best.sigma == pytest.approx(0.002)
    # a range that may be 30 ms behind counts for less than its standard error says
    name, best = most_precise({'range': one(1.0, 1e-4), 'speed': one(1.01, 0.01)}, {'range': 0.03})
    assert name == 'speed' and best.sigma == pytest.approx(0.01)
    name, best = most_precise({'range': one(1.0, 0.001)}, {'range': 0.03})
    assert best.sigma == pytest.approx(np.hypot(0.001, 0.03))


def test_signals_that_scatter_more_than_their_errors_widen_the_error():
    """Birge's ratio: two others at 3 and 4 sigma make it the root of 12.5 times as wide."""
    _, best = most_precise({'a': one(0.0, 0.001), 'b': one(0.006, 0.002), 'c': one(-0.012, 0.003)})
    assert best.sigma == pytest.approx(0.001 * np.sqrt((3.0 ** 2 + 4.0 ** 2) / 2.0))
    _, best = most_precise({'a': one(0.0, 0.001), 'b': one(0.001, 0.002)})
    assert best.sigma == 0.001  # never narrower


def test_signals_that_disagree_are_refused_by_name():
    offsets = r'different clock offsets .*speed \+1\.000 s, height \+1\.200 s'
    with pytest.raises(AlignError, match=offsets):
        most_precise({'height': one(1.2, 0.01), 'speed': one(1.0, 0.002)})
    assert most_precise({'height': one(1.14, 0.01), 'speed': one(1.0, 0.002)})[0] == 'speed'


def test_constant_quantities_are_reported_and_do_not_stop_the_others():
    t, x = motion(5)
    small = 0.02 * x  # swings over less than 0.1
    found, reasons = align.offsets({
        'height': (t, x, t - 1.0, x), 'speed': (t, small, t - 1.0, small),
        'yaw_rate': (t, x, t, motion(6)[1])})
    assert set(found) == {'height'} and set(reasons) == {'speed', 'yaw_rate'}
    assert isinstance(reasons['speed'], align.NotExcited)
    assert not isinstance(reasons['yaw_rate'], align.NotExcited)
    assert 'are needed' in str(reasons['speed'])


def test_an_offset_that_is_too_uncertain_is_refused():
    *signals, _ = pair(0, (100.0, 100.0), (0.01, 0.01), 0)
    sigma = time_offset(*signals).sigma
    with pytest.raises(AlignError, match='standard error of .* above'):
        time_offset(*signals, worst=0.9 * sigma)
    assert time_offset(*signals, worst=1.1 * sigma).sigma == sigma
    align.refuse_uncertain(2.0, 0.049)
    for unknown in (0.051, np.nan, np.inf):
        with pytest.raises(AlignError, match='the offset of 2.000 s has a standard error of .* s'):
            align.refuse_uncertain(2.0, unknown)


def test_the_overlap_is_what_both_have():
    t, x = motion(7)
    first, second = t < 25.0, t > 10.0
    found = time_offset(t[first], x[first], t[second] - 3.0, x[second])
    assert found.offset == pytest.approx(3.0, abs=1e-3)
    assert found.overlap == pytest.approx(15.0, abs=0.1)
    with pytest.raises(AlignError):  # 15 s of 25 s are not 0.8 of them
        time_offset(t[first], x[first], t[second] - 3.0, x[second], overlap=0.8)


@pytest.mark.parametrize(('limits', 'found'), [((2.0, 3.0), True), ((2.6, 3.0), False)])
def test_an_offset_lies_within_its_limits(limits, found):
    t, x = motion(8)
    if found:
        assert time_offset(t, x, t - 2.5, x, limits=limits).offset == pytest.approx(2.5, abs=1e-3)
    else:
        with pytest.raises(AlignError):
            time_offset(t, x, t - 2.5, x, limits=limits)


def test_repeated_times_count_once():
    t, x = motion(9)
    t, x = t[::10], x[::10]
    twice = np.repeat(t, 2), np.repeat(x, 2)
    assert time_offset(*twice, t - 1.5, x).offset == pytest.approx(1.5, abs=1e-3)
def test_the_public_names_are_documented():
    for name in ('time_offset', 'pose_offset', 'registration', 'equalised', 'find_flight'):
        assert 'Raises' in getattr(align, name).__doc__


@pytest.mark.parametrize('first', [True, False])
def test_a_jump_of_the_clock_is_refused_before_it_fills_the_memory(first):
    ta, a, tb, b, _ = pair(1)
    late = ta if first else tb
    late[len(late) // 2:] += 7 * 86400.0
    with pytest.raises(AlignError, match=('first' if first else 'second') + (
            r' signal lasts 6048\d\d s, with a gap of 604800 s after .* jump of the clock')):
        time_offset(ta, a, tb, b)


def bumps(t):
    """Return a signal with a hump at each of some uneven times, (n,)."""
    return sum(np.exp(-0.5 * ((t - at) / 0.4) ** 2) for at in (3.0, 7.5, 10.0, 16.0, 21.5, 27.0))


@pytest.mark.parametrize('jump', [0.6, 0.8])
def test_a_clock_that_jumps_leaves_an_offset_uncertain(jump):
    t = np.arange(0.0, 30.0, 0.02)
    later = t + jump * (t > 15.0)
    with pytest.raises(UncertainError, match='has a standard error of'):
        time_offset(t, bumps(t), later, bumps(t))
    assert time_offset(t, bumps(t), t + 2.0, bumps(t)).offset == pytest.approx(-2.0, abs=1e-6)


def test_signals_that_are_not_alike_are_not_only_uncertain():
    t, rng = np.arange(0.0, 30.0, 0.02), np.random.default_rng(1)
    with pytest.raises(AlignError) as found:
        time_offset(t, bumps(t), t, rng.standard_normal(len(t)).cumsum())
    assert not isinstance(found.value, UncertainError)


@pytest.mark.parametrize(('sigma', 'refused'), [(0.05, False), (0.051, True), (np.nan, True)])
def test_a_standard_error_above_the_worst_is_refused(sigma, refused):
    with pytest.raises(UncertainError) if refused else nullcontext():
        refuse_uncertain(1.0, sigma)
