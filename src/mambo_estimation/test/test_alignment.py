"""Alignment: signs by hand, scipy rotations, the split of a slope from a bias, and movement."""

from mambo_estimation import alignment
from mambo_estimation.alignment import AlignmentParams
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

G = 9.81
DT = 0.005  # s
TILT = AlignmentParams(accel_bias_std=1e-6, floor_slope_std=1.5).values()   # all of it is slope
SENSOR = AlignmentParams(floor_slope_std=0.0).values()                      # all of it is bias


def rotation(q):
    return Rotation.from_quat([*q[1:], q[0]])


def test_signs_by_hand():
    nose_up = alignment.level((0.5, 0.0, -9.797), G, TILT).q
    assert rotation(nose_up).as_euler('ZYX')[1] == pytest.approx(0.5 / G, rel=1e-3)
    right_down = alignment.level((0.0, -0.5, -9.797), G, TILT).q
    assert rotation(right_down).as_euler('ZYX')[2] == pytest.approx(0.5 / G, rel=1e-3)


@pytest.mark.parametrize('seed', range(10))
def test_tilt_at_rest_is_found_at_any_attitude(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_euler('YX', rng.uniform([-1.4, -3.0], [1.4, 3.0]))  # yaw 0
    force = R.inv().apply([0.0, 0.0, -G])
    found = alignment.level(tuple(force), G, TILT)
    assert (rotation(found.q) * R.inv()).magnitude() < 1e-5  # the tiny share given to the bias
    np.testing.assert_allclose(found.accel_bias, 0.0, atol=1e-5)


def test_on_a_level_floor_the_whole_reading_is_bias():
    found = alignment.level((0.3, -0.2, -9.5), G, SENSOR)
    assert found.q == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert found.accel_bias == pytest.approx((0.3, -0.2, 0.31))
    assert found.tilt_std == 0.0


def test_split_is_the_best_estimate_and_states_its_deviation():
    v = AlignmentParams(accel_bias_std=0.2, floor_slope_std=0.015).values()
    rng = np.random.default_rng(5)
    error = []
    for _ in range(4000):
        slope, bias = 0.015 * rng.standard_normal(2), 0.2 * rng.standard_normal(2)
        R = Rotation.from_euler('YX', slope)
        force = R.inv().apply([0.0, 0.0, -G]) + [*bias, 0.0]
        found = alignment.level(tuple(force), G, v)
        error.append([*(rotation(found.q) * R.inv()).as_rotvec()[:2], found.tilt_std])
    error = np.array(error)
    plain = error[:, 2] == np.median(error[:, 2])  # 1 in 10000 lies beyond 4.3 deviations
    assert plain.mean() > 0.999
    # deviation of a deviation from 7900 numbers: 0.8 %; 4 of them
    assert np.std(error[plain, :2]) == pytest.approx(np.median(error[:, 2]), rel=0.032)


def test_a_large_bias_on_a_level_floor_is_no_slope():
    found = alignment.level((0.9, -0.22, -9.58), G, AlignmentParams().values())  # 3.1 deviations
    assert rotation(found.q).magnitude() < 1e-3
    assert found.accel_bias[:2] == pytest.approx((0.9, -0.22), rel=0.01)


def test_reading_too_large_for_a_bias_is_a_slope():
    v = AlignmentParams().values()
    R = Rotation.from_euler('y', 10, degrees=True)
    found = alignment.level(tuple(R.inv().apply([0.0, 0.0, -G])), G, v)
    assert rotation(found.q).as_euler('ZYX', degrees=True)[1] == pytest.approx(10)


def collect(gyro, accel, params):
    v, m, verdict = params.values(), alignment.EMPTY, alignment.COLLECTING
    for k in range(len(gyro)):
        m, verdict = alignment.collect(m, tuple(gyro[k]), tuple(accel[k]), DT, G, v)
        if verdict != alignment.COLLECTING:
            return m, verdict, k
    return m, verdict, len(gyro) - 1


def resting(n, bias=(0.02, -0.01, 0.03), noise=1e-3, seed=0):
    rng = np.random.default_rng(seed)
    gyro = np.array(bias) + noise * rng.standard_normal((n, 3))
    return gyro, np.array([0.1, 0.0, -9.7]) + 0.02 * rng.standard_normal((n, 3))


def test_means_are_those_of_the_samples_and_their_variance_is_honest():
    found = []
    for seed in range(200):
        gyro, accel = resting(100, seed=seed)
        m, verdict, k = collect(gyro, accel, AlignmentParams(gyro_bias_floor=1e-6))
        assert verdict == alignment.ALIGNED and k == 99
        np.testing.assert_allclose(m.gyro, gyro.mean(axis=0), atol=1e-15)
        np.testing.assert_allclose(m.accel, accel.mean(axis=0), atol=1e-13)
        found.append((*(np.array(m.gyro) - (0.02, -0.01, 0.03)), alignment.gyro_bias_variance(
            m, AlignmentParams(gyro_bias_floor=1e-6).values())))
    found = np.array(found)
    # 600 errors: the deviation of their mean square is 6 %, four of them
    assert np.mean(found[:, :3] ** 2) == pytest.approx(np.mean(found[:, 3]), rel=0.24)


def test_a_gyro_that_is_stuck_at_rest_says_nothing_of_its_bias():
    params, gyro, accel = AlignmentParams(), np.zeros((100, 3)), still(100)
    without_noise = np.full((100, 3), accel[0])
    for force, std in ((accel, alignment.STUCK), (without_noise, 1e-4)):
        m, verdict, _ = collect(gyro, force, params)
        assert verdict == alignment.ALIGNED
        assert alignment.gyro_bias_variance(m, params.values()) == pytest.approx(std * std)


@pytest.mark.parametrize('spoil', ['turn', 'shove', 'spin', 'fall', 'lift'])
def test_movement_starts_the_collection_anew_within_a_block(spoil):
    gyro, accel = resting(100)
    if spoil == 'turn':
        gyro[40:] += [0.0, 0.2, 0.0]
    elif spoil == 'shove':
        accel[40:] += [1.0, 0.0, 0.0]
    elif spoil == 'spin':
        gyro += [0.0, 0.0, 0.5]
    elif spoil == 'fall':
        accel[:] = 0.0
    else:
        accel[40:] -= [0.0, 0.0, 2.0]
    v, m = AlignmentParams().values(), alignment.EMPTY
    for k in range(50 if spoil in ('turn', 'shove', 'lift') else 10):
        m, verdict = alignment.collect(m, tuple(gyro[k]), tuple(accel[k]), DT, G, v)
        assert verdict == alignment.COLLECTING
    assert m.count == 0


def test_a_vehicle_that_does_not_rest_ends_the_alignment_after_the_patience():
    t = np.arange(1000) * DT
    gyro, accel = resting(1000)
    gyro += 0.5 * np.sin(8.0 * t)[:, None]
    _, verdict, k = collect(gyro, accel, AlignmentParams())
    assert verdict == alignment.MOVED and 2.0 <= t[k] < 2.0 + 10 * DT


def test_after_movement_the_alignment_is_as_good_as_without():
    gyro, accel = resting(200)
    gyro[:45] += [0.3, 0.0, 0.0]
    m, verdict, k = collect(gyro, accel, AlignmentParams())
    # one block, mostly at rest, begins it once in vain
    assert verdict == alignment.ALIGNED and k == 159
    np.testing.assert_allclose(m.gyro, gyro[60:160].mean(axis=0), atol=1e-15)


@pytest.mark.parametrize('accel_noise', [0.001, 0.01, 0.05, 0.15, 0.3])
@pytest.mark.parametrize('gyro_noise', [1e-4, 1e-3, 0.01, 0.05])
def test_noise_is_not_movement(accel_noise, gyro_noise):
    aligned = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        gyro = 0.02 + gyro_noise * rng.standard_normal((400, 3))
        accel = [0.1, 0.0, -9.7] + accel_noise * rng.standard_normal((400, 3))
        m, verdict, k = collect(gyro[:100], accel[:100], AlignmentParams())
        aligned += verdict == alignment.ALIGNED
        for k in range(100, 400 if verdict == alignment.ALIGNED else 100):
            m, still = alignment.watch(
                m, tuple(gyro[k]), tuple(accel[k]), DT, AlignmentParams().values())
            assert still
    assert aligned == 50  # ten blocks each: an unlikely one comes once in 2000 alignments


@pytest.mark.parametrize(('frequency', 'amplitude'), [(1.0, 2.0), (5.0, 1.5), (30.0, 4.0)])
def test_a_vehicle_that_is_shaken_does_not_align(frequency, amplitude):
    t = np.arange(450) * DT
    gyro, accel = resting(450)
    accel[:, 0] += amplitude * np.sin(2.0 * np.pi * frequency * t)
    assert collect(gyro, accel, AlignmentParams())[1] == alignment.MOVED


def test_no_samples_wanted_starts_at_once():
    gyro, accel = resting(1)
    assert collect(gyro, accel, AlignmentParams(samples=0))[1] == alignment.MOVED


def test_rest_lasts_through_noise_and_ends_with_movement():
    params = AlignmentParams()
    gyro, accel = resting(2100)
    m, _, _ = collect(gyro[:100], accel[:100], params)
    v = params.values()
    for k in range(100, 2100):
        m, still = alignment.watch(m, tuple(gyro[k]), tuple(accel[k]), 0.005, v)
        assert still
    for k in range(100):
        m, still = alignment.watch(m, tuple(gyro[k]), tuple(accel[k] - [0, 0, 0.5]), 0.005, v)
        if not still:
            break
    # 0.5 m/s^2 smoothed over 0.1 s passes 0.15 m/s^2 after 0.1 ln(0.5 / 0.35) = 0.036 s
    assert 4 <= k <= 10


def settled(accel, gyro=None, sonar=0.44, height=0.05, climb=0.0):
    """Return after how many samples a vehicle that has flown rests; 0: it does not."""
    m, v = alignment.FLYING, AlignmentParams().values()
    gyro = np.zeros_like(accel) if gyro is None else gyro
    for k, (g, a) in enumerate(zip(gyro, accel, strict=True)):
        m, resting = alignment.settle(
            m, sonar if k % 8 == 0 else np.nan, 0.46, height, climb, tuple(g), tuple(a), DT, G, v)
        if resting:
            return k + 1
    return 0


def still(n, noise=0.05, seed=0):
    return np.array([0.1, -0.05, -G]) + noise * np.random.default_rng(seed).standard_normal((n, 3))


def test_a_vehicle_that_has_landed_rests_after_as_long_as_an_alignment():
    assert all(settled(still(400, seed=seed)) == 100 for seed in range(20))
    moving = still(400)
    moving[:150] += 1.5 * np.random.default_rng(1).standard_normal((150, 3))
    assert 250 <= settled(moving) <= 270


@pytest.mark.parametrize('change', [
    {'sonar': 0.5}, {'height': 0.2}, {'climb': -0.3}, {'sonar': np.nan}])
def test_what_is_not_low_does_not_rest(change):
    assert settled(still(400), **change) == 0


def test_running_motors_and_a_body_that_turns_are_no_rest():
    rng = np.random.default_rng(3)
    assert settled(still(2000) + [0.8, 0.8, 0.9] * rng.standard_normal((2000, 3))) == 0
    turning = np.zeros((2000, 3))
    turning[:, 1] = 0.2 * np.sin(np.arange(2000) * DT * 4.0)
    assert settled(still(2000), turning) == 0
    assert settled(np.full((400, 3), np.nan)) == 0  # none was measured
    assert settled(still(400) * [1.0, 1.0, 0.5]) == 0  # it falls
