"""Doubts about imported bags: none about real flights, one for each part of a mapping changed."""

import json
from pathlib import Path

from mambo_analysis.importers import any_table, crazyflie, minidrone
from mambo_analysis.importers.checks import bag_doubts
from mambo_analysis.importers.common import Publisher
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
import numpy as np
import pandas
import pytest
from scipy.spatial.transform import Rotation

DATA = Path(__file__).resolve().parents[6] / 'shared' / 'data'
NANOBENCH = sorted((DATA / 'nanobench').glob('*.csv'))
CRAZYFLIE = sorted((DATA / 'crazyflie_optitrack').glob('*.json'))
ROLLING_SPIDER = sorted((DATA / 'rolling_spider_flights').glob('*.mat'))
ODD = {  # it lies on its side; its logging was interrupted, twice
    '1a_y_rest__5230543': [
        'imu/data_raw: turned by the attitude of onboard/odom, the accelerometer points 97 deg'],
    'crazyflie-client_lab09_lab09_square__b5682fa': [
        'motor_pwm: nothing from 80.49 to 83.20 s: was the logging interrupted?',
        'onboard/odom: nothing from 86.00 to 87.28 s: was the logging interrupted?']}
CIRCLE, HELIX = (
    DATA / 'nanobench' / f'{name}_rep1.csv' for name in ('B2_circle_medium', 'B5_helix_medium'))
MAPPING = any_table.shipped()['nanobench'].read_text()
needs_data = pytest.mark.skipif(
    not NANOBENCH, reason='recordings are not beside the repo (../shared/data)')


def stem(path):
    return path.stem


@needs_data
@pytest.mark.parametrize('path', NANOBENCH, ids=stem)
def test_nothing_is_said_about_flights_of_nanobench(path, tmp_path):
    any_table.import_table(path, tmp_path / 'bag', any_table.shipped()['nanobench'])
    assert not bag_doubts.doubts(read_bag(tmp_path / 'bag'))


@needs_data
@pytest.mark.long
@pytest.mark.parametrize('path', CRAZYFLIE + ROLLING_SPIDER, ids=stem)
def test_nothing_is_said_about_other_flights_but_two(path, tmp_path):
    command = crazyflie if path.suffix == '.json' else minidrone
    assert command.main([str(path), str(tmp_path / 'bag')]) == 0
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag'))
    wanted = ODD.get(path.stem, [])
    assert [line[:len(begin)] for line, begin in zip(found, wanted, strict=True)] == wanted


def said(tmp_path, capsys, path, *changes):
    """Return what an import says whose mapping was changed, by (text, instead)."""
    text = MAPPING
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / 'map.yaml').write_text(text)
    assert any_table.main([str(path), str(tmp_path / 'bag'), '--map',
                           str(tmp_path / 'map.yaml')]) == 0
    return capsys.readouterr().out


GYRO, ACCELERATION = 'imu_gyro_x, imu_gyro_y, imu_gyro_z', 'imu_acc_x, imu_acc_y, imu_acc_z'
VELOCITY = 'est_stateEstimate_vx, est_stateEstimate_vy, est_stateEstimate_vz'
ESTIMATE = 'est_stateEstimate_x, est_stateEstimate_y, est_stateEstimate_z'
TRACKED = 'position: [px, py, pz]'


@needs_data
@pytest.mark.parametrize('path', [
    CIRCLE, pytest.param(HELIX, marks=pytest.mark.long)], ids=stem)
@pytest.mark.parametrize('changes, line', [
    ([(f'[{ACCELERATION}]', f'[{GYRO}]')],
     'imu/data_raw: the accelerometer has a median length of '),
    ([(ACCELERATION, 'imu_acc_z, imu_acc_x, imu_acc_y')],
     'imu/data_raw: turned by the attitude of optitrack/pose, the accelerometer points '),
    ([(f'[{GYRO}]', f'{{columns: [{GYRO}], unit: deg/s}}')],
     'imu/data_raw and optitrack/pose: roll rate: the gyro turns by 0.0'),
    ([('optitrack/pose:', 'optitrack/pose:\n    time: {offset: 1000.0}')],
     'optitrack/pose (1000.0 to '),
    ([(TRACKED, 'position: {columns: [px, py, pz], unit: mm}')],
     'optitrack/pose: the positions stay within 0.00'),
    ([(TRACKED, 'position: [py, px, pz]')],
     'm/s^2) follow the mirror image of its tilts: check the signs of its axes'),
    ([(TRACKED, 'position: [py, px, pz]')],
     'optitrack/pose: the motion capture shows the mirror image of the path'),
    ([(ESTIMATE, 'est_stateEstimate_y, est_stateEstimate_x, est_stateEstimate_z')],
     'onboard/odom: x of the velocity shows the motion of y of the position'),
    ([(f'[{VELOCITY}]', f'{{columns: [{VELOCITY}], unit: mm/s}}')],
     'onboard/odom: the position moves '),
    ([('voltage: [pwr_pm_vbat]', 'voltage: {columns: [pwr_pm_vbat], unit: mV}')],
     'battery: it has a median of 0.003'),
    ([('[sp_ctrltarget_x, sp_ctrltarget_y, sp_ctrltarget_z]',
       '[t, sp_ctrltarget_y, sp_ctrltarget_z]')], 'onboard/reference: it is '),
])
def test_a_changed_mapping_is_told(tmp_path, capsys, path, changes, line):
    assert line in said(tmp_path, capsys, path, *changes)


