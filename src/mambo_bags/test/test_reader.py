"""Reading bags: our own against two other readers, those of rosbag2, and what is no bag."""

from pathlib import Path
import pickle
import time

from mambo_bags import columns
from mambo_bags.reader import BagError, read_bag
from mambo_bags.writer import BagWriter
from mambo_ros import diagnostics, messages
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from synthetic import E_TOTAL, make_flight, Maker, SIMULATED, STEP, truth_position
import zstandard

DATA = Path(__file__).resolve().parents[4] / 'shared' / 'data' / 'mcap_bags'
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason='recordings of rosbag2 are not beside the repo')


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 2.0)


def test_columns_equal_what_rosbags_decodes_message_by_message(flight):
    bag = read_bag(flight)
    checked = 0
    with AnyReader([flight]) as reader:
        for topic in SIMULATED:
            connections = [c for c in reader.connections if c.topic == f'/mambo/{topic}']
            others = [reader.deserialize(raw, c.msgtype)
                      for c, _, raw in reader.messages(connections)]
            ours = bag[topic]
            assert 'table' not in vars(ours) and len(ours) == len(others)  # decoded when asked for
            assert ours.stamp.tolist() == [
                m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in others]
            assert ours._objects is None  # by columns, not by objects
            for path in ours._columns:
                values = []
                for value in others:
                    for name in path.split('.'):
                        value = getattr(value, name)
                    values.append(value)
                np.testing.assert_array_equal(ours[path], np.array(values))
                checked += 1
    assert checked > 150


def test_a_bag_can_be_pickled_before_and_after_it_was_decoded(flight):
    bag = read_bag(flight)
    whole = [pickle.loads(pickle.dumps(bag))]
    bag['imu/data_raw'].acceleration, list(bag['estimate/odom'].objects())
    whole.append(pickle.loads(pickle.dumps(bag)))
    for found in whole:
        assert found.topics == bag.topics and found.path == bag.path
        for topic in SIMULATED:
            assert found[topic].raw == bag[topic].raw
            np.testing.assert_array_equal(found[topic].stamp, bag[topic].stamp)
        np.testing.assert_array_equal(
            found['estimate/odom'].position, bag['estimate/odom'].position)


def test_vectors_and_quaternions_come_whole_and_in_the_frames_of_the_wire(flight):
    bag = read_bag(flight)
    truth = bag['ground_truth/odom']
    np.testing.assert_allclose(truth.position, truth_position(truth.t), atol=1e-15)
    assert truth.position[-1, 2] > 0.3  # z up
    assert truth.orientation[0].tolist() == [0.0, 0.0, 0.0, 1.0]  # x y z w
    assert truth.velocity.shape == truth.angular_velocity.shape == (400, 3)
    assert bag['estimate/odom'].pose_covariance.shape == (400, 36)
    assert bag['imu/data_raw'].acceleration[5].tolist() == [0.0, 0.0, 9.81]
    assert bag['motor_pwm'].pwm.shape == (400, 4)
    assert bag['motor_pwm'].shutdown.dtype == bool
    assert bag['sonar/range'].range.dtype == np.float32
    assert set(bag['reference']['header.frame_id']) == {'odom'}
    assert bag['reference'].constant('PHASE_TRACK') == 2
    error = bag['estimate/odom'].position - truth.position
    np.testing.assert_allclose(np.linalg.norm(error, axis=1), E_TOTAL, atol=1e-12)


def test_names_are_relative_to_the_only_drone_or_absolute(flight):
    bag = read_bag(flight)
    assert bag.namespace == '/mambo'
    assert bag['motor_pwm'] is bag['/mambo/motor_pwm'] is bag.messages('motor_pwm')
    assert 'motor_pwm' in bag and 'onboard/odom' not in bag
    with pytest.raises(BagError, match='no topic /mambo/onboard/odom; it has /mambo/barometer'):
        bag['onboard/odom']
    with pytest.raises(BagError, match='flight: a topic is a name, not 3$'):
        bag[3]
    with pytest.raises(AttributeError, match='has no field thrust; .* has header, pwm'):
        bag['motor_pwm'].thrust


