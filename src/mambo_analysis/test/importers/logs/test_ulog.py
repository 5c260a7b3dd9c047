"""Logs of PX4 come back by message and field; they are written here as the format describes."""

import re
import struct
import sys

import flown
from mambo_analysis.importers import any_table
from mambo_analysis.importers.logs import ulog
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
import numpy as np
import pytest

MESSAGES = {
    'sensor_combined': ('float[3] gyro_rad', 'float[3] accelerometer_m_s2'),
    'actuator_motors': ('float[4] control',), 'battery_status': ('float voltage_v',),
    'vehicle_local_position': ('float x', 'float y', 'float z', 'float vx', 'float vy',
                               'float vz', 'float xy_valid', 'float z_valid', 'float v_xy_valid',
                               'float v_z_valid'),
    'vehicle_attitude': ('float[4] q',)}


def record(kind, payload):
    return struct.pack('<HB', len(payload), ord(kind)) + payload


def log(rows, formats=MESSAGES, in_order=True):
    """
    Return a log: the header, the formats, a subscription for each message, and its rows.

    ``rows``: {(message, number): (times in us (n,), values (n, k))}. They are written by their
    times, or one message after the other.
    """
    out = [b'ULog\x01\x12\x35\x01', struct.pack('<Q', 0), record('B', bytes(40))]
    for name, fields in formats.items():
        text = ';'.join(('uint64_t timestamp', *fields)) + ';'
        out.append(record('F', f'{name}:{text}'.encode()))
    for number, (name, multi) in enumerate(rows):
        out.append(record('A', struct.pack('<BH', multi, number) + name.encode()))
    data = [(time, number, values) for number, (times, table) in enumerate(rows.values())
            for time, values in zip(times.tolist(), table.tolist())]
    for time, number, values in sorted(data, key=lambda row: row[:2]) if in_order else data:
        out.append(record('D', struct.pack(f'<HQ{len(values)}f', number, time, *values)))
    return b''.join(out)


def written(path, rows, **options):
    path.write_bytes(log(rows, **options))
    return path


def flight_log(one):
    """Return the rows of a flight as PX4 has it: north east down, FRD, each at its own rate."""
    over = np.array([1.0, -1.0, -1.0])
    us = np.rint(one.t * 1e6).astype(np.int64) + 5_000_000
    x, y, z, w = one.attitude.T
    q = np.column_stack([w, x, -y, -z])
    place = np.column_stack([one.position * over, one.velocity * over, np.ones((len(us), 4))])
    return {('sensor_combined', 0): (us, np.column_stack([one.gyro * over, one.force * over])),
            ('actuator_motors', 0): (us, one.command[:, [1, 3, 0, 2]] / 65535.0),
            ('battery_status', 0): (us[::50], one.voltage[::50, None]),
            ('vehicle_local_position', 0): (us[::5], place[::5]),
            ('vehicle_attitude', 0): (us + 1000, q)}


LOG = {('sensor_combined', 0): (np.array([100, 200, 300]), np.arange(18.0).reshape(3, 6)),
       ('sensor_combined', 2): (np.array([150, 250]), np.full((2, 6), 7.0)),
       ('battery_status', 0): (np.array([90, 210]), np.array([[4.0], [3.5]]))}


@pytest.fixture(autouse=True)
def reader(request):
    if 'without_the_library' not in request.node.name:
        pytest.importorskip(
            'pyulog', reason='pyulog is not installed: requirements/logs.txt')


def test_fields_come_at_the_times_of_their_message(tmp_path):
    path = written(tmp_path / 'a.ulg', LOG)
    found, wrong = ulog.read(path, {
        'sensor_combined.timestamp': ['sensor_combined.gyro_rad[1]'],
        'sensor_combined#2.timestamp': ['sensor_combined#2.gyro_rad[0]']})
    assert not wrong
    np.testing.assert_array_equal(found['sensor_combined.timestamp'], [100, 200, 300])
    np.testing.assert_array_equal(found['sensor_combined.gyro_rad[1]'], [1.0, 7.0, 13.0])
    np.testing.assert_array_equal(found['sensor_combined#2.gyro_rad[0]'], [7.0, 7.0])


def test_fields_of_other_messages_have_their_nearest_sample(tmp_path):
    slow = {**LOG, ('battery_status', 0): (
        np.array([0, 100, 200, 2000]), np.array([[1.0], [2.0], [3.0], [4.0]]))}
    slow[('sensor_combined', 0)] = (np.array([49, 51, 260, 1000]), np.zeros((4, 6)))
    path = written(tmp_path / 'a.ulg', slow)
    found, _ = ulog.read(path, {'sensor_combined.timestamp': ['battery_status.voltage_v']})
    np.testing.assert_array_equal(
        found['battery_status.voltage_v'], [1.0, 2.0, 3.0, np.nan])  # 800 us from any


