"""A gyro and a tracked attitude of one motion agree; another unit, axis or clock is told."""

from mambo_signals import gyro_check
from mambo_signals.time_offset import AlignError
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

STEP = 0.01


def turning(seed=0, seconds=20.0, size=0.1):
    """Return times, gyro and attitude of a random motion, with noise of both."""
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP)
    wobble = gaussian_filter1d(rng.standard_normal((n, 3)), 0.3 / STEP, axis=0)
    turn = Rotation.from_euler('ZYX', size * wobble / wobble.std(axis=0))
    steps = (turn[:-1].inv() * turn[1:]).as_rotvec() / STEP
    gyro = steps + [0.02, -0.01, 0.03] + 0.02 * rng.standard_normal(steps.shape)
    seen = turn * Rotation.from_rotvec(1e-3 * rng.standard_normal((n, 3)))
    t = np.arange(n) * STEP
    return t[:-1] + 0.5 * STEP, gyro, t, seen.as_quat()


def test_one_motion_agrees():
    found = gyro_check.compare(*turning())
    gyro_check.refuse(found)
    assert found.late == 0.0 and (found.correlation > 0.99).all()
    assert found.gyro == pytest.approx(found.tracked, rel=0.05)


@pytest.mark.parametrize('late', [-0.25, 0.1])
def test_an_attitude_that_is_late_is_measured(late):
    t, gyro, times, q = turning()
    found = gyro_check.compare(t, gyro, times + late, q)
    gyro_check.refuse(found)
    assert found.late == pytest.approx(late, abs=0.6 * STEP)


@pytest.mark.parametrize('change, message', [
    (np.pi / 180.0, 'not in SI units'), (180.0 / np.pi, 'not in SI units'),
    (2.0, 'more than 1.5 times apart'), (0.5, 'more than 1.5 times apart'),
    ([1.0, 0.0, 1.0], 'pitch rate: the gyro turns by 0 rad/s'),
    ([1.0, 1.0, -1.0], 'yaw rate: gyro and tracked attitude turn differently')])
def test_another_unit_and_another_axis_are_told(change, message):
    t, gyro, times, q = turning()
    with pytest.raises(AlignError, match=message):
        gyro_check.refuse(gyro_check.compare(t, gyro * change, times, q))


@pytest.mark.parametrize('size', [0.02, 0.1])
@pytest.mark.parametrize('order, signs, words', [
    ([1, 0, 2], [1, 1, 1], 'pitch, roll, yaw'), ([0, 1, 2], [1, -1, 1], 'roll, -pitch, yaw'),
    ([1, 2, 0], [1, 1, 1], 'yaw, roll, pitch'), ([1, 0, 2], [1, -1, 1], '-pitch, roll, yaw')])
def test_axes_in_another_order_or_sign_are_named_however_slow(size, order, signs, words):
    t, gyro, times, q = turning(size=size)
    found = gyro_check.compare(t, gyro[:, order] * signs, times, q)
    assert gyro_check.other_axes(found) == f'the gyro shows roll, pitch, yaw as {words}'
    with pytest.raises(AlignError):
        gyro_check.refuse(found)
    assert gyro_check.other_axes(gyro_check.compare(t, gyro, times, q)) == ''


def test_one_axis_in_another_unit_is_told():
    t, gyro, times, q = turning()
    assert gyro_check.other_unit(gyro_check.compare(t, gyro, times, q)) is None
    gain = gyro_check.other_unit(gyro_check.compare(t, gyro * [1.0, 1.0, 1.0 / 57.3], times, q))
    assert gain == pytest.approx(1.0 / 57.3, rel=0.1)


@pytest.mark.parametrize('angle', [0.35, -0.35])
def test_axes_turned_about_the_vertical_are_measured(angle):
    t, gyro, times, q = turning()
    askew = (Rotation.from_quat(q) * Rotation.from_rotvec([0.0, 0.0, angle])).as_quat()
    found = gyro_check.compare(t, gyro, times, askew)
    gyro_check.refuse(found)
    assert gyro_check.askew(found) == pytest.approx(angle, abs=0.03)
    assert abs(gyro_check.askew(gyro_check.compare(t, gyro, times, q))) < 0.03


