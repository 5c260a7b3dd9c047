"""Takes in the layouts of real exports, made here with known poses, and what is no take."""

import hashlib
from pathlib import Path

from hypothesis import given, settings, strategies as st
from mambo_analysis.importers import motive
from mambo_analysis.importers.common import Source
from mambo_analysis.importers.motive import import_motive, main, poses, read_take, Take
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

N, RATE = 60, 120.0


def truth():
    """Return times, positions (n, 3) m and attitudes, y up as in Motive: a climbing turn."""
    t = np.arange(N) / RATE
    position = np.column_stack([0.3 * t, 1.0 + 0.5 * t, -0.2 * t])
    return t, position, Rotation.from_euler('YZ', np.column_stack([0.4 + t, 0.1 + 0.2 * t]))


def cells(*values):
    return [f'{value:.6f}' for value in values]


def take(path, version='1.23', order='Quaternion', unit='Meters', scale=1.0, lost=(), bodies=1,
         markers=True, decimals=6, code=False, change=lambda lines: lines, **about):
    """
    Write a take as Motive does.

    1.21 has no words before the labels and calls the time column Time; 1.25 has a line with
    parents; 1.24 may have a column of time codes without type and name.
    """
    t, position, attitude = truth()
    turn = attitude.as_quat() if order == 'Quaternion' else np.degrees(attitude.as_euler(order))
    if order != 'Quaternion':  # columns are X Y Z whatever the order of the turns
        turn = turn[:, [order.index(axis) for axis in 'XYZ']]
    keys = {'Format Version': version, 'Take Name': 'Take 2016-01-05 03.49.50 PM',
            'Take Notes': '', 'Capture Frame Rate': f'{RATE:.6f}',
            'Export Frame Rate': f'{RATE:.6f}',
            'Capture Start Time': '2023-03-29 06.23.40.520 下午', 'Total Frames in Take': N,
            'Total Exported Frames': N, 'Rotation Type': order, 'Length Units': unit,
            'Coordinate Space': 'Global'} | about
    words = ['', '', ''] if version < '1.22' else ['Type', 'Name', 'ID']
    rows = [['', word] for word in words]
    rows += [['', 'Parent']] if version >= '1.25' else []
    rows += [['', ''], ['Frame', 'Time' if version < '1.22' else 'Time (Seconds)']]

    def column(kind, name, what, axis):
        labels = [kind, name, '"CF51"' if version < '1.22' else 'CF51']
        for row, label in zip(rows, labels + ([''] if version >= '1.25' else []) + [what, axis]):
            row.append(label)

    if code:
        column('', '', '', 'TimeCode')
    axes = 'XYZW' if order == 'Quaternion' else 'XYZ'
    for body in range(bodies):
        name = f'Rigid Body {body + 1}'
        for axis in axes:
            column('Rigid Body', name, 'Rotation', axis)
        for axis in 'XYZ':
            column('Rigid Body', name, 'Position', axis)
        if markers:
            column('Rigid Body', name, 'Mean Marker Error', '')
            for axis in 'XYZ':
                column('Rigid Body Marker', f'{name}:Marker1', 'Position', axis)
    for i in range(N):
        row = [str(i), f'{t[i]:.{decimals}f}'] + (['15:26:46:12.02'] if code else [])
        for body in range(bodies):
            pose = cells(*turn[i], *(scale * (position[i] + body)))
            row += [''] * len(pose) if i in lost else pose
            row += cells(0.0001, 9.0, 9.0, 9.0) if markers else []
        rows.append(row)
    first = ','.join(f'{key},{value}' for key, value in keys.items())
    lines = [first, '', *(','.join(row) for row in rows)]
    path.write_text('\r\n'.join(change(lines)) + '\r\n', encoding='utf-8')
    return path


def expected():
    """Return positions and attitudes with z up: both turned a quarter about x."""
    _, position, attitude = truth()
    quarter = Rotation.from_matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    return (np.column_stack([position[:, 0], -position[:, 2], position[:, 1]]),
            quarter * attitude * quarter.inv())


def check(bag, tolerance=1e-5):
    poses, (position, attitude) = bag['optitrack/pose'], expected()
    np.testing.assert_allclose(poses.position, position, atol=tolerance)
    assert (Rotation.from_quat(poses.orientation) * attitude.inv()).magnitude().max() < 1e-5
    assert set(poses['header.frame_id']) == {'map'}