G, A, V, Q = ([f'{begin}{x}' for x in 'xyz'] for begin in (
    'imu_gyro_', 'imu_acc_', 'est_stateEstimate_v', 'att_stateEstimate_q'))


POSE = ['qx', 'qy', 'qz', 'qw']


def frozen(table):
    table.loc[1500:1800, G + A] = table.loc[1500, G + A].to_numpy()


def rested(table):
    """The recording begins with 4 s of the same numbers at rest."""
    table.loc[:399, G + A] = table.loc[0, G + A].to_numpy()
    table.loc[:399, ['px', 'py', 'pz']] = table.loc[0, ['px', 'py', 'pz']].to_numpy()
    frozen(table)


def late(table):
    table[G + A] = table[G + A].shift(100).bfill()


def short(table):
    table.loc[1600:, G + A] = np.nan


def dead(table):
    table[G] = 0.0


def half(table):
    table[G] *= 0.5


def fast(table):
    table[V] *= 1.5


def inverted(table):
    table[Q] *= -1.0


def exchanged(table):
    table[['py', 'pz']] = table[['pz', 'py']].to_numpy()


def shrunk(table):
    table[['px', 'py', 'pz']] *= 0.6


def delayed(table):
    table[['px', 'py', 'pz']] = table[['px', 'py', 'pz']].shift(30).bfill()


def askew(table):
    turned = Rotation.from_quat(table[POSE]) * Rotation.from_euler('z', 20.0, degrees=True)
    table[POSE] = turned.as_quat()


@needs_data
@pytest.mark.parametrize('change, line', [
    (delayed, 'follow its tilts 0.'),
    (shrunk, 'times those of its tilts: check the unit of the positions, or their scale'),
    (frozen, 'imu/data_raw: it repeats one value from 15.00 to 18.00 s, while optitrack/pose mo'),
    (rested, 'imu/data_raw: it repeats one value from 15.00 to 18.00 s, while optitrack/pose mo'),
    (late, 'imu/data_raw and optitrack/pose: the attitude is 1.00 s early against the gyro'),
    (short, 'imu/data_raw: covers 0.00 to 15.99 s, and the recording 0.00 to 26.7'),
    (dead, 'imu/data_raw: the gyro shows 0 along x throughout: that axis is dead'),
    (half, 'imu/data_raw and optitrack/pose: roll rate: the gyro turns by 0.1'),
    (fast, 'onboard/odom: x of the velocity is 1.32 times what x of the position changes by'),
    (inverted, 'imu/data_raw and onboard/odom: the gyro shows roll, pitch, yaw as -roll, -pitch'),
    (askew, 'imu/data_raw and optitrack/pose: the tracked body is turned by '),
    (exchanged, 'optitrack/pose: the height of onboard/odom follows y of the motion capture')])
def test_columns_that_contradict_others_are_told(tmp_path, capsys, change, line):
    table = pandas.read_csv(CIRCLE.with_name('B2_circle_fast_rep1.csv'))
    change(table)
    table.to_csv(tmp_path / 'flight.csv', index=False)
    assert line in said(tmp_path, capsys, tmp_path / 'flight.csv')


@needs_data
def test_swapped_rates_are_told_where_the_flight_turns_enough(tmp_path, capsys):
    line = 'imu/data_raw and optitrack/pose: '
    assert line in said(
        tmp_path, capsys, HELIX, (GYRO, 'imu_gyro_y, imu_gyro_x, imu_gyro_z'))


