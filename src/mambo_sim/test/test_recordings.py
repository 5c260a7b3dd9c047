"""
Defaults of the sensors, measured again on the recordings they come from.

Rolling Spider bench and flights: the Mambo's predecessor with the same toolbox, every 5 ms.
``mambo identify sensors FILES`` measures the same with intervals, by other code:
docs/explanation/sensors.md lists the results.
"""

import functools
import json
from pathlib import Path

from mambo_model.motion.rigid_body import State
from mambo_ros.messages import decode_pose
from mambo_sim.sensors import optitrack
from mambo_sim.sensors.barometer import BarometerParams
from mambo_sim.sensors.imu import ImuParams
from mambo_sim.sensors.marker_occlusion import MarkerParams
from mambo_sim.sensors.optical_flow import OpticalFlowParams
from mambo_sim.sensors.optitrack import OptitrackParams
from mambo_sim.sensors.sonar import RESOLUTION, SonarParams
from mcap.reader import make_reader
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import butter, sosfiltfilt, welch

DATA = Path(__file__).resolve().parents[4] / 'shared' / 'data'
BENCH, FLIGHTS = DATA / 'rolling_spider_bench', DATA / 'rolling_spider_flights'
pytestmark = pytest.mark.skipif(
    not FLIGHTS.is_dir(), reason=f'the recordings are not there: {DATA}')
G = 9.81


@functools.cache
def flights():
    """Return {name: {signal: values}} of every flight."""
    out = {}
    for path in sorted(FLIGHTS.glob('*.mat')):
        record = loadmat(path, squeeze_me=True, struct_as_record=False)['rt_yout']
        out[path.stem] = {
            s.blockName.split('/')[-1]: np.asarray(s.values, float) for s in record.signals}
    return out


def free_flights():
    """Return the flights with propellers and without a rig."""
    return {n: f for n, f in flights().items() if n.startswith(('RSdata', 'p9', 'square'))}


def second_difference_sigma(x):
    """Return the white noise of a slow signal: robust deviation of second differences."""
    return 1.4826 * np.median(np.abs(np.diff(x, 2))) / np.sqrt(6)


def new_values(x):
    return np.flatnonzero(np.r_[False, np.any(np.diff(x.reshape(len(x), -1), axis=0), axis=1)])


@functools.cache
def resting():
    return loadmat(BENCH / 'noisedata.mat')['noisedata']  # acc m/s^2, gyro rad/s


def test_resting_noise_and_resolution_of_the_imu():
    params, sigma = ImuParams(), resting().std(axis=0)
    np.testing.assert_allclose(params.accel_noise, sigma[:3], rtol=0.01)
    white = np.sqrt(sigma[3:]**2 - params.gyro_resolution**2 / 12)
    np.testing.assert_allclose(params.gyro_noise, white, rtol=0.02)
    for column, step in ((0, params.accel_resolution), (3, params.gyro_resolution)):
        steps = np.diff(np.unique(resting()[:, column]))
        assert steps.min() == pytest.approx(step, rel=0.02)  # the file has five decimals


def in_the_air(f):
    pwm = np.abs(f['motors_refout']).mean(axis=1)
    return (f['Z'] < -0.4) & (pwm > 180) & (pwm < 350)


def test_vibration_in_free_flight():
    sos = butter(4, 15, 'high', fs=200, output='sos')
    accel, gyro = [], []
    for f in free_flights().values():
        air = in_the_air(f)
        for out, names in ((accel, ('ddxb', 'ddyb', 'ddzb')), (gyro, ('pa', 'qa', 'ra'))):
            high = sosfiltfilt(sos, np.c_[tuple(f[n] for n in names)], axis=0)[air]
            out.append(1.4826 * np.median(np.abs(high), axis=0))
    assert len(accel) == 8
    np.testing.assert_allclose(ImuParams().accel_vibration, np.median(accel, axis=0), rtol=0.05)
    np.testing.assert_allclose(ImuParams().gyro_vibration, np.median(gyro, axis=0), rtol=0.08)


def test_vibration_has_little_below_10_hertz():
    ratios = []
    for f in free_flights().values():
        for name in ('ddxb', 'ddyb'):  # z moves with the thrust
            freq, power = welch(f[name][in_the_air(f)], 200, nperseg=256)
            white = f[name][in_the_air(f)].var() / 100
            ratios.append(white / power[(freq > 2) & (freq < 10)].mean())
    assert 10 < np.median(ratios) < 60  # 24 for differenced white noise


