"""Sensors identified: known truth on synthetic recordings, the simulator's bag, real flights."""

import functools
import json
from pathlib import Path

from mambo_analysis.identify import sensors
from mambo_analysis.identify.recording import read_sensors, Recording, Stream
from mambo_analysis.identify.sensors import phases, statistics, table
from mambo_sim.sensors.imu import ImuParams
from mambo_sim.sensors.optical_flow import OpticalFlowParams
from mambo_sim.sensors.sonar import RESOLUTION, SonarParams
import numpy as np
import pytest
from scipy.stats import binom

ROOT = Path(__file__).parents[4]
BAG = ROOT / 'bags' / 'circle_short'
DATA = ROOT.parent / 'shared' / 'data'
real = pytest.mark.skipif(not DATA.is_dir(), reason=f'the recordings are not there: {DATA}')
SEEDS = 60
FEWEST = int(binom.ppf(0.005, SEEDS, 0.95))  # of 60 intervals at 95 %, but for 1 in 200 tries
G = 9.81
STEP = 0.005
LATENCY, NOISE, STRAY, LOST, PRESSURE = 0.06, 0.005, 0.03, 0.02, 5.0


def swaying(rng, n):
    """Return roll, pitch, their rates, velocity and drag of a vehicle that sways about level."""
    t = np.arange(n) * STEP
    f, size = rng.uniform(0.4, 5.0, (2, 12)), 0.03 * rng.standard_normal((2, 12))
    phase = rng.uniform(0, 2 * np.pi, (2, 12))
    turn = 2 * np.pi * f[..., None] * t + phase[..., None]
    angle = (size[..., None] * np.sin(turn)).sum(axis=1)
    rate = (size[..., None] * 2 * np.pi * f[..., None] * np.cos(turn)).sum(axis=1)
    tilt = G * np.array([-angle[1], angle[0]])  # nose up slows, right side down speeds up
    v, drag = np.zeros((2, n)), 0.3
    for k in range(1, n):  # trapezoid in the gravity, exact enough at 5 ms
        v[:, k] = v[:, k - 1] + STEP * (0.5 * (tilt[:, k] + tilt[:, k - 1]) - drag * v[:, k - 1])
    return t, rate, v, -drag * v


@functools.cache
def flight(seed, n=4000):
    """Return a recording of 20 s in the air at 1.2 m whose every error is known."""
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal
    t, rate, v, drag = swaying(rng, n)
    gyro = np.c_[rate[0], rate[1], np.zeros(n)] + 0.01 * normal((n, 3))
    accel = np.c_[drag[0], drag[1], np.full(n, -G)] + 0.5 * normal((n, 3))
    echo = np.arange(0, n, 8)
    height = 1.2 + NOISE * normal(len(echo))
    strays = rng.random(len(echo)) < STRAY
    height[strays] += rng.uniform(0.5, 3.0, strays.sum())
    height[rng.random(len(echo)) < LOST] = np.nan
    cycle = 14 * 6 + 22  # 15 values each 30 ms, then one 110 ms later
    frame = np.array([k for k in range(n) if k % cycle % 6 == 0 and k % cycle <= 14 * 6])
    seen = np.array([np.interp(t[frame] - LATENCY, t, v[k]) for k in range(2)]).T / 1.2
    flow = seen + 0.02 * normal((len(frame), 2))
    air = np.arange(0, n, 3)
    return Recording(
        'synthetic', Stream(t, gyro), Stream(t, accel), Stream(t[echo], height),
        Stream(t[frame], flow), Stream(t[air], 101325.0 + PRESSURE * normal(len(air))),
        Stream(t, np.full((n, 4), 250.0)))


def found(lines, sensor, quantity):
    return next(line for line in lines if line[:2] == (sensor, quantity))


@functools.cache
def measured(seed):
    return sensors.measure(flight(seed))[0]


@pytest.mark.parametrize('sensor, quantity, truth', [
    ('sonar', 'noise', NOISE), ('sonar', 'outliers', STRAY), ('sonar', 'dropouts', LOST),
    ('flow', 'latency', 1e3 * LATENCY), ('barometer', 'noise from value to value', PRESSURE),
    ('gyro x', 'vibration in flight', None), ('accel z', 'vibration in flight', None)])
@pytest.mark.long
def test_intervals_cover_the_truth(sensor, quantity, truth):
    if truth is None:  # white noise above 15 Hz: what is left of it to the Nyquist frequency
        truth = {'gyro x': 0.01, 'accel z': 0.5}[sensor] * np.sqrt(85.0 / 100.0)
    lines = [found(measured(seed), sensor, quantity) for seed in range(SEEDS)]
    covered = sum(line.low <= truth <= line.high for line in lines)
    assert covered >= FEWEST
    assert np.median([line.value for line in lines]) == pytest.approx(truth, rel=0.1)


@pytest.mark.long
def test_latency_is_found_to_some_milliseconds():
    lines = [found(measured(seed), 'flow', 'latency') for seed in range(SEEDS)]
    assert np.median([line.high - line.low for line in lines]) < 15.0


