"""Tables of known motion come back as that motion, whatever unit, frame and clock they are in."""

from hypothesis import given, settings, strategies as st
from mambo_analysis.importers import any_table
from mambo_analysis.importers.any_table import import_table, main
from mambo_analysis.importers.table_map import ORDERS, UNITS
from mambo_bags.reader import read_bag
import numpy as np
import pandas
import pytest
from scipy.spatial.transform import Rotation

N = 50
TIMES = np.arange(N) / 100.0
POSITION = np.column_stack([0.3 * TIMES, 1.0 + 0.5 * TIMES, 0.8 - 0.2 * TIMES])
ATTITUDE = Rotation.from_euler('ZYX', np.column_stack([0.4 + TIMES, 0.1 + TIMES, -0.3 * TIMES]))
VELOCITY = np.tile([0.3, 0.5, -0.2], (N, 1))
RATES = np.column_stack([0.1 + TIMES, -0.2 * TIMES, 0.3 + 0.0 * TIMES])
"""In the frames of the bag: z up and body FLU."""
UP = {'z_up': np.eye(3), 'z_down': np.diag([1.0, -1.0, -1.0]),
      'y_up': np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])}
BODY = {'flu': UP['z_up'], 'frd': UP['z_down'], 'y_up': UP['y_up']}
MAP = """\
time: {{column: t, unit: {unit}}}
world: {world}
body: {body}
topics:
  optitrack/pose:
    position: {{columns: [x, y, z], unit: cm}}
    quaternion: {{columns: [qw, qx, qy, qz], order: wxyz}}
  onboard/odom:
    position: {{columns: [x, y, z], unit: cm}}
    euler: {{columns: [yaw, pitch, roll], unit: deg, order: ZYX}}
    velocity: [vx, vy, vz]
    angular_velocity: {{columns: [p, q, r], unit: deg/s}}
  imu/data_raw:
    angular_velocity: {{columns: [p, q, r], unit: deg/s}}
    acceleration: {{columns: [ax, ay, az], unit: g}}
"""
FLIPPED = MAP.partition('  onboard/odom')[0].replace('x, y, z], unit: cm', 'x, y, z]')
OWN_ATTITUDE = """\
  onboard/odom:
    position: [x, y, z]
    quaternion: {{columns: [ow, ox, oy, oz], order: wxyz}}
    velocity: [vx, vy, vz]
"""


def frame(world='z_up', body='flu', seconds=1.0):
    """Return the motion as somebody else would write it."""
    into, turned = UP[world].T, Rotation.from_matrix(UP[world].T @ ATTITUDE.as_matrix()
                                                     @ BODY[body])
    w = np.degrees(RATES @ BODY[body])
    a = (np.array([0.0, 0.0, 9.80665]) @ BODY[body]) / 9.80665
    q = turned.as_quat()
    angles = turned.as_euler('ZYX', degrees=True)
    columns = {'t': 1.77e9 / seconds + TIMES / seconds}
    columns |= dict(zip(('x', 'y', 'z'), (100.0 * POSITION @ into.T).T))
    columns |= dict(zip(('qx', 'qy', 'qz', 'qw'), q.T))
    columns |= dict(zip(('yaw', 'pitch', 'roll'), angles.T))
    columns |= dict(zip(('vx', 'vy', 'vz'), (VELOCITY @ into.T).T))
    columns |= dict(zip(('p', 'q', 'r'), w.T))
    columns |= {name: np.full(N, value) for name, value in zip(('ax', 'ay', 'az'), a)}
    return pandas.DataFrame(columns)


def files(tmp_path, data, world='z_up', body='flu', unit='s', text=MAP, suffix='.csv'):
    source, mapping = tmp_path / f'flight{suffix}', tmp_path / 'map.yaml'
    if suffix == '.csv':
        data.to_csv(source, index=False)
    else:
        data.to_parquet(source)
    mapping.write_text(text.format(world=world, body=body, unit=unit))
    return source, mapping


@pytest.mark.parametrize('world, body', [
    ('z_up', 'flu'), ('z_down', 'frd'), ('z_up', 'frd'), ('z_down', 'flu'), ('y_up', 'y_up')])
def test_frames(tmp_path, world, body):
    source, mapping = files(tmp_path, frame(world, body), world, body)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert set(counts.values()) == {N}
    assert all('throughout' in note for note in notes)  # axes without noise
    bag = read_bag(tmp_path / 'bag')
    for topic in ('optitrack/pose', 'onboard/odom'):
        found = bag[topic]
        assert np.allclose(found.position, POSITION, atol=1e-9)
        q = np.asarray(found.orientation)
        wrong = (Rotation.from_quat(q).inv() * ATTITUDE).magnitude()
        assert np.allclose(wrong, 0.0, atol=1e-7)
        assert np.abs(found.stamp - np.rint(TIMES * 1e9)).max() < 1000  # ns in 1.77e9 s
    odom = bag['onboard/odom']
    assert np.allclose(odom['twist.twist.linear'], ATTITUDE.inv().apply(VELOCITY), atol=1e-9)
    assert np.allclose(odom['twist.twist.angular'], RATES, atol=1e-9)
    assert np.allclose(bag['imu/data_raw'].angular_velocity, RATES, atol=1e-9)
    assert np.allclose(bag['imu/data_raw'].linear_acceleration, [0.0, 0.0, 9.80665], atol=1e-9)