def test_two_drones_must_be_told_apart(tmp_path):
    maker = Maker(tmp_path / 'two', ())
    for name in ('/a', '/b'):
        maker.writer.add_topic(f'{name}/motor_pwm', 'mambo_interfaces/msg/MotorPwm')
    for ns, name in ((0, '/a'), (STEP, '/b')):
        maker.writer.write(f'{name}/motor_pwm', maker.message('motor_pwm', ns), ns)
    maker.writer.close()
    with pytest.raises(BagError, match='several drones, in the namespaces /a, /b; choose one'):
        read_bag(tmp_path / 'two')
    for name in ('/b', 'b/'):
        assert read_bag(tmp_path / 'two', namespace=name)['motor_pwm'].stamp.tolist() == [STEP]
    with pytest.raises(BagError, match='nothing in the namespace /c'):
        read_bag(tmp_path / 'two', namespace='/c')


def test_only_wanted_topics_are_kept_and_attachments_always(flight):
    bag = read_bag(flight, topics=('motor_pwm',))
    assert 'motor_pwm' in bag and 'reference' not in bag and '/mambo/reference' in bag.topics
    bare = read_bag(flight, topics=())
    assert not any(topic in bare for topic in SIMULATED)
    assert bare.attachments['scenario.yaml'].startswith('/mambo/reference_node')
    assert bare.scenario['/mambo/reference_node']['ros__parameters']['plan']['start_time'] == 5.0
    assert bare.custom_data == {'real_time_factor': '4.25'}


def test_messages_of_different_lengths_fall_back_to_objects(tmp_path):
    maker = Maker(tmp_path / 'mixed', ('motor_pwm', 'imu/data_raw'))
    for step, frame in enumerate(('a', 'bcdef', '')):
        maker.write('motor_pwm', step * STEP, frame=frame, pwm=np.full(4, float(step)))
    for step, frame in enumerate(('abc', 'abd', 'abe')):
        maker.write('imu/data_raw', step * STEP, frame=frame)
    maker.writer.close()
    bag = read_bag(tmp_path / 'mixed')
    pwm, imu = bag['motor_pwm'], bag['imu/data_raw']
    assert pwm['header.frame_id'].tolist() == ['a', 'bcdef', '']
    assert pwm._objects is not None and pwm.pwm[:, 0].tolist() == [0.0, 1.0, 2.0]
    assert pwm.stamp.tolist() == [0, STEP, 2 * STEP]
    assert imu['header.frame_id'].tolist() == ['abc', 'abd', 'abe'] and imu._objects is None


def test_what_the_middleware_leaves_behind_a_message_does_no_harm(tmp_path):
    store = columns.load_types(['sensor_msgs/msg/JointState'])
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/joints', 'sensor_msgs/msg/JointState')
    for step, effort in enumerate(([1.5], [2.5, 3.5])):
        message = columns.zero(store, 'sensor_msgs/msg/JointState', effort=np.array(effort))
        data = bytes(store.serialize_cdr(message, 'sensor_msgs/msg/JointState'))
        writer.write('/joints', data + b'\x17' * 8, step)
    writer.close()
    joints = read_bag(tmp_path / 'b')['/joints']
    assert [value.tolist() for value in joints.effort] == [[1.5], [2.5, 3.5]]


def test_strings_of_equal_total_length_but_other_layout_are_not_misread(tmp_path):
    # Odometry has two strings; one longer, one shorter keeps the length and moves the fields
    maker = Maker(tmp_path / 'b', ('estimate/odom',))
    for step, (frame, child) in enumerate((('odom', 'base_link_xyz'), ('odom_xyz', 'base_link'))):
        maker.write('estimate/odom', step * STEP, frame=frame, child_frame_id=child,
                    pose=maker.store.types['geometry_msgs/msg/PoseWithCovariance'](
                        maker.pose((1.0, 2.0, 3.0)), np.zeros(36)))
    maker.writer.close()
    odometry = read_bag(tmp_path / 'b')['estimate/odom']
    assert len(set(map(len, odometry.raw))) == 1
    np.testing.assert_array_equal(odometry.position, [[1.0, 2.0, 3.0]] * 2)
    assert odometry._objects is not None


def test_sequences_of_messages_are_reached_by_index(tmp_path):
    store = columns.load_types(['diagnostic_msgs/msg/DiagnosticArray'])
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    for step in range(3):
        status = columns.zero(
            store, 'diagnostic_msgs/msg/DiagnosticStatus', level=step, name='sim')
        message = columns.zero(store, 'diagnostic_msgs/msg/DiagnosticArray', status=[status])
        writer.write('/diagnostics', bytes(store.serialize_cdr(
            message, 'diagnostic_msgs/msg/DiagnosticArray')), step)
    writer.close()
    found = read_bag(tmp_path / 'b')['/diagnostics']
    assert found['status[0].level'].tolist() == [0, 1, 2]
    assert found['status[0].name'].tolist() == ['sim'] * 3