def test_rates_and_pauses():
    lines = measured(0)
    assert found(lines, 'imu', 'rate').value == pytest.approx(200.0)
    assert found(lines, 'sonar', 'interval').value == pytest.approx(40.0)
    assert found(lines, 'flow', 'interval').value == pytest.approx(30.0)
    assert found(lines, 'flow', 'rate').value == pytest.approx(1000 / 30)
    assert found(lines, 'flow', 'pause').value == pytest.approx(110.0)
    assert found(lines, 'flow', 'values from pause to pause').value == 15


def test_no_latency_is_told_without_motion():
    still = flight(0)
    n = len(still.gyro.t)
    rng = np.random.default_rng(5)
    lines, _ = sensors.measure(Recording(
        'still', Stream(still.gyro.t, 0.01 * rng.standard_normal((n, 3))), still.accel,
        still.sonar, Stream(still.flow.t, 0.02 * rng.standard_normal((len(still.flow.t), 2))),
        pwm=still.pwm))
    line = found(lines, 'flow', 'latency')
    assert np.isnan(line.value) and 'not to be told' in line.note


@pytest.mark.parametrize('k, n', [(0, 50), (3, 100), (50, 50)])
def test_proportion_is_clopper_and_pearson(k, n):
    value, low, high = statistics.proportion(k, n)
    assert value == k / n
    # the ends make k or more, k or less, exactly so unlikely
    assert low == 0.0 if k == 0 else binom.sf(k - 1, n, low) == pytest.approx(0.025)
    assert high == 1.0 if k == n else binom.cdf(k, n, high) == pytest.approx(0.025)


def test_median_covers_the_truth():
    rng = np.random.default_rng(0)
    found = [statistics.median(rng.exponential(1.0, 31)) for _ in range(400)]
    covered = sum(low <= np.log(2) <= high for _, low, high in found)
    assert covered >= binom.ppf(0.005, 400, 0.95)
    assert np.mean([high - low for _, low, high in found]) < 1.0


@pytest.mark.parametrize('step, offset', [(RESOLUTION, 0.0), (0.25, 0.1), (1.0 / 128, 101325.0)])
def test_resolution_is_found(step, offset):
    k = np.random.default_rng(0).integers(-300, 300, 400)
    value, low, high = statistics.resolution(offset + step * k)
    assert value == pytest.approx(step, rel=1e-6)


def test_resolution_of_rounded_values_has_a_fair_interval():
    k = np.random.default_rng(0).integers(-300, 300, 400)
    value, low, high = statistics.resolution(np.round(0.0010643 * k, 5))  # as noisedata.mat
    assert low < 0.0010643 < high and high - low < 1e-7


def test_values_anywhere_have_no_resolution():
    assert statistics.resolution(np.random.default_rng(0).standard_normal(500)) is None
    assert statistics.resolution(np.full(100, 3.0)) is None


def test_rest_is_found_between_motion():
    rng = np.random.default_rng(0)
    t = np.arange(4000) * STEP
    size = np.where((t >= 5.0) & (t < 11.998), 1.0, 100.0)[:, None]
    gyro, accel = (size * s * rng.standard_normal((4000, 3)) for s in (0.0007, 0.02))
    accel[:, 2] -= G
    rest = phases.stretch_at_rest(Recording('r', Stream(t, gyro), Stream(t, accel)))
    assert (rest.start, rest.stop) == (1000, 2400)
    lines, _ = sensors.measure(Recording('r', Stream(t, gyro), Stream(t, accel)))
    noise = found(lines, 'gyro x', 'noise at rest')
    assert noise.low < 0.0007 < noise.high and noise.samples == 1400
    walk = found(lines, 'accel y', 'velocity random walk')
    assert walk.low < 0.02 * np.sqrt(STEP) < walk.high


def test_missing_values_are_those_due_or_those_said_to_be():
    t = np.delete(np.arange(100) * 0.04, [10, 50, 51])
    values = np.full(97, 1.0) + 0.01 * np.arange(97) % 2
    values[20] = np.nan
    output, due = (found(sensors.measure(Recording('s', sonar=Stream(t, values), held=held))[0],
                       'sonar', 'dropouts') for held in (True, False))
    assert round(output.value * output.samples) == 1 and round(due.value * due.samples) == 4


def test_bag_of_the_simulator_gives_its_parameters():
    lines, _ = sensors.measure(read_sensors(BAG))
    imu, flow, sonar = ImuParams(), OpticalFlowParams(), SonarParams()
    assert found(lines, 'flow', 'rate').value == pytest.approx(flow.rate, rel=0.005)
    assert found(lines, 'sonar', 'interval').value == pytest.approx(1e3 / sonar.rate)
    for sensor, quantity, truth in (
            ('gyro', 'resolution', imu.gyro_resolution), ('sonar', 'noise', sonar.noise),
            ('flow', 'latency', 0.0), ('barometer', 'noise from value to value', 5.0),
            ('sonar', 'outliers', 0.0), ('sonar', 'dropouts', 0.0)):
        line = found(lines, sensor, quantity)
        assert line.low - 1e-6 <= truth <= line.high + 1e-6, line
    assert found(lines, 'flow', 'latency').high - found(lines, 'flow', 'latency').low < 20.0