@needs_data
def test_a_flow_of_the_wrong_sign_is_told(tmp_path):
    log = json.loads(next(path for path in CRAZYFLIE if 'lab02' in path.stem).read_text())
    name = next(name for name in log['drone'] if name.endswith('.n_x'))
    log['drone'][name]['data'] = [-value for value in log['drone'][name]['data']]
    (tmp_path / 'log.json').write_text(json.dumps(log))
    assert crazyflie.main([str(tmp_path / 'log.json'), str(tmp_path / 'bag')]) == 0
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag'))
    assert [line[:48] for line in found] == ['optical_flow: rate_x shows the motion along -x (']


def poses_and(path, name, make, jump=0):
    """Write 20 s of a climb and a turn, and of another topic; return the doubts about both."""
    with BagWriter(path) as writer:
        out = Publisher(writer, {'optitrack/pose': any_table.TYPES['optitrack/pose'],
                                 name: any_table.TYPES[name]})
        for k in range(2000):
            t = 0.01 * k
            stamp, height = 10_000_000 * k + (jump if k > 999 else 0), 1.0 + np.sin(0.3 * t)
            pose = out.pose((0.3 * np.sin(t), 0.3 * np.cos(t), height),
                            (0.0, 0.0, np.sin(t), np.cos(t)))
            out.publish('optitrack/pose', stamp, 'map', pose=pose)
            out.publish(name, stamp, 'base_link', **make(out, height, pose))
    return bag_doubts.doubts(read_bag(path, namespace='/mambo'))


@pytest.mark.parametrize('shown, said', [
    (lambda height: height, ''),
    (lambda height: max(height, 1.9), ''),                # its floor
    (lambda height: min(height, 0.5), ''),                # its reach
    (lambda height: 0.001 * height, 'sonar/range: the ranges stay within 0.00')])
def test_floor_and_reach_of_a_range_say_nothing(tmp_path, shown, said):
    found = poses_and(tmp_path / 'bag', 'sonar/range', lambda out, height, pose: {
        'min_range': 0.0, 'max_range': 10.0, 'range': shown(height)})
    assert [line[:len(said)] for line in found] == [said] * bool(said)


@pytest.mark.parametrize('factor, late, said', [
    (1.0, 0.0, ''), (1.0, 0.1, ''),
    (0.5, 0.0, 'the height of onboard/odom changes 2 times as much as the range: one of them is'),
    (1.0, 0.2, 'it is 0.20 s late against the height of onboard/odom: check the clock of both'),
    (1.0, 0.5, 'it is 0.50 s late against the height of onboard/odom: check the clock of both')])
def test_a_range_is_compared_with_the_height_that_the_drone_estimates(
        tmp_path, factor, late, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {name: any_table.TYPES[name] for name in (
            'onboard/odom', 'sonar/range')})
        for k in range(2000):
            def height(t):
                return 1.5 + 0.5 * np.sin(0.9 * t) + 0.4 * np.sin(2.3 * t + 1.0)
            t = 0.01 * k
            turn = Rotation.from_euler('x', 0.1 * np.sin(t)).as_quat()
            out.publish('onboard/odom', 10_000_000 * k, 'odom', **out.odometry(
                out.pose((0.5 * np.sin(t), 0.0, height(t)), turn), (0.0, 0.0, 0.0),
                (0.0, 0.0, 0.0)))
            if k % 4 == 0:
                out.publish('sonar/range', 10_000_000 * k, 'sonar', min_range=0.1, max_range=9.0,
                            range=factor * height(t - late))
    found = [line for line in bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
             if line.startswith('sonar/range')]
    assert len(found) == bool(said) and said in ''.join(found)


@pytest.mark.parametrize(('height', 'from_floor', 'told'), [
    (lambda t: -min(t, 1.0), True, True),
    (lambda t: -min(t, 1.0), False, False),  # whose zero may be anywhere
    (lambda t: min(t, 1.0), True, False),
    (lambda t: -1.3 if t > 1.0 else 0.2, True, False),  # it has diverged
    (lambda t: -0.1, True, False)])
def test_a_height_below_the_floor_throughout_is_told(tmp_path, height, from_floor, told):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'onboard/odom': any_table.TYPES['onboard/odom']})
        for k in range(60):
            out.publish('onboard/odom', 200_000_000 * k, 'odom', **out.odometry(out.pose(
                (0.0, 0.0, height(0.2 * k)), (0.0, 0.0, 0.0, 1.0)), [np.nan] * 3, [np.nan] * 3))
    found = [line for line in bag_doubts.imported(tmp_path / 'bag', from_floor)
             if 'its height is negative throughout, down to -1.00 m' in line]
    assert len(found) == told


