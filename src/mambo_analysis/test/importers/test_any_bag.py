"""Foreign bags, made and real: what is mapped arrives unchanged, what does not fit is refused."""

from pathlib import Path
import random
import sqlite3

from damage import check, mutated
from mambo_analysis.importers.any_bag import import_bag, main, TARGETS
from mambo_analysis.importers.checks import assignments
from mambo_bags import columns
from mambo_bags.reader import read_bag
from mambo_bags.recover import recover
from mambo_bags.writer import BagWriter
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from scipy.spatial.transform import Rotation
import yaml
import zstandard

DATA = Path(__file__).resolve().parents[5] / 'shared' / 'data' / 'mcap_bags'
needs_data = pytest.mark.skipif(
    not DATA.exists(), reason='foreign bags are not beside the repo (../shared/data)')
N, SECOND = 50, 10**9
EPOCH = 1_763_073_169 * SECOND  # ns, stamps of a real clock
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = {
    '/vrpn/mambo/pose': 'geometry_msgs/msg/PoseStamped',
    '/amcl': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    '/vicon/mambo': 'geometry_msgs/msg/TransformStamped', '/odom': 'nav_msgs/msg/Odometry',
    '/imu': 'sensor_msgs/msg/Imu', '/range': 'sensor_msgs/msg/Range',
    '/pressure': 'sensor_msgs/msg/FluidPressure', '/chatter': 'std_msgs/msg/String'}


def make(name, **fields):
    return columns.zero(STORE, name, **fields)


def header(i, frame='world'):
    sec, nanosec = divmod(EPOCH + i * 10_000_000, SECOND)
    return make('std_msgs/msg/Header', frame_id=frame,
                stamp=make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec))


def pose(i):
    return make('geometry_msgs/msg/Pose',
                position=make('geometry_msgs/msg/Point', x=0.1 * i, y=-0.2 * i, z=1.0),
                orientation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.6, w=0.8))


def message(name, i):
    """Return message i of a type, a moving vehicle."""
    if name == 'std_msgs/msg/String':
        return make(name, data=f'hello {i}')
    fields = {'header': header(i)}
    if name.endswith('/PoseStamped'):
        fields['pose'] = pose(i)
    elif name.endswith(('PoseWithCovarianceStamped', 'Odometry')):
        fields['pose'] = make('geometry_msgs/msg/PoseWithCovariance', pose=pose(i),
                              covariance=np.arange(36.0))
    elif name.endswith('TransformStamped'):
        p = pose(i)
        fields['transform'] = make(
            'geometry_msgs/msg/Transform', rotation=p.orientation,
            translation=make('geometry_msgs/msg/Vector3', x=p.position.x, y=p.position.y,
                             z=p.position.z))
    elif name.endswith('Imu'):
        fields['linear_acceleration'] = make('geometry_msgs/msg/Vector3', x=0.1, y=0.2, z=9.7)
    elif name.endswith('Range'):
        fields.update(range=1.5, min_range=0.25, max_range=4.0)
    elif name.endswith('FluidPressure'):
        fields['fluid_pressure'] = 1e5 + i
    return make(name, **fields)


def raw(name, i, change=None):
    out = message(name, i)
    if change:
        change(i, out)
    return bytes(STORE.serialize_cdr(out, name))


def foreign(path, topics=TYPES, change=None, step=10_000_000, count=N):
    """Write a bag as a foreign recorder would: log times 3 ms behind the stamps."""
    with BagWriter(path) as writer:
        for topic, name in topics.items():
            text = STORE.generate_msgdef(name)[0].encode()
            writer.add_topic(topic, name, schema=text, type_hash='')
        for i in range(count):
            for topic, name in topics.items():
                writer.write(topic, raw(name, i, change), EPOCH + i * step + 3_000_000)
    return path


def sqlite_bag(path, topics=TYPES, form='cdr', listing=True):
    """Write a bag of the storage sqlite3, as rosbag2 did by default before Iron."""
    path.mkdir()
    file = path / f'{path.name}_0.db3'
    with sqlite3.connect(file) as database:
        database.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type '
                         'TEXT NOT NULL, serialization_format TEXT NOT NULL, '
                         'offered_qos_profiles TEXT NOT NULL)')
        database.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT '
                         'NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL)')
        for number, (topic, name) in enumerate(topics.items(), 1):
            database.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?)',
                             (number, topic, name, form, ''))
            database.executemany(
                'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
                [(number, EPOCH + i * 10_000_000 + 3_000_000, raw(name, i)) for i in range(N)])
    if listing:
        (path / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
            'version': 5, 'storage_identifier': 'sqlite3', 'compression_mode': '',
            'relative_file_paths': [file.name]}}))
    return path


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return foreign(tmp_path_factory.mktemp('foreign') / 'theirs')


ALL = {'/vrpn/mambo/pose': 'optitrack/pose', '/odom': 'onboard/odom', '/imu': 'imu/data_raw',
       '/range': 'sonar/range', '/pressure': 'barometer/pressure'}


def check_all(path):
    ours = read_bag(path)
    assert ours.namespace == '/mambo' and len(ours.topics) == len(ALL)
    for topic in ALL.values():
        np.testing.assert_array_equal(ours[topic].stamp, EPOCH + 10_000_000 * np.arange(N))
        np.testing.assert_array_equal(ours[topic].log_time - ours[topic].stamp, 3_000_000)
        assert set(ours[topic]['header.frame_id']) == {'world'}
    i = np.arange(N)
    np.testing.assert_allclose(ours['optitrack/pose'].position,
                               np.column_stack([0.1 * i, -0.2 * i, np.ones(N)]))
    np.testing.assert_array_equal(ours['onboard/odom'].pose_covariance[3], np.arange(36.0))
    np.testing.assert_array_equal(ours['imu/data_raw'].acceleration[0], [0.1, 0.2, 9.7])
    assert ours['sonar/range'].range[0] == 1.5
    np.testing.assert_array_equal(ours['barometer/pressure'].pressure, 1e5 + i)


