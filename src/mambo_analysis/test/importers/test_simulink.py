"""Logs of Simulink models after the layouts of public ones, from a flight whose truth is known."""

from dataclasses import replace
import math

from mambo_analysis.compare.estimate import again, parameters
from mambo_analysis.importers.mat_file import variables
from mambo_analysis.importers.minidrone import import_minidrone, main
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_flight import offline_replay
from mambo_flight.closed_loop import fly
from mambo_flight.scenario import scenario
import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

STEP = 0.005  # s
SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


@pytest.fixture(scope='module')
def flight():
    """Return 20 s of the default flight, aligned on the floor before."""
    return fly(scenario(duration=20.0, land=False))


def block(values, time=None, label=''):
    """Return a signal as a To Workspace block logs it."""
    values = np.asarray(values)
    time = np.arange(len(values)) * STEP if time is None else time
    return {'time': time, 'blockName': '', 'signals': {
        'values': values, 'dimensions': 1 if values.ndim == 1 else values.shape[1],
        'label': label}}


def held(values, before=0.0):
    """Return a sensor's values, (n,) or (n, k) with NaN between, held as the drone's code does."""
    values = values.reshape(len(values), -1)
    new = np.isfinite(values).all(axis=1)
    last = np.maximum.accumulate(np.where(new, np.arange(len(values)), -1))
    out = np.where((last >= 0)[:, None], values[last], before)
    return out if out.shape[1] > 1 else out[:, 0]


def sensors(flight):
    """Return gyro, specific force, sonar, flow and pressure of a flight, a row for each step."""
    return (flight.imu[:, :3], flight.imu[:, 3:], held(flight.sonar), held(flight.flow[:, :2]),
            held(flight.pressure, 101325.0))


def scopes(flight, prefix='rt_', gyro_unit=1.0):
    """Return the variables of a Mambo log with a scope for each signal."""
    gyro, force, sonar, flow, pressure = sensors(flight)
    named = {
        'a_x': force[:, 0].astype('f4'), 'a_y': force[:, 1].astype('f4'), 'a_z': force[:, 2],
        'p': gyro_unit * gyro[:, 0], 'q': gyro_unit * gyro[:, 1], 'r': gyro_unit * gyro[:, 2],
        'pressure': pressure, 'z_ultrasonic': -sonar, 'u': flow[:, 0], 'v': flow[:, 1],
        'w': np.ones(len(flow)), 'motor_speeds': flight.pwm}
    out = {f'{prefix}{name}': block(values) for name, values in named.items()}
    return out | {
        'rt_tout': np.arange(len(gyro)) * STEP, 'rt_Commands': block(np.zeros((len(gyro), 4))),
        'rt_phi_drone': block(np.zeros(len(gyro)), label='phi_kf'),
        **{f'gain_{i}': float(i) for i in range(100)}}


def template(flight, width=10):
    """Return the variables of the class template; the flow in the toolbox's units."""
    gyro, force, sonar, flow, pressure = sensors(flight)
    n = len(gyro)
    force, gyro = force + [0.15, -0.1, 0.05], gyro + [0.01, -0.02, 0.005]
    bias = np.append(force[:200].mean(axis=0) + [0.0, 0.0, 9.81], gyro[:200].mean(axis=0))
    sensor = np.column_stack([force, gyro, sonar, pressure, np.full(n, 3.9), np.full(n, 81.0)])
    optical = np.zeros((n, 8))
    optical[:, 1:3], optical[:, 4] = flow / 20.0, np.where(flow.any(axis=1), 0.0, -99.0)
    truth = flight.truth
    estim = np.column_stack([
        truth[:, :3], Rotation.from_quat(truth[:, [7, 8, 9, 6]]).as_euler('ZYX'),
        truth[:, 3:6], truth[:, 10:13]])
    return {
        'rt_tout': np.arange(n) * STEP, 'rt_sensor': block(sensor[:, :width]),
        'rt_optical': block(optical), 'rt_estim': block(estim),
        'rt_calib': block(np.tile([*bias, 101325.0], (n, 1))),
        'rt_motor': block(SIGNS * flight.pwm), 'rt_cmd': block(np.zeros((n, 9)))}