def test_another_turning_has_no_angle_between_the_axes():
    t, gyro, times, q = turning()
    assert gyro_check.askew(None) == 0.0
    assert gyro_check.askew(gyro_check.compare(t, gyro[::-1], times, q)) == 0.0
    assert gyro_check.askew(gyro_check.compare(*turning(size=1e-3))) == 0.0


def test_what_hardly_turns_shows_nothing_wrong():
    """A hover: what a tracked attitude shows then is its noise."""
    t, gyro, times, q = turning(size=1e-3)
    found = gyro_check.compare(t, gyro, times, q)
    assert found.late == 0.0
    gyro_check.refuse(found)
    assert gyro_check.compare(t, gyro, times + 100.0, q) is None
    gyro_check.refuse(None)


def test_one_axis_alone_is_compared():
    """A motion about one axis says nothing about the others, whose rates are noise."""
    t, gyro, times, q = turning(size=np.array([0.1, 1e-4, 1e-4]))  # yaw, pitch, roll
    gyro_check.refuse(gyro_check.compare(t, gyro, times, q))
    with pytest.raises(AlignError, match='yaw rate'):
        gyro_check.refuse(gyro_check.compare(t, gyro * [1.0, 1.0, -1.0], times, q))
    gyro_check.refuse(gyro_check.compare(t, gyro * [-1.0, 1.0, 1.0], times, q))


def test_an_order_of_the_quaternion_is_told():
    t, gyro, times, q = turning(size=0.4)
    with pytest.raises(AlignError, match='rate: '):
        gyro_check.refuse(gyro_check.compare(t, gyro, times, q[:, [3, 0, 1, 2]]))


def test_gaps_and_repeated_samples_do_no_harm():
    t, gyro, times, q = turning()
    gyro[500:520] = np.nan
    q[900:930] = np.nan
    t[1000] = t[999]
    keep = np.r_[0:300, 340:len(t)]
    found = gyro_check.compare(t[keep], gyro[keep], times, q)
    gyro_check.refuse(found)
    assert found.late == 0.0 and (found.correlation > 0.99).all()