@pytest.mark.parametrize('options', [
    {'version': '1.2'}, {'version': '1.21'}, {'version': '1.22', 'markers': False},
    {'version': '1.23'}, {'version': '1.24', 'code': True}, {'version': '1.25'},
    {'unit': 'Millimeters', 'scale': 1000.0}, {'unit': 'Centimeters', 'scale': 100.0},
    {'order': 'XYZ'}, {'order': 'YXZ'}, {'order': 'ZYX'}], ids=str)
def test_every_layout_gives_the_same_poses(tmp_path, options):
    import_motive(take(tmp_path / 'take.csv', **options), tmp_path / 'bag')
    check(read_bag(tmp_path / 'bag'))


def test_a_climb_in_motive_is_a_climb_here_and_a_turn_to_the_left_stays_one(tmp_path):
    import_motive(take(tmp_path / 'take.csv'), tmp_path / 'bag')
    poses = read_bag(tmp_path / 'bag')['optitrack/pose']
    assert poses.position[0].tolist() == pytest.approx([0.0, 0.0, 1.0])
    assert poses.position[-1, 2] > poses.position[0, 2]
    yaw = Rotation.from_quat(poses.orientation).as_euler('ZYX')[:, 0]
    assert yaw[0] == pytest.approx(0.4, abs=1e-4) and yaw[-1] > yaw[0]  # counter-clockwise


def test_z_up_is_copied_and_the_nose_turned(tmp_path):
    _, position, attitude = truth()
    source = take(tmp_path / 'take.csv')
    assert main([str(source), str(tmp_path / 'z'), '--up', 'z', '--nose', '90']) == 0
    poses = read_bag(tmp_path / 'z')['optitrack/pose']
    np.testing.assert_allclose(poses.position, position, atol=1e-6)
    nose = Rotation.from_quat(poses.orientation).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(nose, attitude.apply([0.0, 1.0, 0.0]), atol=1e-5)


def test_stamps_are_exact_where_the_column_is_rounded(tmp_path):
    import_motive(take(tmp_path / 'take.csv', decimals=3), tmp_path / 'bag')
    stamps = read_bag(tmp_path / 'bag')['optitrack/pose'].stamp
    np.testing.assert_array_equal(stamps, np.rint(np.arange(N) * 1e9 / RATE))
    other = take(tmp_path / 'other.csv', **{'Export Frame Rate': '100.000000'})
    import_motive(other, tmp_path / 'other')  # a rate that the times contradict is not used
    assert read_bag(tmp_path / 'other')['optitrack/pose'].t[-1] == pytest.approx(59.0 / RATE)


def test_lost_markers_give_no_pose(tmp_path):
    lost = (0, 5, 6, 7, 59)
    counts, notes = import_motive(
        take(tmp_path / 'take.csv', lost=lost, markers=False), tmp_path / 'bag')
    assert counts == {'/mambo/optitrack/pose': N - 5}
    assert notes == ["optitrack/pose: 5 of 60 frames have no pose of 'Rigid Body 1' and are left "
                     'out']
    bag = read_bag(tmp_path / 'bag')
    frames = np.rint(bag['optitrack/pose'].t * RATE).astype(int)
    assert frames.tolist() == [i for i in range(N) if i not in lost]
    assert bag.metadata['import']['frames_lost'] == '5'


def test_impossible_poses_are_left_out(tmp_path):
    source = take(tmp_path / 'take.csv', markers=False, change=lambda lines: [
        *lines[:20], *(line.rpartition(',')[0] + ',1e25' for line in lines[20:21]), *lines[21:]])
    counts, notes = import_motive(source, tmp_path / 'bag')
    assert counts == {'/mambo/optitrack/pose': N - 1}
    assert len(notes) == 1 and '1 impossible pose left out' in notes[0]
    bag = read_bag(tmp_path / 'bag')
    assert np.abs(bag['optitrack/pose'].position).max() < 2.0
    assert bag.metadata['import']['poses_impossible'] == '1'