def test_mapped_topics_arrive_with_their_headers_and_values(bag, tmp_path):
    counts, *_ = import_bag(bag, tmp_path / 'dir', ALL)
    assert set(counts.values()) == {N}
    check_all(tmp_path / 'dir')
    import_bag(bag / 'theirs_0.mcap', tmp_path / 'file', ALL)  # one file without its directory
    check_all(tmp_path / 'file')


def test_sqlite_bags_are_read_too(tmp_path):
    source = sqlite_bag(tmp_path / 'old')
    before = (source / 'old_0.db3').read_bytes()
    import_bag(source, tmp_path / 'dir', ALL)
    check_all(tmp_path / 'dir')
    import_bag(source / 'old_0.db3', tmp_path / 'file', ALL)
    check_all(tmp_path / 'file')
    import_bag(sqlite_bag(tmp_path / 'bare', listing=False), tmp_path / 'bare_out', ALL)
    check_all(tmp_path / 'bare_out')
    assert (source / 'old_0.db3').read_bytes() == before
    assert sorted(p.name for p in source.iterdir()) == ['metadata.yaml', 'old_0.db3']


def recorded(path, version=9, storage=StoragePlugin.SQLITE3, mode=CompressionMode.NONE,
             topics=TYPES):
    """Write a bag of a late rosbag2 by another hand: it carries its definitions."""
    writer = Writer(path, version=version, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {topic: writer.add_connection(topic, name, typestore=STORE)
                       for topic, name in topics.items()}
        for i in range(N):
            for topic, name in topics.items():
                writer.write(connections[topic], EPOCH + i * 10_000_000 + 3_000_000, raw(name, i))
    return path


@pytest.mark.parametrize('mode', [
    CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('version', [8, 9])
def test_sqlite_bags_of_late_versions_plain_or_compressed(tmp_path, version, mode):
    source = recorded(tmp_path / 'late', version, mode=mode)
    import_bag(source, tmp_path / 'dir', ALL)
    check_all(tmp_path / 'dir')
    file = next(path for path in source.iterdir() if '.db3' in path.name)
    assert (file.suffix == '.zstd') == (mode == CompressionMode.FILE)
    import_bag(file, tmp_path / 'file', ALL)
    check_all(tmp_path / 'file')
    (source / 'metadata.yaml').unlink()
    import_bag(source, tmp_path / 'bare', ALL)
    check_all(tmp_path / 'bare')


def test_a_compressed_mcap_file_is_unpacked(tmp_path):
    source = recorded(tmp_path / 'late', storage=StoragePlugin.MCAP, mode=CompressionMode.FILE)
    import_bag(source, tmp_path / 'dir', ALL)
    check_all(tmp_path / 'dir')
    import_bag(next(source.glob('*.zstd')), tmp_path / 'file', ALL)
    check_all(tmp_path / 'file')


def test_an_mcap_bag_of_compressed_messages_is_read_and_recovered(tmp_path):
    source = recorded(tmp_path / 'late', storage=StoragePlugin.MCAP, mode=CompressionMode.MESSAGE)
    assert 'compression_mode: message' in (source / 'metadata.yaml').read_text().lower()
    import_bag(source, tmp_path / 'dir', ALL)
    check_all(tmp_path / 'dir')
    recover(source, tmp_path / 'plain')
    sent = [raw(TYPES['/imu'], i) for i in range(N)]
    assert read_bag(source)['/imu'].raw == read_bag(tmp_path / 'plain')['/imu'].raw == sent


@pytest.mark.parametrize('version', range(1, 10))
def test_every_version_of_the_metadata_is_read(tmp_path, version):
    source = sqlite_bag(tmp_path / 'old')
    listing = {'version': version, 'storage_identifier': 'sqlite3', 'message_count': N,
               'relative_file_paths': ['old_0.db3' if version > 2 else 'old/old_0.db3']}
    if version >= 3:
        listing |= {'compression_format': '', 'compression_mode': ''}
    if version >= 7:
        listing |= {'custom_data': None, 'ros_distro': 'rolling'}
    (source / 'metadata.yaml').write_text(
        yaml.safe_dump({'rosbag2_bagfile_information': listing}))
    import_bag(source, tmp_path / 'dir', ALL)
    check_all(tmp_path / 'dir')


def range_of_humble():
    """Return a type store with Range as before Iron, which has no variance."""
    old = get_typestore(Stores.ROS2_HUMBLE)
    assert len(old.fielddefs['sensor_msgs/msg/Range'][1]) == 6
    return old


@pytest.mark.parametrize('distribution', ['', 'humble', 'foxy'])
def test_an_old_bag_without_definitions_is_read_as_its_distribution_had_them(
        tmp_path, distribution):
    old, name = range_of_humble(), 'sensor_msgs/msg/Range'
    source = sqlite_bag(tmp_path / 'old', {'/range': name})
    with sqlite3.connect(source / 'old_0.db3') as database:
        for i in range(N):
            new = message(name, i)
            out = columns.zero(old, name, **{
                key: getattr(new, key) for key, _ in old.fielddefs[name][1]})
            database.execute('UPDATE messages SET data = ? WHERE id = ?',
                             (bytes(old.serialize_cdr(out, name)), i + 1))
    listing = yaml.safe_load((source / 'metadata.yaml').read_text())
    listing['rosbag2_bagfile_information']['ros_distro'] = distribution
    (source / 'metadata.yaml').write_text(yaml.safe_dump(listing))
    import_bag(source, tmp_path / 'bag', {'/range': 'sonar/range'})
    ours = read_bag(tmp_path / 'bag')['sonar/range']
    assert ours.range.tolist() == [1.5] * N
    np.testing.assert_array_equal(ours.stamp, EPOCH + 10_000_000 * np.arange(N))


def test_a_definition_that_only_the_bag_has_is_the_one_it_is_read_by(tmp_path):
    name = 'sensor_msgs/msg/Range'
    text = 'std_msgs/Header header\nfloat64 range\n' + '=' * 80 + '\nMSG: std_msgs/Header\n' \
        'builtin_interfaces/Time stamp\nstring frame_id\n' + '=' * 80 + \
        '\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
    theirs = get_typestore(Stores.EMPTY)
    theirs.register(get_types_from_msg(text, name))
    source = sqlite_bag(tmp_path / 'theirs', {'/range': name})
    with sqlite3.connect(source / 'theirs_0.db3') as database:
        database.execute('CREATE TABLE message_definitions(id INTEGER PRIMARY KEY,'
                         ' topic_type TEXT, encoding TEXT, encoded_message_definition TEXT,'
                         ' type_description_hash TEXT)')
        database.execute("INSERT INTO message_definitions VALUES (1, ?, 'ros2msg', ?, '')",
                         (name, text))
        for i in range(N):
            out = columns.zero(theirs, name, header=header(i), range=0.5 + 0.5 * i)
            database.execute('UPDATE messages SET data = ? WHERE id = ?',
                             (bytes(theirs.serialize_cdr(out, name)), i + 1))
    import_bag(source, tmp_path / 'bag', {'/range': 'sonar/range'})
    ours = read_bag(tmp_path / 'bag')['sonar/range']
    assert ours.range.tolist() == [0.5 + 0.5 * i for i in range(N)]


def own_bag(path, name='mambo_interfaces/msg/MotorPwm'):
    """Write an old bag of a type of this product, or of one that it calls so."""
    store = columns.load_types(['mambo_interfaces/msg/MotorPwm'])
    out = columns.zero(store, 'mambo_interfaces/msg/MotorPwm', pwm=np.array([1.0, 2.0, 3.0, 4.0]))
    source = sqlite_bag(path, {'/motors': TYPES['/imu'], '/imu': TYPES['/imu']})
    with sqlite3.connect(next(source.glob('*.db3'))) as database:
        database.execute('UPDATE topics SET type = ? WHERE id = 1', (name,))
        database.execute('UPDATE messages SET data = ? WHERE topic_id = 1', (
            bytes(store.serialize_cdr(out, 'mambo_interfaces/msg/MotorPwm')),))
    return source


def test_our_own_types_are_known_where_the_bag_carries_none(tmp_path):
    import_bag(own_bag(tmp_path / 'db3'), tmp_path / 'bag', {'/motors': 'motor_pwm'})
    ours = read_bag(tmp_path / 'bag')['motor_pwm']
    assert ours.pwm[7].tolist() == [1.0, 2.0, 3.0, 4.0]
    with BagWriter(tmp_path / 'mcap') as writer:  # as rosbag2 does for a type it does not find
        writer.add_topic('/motors', 'mambo_interfaces/msg/MotorPwm', schema=b'',
                         schema_encoding='', type_hash='')
        for stamp, data in zip(ours.stamp.tolist(), ours.raw):
            writer.write('/motors', data, stamp)
    import_bag(tmp_path / 'mcap', tmp_path / 'again', {'/motors': 'motor_pwm'})
    assert read_bag(tmp_path / 'again')['motor_pwm'].pwm[7].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_a_foreign_type_without_a_definition_is_named_with_what_to_do(tmp_path, capsys):
    source = own_bag(tmp_path / 'db3', 'their_msgs/msg/Odd')
    assert main([str(source)]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if 'cannot be read' in line)
    assert 'no definition of their_msgs/msg/Odd' in line and 'ros2 bag convert' in line
    with sqlite3.connect(next(source.glob('*.db3'))) as database:
        database.execute('DELETE FROM messages WHERE topic_id = 2')
    refuse(source, tmp_path, capsys, 'no definition of their_msgs/msg/Odd', '/motors:=motor_pwm')


def test_damaged_or_huge_compression_is_one_line(tmp_path, capsys, monkeypatch):
    source = recorded(tmp_path / 'late', mode=CompressionMode.FILE)
    file, entry = next(source.glob('*.zstd')), '/imu:=imu/data_raw'
    content = file.read_bytes()
    file.write_bytes(content[:len(content) // 2])
    refuse(source, tmp_path, capsys, 'its compression is cut off', entry)
    file.write_bytes(content[:4] + bytes(60) + content[64:])
    refuse(source, tmp_path, capsys, 'damaged compression', entry)
    file.write_bytes(zstandard.compress(bytes(50 << 20)))
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '5')
    refuse(source, tmp_path, capsys, 'unpacks to more than 5 MB; MAMBO_MAX_UNPACKED_MB (now 5) '
           'raises the limit', entry)
    huge = sqlite_bag(tmp_path / 'huge', {'/imu': TYPES['/imu']})
    with sqlite3.connect(huge / 'huge_0.db3') as database:
        database.execute('UPDATE messages SET data = ?', (zstandard.compress(bytes(9 << 20)),))
    refuse(huge, tmp_path, capsys, 'unpacks to more than 5 MB; MAMBO_MAX_UNPACKED_MB', entry)


def test_messages_that_unpack_to_much_together_are_refused(tmp_path, capsys, monkeypatch):
    source = sqlite_bag(tmp_path / 'many', {'/imu': TYPES['/imu']})
    with sqlite3.connect(source / 'many_0.db3') as database:
        database.execute('UPDATE messages SET data = ?', (zstandard.compress(bytes(2 << 20)),))
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '5')
    refuse(source, tmp_path, capsys, 'MAMBO_MAX_UNPACKED_MB (now 5)', '/imu:=imu/data_raw')


@pytest.mark.parametrize('view', [
    'WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) '
    'SELECT x AS id, 1 AS topic_id, x AS timestamp, x AS data FROM c',
    'SELECT a.id, a.topic_id, a.timestamp, a.data FROM letters a, letters b, letters c, letters d',
    'SELECT id, topic_id, timestamp, zeroblob(900000000) AS data FROM letters'])
def test_a_view_that_never_ends_is_refused(tmp_path, capsys, view):
    source = sqlite_bag(tmp_path / 'odd', {'/imu': TYPES['/imu']})
    with sqlite3.connect(source / 'odd_0.db3') as database:
        database.execute('ALTER TABLE messages RENAME TO letters')
        database.execute(f'CREATE VIEW messages AS {view}')
    refuse(source, tmp_path, capsys, 'no rosbag2 file, or damaged', '/imu:=imu/data_raw')


@pytest.mark.parametrize('change, text', [
    ('UPDATE messages SET data = 10000000000 WHERE id = 3', 'no sequence of bytes'),
    ("UPDATE messages SET timestamp = 'noon' WHERE id = 3", 'the impossible time noon'),
    ('UPDATE messages SET timestamp = -1 WHERE id = 3', 'the impossible time -1'),
    ('UPDATE messages SET topic_id = 77 WHERE id = 3', 'the topic 77, which is not listed'),
    ("UPDATE topics SET name = x'ff00'", 'has no name, type or encoding'),
    ('ALTER TABLE messages RENAME TO letters', 'no such table')])
def test_a_database_of_odd_content_is_one_line(tmp_path, capsys, change, text):
    source = sqlite_bag(tmp_path / 'odd', {'/imu': TYPES['/imu']})
    with sqlite3.connect(source / 'odd_0.db3') as database:
        database.execute(change)
    refuse(source, tmp_path, capsys, text, '/imu:=imu/data_raw')


@pytest.mark.parametrize('theirs', ['/vrpn/mambo/pose', '/amcl', '/vicon/mambo', '/odom'])
def test_a_pose_is_taken_from_whatever_holds_one(bag, tmp_path, theirs):
    import_bag(bag, tmp_path / 'bag', {theirs: 'optitrack/pose'})
    poses = read_bag(tmp_path / 'bag')['optitrack/pose']
    assert poses.type_name == 'geometry_msgs/msg/PoseStamped'
    np.testing.assert_allclose(poses.position[10], [1.0, -2.0, 1.0])
    np.testing.assert_array_equal(poses.orientation[10], [0.0, 0.0, 0.6, 0.8])


def test_a_definition_of_an_older_distribution_is_brought_up_to_date(tmp_path):
    name = 'sensor_msgs/msg/Range'
    text = ('std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\n'
            'float32 min_range\nfloat32 max_range\nfloat32 range\n')  # Humble has no variance
    full = text + '=' * 80 + '\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\n' \
        'string frame_id\n' + '=' * 80 + '\nMSG: builtin_interfaces/Time\nint32 sec\n' \
        'uint32 nanosec\n'
    old = get_typestore(Stores.EMPTY)
    old.register(get_types_from_msg(full, name))
    with BagWriter(tmp_path / 'humble') as writer:
        writer.add_topic('/range', name, schema=full.encode(), type_hash='')
        for i in range(3):
            new = message(name, i)
            fields = {key: getattr(new, key) for key, _ in old.fielddefs[name][1]}
            out = columns.zero(old, name, **fields)
            writer.write('/range', bytes(old.serialize_cdr(out, name)), EPOCH + i)
    import_bag(tmp_path / 'humble', tmp_path / 'bag', {'/range': 'sonar/range'})
    ours = read_bag(tmp_path / 'bag')['sonar/range']
    assert ours.range.tolist() == [1.5] * 3 and ours.variance.tolist() == [0.0] * 3


def test_a_lost_body_gives_no_pose_and_is_counted(tmp_path, capsys):
    def change(i, out):
        if i % 10 == 3:
            out.pose.position.x = float('nan')
        if i % 10 == 4:
            out.pose.orientation.z = out.pose.orientation.w = 0.0

    source = foreign(tmp_path / 'theirs', {'/p': TYPES['/vrpn/mambo/pose']}, change)
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/p:=optitrack/pose']) == 0
    assert 'lost optitrack/pose: 10' in capsys.readouterr().out
    ours = read_bag(tmp_path / 'bag')
    assert len(ours['optitrack/pose']) == 40
    assert ours.metadata['import']['lost optitrack/pose'] == '10'

    def never(i, out):
        out.pose.position.x = float('nan')

    source = foreign(tmp_path / 'nan', {'/p': TYPES['/vrpn/mambo/pose']}, never)
    refuse(source, tmp_path, capsys, 'the body is lost throughout', '/p:=optitrack/pose')


def test_stamps_that_are_missing_or_run_backwards_are_told(tmp_path, capsys):
    def change(i, out):
        if i == 5:
            out.header.stamp = header(2).stamp
        if i >= 40:
            out.header.stamp = make('builtin_interfaces/msg/Time')

    source = foreign(tmp_path / 'theirs', {'/imu': TYPES['/imu']}, change)
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/imu:=imu/data_raw']) == 0
    out = capsys.readouterr().out
    assert 'unstamped imu/data_raw: 10' in out and 'backwards imu/data_raw: 1' in out
    imu = read_bag(tmp_path / 'bag')['imu/data_raw']
    np.testing.assert_array_equal(imu.stamp[40:], imu.log_time[40:])


DAY = 86_400 * SECOND


def boot(i, out):
    """Stamp with the time since boot, 6.1 days before the recorder's; the pose not at all."""
    stamp = EPOCH - int(6.1 * DAY) + i * 10_000_000
    bare = 'PoseStamped' in type(out).__name__
    out.header.stamp = make('builtin_interfaces/msg/Time') if bare else make(
        'builtin_interfaces/msg/Time', sec=stamp // SECOND, nanosec=stamp % SECOND)


TWO = {'/imu': TYPES['/imu'], '/pose': TYPES['/vrpn/mambo/pose']}
MAPS = '/imu:=imu/data_raw', '/pose:=optitrack/pose'


def test_an_unstamped_topic_among_those_of_another_clock_is_one_line(tmp_path, capsys):
    source = foreign(tmp_path / 'theirs', TWO, boot)
    refuse(source, tmp_path, capsys, 'messages of /pose have no stamp, and their log time is 6.1 '
           'days from the stamps of the others; --time header', *MAPS)
    maps = [word for entry in MAPS for word in ('--map', entry)]
    for time in ('header', 'log'):
        assert main([str(source), str(tmp_path / time), '--time', time, *maps]) == 0
        ours = read_bag(tmp_path / time)
        imu, pose = ours['imu/data_raw'], ours['optitrack/pose']
        np.testing.assert_array_equal(imu.stamp, pose.stamp)
        first = EPOCH + 3_000_000 if time == 'log' else EPOCH - int(6.1 * DAY)
        np.testing.assert_array_equal(imu.stamp, first + 10_000_000 * np.arange(N))
        assert ours.metadata['import']['time'] == time
    capsys.readouterr()
    import_bag(source, tmp_path / 'one', {'/imu': 'imu/data_raw'})  # alone it is on one clock
    import_bag(source, tmp_path / 'other', {'/pose': 'optitrack/pose'})


def test_topics_stamped_by_two_clocks_are_one_line(tmp_path, capsys):
    def change(i, out):
        if 'Imu' in type(out).__name__:
            boot(i, out)

    source = foreign(tmp_path / 'theirs', TWO, change)
    refuse(source, tmp_path, capsys, 'are on two clocks, 6.1 days apart; --time log', *MAPS)
    import_bag(source, tmp_path / 'bag', dict(entry.split(':=') for entry in MAPS), 'log')
    ours = read_bag(tmp_path / 'bag')
    np.testing.assert_array_equal(ours['imu/data_raw'].stamp, ours['optitrack/pose'].stamp)


def test_one_stamp_far_from_its_neighbours_is_one_line(tmp_path, capsys):
    def change(i, out):
        if i == 20:
            boot(i, out)

    source = foreign(tmp_path / 'theirs', {'/imu': TYPES['/imu']}, change)
    refuse(source, tmp_path, capsys, 'the stamps of /imu are on two clocks: one of them is 6.1 '
           'days from the one before', '/imu:=imu/data_raw')


def test_a_recorder_that_ran_slower_or_paused_is_no_second_clock(tmp_path):
    source = foreign(tmp_path / 'slow', TWO, step=SECOND)  # of a bag played at a hundredth
    counts, *_ = import_bag(source, tmp_path / 'bag', dict(entry.split(':=') for entry in MAPS))
    assert set(counts.values()) == {N}


def moved(i, out):
    """Move slowly, and turn the tracked body over in five messages."""
    out.pose.position.x, out.pose.position.y = 0.01 * i, 0.0
    if 20 <= i < 25:
        out.pose.orientation.x, out.pose.orientation.z = 1.0, 0.0
        out.pose.orientation.w = 0.0


def millimetres(i, out):
    out.pose.position.x, out.pose.position.y = 1e3 * out.pose.position.x, 0.0


def of_two_bodies(i, out):
    out.child_frame_id = f'drone{i % 2}'


def in_two_frames(i, out):
    out.header.frame_id = 'map' if i % 2 else 'odom'


def slow(i, out):
    out.header.stamp = make('builtin_interfaces/msg/Time', sec=1000 + 2 * i, nanosec=0)


def turning(i, out):
    turn = 500.0 * np.cos(0.3 * i)  # deg/s; as rad/s it tilts by 17 rad
    out.angular_velocity = make('geometry_msgs/msg/Vector3', x=turn, y=0.0, z=0.0)


def in_g(i, out):
    out.linear_acceleration.z = -1.0


@pytest.mark.parametrize('theirs, change, ours, text', [
    ('/vrpn/mambo/pose', millimetres, 'optitrack/pose', '49 of 49 steps are faster than'),
    ('/vicon/mambo', of_two_bodies, 'optitrack/pose',
     "/vicon/mambo: its messages are of 2 bodies, child_frame_id 'drone0', 'drone1': give each"),
    ('/odom', of_two_bodies, 'onboard/odom', 'its messages are of 2 bodies, child_frame_id'),
    ('/vrpn/mambo/pose', in_two_frames, 'optitrack/pose',
     "its messages are of 2 frames, frame_id 'map', 'odom': give each"),
    ('/vrpn/mambo/pose', slow, 'optitrack/pose', 'its stamps: its samples are 2 s apart'),
    ('/imu', turning, 'imu/data_raw', 'is it in deg/s? give it in rad/s'),
    ('/imu', in_g, 'imu/data_raw', 'is it in g? give it in m/s^2'),
    ('/range', lambda i, out: setattr(out, 'range', 1500.0), 'sonar/range',
     '50 of 50 ranges are beyond 40 m'),
    ('/pressure', lambda i, out: setattr(out, 'fluid_pressure', 1013.0 + 0.1 * i),
     'barometer/pressure', 'is it in hPa? give it in Pa'),
    ('/battery', lambda i, out: setattr(out, 'voltage', 3700.0), 'battery',
     'the battery has a median of 3700 V')])
def test_what_cannot_be_one_vehicle_in_these_units_is_refused(
        tmp_path, capsys, theirs, change, ours, text):
    types = TYPES | {'/battery': 'sensor_msgs/msg/BatteryState'}
    source = foreign(tmp_path / 'theirs', {theirs: types[theirs]}, change)
    refuse(source, tmp_path, capsys, text, f'{theirs}:={ours}')


@pytest.mark.parametrize('frame, axes, turned', [
    ('base_link', 'body', False), ('base_link', 'world', True), ('world', 'world', True),
    ('world', 'body', False)])
def test_a_velocity_in_the_axes_of_the_poses_is_turned(tmp_path, capsys, frame, axes, turned):
    turn = Rotation.from_quat([0.0, 0.0, 0.6, 0.8])  # of every pose

    def change(i, odometry):
        t = 0.1 * i
        odometry.header = header(10 * i)
        odometry.child_frame_id = frame
        place, velocity = odometry.pose.pose.position, odometry.twist.twist.linear
        place.x, place.y = np.cos(t), 0.5 * np.sin(2.0 * t)
        v, w = np.array([-np.sin(t), np.cos(2.0 * t), 0.0]), np.array([0.1, 0.2, 0.3])
        if axes == 'body':
            v, w = turn.inv().apply([v, w])
        velocity.x, velocity.y, velocity.z = v
        rates = odometry.twist.twist.angular
        rates.x, rates.y, rates.z = w
        odometry.twist.covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).reshape(-1)
    source = foreign(tmp_path / 'theirs', {'/odom': 'nav_msgs/msg/Odometry'}, change, SECOND // 10)
    assert main([str(source), str(tmp_path / 'ours'), '--map', '/odom:=ground_truth/odom']) == 0
    said = 'turned ground_truth/odom: its velocity was in the axes of its poses, and is now in'
    assert (said in capsys.readouterr().out) == turned
    found = read_bag(tmp_path / 'ours')['ground_truth/odom']
    t = 0.1 * np.arange(N)
    world = np.stack([-np.sin(t), np.cos(2.0 * t), 0.0 * t], axis=1)
    np.testing.assert_allclose(found.velocity, turn.inv().apply(world), atol=1e-12)
    np.testing.assert_allclose(
        found['twist.twist.angular'], np.tile(turn.inv().apply([0.1, 0.2, 0.3]), (N, 1)))
    covariance = found['twist.covariance'][0].reshape(6, 6)
    np.testing.assert_allclose(np.diag(covariance).sum(), 21.0)
    assert (abs(covariance[0, 1]) > 0.1) == turned  # the one of x and y is turned, too


def test_samples_that_are_no_numbers_and_a_stamp_of_zero_are_counted(tmp_path, capsys):
    def change(i, imu):
        imu.header.stamp.sec, imu.header.stamp.nanosec = 0, 10_000_000 * i
        if i % 5 == 0:
            imu.linear_acceleration.z = np.nan
    with BagWriter(tmp_path / 'theirs') as writer:
        writer.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for i in range(N):
            writer.write('/imu', raw('sensor_msgs/msg/Imu', i, change), 10_000_000 * i)
    assert main([str(tmp_path / 'theirs'), str(tmp_path / 'ours'),
                 '--map', '/imu:=imu/data_raw']) == 0
    said = capsys.readouterr().out
    assert 'not finite imu/data_raw: 10' in said and 'unstamped' not in said


@pytest.mark.parametrize('sensor', ['the gyro', 'the attitude of onboard/odom', ''])
def test_of_flipped_poses_those_are_kept_that_turn_as_a_sensor(tmp_path, capsys, sensor):
    """The body is turned by a half turn in 9 of 12 s."""
    t = 0.01 * np.arange(1200)
    turn = Rotation.from_euler('ZYX', np.column_stack([
        0.5 * np.sin(0.7 * t), 0.2 * np.sin(2.1 * t), 0.2 * np.cos(1.7 * t)]))
    wrong = (t > 1.0) & (t < 5.0) | (t > 5.5) & (t < 9.0) | (t > 10.5)
    seen = turn * Rotation.from_euler('z', np.where(wrong, np.pi, 0.0)[:, None])
    rates = np.append((turn[:-1].inv() * turn[1:]).as_rotvec() / 0.01, [[0.0] * 3], axis=0)

    def change(i, out):
        """Set the turning of one message."""
        if hasattr(out, 'angular_velocity'):
            out.angular_velocity = make('geometry_msgs/msg/Vector3', **dict(zip('xyz', rates[i])))
            return
        q = seen[i] if hasattr(out.pose, 'position') else turn[i]
        place = getattr(out.pose, 'pose', out.pose)
        place.position.x, place.position.y = 1e-3 * i, 0.0
        place.orientation = make(
            'geometry_msgs/msg/Quaternion', **dict(zip('xyzw', q.as_quat())))

    names = {'/p': TYPES['/vrpn/mambo/pose'], '/odom': TYPES['/odom'], '/imu': TYPES['/imu']}
    source = foreign(tmp_path / 'theirs', names, change, count=len(t))
    maps = {'the gyro': ['--map', '/imu:=imu/data_raw'], '': []}.get(
        sensor, ['--map', '/odom:=onboard/odom'])
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/p:=optitrack/pose', *maps]) == 0
    said, = (line for line in capsys.readouterr().out.splitlines() if 'symmetric' in line)
    assert said.endswith(f'Those kept turn as {sensor} does' if sensor else 'without symmetry')
    kept = ~wrong if sensor else wrong
    ours = read_bag(tmp_path / 'bag')['optitrack/pose']
    np.testing.assert_array_equal(ours.stamp, EPOCH + 10_000_000 * np.flatnonzero(kept))


def test_impossible_poses_are_left_out_and_counted(tmp_path, capsys):
    source = foreign(tmp_path / 'theirs', {'/p': TYPES['/vrpn/mambo/pose']}, moved)
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/p:=optitrack/pose']) == 0
    said = capsys.readouterr().out
    assert 'optitrack/pose: 5 impossible poses left out, reached faster than' in said
    ours = read_bag(tmp_path / 'bag')['optitrack/pose']
    i = np.delete(np.arange(N), range(20, 25))
    np.testing.assert_array_equal(ours.stamp, EPOCH + 10_000_000 * i)
    np.testing.assert_allclose(ours.position[:, 0], 0.01 * i)


def test_frozen_poses_are_left_out_and_those_on_both_sides_stay(tmp_path, capsys):
    def change(i, stamped):
        at = 20 if 20 <= i <= 30 else i
        stamped.pose.position.x, stamped.pose.position.y = 0.01 * at, 0.02 * at
    source = foreign(tmp_path / 'theirs', {'/p': TYPES['/vrpn/mambo/pose']}, change)
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/p:=optitrack/pose']) == 0
    assert 'optitrack/pose: 10 frozen poses left out, equal to' in capsys.readouterr().out
    ours = read_bag(tmp_path / 'bag')['optitrack/pose']
    i = np.delete(np.arange(N), range(21, 31))
    np.testing.assert_array_equal(ours.stamp, EPOCH + 10_000_000 * i)


def test_repeated_stamps_are_counted(tmp_path, capsys):
    def change(i, out):
        out.header.stamp = header(i // 10 * 10).stamp

    source = foreign(tmp_path / 'theirs', {'/p': TYPES['/vrpn/mambo/pose']}, change)
    assert main([str(source), str(tmp_path / 'bag'), '--map', '/p:=optitrack/pose']) == 0
    assert 'repeated optitrack/pose: 45' in capsys.readouterr().out
    assert len(read_bag(tmp_path / 'bag')['optitrack/pose']) == N


def test_an_echo_that_never_came_back_is_no_wrong_unit(tmp_path):
    def change(i, out):
        out.range = float('inf') if i % 2 else 1.5

    source = foreign(tmp_path / 'theirs', {'/range': TYPES['/range']}, change)
    counts, *_ = import_bag(source, tmp_path / 'bag', {'/range': 'sonar/range'})
    assert counts == {'/mambo/sonar/range': N}


def test_topics_that_are_not_mapped_are_named(bag, tmp_path, capsys):
    assert main([str(bag), str(tmp_path / 'bag'), '--map', '/imu:=imu/data_raw']) == 0
    assert 'not used: /amcl, /chatter, /odom, ' in capsys.readouterr().out


def test_a_bag_of_ros_1_is_told_what_to_do(tmp_path, capsys):
    (tmp_path / 'old.bag').write_bytes(b'#ROSBAG V2.0' + bytes(99))
    refuse(tmp_path / 'old.bag', tmp_path, capsys, 'rosbags-convert', '/imu:=imu/data_raw')
    long = tmp_path / ('x' * 300)
    refuse(long, tmp_path, capsys, 'cannot be read', '/imu:=imu/data_raw')


@pytest.mark.parametrize('mode', [
    CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_a_damaged_file_gives_one_line_or_a_bag(tmp_path, capfd, mode):
    topics = {'/imu': TYPES['/imu'], '/chatter': TYPES['/chatter']}
    file = next(path for path in recorded(tmp_path / 'theirs', mode=mode, topics=topics).iterdir()
                if '.db3' in path.name)
    (tmp_path / 'theirs' / 'metadata.yaml').unlink()
    content, rng = file.read_bytes(), random.Random(str(mode))
    arguments = [str(file), '--map', '/imu:=imu/data_raw']
    assert check(main, arguments, tmp_path / 'out', capfd)
    for _ in range(20):
        file.write_bytes(mutated(rng, content))
        check(main, arguments, tmp_path / 'out', capfd)


def test_the_list_says_what_each_topic_could_become(bag, capsys):
    assert main([str(bag)]) == 0
    lines = capsys.readouterr().out.splitlines()
    row = next(i for i, line in enumerate(lines) if '/vicon/mambo' in line)
    assert 'geometry_msgs/msg/TransformStamped' in lines[row] and ' 50 ' in lines[row]
    assert 'could be optitrack/pose, onboard/reference' in lines[row + 1]
    assert 'could be imu/data_raw' in '\n'.join(lines)
    assert len(TARGETS) == 12


def test_the_bag_says_where_it_came_from(bag, tmp_path):
    import_bag(bag, tmp_path / 'bag', {'/imu': 'imu/data_raw'})
    record = read_bag(tmp_path / 'bag').metadata['import']
    assert record['source_file'] == 'theirs' and len(record['source_sha256']) == 64
    assert record['map imu/data_raw'] == '/imu (sensor_msgs/msg/Imu)'


def refuse(path, tmp_path, capsys, text, *maps):
    arguments = [str(path), str(tmp_path / 'out')]
    for entry in maps:
        arguments += ['--map', entry]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith('import_bag: ') and error.count('\n') == 1, error
    assert text in error
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('maps,text', [
    (['/nothing:=imu/data_raw'], 'no topic /nothing; it has /amcl, '),
    (['/imu:=imu'], 'imu is not one of our topics: optitrack/pose'),
    (['/imu:=optitrack/pose'], '/imu is a sensor_msgs/msg/Imu, which cannot become'),
    (['/vrpn/mambo/pose:=onboard/odom'], 'which cannot become onboard/odom'),
    (['/amcl:=optitrack/pose', '/odom:=optitrack/pose'], 'optitrack/pose is mapped to twice'),
    (['/odom:=onboard/odom', '/odom:=estimate/odom'], 'a topic is mapped twice')])
def test_a_map_that_does_not_fit_is_refused(bag, tmp_path, capsys, maps, text):
    refuse(bag, tmp_path, capsys, text, *maps)


def test_what_is_no_sound_bag_is_named_in_one_line(bag, tmp_path, capsys):
    entry = '/imu:=imu/data_raw'
    refuse(tmp_path / 'none', tmp_path, capsys, 'no such bag', entry)
    (tmp_path / 'empty.mcap').touch()
    refuse(tmp_path / 'empty.mcap', tmp_path, capsys, 'the file is empty', entry)
    (tmp_path / 'text.mcap').write_text('hello ' * 99)
    refuse(tmp_path / 'text.mcap', tmp_path, capsys, 'not an MCAP file', entry)
    whole = (bag / 'theirs_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(whole[:len(whole) // 2])
    refuse(tmp_path / 'cut.mcap', tmp_path, capsys, 'save what is readable with', entry)
    at = whole.rindex(b'sensor_msgs/msg/Imu')  # in what the end of the file repeats
    (tmp_path / 'end.mcap').write_bytes(whole[:at] + b'\xff' + whole[at + 1:])
    refuse(tmp_path / 'end.mcap', tmp_path, capsys, 'save what is readable with', entry)
    (tmp_path / 'text.db3').write_text('hello ' * 99)
    refuse(tmp_path / 'text.db3', tmp_path, capsys, 'no rosbag2 file, or damaged', entry)
    (tmp_path / 'empty.db3').touch()
    refuse(tmp_path / 'empty.db3', tmp_path, capsys, 'no rosbag2 file, or damaged', entry)
    refuse(tmp_path / 'none.db3', tmp_path, capsys, 'no such bag', entry)
    (tmp_path / 'missing').mkdir()
    (tmp_path / 'missing' / 'metadata.yaml').write_text(
        (sqlite_bag(tmp_path / 'listed') / 'metadata.yaml').read_text())
    refuse(tmp_path / 'missing', tmp_path, capsys, 'listed in metadata.yaml, but missing', entry)
    whole = (sqlite_bag(tmp_path / 'good') / 'good_0.db3').read_bytes()
    (tmp_path / 'cut.db3').write_bytes(whole[:len(whole) // 2])
    refuse(tmp_path / 'cut.db3', tmp_path, capsys, 'no rosbag2 file, or damaged', entry)
    nothing = sqlite_bag(tmp_path / 'nothing', {})
    refuse(nothing, tmp_path, capsys, 'has no messages', entry)
    other = sqlite_bag(tmp_path / 'other', form='protobuf')
    refuse(other, tmp_path, capsys, "encoded as 'protobuf', only cdr is read", entry)


def test_an_existing_bag_is_never_overwritten_and_wrong_usage_is_exit_code_2(
        bag, tmp_path, capsys):
    (tmp_path / 'out').mkdir()
    assert main([str(bag), str(tmp_path / 'out'), '--map', '/imu:=imu/data_raw']) == 2
    assert 'exists: give another name' in capsys.readouterr().err
    assert main([str(bag), '--map', '/a:=b']) == 2
    for words in ([str(tmp_path / 'new')], ['--time', 'log']):
        capsys.readouterr()
        assert main([str(bag), *words]) == 2
        assert 'has no effect, as without --map the topics are only' in capsys.readouterr().err
    for arguments in ([], [str(bag), 'out', '--map', '/imu']):
        with pytest.raises(SystemExit) as usage:
            main(arguments)
        assert usage.value.code == 2


@needs_data
def test_a_real_recording_of_motion_capture(tmp_path):
    source = DATA / 'cub_stabilize_2025_11_13.mcap'
    counts, *_ = import_bag(source, tmp_path / 'bag', {'/cub1/pose': 'optitrack/pose'})
    assert counts == {'/mambo/optitrack/pose': 19703}
    ours, theirs = read_bag(tmp_path / 'bag')['optitrack/pose'], read_bag(source)['/cub1/pose']
    for field in ('stamp', 'log_time', 'position', 'orientation'):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    assert (np.diff(ours.t) > 0.02).sum() == 33


@needs_data
def test_the_test_bags_of_rosbag2(capsys):
    folder = DATA / 'rosbag2_tests'
    for path in sorted(folder.iterdir()):
        expected = 1 if path.name == 'wrong_rmw_test' else 0
        assert main([str(path)]) == 2 * expected, path
        captured = capsys.readouterr()
        assert captured.err.count('\n') == expected
    assert main([str(folder / 'wrong_rmw_test')]) == 2
    assert "encoded as 'wrong_format', only cdr is read" in capsys.readouterr().err


def test_a_line_on_turned_poses_is_printed_as_it_is(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(assignments, 'describe', lambda *_: ['turned; kept', 'long'])
    asked = ['--map', '/vrpn/mambo/pose:=optitrack/pose']
    assert main([str(bag), str(tmp_path / 'bag'), *asked]) == 0
    assert '  turned; kept\n  long\n' in capsys.readouterr().out