def test_a_minute_of_flight_reads_in_seconds(tmp_path):
    topics = [t for t in SIMULATED if t not in ('sonar/range', 'optitrack/pose')]
    maker = Maker(tmp_path / 'long', topics)
    raw = {topic: maker.message(topic, 0) for topic in topics}
    for ns in range(0, 60 * 10**9, STEP):
        stamp = b''.join(v.to_bytes(4, 'little') for v in divmod(ns, 10**9))
        for topic in topics:
            maker.writer.write(
                f'/mambo/{topic}', raw[topic][:4] + stamp + raw[topic][12:], ns)
    maker.writer.close()
    began = time.process_time()
    bag = read_bag(tmp_path / 'long')
    for topic in topics:
        assert bag[topic].stamp[-1] == 60 * 10**9 - STEP
    assert bag['estimate/odom'].position.shape == (12000, 3)
    # some 0.7 s of processor time; the bound has room for a slow and busy machine
    assert time.process_time() - began < 4.0


@needs_data
def test_a_real_recording_of_rosbag2_is_read():
    bag = read_bag(DATA / 'cub_stabilize_2025_11_13.mcap')
    pose = bag['/cub1/pose']
    assert (len(pose), bag.namespace) == (19703, '')
    norm = np.linalg.norm(pose.orientation, axis=1)
    np.testing.assert_allclose(norm, 1.0, atol=1e-6)  # float32 inside the mocap
    assert pose.t[0] == pytest.approx(1763073169.9, abs=1.0)


@needs_data
def test_a_bag_of_several_files_is_one_bag_in_order():
    bag = read_bag(DATA / 'rosbag2_tests' / 'multiple_files')
    chatter = bag['/chatter']
    assert len(chatter) == 3177 and (np.diff(chatter.log_time) > 0).all()
    assert bag['/chatter'].data[0] == 'test'


@needs_data
def test_every_test_bag_of_rosbag2_is_read_or_refused_in_one_line():
    for path in sorted((DATA / 'rosbag2_tests').iterdir()):
        bag = read_bag(path)
        for topic, found in ((t, bag[t]) for t in bag.topics if t in bag):
            try:
                assert len(found.stamp) == len(found)
            except BagError as error:
                assert '\n' not in str(error) and topic in str(error)


@needs_data
def test_messages_in_another_encoding_are_refused_by_name():
    bag = read_bag(DATA / 'rosbag2_tests' / 'wrong_rmw_test')
    with pytest.raises(BagError, match="encoded as 'wrong_format', only cdr is read"):
        bag['/test_topic'].stamp


def test_what_is_no_bag_is_named(tmp_path, flight):
    def refuse(path, text):
        with pytest.raises(BagError, match=text) as caught:
            read_bag(path)
        assert '\n' not in str(caught.value) and str(path) in str(caught.value)

    refuse(tmp_path / 'none', 'no such bag')
    refuse(tmp_path, 'not a bag; give a rosbag2 directory or an .mcap file')
    text = tmp_path / 'notes.txt'
    text.write_text('hello')
    refuse(text, 'not an MCAP file')
    (tmp_path / 'empty.mcap').touch()
    refuse(tmp_path / 'empty.mcap', 'the file is empty')
    refuse(flight / 'metadata.yaml', 'give the directory of the bag')
    silent = Maker(tmp_path / 'silent', ('motor_pwm',))
    silent.writer.close()
    refuse(tmp_path / 'silent', 'has no messages')