def test_frozen_poses_are_left_out_and_the_good_ones_beside_them_stay(tmp_path, capsys):
    """The body moves by 0.4 m in 0.25 s while it is lost: in one step, that would be 48 m/s."""
    def change(lines):
        rows = [line.split(',') for line in lines[7:]]
        for row in rows[20:50]:
            row[2:] = rows[20][2:]
        for row in rows[50:]:
            row[6] = f'{float(row[6]) + 0.4:.6f}'
        return [*lines[:7], *(','.join(row) for row in rows)]
    source = take(tmp_path / 'take.csv', markers=False, change=change)
    assert main([str(source), str(tmp_path / 'bag')]) == 0
    assert ('optitrack/pose: 29 frozen poses left out, equal to the one before in all numbers'
            in capsys.readouterr().out)
    bag = read_bag(tmp_path / 'bag')
    frames = np.rint(bag['optitrack/pose'].t * RATE).astype(int)
    assert frames.tolist() == [*range(21), *range(50, N)]
    assert bag.metadata['import']['poses_frozen'] == '29'


def test_frames_with_a_quaternion_of_zeros_are_left_out_and_counted(tmp_path, capsys):
    def zeroed(frames):
        def change(lines):
            rows = [line.split(',') for line in lines[7:]]
            return [*lines[:7], *(','.join(
                [*row[:2], *(['0.0'] * 4 if k in frames else row[2:6]), *row[6:]])
                for k, row in enumerate(rows))]
        return change
    counts, notes = import_motive(take(
        tmp_path / 'take.csv', markers=False, change=zeroed({5, 7}), lost=(9,)), tmp_path / 'bag')
    assert counts == {'/mambo/optitrack/pose': N - 3}
    assert notes == [
        "optitrack/pose: 3 of 60 frames have no pose of 'Rigid Body 1' and are left out",
        'optitrack/pose: 2 of them have a quaternion of zeros, no attitude']
    refuse(take(tmp_path / 'none.csv', change=zeroed(range(N))), tmp_path, capsys,
           "'Rigid Body 1' is never seen: its quaternions are of zeros")


def test_millimetres_that_are_called_metres_are_refused(tmp_path, capsys):
    refuse(take(tmp_path / 'mm.csv', scale=1000.0), tmp_path, capsys,
           'optitrack/pose: 59 of 59 steps are faster than 2005 deg/s or 30 m/s')


def test_positions_beyond_a_hall_are_refused(tmp_path, capsys):
    def change(lines):
        rows = [line.split(',') for line in lines[7:]]
        return [*lines[:7], *(','.join([*row[:6], '1e9', *row[7:]]) for row in rows)]
    refuse(take(tmp_path / 'far.csv', change=change), tmp_path, capsys,
           'a position is 1e+09 m from the origin, more than 10000 m')


def test_a_sound_take_is_whole_and_nothing_is_said_about_its_poses(tmp_path):
    counts, notes = import_motive(take(tmp_path / 'take.csv', markers=False), tmp_path / 'bag')
    assert counts == {'/mambo/optitrack/pose': N} and not notes


def test_frames_that_are_missing_between_others_are_told(tmp_path):
    path = take(tmp_path / 'cut.csv', markers=False, change=lambda lines: [
        *lines[:7], *lines[7:27], *lines[37:47], *lines[48:]], **{'Total Exported Frames': N - 11})
    counts, notes = import_motive(path, tmp_path / 'bag')
    assert counts == {'/mambo/optitrack/pose': N - 11}
    assert notes == ['optitrack/pose: 11 frames are missing in the file, most from 0.16 to 0.25 s:'
                     ' was it cut?']


@pytest.mark.parametrize('size, turn, said', [
    (1e-3, 0.1, 'stay within 0.00098 m while the attitude changes: check the unit of the exp'),
    (0.0, 0.0, 'stay within 0 m throughout: was another rigid body flown?'), (0.5, 0.1, '')])
def test_a_body_that_hardly_moves_is_told(size, turn, said):
    t = np.arange(0.0, 10.0, 0.01)
    attitude = Rotation.from_euler('x', turn * np.sin(t)[:, None]).as_quat()
    found = motive._still(t, 0.5 * size * np.sin(t)[:, None] * [1.0, 0.0, 0.0], attitude)
    assert len(found) == bool(said) and said in ''.join(found)