def save(path, found):
    scipy.io.savemat(path, {name: value for name, value in found.items() if value is not None},
                     do_compression=True)
    return path


def errors(flight, bag):
    """Return largest errors of height [m], level attitude [deg] and horizontal position [m]."""
    content = read_bag(bag)
    # the sensors are simulated ones, not those of a real minidrone
    params = replace(JointParams(), alignment=parameters(content).joint.alignment)
    found = offline_replay.estimate(content, params)
    rows = np.rint(found.t * 1e-9 / STEP).astype(int)
    truth = flight.truth[rows]
    fly = rows * STEP > 4.0
    turn = (Rotation.from_quat(found.state[:, [7, 8, 9, 6]]).as_euler('ZYX')
            - Rotation.from_quat(truth[:, [7, 8, 9, 6]]).as_euler('ZYX'))
    distance = np.linalg.norm(found.state[:, :2] - truth[:, :2], axis=1)
    return (np.abs(found.state[:, 2] - truth[:, 2])[fly].max(),
            np.degrees(np.abs(turn[fly, 1:])).max(), distance.max())


def imported(tmp_path, capsys, found, *options):
    """Import and return the bag's path and what was said."""
    source = save(tmp_path / 'log.mat', found)
    assert main([str(source), str(tmp_path / 'bag'), *options]) == 0
    return tmp_path / 'bag', capsys.readouterr().out