@pytest.mark.parametrize('sign, said', [(-1.0, False), (1.0, True)])
def test_a_pressure_that_rises_with_the_height_is_told(tmp_path, sign, said):
    found = poses_and(tmp_path / 'bag', 'barometer/pressure', lambda out, height, pose: {
        'fluid_pressure': 1e5 + 11.9 * sign * height})
    assert found == ['barometer/pressure: the pressure rises with the height of optitrack/pose '
                     '(correlation 1.00): check its sign and column'] * said


@pytest.mark.parametrize(('sign', 'noise', 'told'), [
    (1.0, 0.0, False), (-1.0, 0.0, True), (-1.0, 0.3, True), (-1.0, 3.0, False)])
def test_an_own_height_that_falls_where_the_ranges_rise_is_told_alone(
        tmp_path, sign, noise, told):
    rng = np.random.default_rng(0)
    with BagWriter(tmp_path / 'bag') as writer:
        names = ('onboard/odom', 'sonar/range', 'barometer/pressure')
        out = Publisher(writer, {name: any_table.TYPES[name] for name in names})
        for k in range(1000):
            height = 1.0 + 0.5 * np.sin(0.01 * k)
            own = (0.0, 0.0, sign * height + noise * rng.normal())
            out.publish('onboard/odom', 10**7 * k, 'odom', **out.odometry(
                out.pose(own, (0.0, 0.0, 0.0, 1.0)), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            out.publish('sonar/range', 10**7 * k, 'base_link', min_range=0.0, max_range=10.0,
                        range=height)
            out.publish('barometer/pressure', 10**7 * k, 'base_link',
                        fluid_pressure=1e5 - 11.9 * height)
    found = [line for line in bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
             if 'falls where' in line or 'pressure' in line]
    assert len(found) == told and all(line.startswith(
        'onboard/odom: its height falls where the ranges rise (correlation -') for line in found)


def _paused(k, state):
    return None if 800 <= k < 1000 else state


def _reset(k, state):
    return (state[0] + 3.0 * (k > 900), state[1])


def _stood(k, state):
    return (0.3, state[1]) if 700 <= k < 1300 else state


@pytest.mark.parametrize('change, said', [
    (lambda k, state: state, ''),
    (_paused, 'onboard/odom: nothing from 7.99 to 10.00 s: was the logging interrupted?'),
    (_reset, 'onboard/odom: the position leaps by 3.00 m at t = 9.01 s and stays there: was the '),
    (_stood, 'onboard/odom: the position stands from 7.00 to 12.99 s while its velocity does')])
def test_an_estimate_that_pauses_leaps_or_stands_is_told(tmp_path, change, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'onboard/odom': any_table.TYPES['onboard/odom']})
        for k in range(2000):
            t = 0.01 * k
            if (state := change(k, (np.sin(t), np.cos(t)))) is None:
                continue
            pose = out.pose((state[0], 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
            out.publish('onboard/odom', 10_000_000 * k, 'odom', **out.odometry(
                pose, (state[1], 0.0, 0.0), (0.0, 0.0, 0.0)))
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
    assert any(line.startswith(said) for line in found) if said else not found


def test_a_tracked_position_that_slips_is_told(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'optitrack/pose': any_table.TYPES['optitrack/pose']})
        for k in range(300):
            pose = out.pose((0.01 * k, 0.0, 1.0 + (0.04 if k > 199 else 0.0)), (0, 0, 0, 1))
            out.publish('optitrack/pose', 10_000_000 * k, 'map', pose=pose)
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo')) == [
        'optitrack/pose: the position moves by 0.040 m from one frame to the next at t = 2.00 s '
        'and stays there: did a marker slip, was the tracker set anew, or did it repeat its last '
        'pose before? Cut the recording there']


def test_poses_that_a_driver_sends_twice_are_told_and_are_no_slip(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'optitrack/pose': any_table.TYPES['optitrack/pose']})
        for k in range(300):
            pose = out.pose((0.02 * (k // 2 * 2), 0.0, 1.0), (0, 0, 0, 1))
            out.publish('optitrack/pose', 10_000_000 * k, 'map', pose=pose)
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo')) == [
        'optitrack/pose: 148 of 300 positions repeat the one before while the vehicle moves, as '
        'of a table that is faster than the motion capture: record each of its poses once']


def test_a_jump_of_the_clock_is_told_and_costs_no_memory(tmp_path):
    found = poses_and(tmp_path / 'bag', 'onboard/odom', lambda out, height, pose: out.odometry(
        pose, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), jump=900_000_000 * 10**9)
    assert sum('times jump by 9e+08 s after 9.99 s' in line for line in found) == 2


@pytest.mark.parametrize('roll, factor, said', [
    (0.0, 1.0, ''), (0.45, 1.0, ''),
    (0.0, 57.3, 'imu/data_raw and onboard/odom: the gyro shows the turning 57.')])
def test_a_gyro_in_another_unit_is_told_and_a_vehicle_may_lean(tmp_path, roll, factor, said):
    t = 0.01 * np.arange(2000)
    turn = Rotation.from_euler('xyz', np.column_stack([
        roll + 0.2 * np.sin(2.0 * t), 0.2 * np.sin(3.0 * t), 0.3 * np.sin(1.3 * t)]))
    rates = (turn[:-1].inv() * turn[1:]).as_rotvec() / 0.01
    force = turn.inv().apply([0.0, 0.0, 9.81])
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {
            name: any_table.TYPES[name] for name in ('imu/data_raw', 'onboard/odom')})
        for k, q in enumerate(turn.as_quat()[:-1]):
            out.publish('imu/data_raw', 10_000_000 * k, 'base_link', **out.imu(
                factor * rates[k], force[k]))
            out.publish('onboard/odom', 10_000_000 * k, 'odom', **out.odometry(
                out.pose((np.sin(t[k]), 0.0, 1.0), q), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
    assert [line[:len(said)] for line in found if 'onboard/odom: ' not in line[:15]] == (
        [said] * bool(said))


def test_a_topic_of_one_message_is_told(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm'})
        out.publish('motor_pwm', 0, '', pwm=np.array([1.0, 2.0, 3.0, 4.0]))
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag')) == [
        'motor_pwm: it has one message: nothing can be seen of a motion']


def test_topics_that_name_no_drone_are_no_obstacle(tmp_path):
    (tmp_path / 'goal.csv').write_text('t,x,y,z,v\n' + ''.join(
        f'{0.1 * k},{0.1 * k},0,1,3.7\n' for k in range(40)))
    (tmp_path / 'map.yaml').write_text(
        'time: {column: t, unit: s}\ntopics:\n  onboard/reference: {position: [x, y, z]}\n'
        '  battery: {voltage: [v]}\n')
    counts, notes = any_table.import_table(
        tmp_path / 'goal.csv', tmp_path / 'bag', tmp_path / 'map.yaml')
    assert set(counts.values()) == {40} and not notes


@pytest.mark.parametrize(('change', 'said'), [
    (lambda k, gyro, force: (gyro, force), ''),
    (lambda k, gyro, force: ((0.0,) * 3 if 800 < k < 1100 else gyro, force),
     'imu/data_raw: its gyro repeats one value from 8.01 to 10.99 s, while optitrack/pose moves'),
    (lambda k, gyro, force: (gyro, (0.1, 0.2, 9.8) if 800 < k < 1100 else force),
     'imu/data_raw: its accelerometer repeats one value from 8.01 to 10.99 s'),
    (lambda k, gyro, force: ((0.0,) * 3, (0.1, 0.2, 9.8)) if 800 < k < 1100 else (gyro, force),
     'imu/data_raw: it repeats one value from 8.01 to 10.99 s')])
def test_a_gyro_or_an_accelerometer_that_stops_is_told(tmp_path, change, said):
    rng = np.random.default_rng(0)

    def make(out, height, pose):
        make.k += 1
        gyro, force = change(make.k - 1, *(
            (np.array(x) + 0.01 * rng.standard_normal(3)).tolist()
            for x in ((0.0, 0.0, 2.0), (0.0, 0.0, 9.81))))
        return out.imu(gyro, force)
    make.k = 0
    found = [line for line in poses_and(tmp_path / 'bag', 'imu/data_raw', make)
             if 'repeats' in line]
    assert [line[:len(said)] for line in found] == [said] * bool(said)


@pytest.mark.parametrize(('z', 'told'), [(9.81, False), (-9.81, True)])
def test_an_accelerometer_of_the_wrong_sign_is_told_without_an_attitude(tmp_path, z, told):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'imu/data_raw': any_table.TYPES['imu/data_raw']})
        rng = np.random.default_rng(0)
        for k in range(300):
            noise = 0.01 * rng.standard_normal((2, 3))
            out.publish('imu/data_raw', 10_000_000 * k, 'base_link', **out.imu(
                noise[0].tolist(), (noise[1] + [0.0, 0.0, z]).tolist()))
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
    assert any('check its sign and the axes of the body' in line for line in found) == told
    assert len(found) == told