def test_positions_that_contradict_the_tilts_are_told(tmp_path):
    """Of a take along x, 0.5 sin(2 t) m, whose tilts are those of the acceleration or opposite."""
    t = np.arange(0.0, 20.0, 0.01)
    tilt = np.arctan(-2.0 * np.sin(2.0 * t) / 9.81)
    for sign, said in ((1.0, []), (-1.0, ['are turned by ', ' deg about the vertical from its'])):
        # of Motive: y up, so the body leans towards x about -z
        turns = Rotation.from_euler('z', -sign * tilt[:, None]).as_quat()
        rows = [f'{k},{k / 100:.6f},{",".join(f"{v:.9f}" for v in turn)},'
                f'{0.5 * np.sin(0.02 * k):.9f},{1.0:.9f},{0.0:.9f}'
                for k, turn in enumerate(turns)]
        kinds = ['Rotation'] * 4 + ['Position'] * 3
        path = tmp_path / f'{sign}.csv'
        path.write_text('\r\n'.join([
            'Format Version,1.23,Length Units,Meters,Rotation Type,Quaternion,'
            'Export Frame Rate,100.0,Coordinate Space,Global', '',
            ',Type' + ',Rigid Body' * 7, ',Name' + ',drone' * 7, ',ID' + ',1' * 7,
            ',,' + ','.join(kinds), 'Frame,Time (Seconds),X,Y,Z,W,X,Y,Z', *rows]))
        found = import_motive(path, tmp_path / f'bag{sign}')[1]
        assert len(found) == bool(said) and all(word in found[0] for word in said)


def test_a_wrong_quaternion_is_named_by_the_number_of_its_frame(tmp_path, capsys):
    def change(lines):
        rows = [line.split(',') for line in lines[7:]]
        rows[50][2] = '2.0'
        return [*lines[:7], *(','.join([str(1000 + k), *row[1:]]) for k, row in enumerate(rows))]
    refuse(take(tmp_path / 'take.csv', change=change), tmp_path, capsys,
           'the quaternion of frame 1050 has the length')


@pytest.mark.parametrize('delimiter, name', [(';', "';'"), ('\t', 'a tab'), ('|', "'|'")])
def test_another_delimiter_is_named(tmp_path, capsys, delimiter, name):
    path = take(tmp_path / 'take.csv', change=swap(',', delimiter, -1))
    refuse(path, tmp_path, capsys,
           f'its cells are separated by {name}: export or save it with commas instead')


@pytest.mark.parametrize('encoding', ['utf-16-le', 'utf-16-be'])
def test_a_take_in_utf_16_is_to_be_saved_in_utf_8(tmp_path, capsys, encoding):
    path = take(tmp_path / 'take.csv')
    path.write_bytes(('\ufeff' + path.read_text(encoding='utf-8')).encode(encoding))
    refuse(path, tmp_path, capsys, 'not a text file in UTF-8 (byte 0): save it in this encoding')


def test_the_body_is_chosen_by_name(tmp_path, capsys):
    source = take(tmp_path / 'take.csv', bodies=2)
    assert main([str(source), str(tmp_path / 'bag'), '--body', 'Rigid Body 2']) == 0
    poses = read_bag(tmp_path / 'bag')['optitrack/pose']
    np.testing.assert_allclose(poses.position[0], [1.0, -1.0, 2.0], atol=1e-6)
    capsys.readouterr()
    refuse(source, tmp_path, capsys, "several rigid bodies; say which with --body: 'Rigid Body 1'")
    assert main([str(source), str(tmp_path / 'first'), '--body', 'Rigid Body 1']) == 0
    assert 'not used: Rigid Body 1:Marker1, Rigid Body 2, Rigid' in capsys.readouterr().out
    refuse(source, tmp_path, capsys, "no rigid body 'Mambo'; it has", '--body', 'Mambo')


def test_the_bag_says_where_it_came_from(tmp_path):
    source = take(tmp_path / 'take.csv')
    import_motive(source, tmp_path / 'bag', nose=0.5)
    record = read_bag(tmp_path / 'bag').metadata['import']
    assert record['source_file'] == 'take.csv'
    assert record['source_sha256'] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert record['importer'] == 'mambo_analysis.import_motive'
    assert (record['up'], record['nose_rad'], record['frames']) == ('y', '0.5', str(N))
    assert record['motive_capture_start_time'].endswith('下午')