@pytest.mark.parametrize('listing, text', [
    ('][', 'not the metadata of a rosbag2 bag'), ('a: 1', 'not the metadata of a rosbag2 bag'),
    ('rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}', 'but missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: []}', 'not a bag'),
    ('rosbag2_bagfile_information: {relative_file_paths: 3}', 'not the metadata'),
    ('rosbag2_bagfile_information: {relative_file_paths: [3]}', 'not a list of names'),
    ('rosbag2_bagfile_information: {relative_file_paths: ["a\\0"]}', 'not a list of names'),
    ('rosbag2_bagfile_information: [1]', 'it has no rosbag2_bagfile_information'),
    ('rosbag2_bagfile_information: {version: 9}', 'relative_file_paths is missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: [], storage_identifier: [1]}',
     'storage_identifier is not a name'),
    ('rosbag2_bagfile_information: {relative_file_paths: [], compression_mode: 1}',
     'compression_mode is not a name'),
    ('rosbag2_bagfile_information: {relative_file_paths: [], custom_data: 1}',
     'custom_data is not names and values'),
    ('rosbag2_bagfile_information: {version: 2001-13-45}', 'month must be in 1..12'),
    ('[' * 1000, 'nested deeper than 64 levels'), ('\0', 'not the metadata'),
    ('rosbag2_bagfile_information: {relative_file_paths: [a.db3], storage_identifier: sqlite3}',
     'import its topics with mambo import bag')])
def test_broken_listings_are_named(tmp_path, listing, text):
    (tmp_path / 'metadata.yaml').write_text(listing)
    with pytest.raises(BagError, match=text):
        read_bag(tmp_path)


@pytest.mark.parametrize('data, text', [
    (zstandard.compress(bytes(9 << 20)), r'MAMBO_MAX_UNPACKED_MB .now 5. raises the limit'),
    (zstandard.compress(bytes(999))[:-2], 'a compressed message: '),
    (zstandard.compress(bytes(999))[:4] + bytes(40), 'a compressed message: ')])
def test_a_compressed_message_that_cannot_be_unpacked_is_named(
        tmp_path, monkeypatch, data, text):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '5')
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/chatter', 'std_msgs/msg/Header')
        bag.write('/chatter', data, 0)
    with pytest.raises(BagError, match=text):
        read_bag(tmp_path / 'bag')