def test_biases_and_their_walk():
    calibration = {n: f['sensordataCalib_datout'][-1] for n, f in flights().items()}
    upright = np.array([c for n, c in calibration.items() if not n.startswith('1a')])
    params = ImuParams()
    gyro = np.sqrt((np.array(list(calibration.values()))[:, 3:6]**2).mean(axis=0))
    np.testing.assert_allclose(params.gyro_bias, gyro, rtol=0.05)
    accel = upright[:, :3] + [0, 0, G]
    assert params.accel_bias[2] == pytest.approx(np.sqrt((accel[:, 2]**2).mean()), rel=0.1)
    assert params.accel_bias[0] == pytest.approx(np.median(np.abs(accel[:, 0])), rel=0.15)
    assert params.accel_bias[1] == pytest.approx(np.median(np.abs(accel[:, 1])), rel=0.2)
    first, second = (
        next(c for n, c in calibration.items() if key in n) for key in ('22_54_51', '23_02_39'))
    change = second - first  # 468 s apart by their names
    rms = np.sqrt((change[3:6]**2).mean())
    assert params.gyro_walk == pytest.approx(rms / np.sqrt(468), rel=0.1)
    assert params.accel_walk == pytest.approx(abs(change[2]) / np.sqrt(468), rel=0.1)


def test_bias_of_a_drone_from_flight_to_flight():
    calibration = {n: f['sensordataCalib_datout'][-1] for n, f in flights().items()}
    series = [np.array([c for n, c in calibration.items() if n.startswith(start)])
              for start in ('p9', 'RSdata__2017', 'data_5b')]
    assert [len(one) for one in series] == [3, 2, 3]
    squares = sum(((one - one.mean(axis=0))**2).sum(axis=0) for one in series)
    spread = np.sqrt(squares / (8 - 3))  # three means are taken out
    np.testing.assert_allclose(ImuParams().gyro_turn_on, spread[3:6], rtol=0.03)
    np.testing.assert_allclose(ImuParams().accel_turn_on, spread[2], rtol=0.03)


def test_filtered_rates_are_not_taken_for_the_gyro():
    for f in free_flights().values():
        raw, onboard = (np.diff(f[name]).std() for name in ('ra', 'rb'))
        assert onboard < 0.8 * raw
        assert np.diff(f['pb']).std() == pytest.approx(np.diff(f['pa']).std(), rel=0.01)


def test_sonar_interval_resolution_limits_and_noise():
    params, smallest, largest = SonarParams(), [], []
    for f in flights().values():
        values = f['altitude_sonarb']
        assert np.median(np.diff(new_values(values))) == 200 / params.rate
        multiples = values / RESOLUTION
        # whole multiples up to 4100: the resolution is right to 1e-6
        np.testing.assert_allclose(multiples, np.round(multiples), atol=0.005)
        smallest.append(round(multiples[values > 0].min()))
        largest.append(values.max())
    assert min(smallest) == 338 and smallest.count(338) == 7
    assert params.min_range == pytest.approx(338 * RESOLUTION)
    assert params.max_range == pytest.approx(max(largest), abs=0.01)
    f = flights()['RSdata_exampleflight__5c88b34']
    new = new_values(f['altitude_sonarb'])
    new = new[f['Z'][new] < -0.55]
    sigma = second_difference_sigma(f['altitude_sonarb'][new])
    assert params.noise == pytest.approx(sigma, rel=0.15)
    strays = np.abs(f['altitude_sonarb'][new] + f['Z'][new]) > 0.2
    assert 0.01 < strays.mean() < 0.03


def test_flow_interval_and_noise():
    params, intervals = OpticalFlowParams(), []
    for f in free_flights().values():
        gaps = np.diff(new_values(f['opticalFlow_datout'][:, :2]))
        intervals.append(gaps[gaps <= 10].mean())
    assert 200 / params.rate == pytest.approx(np.mean(intervals), rel=0.02)
    f = flights()['RSdata_exampleflight__5c88b34']
    new = new_values(f['opticalFlow_datout'][:, :2])
    gap = np.diff(new)
    frame = gap[gap <= 10].mean() / 200
    flow = f['opticalFlow_datout'][new[f['Z'][new] < -0.5]]
    for axis in (0, 1):  # the signal is an angle per frame
        sigma = second_difference_sigma(flow[:, axis]) / frame
        assert params.noise == pytest.approx(sigma, rel=0.1)


def test_flow_pauses_after_every_15_values():
    for f in flights().values():
        gaps = np.diff(new_values(f['opticalFlow_datout'][:, :2]))
        pauses = np.flatnonzero(gaps >= 12)
        assert np.median(np.diff(pauses)) == OpticalFlowParams().burst
        assert 0.085 <= np.median(gaps[pauses]) / 200 <= 0.13


def test_flow_signal_holds_no_whole_rotation():
    slopes = []
    for f in free_flights().values():
        new = new_values(f['opticalFlow_datout'][:, :2])
        new = new[f['Z'][new] < -0.5]
        for axis, velocity, rate in ((0, 'dx', f['qb']), (1, 'dy', -f['pb'])):
            A = np.c_[f[velocity][new] / -f['Z'][new], rate[new], np.ones(len(new))]
            fit = np.linalg.lstsq(A, f['opticalFlow_datout'][new, axis], rcond=None)[0]
            slopes.append(fit[1] / fit[0])
    assert abs(np.median(slopes)) < 0.25  # 1 if it were left in, -1 if removed twice