def refuse(path, tmp_path, capsys, text, *options):
    assert main([str(path), str(tmp_path / 'out'), *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith('import_motive: ') and error.count('\n') == 1, error
    assert text in error and str(path) in error
    assert not (tmp_path / 'out').exists()


def drop(number):
    return lambda lines: lines[:number]


def swap(old, new, count=1):
    return lambda lines: '\n'.join(lines).replace(old, new, count).split('\n')


def times(factor):
    """Return a change of a take whose times are too large by a factor."""
    def change(lines):
        rows = [line.split(',') for line in lines[7:]]
        return [*lines[:7], *(','.join([a, f'{factor * float(b):.6f}', *rest])
                              for a, b, *rest in rows)]
    return change


@pytest.mark.parametrize('change,text', [
    (lambda lines: ['x,y,z', '1,2,3'], 'no CSV export of Motive'),
    (lambda lines: lines[2:], 'no CSV export of Motive'),  # exported without header information
    (swap('1.23', '1.1'), "format version '1.1'"),
    (swap('Meters', 'Furlongs'), "length unit 'Furlongs' is not one of"),
    (swap('Quaternion', 'Matrix'), "rotation type 'Matrix' is not one of"),
    (swap('Global', 'Local'), "coordinates are 'Local'"),
    (drop(1), 'are missing or cut off'), (drop(5), 'are missing or cut off'),
    (drop(7), 'no frames, only a header'), (drop(40), 'it has 33 of 60 exported frames'),
    (lambda lines: [*lines[:-1], lines[-1][:20]], 'line 67 has 3 cells, not 13'),
    (swap('\n5,', '\n3,'), 'frame numbers do not increase after frame 4'),
    (swap('\n5,0.041667', '\n5,0.025000'), 'times do not increase after frame 4'),
    (swap('\n5,0.041667', '\n5,'), 'row 6 of the frames has no frame number, or no time'),
    (swap('Time (Seconds)', 'Time (Milliseconds)'), "the unit of its times is 'Milliseconds'"),
    (times(1000.0), 'its times give 0.12 frames/s, its Export Frame Rate is 120 Hz'),
    (times(1.1), 'its times give 109.1 frames/s, its Export Frame Rate is 120 Hz'),
    (times(1.03), None),  # a nominal rate
    (swap('9.000000', 'nine'), None),
    (swap('1.000000', 'one'), "line 8: 'one' is not a number"),
    (swap('1.000000', 'inf'), 'line 8: inf is absurdly large'),
    (swap('1.000000', '1_0.5'), "line 8: '1_0.5' is not a number"),
    (swap('1.000000', '\u0661\u0662'), 'is not a number'),
    (lambda lines: [lines[0] + ',Length Units,Millimeters', *lines[1:]],
     "line 1 gives 'Length Units' twice: keep only the right one"),
    (lambda lines: [lines[0] + ',Rotation Type,XYZ', *lines[1:]],
     "line 1 gives 'Rotation Type' twice"),
    (lambda lines: [lines[0].replace('Rotation Type,Quaternion', 'Rotation Type,XYZ'), *lines[1:]],
     "its header has the rotation type XYZ, but the columns of 'Rigid Body 1' are a quaternion"),
    (swap(',Y,', ',X,'), "rigid body 'Rigid Body 1' has the column Rotation X twice"),
    (swap('Rigid Body,', 'Bone,', 99), 'no rigid body; export with rigid bodies'),
    (swap('Rotation,', 'Turning,', 4), 'lacks the columns Rotation X')])
def test_what_is_no_sound_take_is_named_in_one_line(tmp_path, capsys, change, text):
    path = take(tmp_path / 'take.csv', change=change)
    if text is None:  # a damaged cell of a column that is not asked for does no harm
        assert main([str(path), str(tmp_path / 'out')]) == 0
        return
    refuse(path, tmp_path, capsys, text)


def test_more_that_is_refused(tmp_path, capsys):
    refuse(tmp_path / 'none.csv', tmp_path, capsys, 'cannot be read')
    (tmp_path / 'empty.csv').touch()
    refuse(tmp_path / 'empty.csv', tmp_path, capsys, 'the file is empty')
    (tmp_path / 'binary.csv').write_bytes(b'\xff\xfe\x00' * 100)
    refuse(tmp_path / 'binary.csv', tmp_path, capsys, 'not a text file')
    refuse(take(tmp_path / 'lost.csv', lost=range(N)), tmp_path, capsys, 'is never seen')
    double = take(tmp_path / 'two.csv', bodies=2, change=swap('Rigid Body 2', 'Rigid Body 1', 99))
    refuse(double, tmp_path, capsys, "two rigid bodies are named 'Rigid Body 1'")
    refuse(take(tmp_path / 'q.csv', change=lambda lines: [
        *lines[:7], lines[7].replace(lines[7].split(',')[2], '2.0', 1), *lines[8:]]),
        tmp_path, capsys, 'the quaternion of frame 0 has the length')


def test_an_existing_bag_is_never_overwritten(tmp_path, capsys):
    source = take(tmp_path / 'take.csv')
    (tmp_path / 'out').mkdir()
    assert main([str(source), str(tmp_path / 'out')]) == 2
    assert 'exists: give another name' in capsys.readouterr().err


def test_two_imports_are_the_same_bytes(tmp_path):
    source = take(tmp_path / 'take.csv')
    for folder in ('a', 'b'):
        import_motive(source, tmp_path / folder / 'bag')
    a, b = ((tmp_path / folder / 'bag' / 'bag_0.mcap').read_bytes() for folder in ('a', 'b'))
    assert a == b


COORDINATE = st.floats(-20.0, 20.0)
ANGLE = st.floats(-3.1, 3.1)
POSES = st.lists(st.tuples(st.tuples(*[COORDINATE] * 3), st.tuples(*[ANGLE] * 3)),
                 min_size=1, max_size=20)
# what is up in the file, as columns: east, north and up of a right-handed frame seen in it
IN_FILE = {'y': [[1, 0, 0], [0, 0, 1], [0, -1, 0]], 'z': np.eye(3)}


@given(POSES, st.sampled_from('yz'), ANGLE)
def test_any_pose_survives_whatever_axis_is_up_and_wherever_the_nose_is(rows, up, nose):
    """Written in the axes of the file and read again: the same pose, z up, body FLU."""
    position, rotvec = (np.array(column) for column in zip(*rows))
    attitude, to_file = Rotation.from_rotvec(rotvec), Rotation.from_matrix(IN_FILE[up])
    tracked = attitude * Rotation.from_euler('z', -nose)  # the body as it was defined
    take = Take(np.arange(len(rows)) / RATE, to_file.apply(position),
                (to_file * tracked * to_file.inv()).as_quat(), 'drone', {}, [])
    t, found, q = poses(take, up, nose)
    np.testing.assert_allclose(found, position, atol=1e-9)
    assert (Rotation.from_quat(q) * attitude.inv()).magnitude().max() < 1e-7
    np.testing.assert_array_equal(t, take.times)


@settings(max_examples=20)
@given(POSES, st.sampled_from(['Quaternion', 'XYZ', 'XZY', 'YXZ', 'YZX', 'ZXY', 'ZYX']),
       st.sampled_from([('Meters', 1.0), ('Centimeters', 0.01), ('Millimeters', 0.001)]))
def test_any_pose_is_read_as_it_was_written_in_any_unit_and_order_of_angles(rows, order, unit):
    name, metres = unit
    position, rotvec = (np.array(column) for column in zip(*rows))
    attitude = Rotation.from_rotvec(rotvec)
    if order == 'Quaternion':
        turns = attitude.as_quat()
    else:
        angles = np.degrees(attitude.as_euler(order))
        turns = angles[:, [order.index(axis) for axis in 'XYZ']]
    axes = 'XYZW' if order == 'Quaternion' else 'XYZ'
    kinds = [*('Rotation' for _ in axes), *['Position'] * 3]
    lines = [
        f'Format Version,1.23,Rotation Type,{order},Length Units,{name},'
        f'Total Exported Frames,{len(rows)},Coordinate Space,Global',
        ',Type' + ',Rigid Body' * len(kinds), ',Name' + ',drone' * len(kinds),
        ',ID' + ',1' * len(kinds), ',,' + ','.join(kinds),
        'Frame,Time (Seconds),' + ','.join([*axes, *'XYZ'])]
    for k, (turn, p) in enumerate(zip(turns, position / metres)):
        lines.append(','.join([str(k), f'{k / RATE:.6f}', *(f'{v:.9f}' for v in (*turn, *p))]))
    take = read_take(Source(Path('take.csv'), '\r\n'.join(lines).encode(), ''))
    np.testing.assert_allclose(take.position, position, atol=1e-7)
    assert (Rotation.from_quat(take.rotation) * attitude.inv()).magnitude().max() < 1e-6