def test_a_bag_that_was_never_closed_points_to_recover(tmp_path, flight):
    content = (flight / 'flight_0.mcap').read_bytes()
    for size in (len(content) // 2, len(content) - 4, 60):
        cut = tmp_path / f'cut{size}.mcap'
        cut.write_bytes(content[:size])
        with pytest.raises(BagError, match=r'save what is readable with: .* recover'):
            read_bag(cut)


def test_a_flipped_bit_is_noticed(tmp_path, flight):
    content = bytearray((flight / 'flight_0.mcap').read_bytes())
    content[content.index(b'zstd') + 500] ^= 4
    (tmp_path / 'bad.mcap').write_bytes(content)
    with pytest.raises(BagError, match='chunk at byte .*recover'):
        read_bag(tmp_path / 'bad.mcap')


def test_a_message_that_is_not_its_type_is_named(tmp_path):
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/mambo/motor_pwm', 'mambo_interfaces/msg/MotorPwm')
    writer.write('/mambo/motor_pwm', b'\0\1\0\0\1', 0)
    writer.close()
    with pytest.raises(BagError, match='b: /mambo/motor_pwm: message 0 is not a mambo'):
        read_bag(tmp_path / 'b')['motor_pwm'].pwm


def test_a_report_that_claims_more_than_it_holds_is_left_out(tmp_path):
    good = diagnostics.report(0, 'sim_node', diagnostics.OK, 'well', {})
    bad = bytes.fromhex('00010000000000000000000001000000ffffffff00000000')
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    for t, data in enumerate([good, bad, good]):
        writer.write('/diagnostics', data, t)
    writer.close()
    kept = read_bag(tmp_path / 'b')['/diagnostics'].readable()
    assert kept.log_time.tolist() == [0, 2] and len(list(kept.objects())) == 2
    assert kept.readable() is kept


@pytest.mark.parametrize('bad', [b'\0\1\0\0\1', b'\0\1\0\0' + bytes(70_000)])
def test_messages_that_are_not_their_type_are_left_out_with_a_note(tmp_path, bad):
    good = messages.motor_pwm(5 * 10**6, (1.0, 2.0, 3.0, 4.0), True, 0)
    writer = BagWriter(tmp_path / 'b')
    for name in ('/mambo/motor_pwm', '/mambo/motor_pwm_raw'):
        writer.add_topic(name, 'mambo_interfaces/msg/MotorPwm')
    for number, data in enumerate([good, bad, good, bad]):
        writer.write('/mambo/motor_pwm', data, number * 10**6)
        writer.write('/mambo/motor_pwm_raw', good, number * 10**6)
    writer.close()
    bag = read_bag(tmp_path / 'b')
    bag.leave_out_unreadable()
    assert bag.notes == ['2 of 4 messages of /mambo/motor_pwm are not a '
                         'mambo_interfaces/msg/MotorPwm: left out']
    assert bag['motor_pwm'].log_time.tolist() == [0, 2 * 10**6]
    assert bag['motor_pwm'].pwm.tolist() == [[1.0, 2.0, 3.0, 4.0]] * 2
    assert len(bag['motor_pwm_raw']) == 4
    bag.leave_out_unreadable()
    assert len(bag.notes) == 1


def test_a_field_or_constant_that_is_not_there_is_named_in_whatever_way_it_is_asked_for(flight):
    reference = read_bag(flight)['reference']
    for ask in (lambda: reference.nonsense, lambda: reference['nonsense'],
                lambda: reference.constant('NONSENSE')):
        with pytest.raises(BagError, match='has no .* NONSENSE|has no field nonsense') as refused:
            ask()
        assert isinstance(refused.value, KeyError) and isinstance(refused.value, AttributeError)
        assert not str(refused.value).startswith(('"', "'"))
    assert not hasattr(reference, 'nonsense')


@pytest.mark.parametrize('path', [
    5, None, (1, 2), slice(2), '', '[', '[a]', '[-1]', 'pose.covariance[36]',
    'pose.covariance[a]', 'pose.covariance.x', 'header.stamp[0]', 'header.frame_id[0]',
    'pose..pose', 'pose.covariance['])
def test_what_is_no_name_of_a_field_is_refused(flight, path):
    estimate = read_bag(flight)['estimate/odom']
    with pytest.raises(BagError, match='^/mambo/estimate/odom'):
        estimate[path]
    assert len(estimate['pose.covariance[35]']) == len(estimate)


def test_arrays_of_arrays_of_arrays_are_not_walked_beyond_their_bytes(tmp_path):
    parts = [f'MSG: a/L{k}\na/L{k + 1}[200] x' for k in range(1, 6)] + ['MSG: a/L6\nuint8 x']
    text = f'\n{"=" * 80}\n'.join(['a/L1[200] x', *parts])
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', 'a/msg/L0', schema=text.encode(), type_hash='')
        bag.write('/a', b'\0\1\0\0' + bytes(100), 0)
    began = time.process_time()
    with pytest.raises(BagError, match='message 0 is not a a/msg/L0'):
        read_bag(tmp_path / 'bag')['/a']['x[0]']
    assert time.process_time() - began < 5.0


def test_a_type_that_holds_itself_is_refused(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', 'a/msg/A', schema=b'a/A x', type_hash='')
        bag.write('/a', b'\0\1\0\0' + bytes(100), 0)
    with pytest.raises(BagError):
        read_bag(tmp_path / 'bag')['/a']['x']


def swapped(tmp_path, start, stated, kept):
    """Return the notes of a bag whose metadata.yaml is of another one, by numbers of messages."""
    bags = [tmp_path / f'{start}_{n}' for n in (stated, kept)]
    for bag, n in zip(bags, (stated, kept)):
        with BagWriter(bag) as writer:
            for name in ('/a', '/tf'):
                writer.add_topic(name, 'std_msgs/msg/Empty', [])
            for name in ('/a', '/tf'):
                for k in range(n if name == '/tf' else 3):
                    writer.write(name, bytes(4), start + k, start + k)
            writer.close()
        assert read_bag(bag).notes == []
    theirs, ours = (next(bag.glob('*.mcap')) for bag in bags)
    theirs.write_bytes(ours.read_bytes())
    return read_bag(bags[0], ()).notes


def test_metadata_of_another_bag_is_noted(tmp_path):
    assert swapped(tmp_path, 0, 5, 15) == [
        'metadata.yaml says 5 messages of /tf, the file has 15: the file may be of another bag']
    assert 'says 16 messages of /tf, the file has 6' in swapped(tmp_path, 0, 16, 6)[0]
    assert 'says 7 messages of /tf, the file has 17' in swapped(tmp_path, 10**18, 7, 17)[0]
    assert swapped(tmp_path, 10**18, 18, 8) == []  # by the clock, from the same moment on: cut


@needs_data
def test_recordings_of_rosbag2_have_no_note():
    bags = [file.parent for file in DATA.rglob('metadata.yaml')]
    read = []
    for bag in bags:
        try:
            read.append(read_bag(bag, ()).notes)
        except BagError:  # of another storage, or damaged on purpose
            continue
    assert read and not any(read)