@functools.cache
def recording(name):
    folder = 'rolling_spider_flights' if '_' in name else 'rolling_spider_bench'
    file, = (DATA / folder).glob(f'{name}*.mat')
    return sensors.measure(read_sensors(file))[0]


@real
def test_bench_recording_gives_the_noise_of_the_simulated_imu():
    params = ImuParams()
    for axis, name in enumerate('xyz'):
        accel = found(recording('noisedata'), f'accel {name}', 'noise at rest')
        assert accel.low < params.accel_noise[axis] < accel.high
        gyro = found(recording('noisedata'), f'gyro {name}', 'noise at rest')
        assert gyro.low < params.gyro_noise[axis] < gyro.high
    step = found(recording('noisedata'), 'gyro', 'resolution')
    assert step.low < params.gyro_resolution < step.high


@real
@pytest.mark.parametrize('name', ['p9_trial4', 'square_1', 'p9_trial3', 'RSdata_speed1',
                                  'RSdata_exampleflight', 'RSdata__2017_02_26__23'])
def test_flow_of_the_predecessor_is_late_by_an_eighth_of_a_second(name):
    line = found(recording(name), 'flow', 'latency')
    assert line.low < 120.0 < line.high


@real
@pytest.mark.parametrize('name', ['p9_trial4', 'square_1', '1a_y_rest', 'data_5b_badtexture'])
def test_flow_of_the_predecessor_pauses_after_15_values(name):
    params = OpticalFlowParams()
    assert found(recording(name), 'flow', 'values from pause to pause').value == params.burst
    assert 85.0 <= found(recording(name), 'flow', 'pause').value <= 130.0


@real
def test_imported_log_says_the_same_as_the_log(tmp_path):
    from mambo_analysis.importers.minidrone import import_minidrone
    file, = (DATA / 'rolling_spider_flights').glob('p9_trial4*.mat')
    import_minidrone(file, tmp_path / 'bag')
    lines, _ = sensors.measure(read_sensors(tmp_path / 'bag'))
    for sensor, quantity in (('gyro z', 'vibration in flight'), ('flow', 'latency'),
                             ('sonar', 'outliers'), ('sonar', 'resolution')):
        once, again = (found(x, sensor, quantity) for x in (recording('p9_trial4'), lines))
        assert again.value == pytest.approx(once.value, rel=0.02)  # the first sample may differ
    assert found(lines, 'sonar', 'dropouts').value == 0.0  # repeated values are not missing


def test_command_prints_draws_and_writes(tmp_path, capsys):
    out, values = tmp_path / 'figures', tmp_path / 'values.json'
    assert sensors.main([str(BAG), str(BAG), '--out', str(out), '--json', str(values)]) == 0
    text = capsys.readouterr().out
    assert 'sonar' in text and '95 % interval' in text and 'lowest to highest' in text
    figures = sorted(out.glob('*.png'))
    assert len(figures) == 2 and all(f.read_bytes()[1:4] == b'PNG' for f in figures)
    content = json.loads(values.read_text())
    first, second = content['recordings']
    assert first == second and content['level'] == 0.95
    rate = next(m for m in first['measured'] if m['quantity'] == 'rate' and m['sensor'] == 'imu')
    assert rate['value'] == pytest.approx(200.0) and rate['unit'] == 'Hz'


def test_values_that_cannot_be_told_are_null_in_json_and_a_dash_in_the_table():
    nothing = table.Measured('flow', 'latency', 'ms', np.nan, np.nan, np.nan, 9, 'why')
    assert ' -  ' in table.table([nothing]) and 'nan' not in table.table([nothing])
    assert table.summary([[nothing]]) == []


@pytest.mark.parametrize('name, content, message', [
    ('none.mat', None, 'cannot be read'), ('empty.mat', b'', 'empty'),
    ('text.mat', b'no mat file at all, but long enough to look at ' * 9, 'not a readable mat'),
    ('none', None, 'no such bag'), ('text.mcap', b'nothing', 'text.mcap')])
def test_foreign_files_get_one_line(tmp_path, capsys, name, content, message):
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    assert sensors.main([str(BAG), str(file)]) == 2
    output = capsys.readouterr()
    assert output.err.startswith('identify_sensors: ') and message in output.err
    assert output.err.count('\n') == 1 and not output.out


def test_malformed_noisedata_gets_one_line(tmp_path, capsys):
    from scipy.io import savemat
    for values in (np.zeros((10, 5)), np.full((10, 6), np.nan), np.zeros((10, 6))):
        savemat(tmp_path / 'noisedata.mat', {'noisedata': values})
        assert sensors.main([str(tmp_path / 'noisedata.mat')]) == 2
        output = capsys.readouterr().err
        assert output.count('\n') == 1 and 'noisedata' in output


def test_the_interval_of_rounded_samples_is_not_that_of_their_ties():
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(50):
        rounded = np.round(rng.normal(0.0, 0.005, 400) / 0.002) * 0.002
        found = statistics.robust_sigma(rounded)
        assert (found.high - found.low) / found.value > 0.2
        inside += found.low < 0.005 < found.high
    assert inside >= 45