def test_barometer_noise_resolution_and_walk():
    params = BarometerParams()
    rig = [f['prsb'][400:] for n, f in flights().items() if n.startswith(('1a', '5b', 'data_5b'))]
    sigmas = sorted(p.std() for p in rig)
    assert sigmas[:3] == pytest.approx([params.noise] * 3, rel=0.06)
    walks = []
    for f in free_flights().values():
        level = f['prsb'] - 11.8 * f['Z']  # Pa per m; Z points down
        seconds = level[:len(level) // 200 * 200].reshape(-1, 200).mean(axis=1)[3:]
        if len(seconds) >= 8:  # not the shortest flight
            walks.append(np.sqrt(((seconds[4:] - seconds[:-4])**2).mean()) / 2)
        steps = np.abs(np.diff(f['prsb']))
        assert params.resolution == pytest.approx(steps[steps > 0].min(), abs=0.02)
    assert params.walk == pytest.approx(np.median(walks), rel=0.15)
    calm = [c for n, f in flights().items() if n.startswith('p9')
            for c in [f['sensordataCalib_datout'][-1][6]]]
    assert params.offset == pytest.approx(np.std(calm), rel=0.35)


def test_propellers_on_the_floor_do_not_show_in_the_pressure():
    change = []
    for f in free_flights().values():
        turning = np.abs(f['motors_refout']).mean(axis=1) > 100
        floor = (f['Z'] > -0.12) & turning & (np.arange(len(turning)) < 600)
        change.append(f['prsb'][floor].mean() - f['sensordataCalib_datout'][-1][6])
    error = np.std(change, ddof=1) / np.sqrt(len(change))
    assert len(change) == 8 and error < 0.7
    assert abs(np.mean(change)) < 2 * error


def test_attitude_noise_of_the_motion_capture():
    sigmas = []
    for path in sorted((DATA / 'crazyflie_optitrack').glob('*.json')):
        mocap = json.loads(path.read_text()).get('mocap')
        for axis in ('yaw', 'pitch', 'roll') if mocap else ():
            x = np.array([np.nan if v is None else v for v in mocap[axis]], float)
            sigmas.append(second_difference_sigma(x[np.isfinite(x)]))
    assert OptitrackParams().attitude_noise == pytest.approx(np.median(sigmas), rel=0.35)


def test_markers_give_the_attitude_noise_of_the_motion_capture():
    # in body axes, first order: s^2 (sum |a|^2 I - a a^T)^-1 with a from the centroid
    params = MarkerParams()
    a = np.array(params.five()) - np.mean(params.five(), axis=0)
    attitude = params.noise * np.sqrt(np.diag(np.linalg.inv((a**2).sum() * np.eye(3) - a.T @ a)))
    assert np.median(attitude) == pytest.approx(OptitrackParams().attitude_noise, rel=0.1)


def test_position_noise_of_the_motion_capture_lies_between_two_halls():
    sigmas = []
    for path in sorted((DATA / 'crazyflie_optitrack').glob('*.json')):
        mocap = json.loads(path.read_text()).get('mocap')
        sigmas += [second_difference_sigma(np.array(mocap[axis])) for axis in 'xyz' if mocap]
    _, places = hall()
    large = np.median([second_difference_sigma(x) for x in places.T])
    # centroid of five markers; a pose away from it has a little more
    assert np.median(sigmas) < MarkerParams().noise / np.sqrt(5) < large < 0.001


@functools.cache
def hall():
    """Return stamps in s and positions (n, 3) of 198 s of poses of a motion capture."""
    path = DATA / 'mcap_bags' / 'cub_stabilize_2025_11_13.mcap'
    with path.open('rb') as file:
        poses = [decode_pose(message.data) for _, _, message
                 in make_reader(file).iter_messages(topics=['/cub1/pose'])]
    return np.array([t for t, _, _ in poses]) * 1e-9, np.array([rho for _, rho, _ in poses])


def rows_of_lost_poses(stamps, period):
    """Return how many poses are missing at each place where some are."""
    missing = np.round(np.diff(stamps) / period).astype(int) - 1
    return missing[missing > 0]


@pytest.mark.long
def test_poses_are_lost_as_often_as_in_a_hall():
    stamps, _ = hall()
    rows = rows_of_lost_poses(stamps, np.median(np.diff(stamps)))
    share = rows.sum() / (len(stamps) + rows.sum())
    assert share == pytest.approx(0.005, rel=0.05) and (np.diff(stamps) > 0.02).sum() == 33
    assert OptitrackParams().loss_length == pytest.approx(rows.mean(), rel=0.1)
    params = OptitrackParams(rate=99.7, frame_loss=share, noise=True)
    p, rng, memory, out = params.values(), np.random.default_rng(3), optitrack.START, []
    still = State((0.0, 0.0, -1.0), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
    for tick in range(1, 198 * 200):
        memory, sample = optitrack.step(
            memory, (tick - 1) * 5_000_000, still, tick * 5_000_000, still, rng, p, None)
        if sample.new:
            out.append(sample.stamp * 1e-9)
    mocked = rows_of_lost_poses(np.array(out), 1.0 / 99.7)
    assert len(mocked) == pytest.approx(len(rows), abs=4 * np.sqrt(len(rows)))  # 50 by chance