@pytest.mark.parametrize('samples', [0, 1, gyro_check.LEAST_SAMPLES // 2])
def test_too_few_samples_are_not_compared(samples):
    t, gyro, times, q = turning()
    assert gyro_check.compare(t[:samples], gyro[:samples], times, q) is None


def test_a_line_names_both_rates():
    t, gyro, times, q = turning()
    with pytest.raises(AlignError) as error:
        gyro_check.refuse(gyro_check.compare(t, 2.0 * gyro, times, q))
    text = str(error.value)
    by_gyro, tracked = (float(word.split(' rad/s')[0]) for word in text.split(' by ')[1:])
    assert by_gyro == pytest.approx(2.0 * tracked, rel=0.05) and '\n' not in text


def test_bias_is_no_contradiction():
    """An offset of the gyro is its bias, whatever its size."""
    t, gyro, times, q = turning()
    found = gyro_check.compare(t, gyro + [0.5, -0.3, 0.2], times, q)
    gyro_check.refuse(found)
    assert found.late == 0.0


def test_an_attitude_of_another_norm_is_left_out():
    t, gyro, times, q = turning()
    q[200:400] *= 3.0
    gyro_check.refuse(gyro_check.compare(t, gyro, times, q))


@pytest.mark.parametrize('gain, other', [
    (0.5, True), (0.6, True), (0.8, False), (1.0, False), (1.4, False), (1.6, True), (3.0, True)])
def test_a_gain_beyond_the_factor_is_another_unit(gain, other):
    """Without noise the ratio of standard deviations is the gain."""
    assert gyro_check.differs(1.0, gain, 1.5) == other


def test_noise_leaves_room_for_the_gain():
    assert gyro_check.differs(0.99, 1.6, 1.5) and not gyro_check.differs(0.9, 1.6, 1.5)


@pytest.mark.parametrize('gain', [np.pi / 180.0, 180.0 / np.pi])
def test_another_unit_is_told_in_a_calm_flight(gain):
    """Each axis turns by less than what is compared by itself."""
    t, gyro, times, q = turning(size=0.012)
    assert (gyro_check.compare(t, gyro, times, q).tracked < gyro_check.TURNING).all()
    assert gyro_check.other_unit(gyro_check.compare(t, gyro, times, q)) is None
    found = gyro_check.compare(t, gain * gyro, times, q)
    assert gyro_check.other_unit(found) == pytest.approx(gain, rel=0.1)
    with pytest.raises(AlignError, match='not in SI units'):
        gyro_check.refuse(found)


def test_a_gyro_without_the_noise_of_the_attitude_is_in_no_other_unit():
    """At rest a good gyro shows nothing, a tracked attitude its noise."""
    for seed in range(5):
        t, gyro, times, q = turning(seed, size=1e-6)
        rest = gyro_check.compare(t, 1e-3 * gyro, times, q)
        assert gyro_check.other_unit(rest) is None
    assert gyro_check.other_unit(None) is None


def test_an_axis_that_rests_is_not_dead():
    t, gyro, times, q = turning(size=np.array([0.1, 0.0, 0.1]))
    gyro[:, 1] = 0.0
    gyro_check.refuse(gyro_check.compare(t, gyro, times, q))


def test_orientations_that_are_none_are_left_out():
    t, gyro, times, q = turning()
    q[::3] = [0.0, 0.0, 2.0, 2.0]
    gyro_check.refuse(gyro_check.compare(t, gyro, times, q))


def test_a_noisy_gyro_is_smoothed_as_the_attitude_is():
    t, gyro, times, q = turning()
    gyro += 2.0 * np.random.default_rng(5).standard_normal(gyro.shape)
    gyro_check.refuse(gyro_check.compare(t, gyro, times, q))


def test_a_moment_tells_nothing():
    assert gyro_check.compare(*turning(seconds=1.8)) is None


@pytest.mark.parametrize('seed', range(1, 13))
def test_another_motion_shows_no_order_of_the_axes(seed):
    t, _, times, q = turning()
    assert gyro_check.other_axes(gyro_check.compare(t, turning(seed)[1], times, q)) == ''


@pytest.mark.parametrize('r, ratio, differs', [
    (0.7, 0.9, False), (0.7, 1.4, False), (0.99, 1.6, True), (0.99, 0.6, True)])
def test_noise_alone_is_no_other_gain(r, ratio, differs):
    assert gyro_check.differs(r, ratio, 1.5) == differs


@pytest.mark.parametrize('size', [0.1, 0.02])
@pytest.mark.parametrize('late', [0.0, 0.05])
def test_all_axes_together_show_one_motion(size, late):
    t, gyro, times, q = turning(size=size)
    found = gyro_check.together(t, gyro, times + late, q)
    assert found.confirmed and not found.differ
    assert found.correlation == pytest.approx(found.possible, abs=0.1)
    assert found.sigma == pytest.approx(np.sqrt(gyro_check.WINDOW / 60.0), rel=0.02)


@pytest.mark.parametrize('seed', range(4))
def test_all_axes_together_show_two_motions(seed):
    found = gyro_check.together(*turning(seed)[:2], *turning(seed + 10)[2:])
    assert found.possible > 0.9 and found.differ and not found.confirmed


def test_a_body_that_lies_still_turns_otherwise():
    t, gyro, times, q = turning()
    lying = Rotation.from_rotvec(1e-3 * np.random.default_rng(5).standard_normal((len(q), 3)))
    found = gyro_check.together(t, gyro, times, lying.as_quat())
    assert found.differ and not found.confirmed


@pytest.mark.parametrize('seed', range(4))
def test_noise_alone_does_not_turn_otherwise(seed):
    t, gyro, times, q = turning(seed, size=1e-5)
    found = gyro_check.together(t, gyro, times, q)
    assert found.possible < gyro_check.SHOWN and not found.differ and not found.confirmed


def test_a_short_flight_must_contradict_more_clearly():
    found = gyro_check.Together(0.45, 1.0, 0.02)
    assert found.differ and not found._replace(sigma=0.1).differ


def test_what_does_not_overlap_is_not_compared():
    t, gyro, times, q = turning()
    assert gyro_check.together(t, gyro, times + 100.0, q) is None
    assert gyro_check.together(t[:1], gyro[:1], times, q) is None


@pytest.mark.parametrize('order, signs', [([1, 0, 2], [1, 1, -1]), ([0, 1, 2], [-1, -1, 1]),
                                          ([1, 2, 0], [1, 1, 1])])
def test_other_axes_turn_otherwise_together(order, signs):
    t, gyro, times, q = turning()
    found = gyro_check.together(t, gyro[:, order] * signs, times, q)
    assert found.differ and not found.confirmed


@pytest.mark.parametrize('every', [1, 2, 5])
def test_rates_of_both_lost_samples_and_biases_show_one_motion_together(every):
    """A capture of 100, 50 or 20 Hz with a gap of 2 s, and a gyro with values that are none."""
    t, gyro, times, q = turning(seconds=30.0)
    there = np.arange(len(times)) % every == 0
    there &= (times < 10.0) | (times > 12.0)
    gyro[100:150] = np.nan
    gyro += [0.1, -0.2, 0.05]
    found = gyro_check.together(t, gyro, times[there], q[there])
    assert found.confirmed and not found.differ
    assert found.sigma == pytest.approx(np.sqrt(gyro_check.WINDOW / 84.0), rel=0.05)


def test_repeated_times_and_attitudes_of_no_length_do_not_count():
    t, gyro, times, q = turning()
    plain = gyro_check.together(t, gyro, times, q)
    again = np.sort(np.append(np.arange(len(t)), [50, 50, 700]))
    none = q.copy()
    none[300:303] = 0.0
    found = gyro_check.together(t[again], gyro[again], times, none)
    assert found.correlation == pytest.approx(plain.correlation, abs=0.01)
    assert found.confirmed


def test_the_noise_of_one_makes_less_of_a_correlation_possible():
    """To 1 over the root of 1 + noise: the variances of turning and noise are equal here."""
    t, gyro, times, q = turning()
    clean = gyro_check.together(t, gyro, times, q)
    rng = np.random.default_rng(8)
    rates = gyro - gyro.mean(axis=0)
    kept = round(gyro_check.WINDOW / STEP)  # samples that the smoothing averages
    noise = rates.std(axis=0) * np.sqrt(kept) * rng.standard_normal(gyro.shape)
    noisy = gyro_check.together(t, gyro + noise, times, q)
    assert noisy.correlation < clean.correlation - 0.1 and not noisy.differ
    assert noisy.possible == pytest.approx(noisy.correlation, abs=0.1)


def test_axes_that_are_turned_a_little_still_turn_together():
    """About z by 20 deg, of two axes of three: the rest of the correlation is the cosine."""
    t, gyro, times, q = turning()
    turned = Rotation.from_euler('z', 20.0, degrees=True).inv().apply(gyro)
    found = gyro_check.together(t, turned, times, q)
    assert found.confirmed
    assert found.correlation == pytest.approx((1.0 + 2.0 * np.cos(np.radians(20.0))) / 3.0,
                                              abs=0.03)


def test_a_lateness_beyond_that_of_filters_is_another_motion():
    t, gyro, times, q = turning()
    assert gyro_check.together(t, gyro, times + 2.0, q).differ


def test_gaps_and_unknown_samples_do_not_count_together():
    t, gyro, times, q = turning()
    gyro[300:500] = np.nan
    q[1200:1400] = np.nan
    found = gyro_check.together(t, gyro, times, q)
    assert found.confirmed
    assert found.sigma > np.sqrt(gyro_check.WINDOW / 60.0)  # 4 of 20 s tell nothing