@pytest.mark.parametrize(('clocks', 'said'), [
    ({'sensor_combined.timestamp': ['baro.alt']},
     'no message baro, whose topic a copy of the mapping may leave out; it has battery_status, '
     'sensor_combined'),
    ({'sensor_combine.timestamp': []}, 'no message sensor_combine'),
    ({'sensor_combined#1.timestamp': []}, 'no message sensor_combined#1, its numbers are 0, 2'),
    ({'battery_status.timestamp': ['battery_status.volts']},
     "battery_status has no field 'volts'"),
    ({'t': []}, "column 't': wanted message.field"),
    ({'sensor_combined.timestamp': ['battery_status.voltage_v'],
      'battery_status.timestamp': ['battery_status.voltage_v']}, 'is wanted at two times')])
def test_what_is_not_there_is_named(tmp_path, clocks, said):
    path = written(tmp_path / 'a.ulg', LOG)
    with pytest.raises(ValueError, match=re.escape(said)):
        ulog.read(path, clocks)


def test_a_whole_flight_through_the_shipped_mapping(tmp_path):
    """Position, velocity and attitude in z up and FLU again, motors in their order."""
    one = flown.steered(seconds=6.0)
    source = written(tmp_path / 'flight.ulg', flight_log(one))
    assert any_table.main([str(source), str(tmp_path / 'bag'), '--map', 'px4']) == 0
    bag = read_bag(tmp_path / 'bag')
    assert np.abs(bag['imu/data_raw'].acceleration - one.force).max() < 1e-5
    assert np.abs(bag['imu/data_raw'].angular_velocity - one.gyro).max() < 1e-5
    assert np.abs(bag['motor_pwm'].pwm - one.command / 65535.0).max() < 1e-5
    assert np.abs(bag['battery'].voltage - one.voltage[::50]).max() < 1e-5
    odom = bag['onboard/odom']
    assert odom.t[-1] == pytest.approx(5.95, abs=0.011)
    assert np.abs(odom.position - one.position[::5][:len(odom)]).max() < 1e-5
    there = np.abs(np.sum(odom.orientation * one.attitude[::5][:len(odom)], axis=1))
    assert there.min() > 1.0 - 1e-6  # to a sign: the sample 1 ms after
    w = one.turn[::5].inv().apply(one.velocity[::5])[:len(odom)]
    assert np.abs(odom.velocity - w).max() < 1e-4


def test_a_topic_at_the_times_of_another_message_is_named_by_its_clock(tmp_path):
    rows = flight_log(flown.steered(seconds=6.0))
    times, q = rows[('vehicle_attitude', 0)]
    rows[('vehicle_attitude', 0)] = times[:100], q[:100]
    source = written(tmp_path / 'flight.ulg', rows)
    _, notes = any_table.import_table(source, tmp_path / 'bag', any_table.find_map('px4'))
    assert any(note.startswith('onboard/odom: ') and note.endswith(
        'rows have no sample of vehicle_attitude.q[0] near their time in '
        'vehicle_local_position.timestamp: is it the clock of this topic?') for note in notes)


def test_a_log_with_a_repeated_stamp_and_no_attitude_yet_is_read(tmp_path):
    rows = flight_log(flown.steered(seconds=6.0))
    rows[('vehicle_attitude', 0)][1][:12] = 0.0
    rows[('sensor_combined', 0)][0][40] = rows[('sensor_combined', 0)][0][39]
    source = written(tmp_path / 'flight.ulg', rows)
    _, notes = any_table.import_table(source, tmp_path / 'bag', any_table.find_map('px4'))
    assert any('imu/data_raw: 1 of ' in note and 'repeat the time' in note for note in notes)
    assert any('onboard/odom: 3 of ' in note and 'quaternion of zeros' in note for note in notes)


def test_rows_that_the_log_marks_as_not_valid_are_left_out(tmp_path):
    rows = flight_log(flown.steered(seconds=6.0))
    place = rows[('vehicle_local_position', 0)][1]
    place[30:70, 0] += 50.0
    place[30:70, 6] = 0.0   # xy_valid
    place[100:110, 9] = 0.0  # v_z_valid
    source = written(tmp_path / 'flight.ulg', rows)
    counts, notes = any_table.import_table(source, tmp_path / 'bag', any_table.find_map('px4'))
    assert counts['/mambo/onboard/odom'] == len(place) - 50
    assert (f'onboard/odom: 50 of {len(place)} rows are marked as not valid by '
            'vehicle_local_position.xy_valid, vehicle_local_position.v_z_valid: left out') in notes
    assert np.abs(read_bag(tmp_path / 'bag')['onboard/odom'].position).max() < 20.0
    place[:, 6] = 0.0
    written(source, rows)
    with pytest.raises(BagError, match='no row makes a message of onboard/odom .*not valid by '
                                       'vehicle_local_position.xy_valid'):
        any_table.import_table(source, tmp_path / 'none', any_table.find_map('px4'))