def refused(tmp_path, capsys, found, *options):
    """Return the one line that refuses a log."""
    source = save(tmp_path / 'log.mat', found)
    assert main([str(source), str(tmp_path / 'bag'), *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith('import_minidrone: ') and error.count('\n') == 1, error
    assert not (tmp_path / 'bag').exists()
    return error


def mapping(tmp_path, text):
    (tmp_path / 'map.yaml').write_text(text)
    return '--map', str(tmp_path / 'map.yaml')


def assert_flown_again(flight, bag):
    """The estimator knows the flight as well as the one that flew it: 8 mm, 0.2 deg, 6 cm."""
    height, tilt, distance = errors(flight, bag)
    assert height < 0.02 and tilt < 0.5 and distance < 0.1


@pytest.mark.long
def test_scopes_named_per_signal_give_the_flight_again(flight, tmp_path, capsys):
    bag, output = imported(tmp_path, capsys, scopes(flight))
    assert_flown_again(flight, bag)
    assert 'gyro taken for rad/s: its integral is a tilt of 4 deg' in output
    assert 'sonar is negative upwards: its sign was turned' in output
    assert 'flow of 1 taken for 1 rad/s' in output
    unused = next(line for line in output.splitlines() if 'not used: ' in line)
    assert 'rt_Commands (4001, 4), rt_phi_drone' in unused and unused.endswith('and 91 more')
    assert len(unused) < 300
    got = read_bag(bag)
    assert got['motor_pwm'].pwm[1000].tolist() == flight.pwm[1000].tolist()
    sonar = flight.sonar[np.isfinite(flight.sonar)]
    assert 0.85 * len(sonar) < len(got['sonar/range']) < len(sonar)  # a repeated one is hidden
    assert got['sonar/range'].range.min() > 0.0
    assert 'gain_99' in got.metadata['import']['ignored']


@pytest.mark.long
@pytest.mark.parametrize('prefix', ['rt_rt_', 'MyModel_'])
def test_other_prefixes_are_known(flight, tmp_path, capsys, prefix):
    bag, _ = imported(tmp_path, capsys, scopes(flight, prefix))
    assert_flown_again(flight, bag)


def test_one_typing_error_is_named_and_mended_by_a_map(flight, tmp_path, capsys):
    found = scopes(flight)
    found['rx_a_y'] = found.pop('rt_a_y')
    error = refused(tmp_path, capsys, found)
    assert 'missing accel_y (such as rt_a_y; nearest: rx_a_y)' in error and '--map' in error
    bag, _ = imported(tmp_path, capsys, found, *mapping(tmp_path, 'accel_y: rx_a_y\n'))
    assert_flown_again(flight, bag)


def test_names_of_nobody_are_told_by_a_map(flight, tmp_path, capsys):
    gyro, force, sonar, flow, pressure = sensors(flight)
    names = 'accel: imu[0:3]\ngyro: 0.017453292519943295 * imu[3:6]\nsonar: -ScopeData1[1]\n' \
        'pressure: ScopeData1[0]\nflow: of\n'
    found = {'imu': block(np.column_stack([force, np.degrees(gyro)])), 'of': block(flow),
             'ScopeData1': block(np.column_stack([pressure, -sonar]))}
    bag, output = imported(tmp_path, capsys, found, *mapping(tmp_path, names))
    assert_flown_again(flight, bag)
    assert 'not used' not in output


@pytest.mark.parametrize('text, wanted', [
    ('acel_x: rt_a_x', 'map.yaml:1: acel_x: not known; nearest: accel_x'),
    ('sonar: rt_a_y\naccel_x: rt_a_q', 'map.yaml:2: accel_x: no logged variable rt_a_q; near'),
    ('gyro: rt_p', 'map.yaml:1: gyro: needs 3 columns, rt_p is [0:1] of 1 in rt_p'),
    ('sonar: rt_Commands', 'sonar: needs 1 column, rt_Commands is [0:4] of 4 in rt_Commands'),
    ('sonar: rt_Commands[4]', 'sonar: needs 1 column, rt_Commands[4] is [4:5] of 4'),
    ('gyro: rt_Commands[0:3]\ngyro_x: rt_p', 'map.yaml:2: gyro_x: is given twice'),
    ('gyro_x: rt_p + 1', "gyro_x: 'rt_p + 1' is not of the form NAME"),
    ('gyro_x: 1.2.3 * rt_p', "gyro_x: '1.2.3' is not a number"),
    ('gyro_x: [rt_p]', 'map.yaml:1: gyro_x: must be text'),
    ('- a', 'must hold names and values'), ('a: [', 'not valid YAML')])
def test_a_map_that_does_not_fit_is_named_by_line(flight, tmp_path, capsys, text, wanted):
    assert wanted in refused(tmp_path, capsys, scopes(flight), *mapping(tmp_path, text))


def test_a_map_that_is_not_there(flight, tmp_path, capsys):
    assert 'No such file' in refused(
        tmp_path, capsys, scopes(flight), '--map', str(tmp_path / 'none.yaml'))


def test_what_a_map_says_is_none_is_left_out(flight, tmp_path, capsys):
    bag, output = imported(tmp_path, capsys, scopes(flight), *mapping(
        tmp_path, 'pressure: none\nsonar: none\n'))
    assert 'barometer/pressure' not in read_bag(bag) and 'sonar/range' not in read_bag(bag)
    assert 'rt_pressure (4001, 1), rt_z_ultrasonic (4001, 1)' in output


@pytest.mark.long
def test_a_gyro_in_degrees_is_found_out_or_told(flight, tmp_path, capsys):
    degrees = scopes(flight, gyro_unit=math.degrees(1.0))
    bag, output = imported(tmp_path, capsys, degrees)
    assert 'gyro taken for deg/s' in output
    assert_flown_again(flight, bag)
    for other, unit in (('told', 'deg/s'), ('wrong', 'rad/s')):
        folder = tmp_path / other
        folder.mkdir()
        bag, _ = imported(folder, capsys, degrees, '--gyro-unit', unit)
        gyro = read_bag(bag)['imu/data_raw'].angular_velocity
        factor = 1.0 if other == 'told' else math.degrees(1.0)
        np.testing.assert_allclose(gyro[:, 0], factor * flight.imu[:, 0], rtol=1e-12)
    (tmp_path / 'between').mkdir()
    between = refused(tmp_path / 'between', capsys, scopes(flight, gyro_unit=8.0))
    assert 'is not told by its integral' in between and 'give --gyro-unit' in between


@pytest.mark.parametrize('change, wanted', [
    (lambda f: {axis: block(f[axis]['signals']['values'] / 9.81)
                for axis in ('rt_a_x', 'rt_a_y', 'rt_a_z')}, '9.81 * NAME'),
    (lambda f: {'rt_a_z': block(-f['rt_a_z']['signals']['values'])}, 'accel_z: -NAME'),
    (lambda f: {'rt_pressure': block(np.full(4001, np.nan))}, 'rt_pressure has values that are'),
    (lambda f: {'rt_pressure': block(np.ones(9), np.arange(8.0))}, 'a row for each of its 8'),
    (lambda f: {'rt_pressure': block(np.ones(9), -np.arange(9.0))}, 'the times of rt_pressure'),
    (lambda f: {'rt_pressure': block(np.ones(9), np.arange(9.0) % 4)}, 'increase after 3 s'),
    (lambda f: {'rt_pressure': block(np.array(['a'] * 9))}, 'rt_pressure holds what is no number'),
    (lambda f: {'rt_pressure': block(np.ones(9), 1000.0 + np.arange(9.0))},
     'rt_pressure (1000.000 to 1008.000 s) is on another clock than the inertial sensors'),
    (lambda f: {'rt_q': block(np.ones(9), 50.0 + np.arange(9.0))},
     'rt_q (50.000 to 58.000 s) is on another clock than rt_a_x (0.000 to 20.000 s)'),
    (lambda f: {'rt_pressure': block(0.01 * f['rt_pressure']['signals']['values'])},
     'rt_pressure: the pressure has a median of 1013, not of 30000 to 120000 Pa: is it in hPa?'),
    (lambda f: {'rt_z_ultrasonic': block(1e3 * f['rt_z_ultrasonic']['signals']['values'])},
     'ranges are beyond 40 m'),
    (lambda f: {'rt_estim': block(np.tile([0.0, 0.0, -1.0, 90.0, 20.0, 15.0] + [0.0] * 6,
                                          (4001, 1)))},
     'pitch in rt_estim is 20 at 0.000 s, and 4001 of 4001 values are beyond a quarter turn'),
    (lambda f: {'rt_estim': block(np.tile([0.0, 0.0, -1.0, 90.0, 0.0, -5.0] + [0.0] * 6,
                                          (4001, 1)))},
     'roll in rt_estim is -5 at 0.000 s, and 4001 of 4001 values are beyond half a turn'),
    (lambda f: {'rt_ref': block(np.tile([0.0, 0.0, -1.0, 0.0, -20.0, 0.0], (4001, 1)))},
     'ref_pitch in rt_ref is -20 at 0.000 s, and 4001 of 4001 values are beyond a quarter turn'),
    (lambda f: {'rt_motor_speeds': block(np.tile([1.0, 1.0, -1.0, 1.0], (4001, 1)))},
     'have not the signs + - + -')])
def test_what_is_malformed_or_in_other_units_is_one_line(flight, tmp_path, capsys, change, wanted):
    found = scopes(flight)
    assert wanted in refused(tmp_path, capsys, found | change(found))


def test_clocks_of_other_rates_are_brought_together_and_told(flight, tmp_path, capsys):
    found = scopes(flight)
    for name in ('rt_r', 'rt_v'):
        found[name] = block(found[name]['signals']['values'][::2], 2 * STEP * np.arange(2001))
    bag, output = imported(tmp_path, capsys, found)
    assert 'rt_r was brought to the times of rt_a_x' in output
    assert 'rt_v was brought to the times of rt_u' in output
    assert_flown_again(flight, bag)


@pytest.mark.parametrize('names, kept', [
    (('rt_p', 'rt_q', 'rt_r'), lambda t: t > 14.9),  # the last 5 s, as a limited buffer logs
    (('rt_a_y',), lambda t: t < 3.0),
    (('rt_p', 'rt_q', 'rt_r'), lambda t: (t < 6.0) | (t > 14.0))])
def test_rows_without_a_sample_of_every_part_are_left_out(flight, tmp_path, capsys, names, kept):
    found, times = scopes(flight), np.arange(4001) * STEP
    known = kept(times)
    for name in names:
        found[name] = block(found[name]['signals']['values'][known], times[known])
    bag, output = imported(tmp_path, capsys, found)
    got = read_bag(bag)
    stamps = got['imu/data_raw'].stamp * 1e-9
    # one step beside a sample is still known
    expected = np.convolve(known, np.ones(3), 'same') > 0.0
    np.testing.assert_allclose(stamps, times[expected])
    left = int((~expected).sum())
    assert (f'imu/data_raw: {left} of 4001 rows lie outside of the times of {", ".join(names)} '
            'or in their gaps: left out') in output
    inside = np.isin(np.rint(stamps / STEP), np.flatnonzero(known))
    np.testing.assert_array_equal(
        got['imu/data_raw'].angular_velocity[inside, 0], flight.imu[known, 0])
    assert got['sonar/range'].t[-1] > 19.0  # on the same clock, though the gyro ends early


def test_a_vector_whose_parts_share_no_time_is_refused(flight, tmp_path, capsys):
    found, times = scopes(flight), np.arange(4001) * STEP
    for name, part in (('rt_p', times < 9.0), ('rt_q', times > 10.0)):
        found[name] = block(found[name]['signals']['values'][part], times[part])
    error = refused(tmp_path, capsys, found)
    assert 'imu/data_raw: 4001 of 4001 rows lie outside of the times of rt_p, rt_q' in error


def test_flow_where_its_flag_was_not_logged_is_left_out(flight, tmp_path, capsys):
    found, times = scopes(flight), np.arange(4001) * STEP
    flag = (times > 0.5).astype(float)
    found['rt_w'] = block(flag[times < 8.0], times[times < 8.0])
    bag, _ = imported(tmp_path, capsys, found)
    flow = read_bag(bag)['optical_flow'].t
    assert len(flow) > 50 and flow.max() < 8.1


def test_the_ten_columns_of_the_class_template(flight, tmp_path, capsys):
    bag, output = imported(tmp_path, capsys, template(flight))
    assert_flown_again(flight, bag)
    got = read_bag(bag)
    assert {'sonar/range', 'barometer/pressure', 'optical_flow', 'battery', 'onboard/odom',
            'motor_pwm'} <= {topic.removeprefix('/mambo/') for topic in got.topics}
    assert got['battery'].voltage[0] == np.float32(3.9)
    assert got['battery'].percentage[0] == np.float32(0.81)
    assert 'flow of 1 taken for 20 rad/s' in output
    assert 'rt_optical[4] refuses the flow at' in output
    assert 'not used: rt_optical[0,3,5,6,7], rt_calib[6], rt_cmd (4001, 9)' in output
    assert not (got['optical_flow'].rate_x == 0.0).any()
    assert 'gyro_bias' in got.attachments['scenario.yaml']
    np.testing.assert_allclose(
        got['onboard/odom'].position[:, 2], -flight.truth[:, 2], atol=1e-12)


def test_six_columns_import_and_leave_the_height_open(flight, tmp_path, capsys):
    bag, _ = imported(tmp_path, capsys, template(flight, 6) | {'rt_optical': None})
    assert sorted(read_bag(bag).topics) == [
        '/mambo/imu/data_raw', '/mambo/motor_pwm', '/mambo/onboard/odom']


@pytest.mark.long
def test_a_vector_of_flow_with_its_flag(flight, tmp_path, capsys):
    found = scopes(flight)
    flow = np.column_stack([found.pop(f'rt_{name}')['signals']['values'] for name in 'uvw'])
    flow[1000:1200, 2] = 0.0
    bag, output = imported(tmp_path, capsys, found | {'rt_optical_flow': block(flow)})
    assert 'rt_optical_flow[2] refuses the flow at 200 of 4001 steps' in output
    times = read_bag(bag)['optical_flow'].t
    assert not ((times > 5.0) & (times < 6.0)).any() and (times < 5.0).sum() > 50


@pytest.mark.parametrize('name', ['rt_estimatedStates', 'estimatedStates_rt'])
def test_a_workspace_with_an_onboard_estimate_alone(flight, tmp_path, capsys, name):
    estim = template(flight)['rt_estim']
    bag, output = imported(tmp_path, capsys, {
        name: estim, 'Out_Pos_rt': block(flight.truth[:, :3]), 'Kp': 3.0})
    assert list(read_bag(bag).topics) == ['/mambo/onboard/odom']
    assert 'not used: Out_Pos_rt (4001, 3), Kp' in output


@pytest.mark.long
def test_few_angles_that_cannot_be_are_left_out_and_counted(flight, tmp_path, capsys):
    found = template(flight)
    found['rt_estim']['signals']['values'][100:103, 4] = 1.7
    found['rt_estim']['signals']['values'][103, 5] = 4.0
    bag, output = imported(tmp_path, capsys, found)
    assert 'onboard/odom: 4 of 4001 rows have a pitch beyond a quarter turn or a roll' in output
    stamps = np.rint(read_bag(bag)['onboard/odom'].stamp * 1e-9 / STEP)
    assert len(stamps) == 3997 and not np.isin([100, 101, 102, 103], stamps).any()


@pytest.mark.long
def test_the_estimate_of_scopes_is_one_where_it_has_a_pose(flight, tmp_path, capsys):
    found = scopes(flight)
    truth = flight.truth
    turn = Rotation.from_quat(truth[:, [7, 8, 9, 6]]).as_euler('ZYX')
    found |= {f'rt_{name}_drone': block(values) for name, values in zip(
        ('psi', 'theta', 'phi', 'x', 'y', 'z'), (*turn.T, *truth[:, :3].T))}
    bag, _ = imported(tmp_path, capsys, found)
    odometry = read_bag(bag)['onboard/odom']
    np.testing.assert_allclose(odometry.position[:, 0], truth[:, 0])
    assert np.isnan(odometry.velocity).all()
    again(bag)  # is compared with what is known of it


def test_a_scope_of_several_signals_and_matrices_of_simulink(flight, tmp_path, capsys):
    gyro, force, *_ = sensors(flight)
    t = np.arange(len(gyro)) * STEP
    entries = np.empty(2, object)
    entries[0] = {'values': gyro[:, 0], 'label': 'roll', 'blockName': ''}
    entries[1] = {'values': gyro[:, 1:], 'label': '', 'blockName': 'model/others'}
    found = {'Scope': {'time': t, 'signals': entries},
             'acc': block(np.moveaxis(force[:, :, None], 0, 2), t)}
    names = 'accel: acc\ngyro_x: Scope/roll\ngyro_y: Scope/others[0]\ngyro_z: Scope/others[1]\n'
    bag, _ = imported(tmp_path, capsys, found, *mapping(tmp_path, names))
    got = read_bag(bag)['imu/data_raw']
    np.testing.assert_array_equal(got.acceleration, force * [1.0, -1.0, -1.0])
    np.testing.assert_array_equal(got.angular_velocity, gyro * [1.0, -1.0, -1.0])


@pytest.mark.long
def test_two_imports_are_the_same_bytes(flight, tmp_path):
    source = save(tmp_path / 'log.mat', template(flight))
    for folder in ('a', 'b'):
        import_minidrone(source, tmp_path / folder / 'bag')
    a, b = ((tmp_path / folder / 'bag' / 'bag_0.mcap').read_bytes() for folder in ('a', 'b'))
    assert a == b


def test_a_log_cut_off_in_the_middle_is_one_line(flight, tmp_path, capsys):
    whole = save(tmp_path / 'whole.mat', scopes(flight)).read_bytes()
    for share in (0.2, 0.5, 0.8, 0.99):
        (tmp_path / 'cut.mat').write_bytes(whole[:int(share * len(whole))])
        assert main([str(tmp_path / 'cut.mat'), str(tmp_path / 'bag')]) == 2
        error = capsys.readouterr().err
        assert 'not a readable mat file' in error and error.count('\n') == 1


@pytest.mark.long
def test_a_small_file_of_large_variables_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '10')
    scipy.io.savemat(tmp_path / 'zeros.mat', {'rt_a_x': np.zeros(12 << 20)}, do_compression=True)
    content = (tmp_path / 'zeros.mat').read_bytes()
    assert len(content) < 200_000
    with pytest.raises(BagError, match='zeros.mat: not a readable mat file .*MAMBO_MAX_UNPACKED'):
        variables(tmp_path / 'zeros.mat', content)
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '400')
    assert len(variables(tmp_path / 'zeros.mat', content)['rt_a_x']) == 12 << 20