def test_velocity_in_the_axes_of_the_body(tmp_path):
    text = MAP.replace('    velocity:', '    velocity_axes: body\n    velocity:')
    source, mapping = files(tmp_path, frame(body='frd'), body='frd', text=text)
    import_table(source, tmp_path / 'bag', mapping)
    found = read_bag(tmp_path / 'bag')['onboard/odom']['twist.twist.linear']
    assert np.allclose(found, VELOCITY * [1.0, -1.0, -1.0], atol=1e-12)


@pytest.mark.parametrize('unit, seconds', [('ms', 1e-3), ('us', 1e-6), ('ns', 1e-9)])
def test_units_of_time(tmp_path, unit, seconds):
    data = frame()
    data['t'] = np.rint((1.0e6 + TIMES) / seconds).astype(np.int64)
    source, mapping = files(tmp_path, data, unit=unit, suffix='.parquet')
    import_table(source, tmp_path / 'bag', mapping)
    assert (read_bag(tmp_path / 'bag')['optitrack/pose'].stamp == np.rint(TIMES * 1e9)).all()


def test_a_clock_of_its_own_held_values_and_missing_ones(tmp_path):
    text = MAP + ('  battery: {{voltage: {{columns: [v], unit: mV}}, only_changes: true, '
                  'time: {{offset: 0.005}}}}\n')
    data = frame()
    data['v'] = np.repeat(4100.0 - np.arange(N // 10), 10)
    data.loc[7, 'ax'] = np.nan
    source, mapping = files(tmp_path, data, text=text)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/battery'] == N // 10 and counts['/mambo/imu/data_raw'] == N - 1
    assert notes == ['imu/data_raw: 1 of 50 rows lack a value in ax']
    bag = read_bag(tmp_path / 'bag')
    assert bag.metadata['import']['only_changes'] == 'battery'
    battery = bag['battery']
    assert np.allclose(battery.voltage, 4.1 - 0.001 * np.arange(N // 10))
    assert abs(battery.stamp[1] - 105_000_000) < 1000


def test_impossible_poses_are_left_out(tmp_path):
    data = frame()
    data.loc[20:22, 'x'] += 300.0
    source, mapping = files(tmp_path, data)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/optitrack/pose'] == N - 3
    assert '3 impossible poses left out' in notes[0]


def flipped_flight(world, body):
    """Return rows of 12 s whose body is turned by a half turn in most of them, and which."""
    t = 0.01 * np.arange(1200)
    turn = Rotation.from_euler('ZYX', np.column_stack([
        0.5 * np.sin(0.7 * t), 0.2 * np.sin(2.1 * t), 0.2 * np.cos(1.7 * t)]))
    wrong = (t > 2.0) & (t < 5.0) | (t > 5.5) & (t < 9.0) | (t > 9.6)
    seen = turn * Rotation.from_euler('z', np.where(wrong, np.pi, 0.0)[:, None])
    into = Rotation.from_matrix(UP[world].T)
    rates = (turn[:-1].inv() * turn[1:]).as_rotvec() / 0.01
    columns = {'t': t[:-1], **dict.fromkeys(('ax', 'ay'), 0.0), 'az': BODY[body][2, 2]}
    for names, values in (
            (('x', 'y', 'z'), into.apply(np.column_stack([np.sin(t), np.cos(t), 1.0 + 0.0 * t]))),
            (('qx', 'qy', 'qz', 'qw'), (into * seen * Rotation.from_matrix(BODY[body])).as_quat()),
            (('ox', 'oy', 'oz', 'ow'), (into * turn * Rotation.from_matrix(BODY[body])).as_quat()),
            (('vx', 'vy', 'vz'), into.apply(np.column_stack([np.cos(t), -np.sin(t), 0.0 * t])))):
        columns |= dict(zip(names, values[:-1].T))
    columns |= dict(zip(('p', 'q', 'r'), np.degrees(rates @ BODY[body]).T))
    return pandas.DataFrame(columns), wrong[:-1]


@pytest.mark.parametrize('world, body', [('z_up', 'flu'), ('z_down', 'frd')])
@pytest.mark.parametrize('sensor', ['the gyro', 'the attitude of onboard/odom', ''])
def test_of_flipped_poses_those_are_kept_that_turn_as_a_sensor(tmp_path, world, body, sensor):
    data, wrong = flipped_flight(world, body)
    source, mapping = files(tmp_path, data, world, body, text=FLIPPED + {
        'the gyro': '  imu/data_raw:\n' + MAP.partition('imu/data_raw:\n')[2], '': ''}.get(
            sensor, OWN_ATTITUDE))
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    said, = (note for note in notes if 'symmetric' in note)
    kept = ~wrong if sensor else wrong
    assert counts['/mambo/optitrack/pose'] == kept.sum()
    np.testing.assert_array_equal(
        read_bag(tmp_path / 'bag')['optitrack/pose'].stamp, np.flatnonzero(kept) * 10_000_000)
    assert said.endswith(f'Those kept turn as {sensor} does' if sensor else 'without symmetry')
    assert not any('two takes' in note for note in notes)


def test_a_position_that_slips_is_told(tmp_path):
    data = frame()
    data.loc[25:, 'x'] += 10.0  # cm
    source, mapping = files(tmp_path, data)
    _, notes = import_table(source, tmp_path / 'bag', mapping)
    assert 'optitrack/pose: the position moves by 0.10' in ''.join(
        notes)


def test_a_position_that_rows_hold_is_told_with_what_helps(tmp_path):
    """Two rows of each pose; of the last one it is not known. The vehicle moves at 3 m/s."""
    data = frame()
    data[['x', 'y', 'z']] *= 5.0
    pose = ['x', 'y', 'z', 'qw', 'qx', 'qy', 'qz']
    data.loc[1::2, pose] = data.loc[:N - 2:2, pose].to_numpy()
    remedy = 'import it with only_changes: true for this topic in the mapping'
    for changes in (False, True):
        text = FLIPPED.replace('x, y, z]', 'x, y, z], unit: cm') + (
            '    only_changes: true\n' * changes)
        source, mapping = files(tmp_path, data, text=text)
        _, notes = import_table(source, tmp_path / f'bag{changes}', mapping)
        assert not any('slip' in note for note in notes)
        assert [note.split(': ', 1)[1] for note in notes if 'repeat the one before' in note] == (
            [] if changes else [
                '23 of 50 positions repeat the one before while the vehicle moves, as of a table '
                f'that is faster than the motion capture: {remedy}'])


def test_frozen_poses_are_left_out_and_those_on_both_sides_stay(tmp_path):
    data = frame()
    pose = ['x', 'y', 'z', 'qw', 'qx', 'qy', 'qz']
    data.loc[21:30, pose] = data.loc[20, pose].to_numpy()
    source, mapping = files(tmp_path, data)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/optitrack/pose'] == N - 10
    assert notes[0].startswith('optitrack/pose: 10 frozen poses left out, equal to the one before')
    stamps = read_bag(tmp_path / 'bag')['optitrack/pose'].stamp
    assert len(stamps) == N - 10 and np.diff(stamps).max() > 105_000_000  # where they were


def test_a_repeated_time_and_a_quaternion_of_zeros_are_left_out_and_counted(tmp_path):
    data = frame()
    data.loc[9, 't'] = data.loc[8, 't']
    data.loc[20:22, ['qw', 'qx', 'qy', 'qz']] = 0.0
    source, mapping = files(tmp_path, data)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/optitrack/pose'] == N - 4 and counts['/mambo/imu/data_raw'] == N - 1
    assert [note for note in notes if note.startswith('optitrack/pose')] == [
        'optitrack/pose: 1 of 50 rows repeat the time before in t: left out',
        'optitrack/pose: 3 of 50 rows have a quaternion of zeros, no attitude: left out']
    stamps = read_bag(tmp_path / 'bag')['imu/data_raw'].stamp
    assert (np.diff(stamps) > 0).all()


def test_a_column_that_repeats_its_times_often_is_no_clock(tmp_path, capsys):
    data = frame()
    data.loc[[9, 30], 't'] = data.loc[[8, 29], 't'].to_numpy()
    source, mapping = files(tmp_path, data)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert ('line 11: the time in column t does not increase (1770000000.08), and 2 of 50 rows '
            'repeat the one before: write times with more digits, or') in capsys.readouterr().err


@pytest.mark.parametrize('row, time, beside', [
    (0, 1770000009.0, 'before 1770000000.01 in line 2'),
    (4, 1770000000.0, 'after 1770000000.03 and before 1770000000.05 in line 6'),
    (4, 9e20, 'after 1770000000.03 and before 1770000000.05 in line 6'),
    (N - 2, 1770000000.4, 'after 1770000000.47 and before 1770000000.49 in line 50'),
    (N - 1, 1770000000.475, 'after 1770000000.48 in line 51')])
def test_a_row_out_of_order_is_left_out_and_told_with_its_time(tmp_path, row, time, beside):
    data = frame()
    data.loc[row, 't'] = time
    data.loc[row, 'x'] += 1.0  # not as the others
    source, mapping = files(tmp_path, data)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert set(counts.values()) == {N - 1}
    assert f't: 1 of 50 rows is out of order and left out: {time:.15g} {beside}' in notes
    bag, kept = read_bag(tmp_path / 'bag'), np.delete(np.arange(N), row)
    for topic in ('optitrack/pose', 'onboard/odom'):
        assert np.allclose(bag[topic].position, POSITION[kept], atol=1e-9)
        since = TIMES[kept] - TIMES[kept[0]]
        assert np.abs(bag[topic].stamp - np.rint(since * 1e9)).max() < 1000
    assert read_bag(tmp_path / 'bag').metadata['import']['time_zero'] == repr(
        float(data.t[kept[0]]))


def test_a_held_value_is_not_new_again_behind_a_row_out_of_order(tmp_path):
    text = MAP + ('  battery: {{voltage: [v], only_changes: true}}\n')
    data = frame()
    data['v'] = np.repeat([4.1, 4.0], N // 2)
    data.loc[40, ['t', 'v']] = data.loc[20, ['t', 'v']]
    source, mapping = files(tmp_path, data, text=text)
    assert import_table(source, tmp_path / 'bag', mapping)[0]['/mambo/battery'] == 2


@pytest.mark.parametrize('change, said', [
    (lambda t: np.concatenate([t[:30], t[:20]]),
     'line 32: the time in column t does not increase: 1770000000 after 1770000000.29; 20 of 50'),
    (lambda t: np.append(t[:-3], t[:3]),
     'line 49: the time in column t does not increase: 1770000000 after 1770000000.46; 3 of 50'),
    (lambda t: t + np.where(np.arange(N) < 3, 655.36, 0.0),
     'line 5: the time in column t does not increase: 1770000000.03 after 1770000655.38; 3 of 50'),
    (lambda t: t - np.where(np.arange(N) < 25, 0.0, 0.05),
     'line 27: the time in column t does not increase: 1770000000.2 after 1770000000.24; '),
    (lambda t: t[np.arange(N) ^ 1], 'sort the rows by time if they are only mixed up'),
], ids=['two recordings', 'the second short', 'a counter wraps', 'set back', 'mixed up'])
def test_a_clock_that_is_set_back_is_refused_with_both_times(tmp_path, capsys, change, said):
    data = frame()
    data['t'] = change(data.t.to_numpy())
    source, mapping = files(tmp_path, data)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()


def damage(tmp_path, change, capsys, **options):
    """Import what change makes of a table; return exit code and what is said."""
    source, mapping = files(tmp_path, frame(), **options)
    change(source)
    code = main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)])
    said = capsys.readouterr().err.strip()
    assert '\n' not in said and not (tmp_path / 'bag').exists()
    return code, said


@pytest.mark.parametrize('old, new, text', [
    ('t,x,', 'time,x,', "no column 't'"),
    ('pitch', 'pich', "no column 'pitch'; did you mean pich?"),
])
def test_missing_columns(tmp_path, capsys, old, new, text):
    code, said = damage(
        tmp_path, lambda file: file.write_text(file.read_text().replace(old, new, 1)), capsys)
    assert code == 2 and text in said


def set_cell(file, row, column, value):
    """Replace one cell of a CSV file."""
    data = pandas.read_csv(file, dtype=str)
    data.loc[row, column] = value
    data.to_csv(file, index=False)


@pytest.mark.parametrize('row, column, value, text', [
    (4, 'x', 'north', "line 6, column x: 'north' is not a number"),
    (4, 'x', 'inf', 'line 6, column x: inf is absurd'),
    (4, 't', '', 'line 6: no time in column t: write it there, or remove the row'),
    (4, 'qw', '7', 'line 6: the quaternion in qw, qx, qy, qz has the norm 7'),
])
def test_bad_cells(tmp_path, capsys, row, column, value, text):
    code, said = damage(tmp_path, lambda file: set_cell(file, row, column, value), capsys)
    assert code == 2 and text in said


@pytest.mark.parametrize('row, column, value, text', [
    (4, 't', '', 'line 11: no time in column t'),
    (4, 'qw', '7', 'line 11: the quaternion in qw, qx, qy, qz has the norm 7'),
])
def test_blank_lines_count_in_the_line_of_a_bad_cell(tmp_path, capsys, row, column, value, text):
    def change(file):
        set_cell(file, row, column, value)
        file.write_text(file.read_text().replace('\n', '\n\n'))
    code, said = damage(tmp_path, change, capsys)
    assert code == 2 and text in said


def test_rows_of_a_parquet_file_are_those_of_its_data(tmp_path, capsys):
    def change(file):
        data = frame()
        data.loc[4, 't'] = np.nan
        data.to_parquet(file)
    code, said = damage(tmp_path, change, capsys, suffix='.parquet')
    assert code == 2 and 'row 5 of the data: no time in column t' in said


@pytest.mark.parametrize('content', [b'', b'\x00' * 100, b't,x\n1,2,3,4\n', b'PAR1 broken PAR1'])
@pytest.mark.parametrize('suffix', ['.csv', '.parquet'])
def test_what_is_no_table(tmp_path, capsys, content, suffix):
    code, said = damage(tmp_path, lambda file: file.write_bytes(content), capsys, suffix=suffix)
    assert code == 2 and 'flight' in said


def test_a_unit_of_time_that_cannot_be(tmp_path, capsys):
    data = frame()
    data['t'] = 1.77e18 + TIMES * 1e12
    source, mapping = files(tmp_path, data)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'its unit is not as the mapping says' in capsys.readouterr().err


def test_names_of_mappings(capsys, tmp_path):
    assert any_table.find_map('nanobench') == any_table.shipped()['nanobench']
    source, _ = files(tmp_path, frame())
    assert main([str(source), str(tmp_path / 'bag'), '--map', 'nanobank']) == 2
    assert 'did you mean nanobench?' in capsys.readouterr().err


@pytest.mark.long
@settings(max_examples=12)  # each is a table written, read and imported
@given(seed=st.integers(0, 2**31), world=st.sampled_from(sorted(UP)),
       length=st.sampled_from(sorted(UNITS['length'])),
       speed=st.sampled_from(sorted(UNITS['speed'])), angle=st.sampled_from(['rad', 'deg']),
       rate=st.sampled_from(sorted(UNITS['rate'])), order=st.sampled_from(ORDERS['euler']))
def test_any_motion_comes_back_from_any_frame_unit_and_order_of_angles(
        tmp_path_factory, seed, world, length, speed, angle, rate, order):
    """Forty random poses, velocities and rates at a time, in one of all combinations."""
    folder, rng, n = tmp_path_factory.mktemp('table'), np.random.default_rng(seed), 40
    position, velocity = rng.uniform(-9.0, 9.0, (2, n, 3))
    attitude, rates = Rotation.random(n, rng), rng.uniform(-3.0, 3.0, (n, 3))
    body = {'z_up': 'flu', 'z_down': 'frd', 'y_up': 'y_up'}[world]
    turned = Rotation.from_matrix(UP[world].T @ attitude.as_matrix() @ BODY[body])
    values = np.hstack([
        np.arange(n)[:, None] * 0.01, position @ UP[world] / UNITS['length'][length],
        turned.as_euler(order) / UNITS['angle'][angle],
        velocity @ UP[world] / UNITS['speed'][speed], rates @ BODY[body] / UNITS['rate'][rate]])
    names = ['t', 'x', 'y', 'z', 'a', 'b', 'c', 'u', 'v', 'w', 'p', 'q', 'r']
    pandas.DataFrame(values, columns=names).to_csv(
        folder / 'a.csv', index=False, float_format='%.17g')
    (folder / 'map.yaml').write_text(
        f'time: {{column: t, unit: s}}\nworld: {world}\nbody: {body}\ntopics:\n'
        '  onboard/odom:\n'
        f'    position: {{columns: [x, y, z], unit: {length}}}\n'
        f'    euler: {{columns: [a, b, c], unit: {angle}, order: {order}}}\n'
        f'    velocity: {{columns: [u, v, w], unit: {speed}}}\n'
        f'    angular_velocity: {{columns: [p, q, r], unit: {rate}}}\n')
    import_table(folder / 'a.csv', folder / 'bag', folder / 'map.yaml')
    odom = read_bag(folder / 'bag')['onboard/odom']
    np.testing.assert_allclose(odom.position, position, atol=1e-9)
    q = Rotation.from_quat(np.asarray(odom.orientation))
    assert (q * attitude.inv()).magnitude().max() < 1e-6
    np.testing.assert_allclose(
        odom['twist.twist.linear'], attitude.inv().apply(velocity), atol=1e-6)
    np.testing.assert_allclose(odom['twist.twist.angular'], rates, atol=1e-9)


@pytest.mark.parametrize(('dimension', 'unit', 'value'), [
    ('time', 'us', 1e-6), ('length', 'mm', 1e-3), ('speed', 'cm/s', 1e-2),
    ('rate', 'deg/s', np.pi / 180.0), ('angle', 'deg', np.pi / 180.0),
    ('acceleration', 'mg', 9.80665e-3), ('pressure', 'mbar', 100.0), ('pressure', 'kPa', 1e3),
    ('voltage', 'mV', 1e-3), ('number', '%', 0.01)])
def test_a_unit_is_what_it_is_in_si(dimension, unit, value):
    assert UNITS[dimension][unit] == pytest.approx(value, rel=1e-15)
    assert next(iter(UNITS[dimension].values())) == 1.0  # the first is that of SI


SENSORS = """\
time: {{column: t, unit: {unit}}}
world: {world}
body: {body}
topics:
  sonar/range: {{range: {{columns: [range], unit: cm}}}}
  optical_flow: {{rate: {{columns: [fx, fy], unit: mrad/s}}}}
  barometer/pressure: {{pressure: {{columns: [hpa], unit: hPa}}}}
  motor_pwm: {{pwm: [m1, m2, m3, m4]}}
  onboard/reference:
    position: {{columns: [rx, ry, rz], unit: mm}}
    yaw: {{columns: [heading], unit: deg}}
"""


def sensors():
    """Return columns of the other sensors: numbers that no other unit or axis would give."""
    rows = np.arange(N)
    return pandas.DataFrame({
        't': TIMES, 'range': 100.0 + rows, 'fx': 200.0 + rows, 'fy': 300.0 + rows,
        'hpa': 1000.0 + rows, 'm1': 1.0 + rows, 'm2': 2.0 + rows, 'm3': 3.0 + rows,
        'm4': 4.0 + rows, 'rx': 1000.0 + rows, 'ry': 2000.0 + rows, 'rz': -3000.0 - rows,
        'heading': 30.0 + rows})


def test_other_sensors_in_their_units(tmp_path):
    source, mapping = files(tmp_path, sensors(), text=SENSORS)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert set(counts.values()) == {N}
    assert all('throughout' in note for note in notes)  # axes without noise
    bag, rows = read_bag(tmp_path / 'bag'), np.arange(N)
    assert np.allclose(bag['sonar/range'].range, 1.0 + 0.01 * rows)
    assert set(bag['sonar/range'].max_range.tolist()) == {10.0}
    assert np.allclose(bag['optical_flow'].rate_x, 0.2 + 0.001 * rows)
    assert np.allclose(bag['optical_flow'].rate_y, 0.3 + 0.001 * rows)
    assert set(bag['optical_flow'].quality.tolist()) == {255}
    assert np.allclose(bag['barometer/pressure'].pressure, 1e5 + 100.0 * rows)
    assert np.allclose(bag['motor_pwm'].pwm, rows[:, None] + [1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize('world, body, sign', [('z_up', 'flu', 1.0), ('z_down', 'frd', -1.0)])
def test_axes_of_flow_and_reference(tmp_path, world, body, sign):
    """Down instead of up turns y and z over, and with them the flow along y and the heading."""
    source, mapping = files(tmp_path, sensors(), world, body, text=SENSORS)
    import_table(source, tmp_path / 'bag', mapping)
    bag, rows = read_bag(tmp_path / 'bag'), np.arange(N)
    assert np.allclose(bag['optical_flow'].rate_x, 0.2 + 0.001 * rows)
    assert np.allclose(bag['optical_flow'].rate_y, sign * (0.3 + 0.001 * rows))
    reference = bag['onboard/reference']
    assert np.allclose(reference.position, np.column_stack([
        1.0 + 0.001 * rows, sign * (2.0 + 0.001 * rows), sign * (-3.0 - 0.001 * rows)]))
    turn = Rotation.from_quat(np.asarray(reference.orientation))
    assert np.allclose(turn.as_euler('ZYX', degrees=True)[:, 0], sign * (30.0 + rows))
    assert np.allclose(turn.as_euler('ZYX')[:, 1:], 0.0)


def test_a_reference_without_heading_is_upright(tmp_path):
    text = SENSORS.replace('    yaw: {{columns: [heading], unit: deg}}\n', '')
    source, mapping = files(tmp_path, sensors(), text=text)
    import_table(source, tmp_path / 'bag', mapping)
    found = read_bag(tmp_path / 'bag')['onboard/reference'].orientation
    assert (np.asarray(found) == [0.0, 0.0, 0.0, 1.0]).all()


def test_degrees_that_are_taken_for_radians_are_refused(tmp_path, capsys):
    text = MAP.replace('[yaw, pitch, roll], unit: deg,', '[yaw, pitch, roll],')
    source, mapping = files(tmp_path, frame(), text=text)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    error = capsys.readouterr().err
    assert 'line 2: the middle one of the Euler angles, column pitch, is 5.73 rad' in error
    assert not (tmp_path / 'bag').exists()


def test_a_flow_in_axes_with_y_up_is_refused(tmp_path, capsys):
    source, mapping = files(tmp_path, sensors(), 'y_up', 'y_up', text=SENSORS)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'optical_flow: is along x and y of a body with z up or down' in capsys.readouterr().err
    text = mapping.read_text().replace('optical_flow: {', 'optical_flow: {body: flu, ')
    mapping.write_text(text)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 0


@pytest.mark.parametrize('delimiter', [';', '\\t', '|'])
def test_delimiters(tmp_path, delimiter):
    data = sensors()
    source, mapping = files(tmp_path, data, text=f'delimiter: "{delimiter}"\n{SENSORS}')
    data.to_csv(source, sep=delimiter.replace('\\t', '\t'), index=False)
    counts, _ = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/motor_pwm'] == N


def test_where_it_came_from_is_in_the_bag(tmp_path):
    data = sensors().assign(spare=1.0, t=TIMES + 12.5)
    source, mapping = files(tmp_path, data, text=SENSORS)
    _, notes = import_table(source, tmp_path / 'bag', mapping)
    record = read_bag(tmp_path / 'bag').metadata['import']
    assert record['source_file'] == 'flight.csv' and record['mapping'] == 'map.yaml'
    assert record['time_zero'] == '12.5' and record['ignored'] == 'spare'
    assert notes == ['not used: spare']
    assert len(record['source_sha256']) == len(record['mapping_sha256']) == 64


def test_rows_before_the_first_time_are_counted(tmp_path):
    text = SENSORS.replace('[range], unit: cm}}}}', '[range], unit: cm}}, '
                                                   'time: {{offset: -0.035}}}}')
    source, mapping = files(tmp_path, sensors(), text=text)
    counts, notes = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/sonar/range'] == N - 4
    assert notes == ['sonar/range: 4 rows before the first time left out']
    assert read_bag(tmp_path / 'bag')['sonar/range'].stamp[0] == 5_000_000


def test_a_table_without_any_value_makes_no_bag(tmp_path, capsys):
    data = sensors()
    data.loc[:, data.columns != 't'] = np.nan
    source, mapping = files(tmp_path, data, text=SENSORS)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'no row has a value of any topic' in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('unit, factor, text', [
    ('ms', 10.0, '49 of 49 steps are faster than 2005 deg/s or 30 m/s: wrong times or units'),
    ('s', 1e3, 'column t of optitrack/pose: its samples are 10 s apart'),
    ('ms', 1e6, 'column t of optitrack/pose: its samples are 10 s apart')])
def test_times_in_another_unit_than_the_mapping_says_are_refused(
        tmp_path, capsys, unit, factor, text):
    data = frame()
    data['t'] = factor * TIMES
    data['x'] += 100.0 * np.sin(10.0 * TIMES)
    source, mapping = files(tmp_path, data, unit=unit)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    said = capsys.readouterr().err
    assert text in said and said.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_inertial_sensors_alone_with_seconds_read_as_milliseconds_are_refused(tmp_path, capsys):
    text = MAP[:MAP.index('  optitrack')] + MAP[MAP.index('  imu/data_raw'):]
    data = frame()
    data['t'] = TIMES
    source, mapping = files(tmp_path, data, unit='ms', text=text)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'column t of imu/data_raw: its samples are 1e-05 s apart' in capsys.readouterr().err


def test_millimetres_that_are_mapped_as_metres_are_refused(tmp_path, capsys):
    data = frame()
    data[['x', 'y', 'z']] *= 1e3
    source, mapping = files(tmp_path, data)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'optitrack/pose: 49 of 49 steps are faster' in capsys.readouterr().err


@pytest.mark.parametrize('old, new, change, text', [
    ('', '', lambda data: data.assign(z=data['z'] + 2e6),  # cm
     'optitrack/pose: a position is 2e+04 m from the origin'),
    ('[p, q, r], unit: deg/s', '[p, q, r]', lambda data: data.assign(p=40.0 * data['p']),
     'imu/data_raw: the gyro turns by up to 1352 rad/s, and its integral is a tilt of'),
    ('unit: g', 'unit: m/s^2', lambda data: data,
     'imu/data_raw: the accelerometer has a median of z of 1, not 9.8 m/s^2: is it in g? give '
     'its unit in the mapping')])
def test_a_position_a_rate_or_an_acceleration_of_another_unit_is_refused(
        tmp_path, capsys, old, new, change, text):
    source, mapping = files(tmp_path, change(frame()), text=MAP.replace(old, new))
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    said = capsys.readouterr().err
    assert text in said and said.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('old, new, change, text', [
    ('unit: cm', 'unit: m', lambda data: data, 'sonar/range: 50 of 50 ranges are beyond 40 m'),
    ('', '', lambda data: data.assign(range=-data['range']),
     'sonar/range: 50 of 50 ranges are negative, down to -1.49 m: turn their sign'),
    ('unit: hPa', 'unit: Pa', lambda data: data,
     'barometer/pressure: the pressure has a median of 1024, not of 30000 to 120000 Pa: is it in'),
    ('', '', lambda data: data.assign(m2=-data['m2']),
     'motor_pwm: 50 of 200 motor commands are outside of 0 to 65535, such as -2: give'),
    ('', '', lambda data: data.assign(m2=7e4), 'are outside of 0 to 65535, such as 7e+04'),
    ('  sonar', '  battery: {{voltage: [v]}}\n  sonar', lambda data: data.assign(v=3700.0),
     'battery: the battery has a median of 3700 V, not of 0 to 100: is it in mV? give it in V')])
def test_other_sensors_in_other_units_are_refused(tmp_path, capsys, old, new, change, text):
    source, mapping = files(tmp_path, change(sensors()), text=SENSORS.replace(old, new, 1))
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    said = capsys.readouterr().err
    assert text in said and said.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('columns, value, why', [
    (['qw', 'qx', 'qy', 'qz'], 0.0, '50 of 50 rows have a quaternion of zeros'),
    (['x'], np.nan, '50 of 50 rows lack a value in x')])
def test_a_topic_without_a_message_is_refused(tmp_path, capsys, columns, value, why):
    data = frame()
    data[columns] = value
    source, mapping = files(tmp_path, data)
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    said = capsys.readouterr().err
    assert f'no row makes a message of optitrack/pose ({why}' in said
    assert said.endswith('): mend its columns, or take it out of the mapping\n')
    assert said.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_a_target_that_exists_is_not_touched(tmp_path, capsys):
    source, mapping = files(tmp_path, sensors(), text=SENSORS)
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'mine').write_text('precious')
    assert main([str(source), str(tmp_path / 'bag'), '--map', str(mapping)]) == 2
    assert 'exists' in capsys.readouterr().err
    assert [file.name for file in (tmp_path / 'bag').iterdir()] == ['mine']


def test_a_ramp_of_the_commands_at_the_end_was_measured(tmp_path):
    rng = np.random.default_rng(3)
    data = frame()
    for motor in range(4):
        data[f'm{motor}'] = np.concatenate([
            rng.integers(300, 400, N - 25), 300 - 10 * np.arange(25)])
    text = MAP + '  motor_pwm:\n    pwm: [m0, m1, m2, m3]\n'
    source, mapping = files(tmp_path, data, text=text)
    counts, _ = import_table(source, tmp_path / 'bag', mapping)
    assert counts['/mambo/motor_pwm'] == N
    for name in ('p', 'q', 'r', 'ax', 'ay', 'az'):
        data[name] = np.concatenate([rng.standard_normal(N - 25), 0.1 * np.arange(25)])
        data[name] += data[name].iloc[0]
    source, mapping = files(tmp_path, data, text=text)
    counts, notes = import_table(source, tmp_path / 'continued', mapping)
    assert counts['/mambo/motor_pwm'] == counts['/mambo/imu/data_raw'] == N - 24
    assert any(note.startswith('motor_pwm: 24 rows left out, from 0.26 s to') for note in notes)


PWM = 'time: {column: t, unit: s}\ntopics:\n  motor_pwm: {pwm: [a, b, c, d]}\n'


def test_one_command_beyond_any_motor_is_left_out_and_counted(tmp_path):
    rows = [f'{0.01 * k:.2f},400,{1e9 if k == 30 else 410},390,{405 + k % 2}' for k in range(99)]
    (tmp_path / 'a.csv').write_text('\n'.join(['t,a,b,c,d', *rows]) + '\n')
    (tmp_path / 'm.yaml').write_text(PWM)
    counts, notes = import_table(tmp_path / 'a.csv', tmp_path / 'bag', tmp_path / 'm.yaml')
    assert counts['/mambo/motor_pwm'] == 98
    assert 'motor_pwm: 1 of 99 rows have a command outside of 0 to 65535: left out' in notes
    assert read_bag(tmp_path / 'bag')['motor_pwm'].pwm.max() == 410.0


@pytest.mark.parametrize(('end', 'rows', 'cut'), [
    ('\n', 99, False), ('', 99, False), (',405', 99, False), ('\n1,400,410,39', 99, True)])
def test_a_last_line_that_is_cut_off_is_left_out(tmp_path, end, rows, cut):
    """A number without the rest of its digits is another number."""
    lines = [f'{0.01 * k:.2f},400,410,390,{405 + k % 2}' for k in range(99)]
    text = '\n'.join(['t,a,b,c,d', *lines])
    (tmp_path / 'a.csv').write_text(text[:-4] + end if end == ',405' else text + end)
    (tmp_path / 'm.yaml').write_text(PWM)
    counts, notes = import_table(tmp_path / 'a.csv', tmp_path / 'bag', tmp_path / 'm.yaml')
    assert counts['/mambo/motor_pwm'] == rows
    assert ('the last line of the file is cut off: left out' in notes) == cut


@pytest.mark.parametrize('factor, said', [(1.0, []), (3.28084, ['changes 3.2'])])
def test_a_range_that_repeats_near_the_floor_is_no_other_unit(tmp_path, factor, said):
    """A sonar repeats 0.434 m below that, and a table has no limits of the range."""
    t = np.arange(0.0, 30.0, 0.05)
    height = 0.02 + np.clip(0.5 * np.minimum(t - 4.0, 26.0 - t), 0.0, 1.1)
    height += np.where(height > 1.1, 0.35 * np.sin(0.8 * t), 0.0)
    data = pandas.DataFrame({
        't': t, 'x': 0.1 * np.sin(t), 'y': 0.1 * np.cos(t), 'z': factor * height, 'qx': 0.0,
        'qy': 0.0, 'qz': 0.0, 'qw': 1.0, 'r': np.maximum(height, 0.434)})
    text = FLIPPED + '  sonar/range: {{range: [r]}}\n'
    source, mapping = files(tmp_path, data, text=text)
    lines = [note for note in import_table(source, tmp_path / 'bag', mapping)[1]
             if 'times as much as the range' in note]
    assert len(lines) == len(said) and all(x in y for x, y in zip(said, lines, strict=True))