def test_an_attitude_whose_clock_starts_again_is_refused(tmp_path):
    rows = flight_log(flown.steered(seconds=6.0))
    rows[('vehicle_attitude', 0)][0][400:] -= 1_000_000
    source = tmp_path / 'flight.ulg'
    source.write_bytes(log(rows, in_order=False))
    with pytest.raises(BagError, match='the times of vehicle_attitude run backwards'):
        any_table.import_table(source, tmp_path / 'bag', any_table.find_map('px4'))


def test_a_log_that_is_cut_off_within_a_message_is_told(tmp_path):
    content = log(flight_log(flown.steered(seconds=6.0)))
    size = 3 + 2 + 8 + 4 * 4  # of the last message, an attitude
    for cut, said in ((0, False), (1, True), (size - 2, True), (size, False)):
        source = tmp_path / f'{cut}.ulg'
        source.write_bytes(content[:len(content) - cut])
        _, notes = any_table.import_table(
            source, tmp_path / f'bag {cut}', any_table.find_map('px4'))
        assert ('the log is cut off within a message: what came after it is missing'
                in notes) == said, cut


@pytest.mark.long
def test_a_log_that_is_cut_off_or_damaged_is_one_line_or_what_is_left(tmp_path, capsys):
    content = log(flight_log(flown.steered(seconds=2.0)))
    rng = np.random.default_rng(5)
    for i in range(12):
        spoilt = bytearray(content[:int(rng.integers(20, len(content)))])
        for at in rng.integers(0, len(spoilt), 20 * (i % 2)):
            spoilt[at] = int(rng.integers(256))
        source = tmp_path / f'{i}.ulg'
        source.write_bytes(bytes(spoilt))
        code = any_table.main([str(source), str(tmp_path / f'bag {i}'), '--map', 'px4'])
        error = capsys.readouterr().err
        assert code in (0, 2) and error.count('\n') == (code == 2), error
        assert 'Traceback' not in error and 'Error' not in error


def test_a_log_of_which_the_head_alone_is_left_is_one_line(tmp_path, capfd):
    source = tmp_path / 'head.ulg'
    source.write_bytes(log(flight_log(flown.steered(seconds=1.0)))[:100])
    assert any_table.main([str(source), str(tmp_path / 'bag'), '--map', 'px4']) == 2
    out, err = capfd.readouterr()
    assert not out and err.count('\n') == 1
    assert f'{source}: it holds no samples: it is cut off or damaged' in err


def test_a_part_that_is_damaged_is_told(tmp_path):
    content = bytearray(log(flight_log(flown.steered(seconds=8.0))))
    half = len(content) // 2
    for begin, said in ((half, False), (half + 4000, True)):
        content[half:begin] = bytes(begin - half)
        source = tmp_path / f'{begin}.ulg'
        source.write_bytes(content)
        _, notes = any_table.import_table(
            source, tmp_path / f'bag {begin}', any_table.shipped()['px4'])
        assert ('a part of the log is damaged: its messages are missing' in notes) == said


def test_numbers_of_a_message_and_its_field_are_told_apart():
    assert ulog.split('vehicle_attitude.q[3]') == ('vehicle_attitude', 0, 'q[3]')
    assert ulog.split('sensor_accel#12.x') == ('sensor_accel', 12, 'x')
    for wrong in ('', '.x', 'a.', 'a#.x', 'a#1234.x', 'a b.x', '9a.x'):
        with pytest.raises(ValueError, match='wanted message.field'):
            ulog.split(wrong)


def test_a_message_of_a_single_sample_is_near_to_nothing(tmp_path):
    alone = {**LOG, ('battery_status', 0): (np.array([200]), np.array([[4.0]]))}
    path = written(tmp_path / 'a.ulg', alone)
    found, _ = ulog.read(path, {'sensor_combined.timestamp': ['battery_status.voltage_v'],
                             'battery_status.timestamp': []})
    assert np.isnan(found['battery_status.voltage_v']).all()
    np.testing.assert_array_equal(found['battery_status.timestamp'], [200.0])


def test_what_is_no_log(tmp_path, capsys):
    source = tmp_path / 'a.ulg'
    source.write_text('t,x\n0,1\n')
    assert any_table.main([str(source), str(tmp_path / 'bag'), '--map', 'px4']) == 2
    assert f'{source}: it does not begin as a log of PX4' in capsys.readouterr().err


def test_without_the_library_there_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyulog', None)
    source = written(tmp_path / 'a.ulg', LOG)
    assert any_table.main([str(source), str(tmp_path / 'bag'), '--map', 'px4']) == 2
    error = capsys.readouterr().err
    assert 'need pyulog: pip install -r requirements/logs.txt' in error
    assert error.count('\n') == 1
