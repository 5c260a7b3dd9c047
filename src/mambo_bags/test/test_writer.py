"""The bag writer against three independent readers, shuffled arrival, killing and careless use."""

from pathlib import Path
import random
import resource
import signal
import subprocess
import sys

from mambo_bags import message_definition
from mambo_bags.recover import recover
from mambo_bags.writer import (
    BagWriter, BagWriterError, GRACE, Qos, SECOND, SENSOR_DATA, TRANSIENT_LOCAL)
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
import yaml

DATA = Path(__file__).resolve().parents[4] / 'shared' / 'data'
TYPES = {
    '/mambo/sonar/range': 'sensor_msgs/msg/Range', '/mambo/motor_pwm':
    'mambo_interfaces/msg/MotorPwm', '/clock': 'rosgraph_msgs/msg/Clock'}
STEP = 5_000_000


@pytest.fixture(scope='module')
def store():
    types = get_typestore(Stores.EMPTY)
    for name in TYPES.values():
        types.register(get_types_from_msg(message_definition.full_text(name), name))
    return types


def payloads(store, seconds=3.0):
    """Return (topic, bytes, stamp ns) of some seconds: clock and PWM each step, sonar rarely."""
    types, out = store.types, []
    for step in range(round(seconds * 200)):
        ns = step * STEP
        stamp = types['builtin_interfaces/msg/Time'](*divmod(ns, SECOND))
        header = types['std_msgs/msg/Header'](stamp, 'base_link')
        messages = {
            '/clock': types['rosgraph_msgs/msg/Clock'](stamp),
            '/mambo/motor_pwm': types['mambo_interfaces/msg/MotorPwm'](
                header, 100.0 + step + np.arange(4.0), False, 0)}
        if step % 9 == 0:
            messages['/mambo/sonar/range'] = types['sensor_msgs/msg/Range'](
                header, 0, 0.5, 0.3, 4.0, 1.0 + step / 1024.0, 0.0)
        out += [(topic, bytes(store.serialize_cdr(message, TYPES[topic])), ns)
                for topic, message in messages.items()]
    return out


def write(path, messages, topics=tuple(TYPES), **options):
    writer = BagWriter(path, **options)
    for topic in topics:
        writer.add_topic(topic, TYPES[topic])
    for topic, data, ns in messages:
        writer.write(topic, data, ns)
    writer.close()
    return writer


def data_file(path):
    return path / f'{path.name}_0.mcap'


def arrival(messages, seed):
    """Return messages as DDS may bring them: any order across topics, in order within one."""
    rng = random.Random(seed)
    delay = {topic: rng.randrange(0, GRACE // 2) for topic in TYPES}
    return sorted(messages, key=lambda m: (m[2] + delay[m[0]], m[0]))


def test_same_payloads_give_the_same_bytes_in_whatever_order_topics_arrive(tmp_path, store):
    messages = payloads(store)
    files = set()
    for seed in range(5):
        folder = tmp_path / str(seed) / 'flight'
        topics = list(TYPES)
        random.Random(seed).shuffle(topics)
        writer = write(folder, arrival(messages, seed), topics)
        assert writer.late == 0
        files.add((data_file(folder).read_bytes(), (folder / 'metadata.yaml').read_bytes()))
    assert len(files) == 1


def test_order_is_log_time_then_topic_name_then_arrival(tmp_path, store):
    data = payloads(store, 0.005)[0][1]
    writer = BagWriter(tmp_path / 'b')
    for topic in ('/z', '/a'):
        writer.add_topic(topic, 'rosgraph_msgs/msg/Clock')
    for topic, ns, mark in (('/z', 10, 1), ('/a', 20, 2), ('/a', 10, 3), ('/z', 10, 4)):
        writer.write(topic, data[:-1] + bytes([mark]), ns)
    writer.close()
    with data_file(tmp_path / 'b').open('rb') as stream:
        found = [(channel.topic, message.log_time, message.data[-1])
                 for _, channel, message in make_reader(stream).iter_messages(
                     log_time_order=False)]
    assert found == [('/a', 10, 3), ('/z', 10, 1), ('/z', 10, 4), ('/a', 20, 2)]


def test_rosbags_reads_every_message_and_its_times(tmp_path, store):
    messages = payloads(store)
    write(tmp_path / 'flight', messages)
    with AnyReader([tmp_path / 'flight']) as reader:
        found = [(connection.topic, bytes(raw), ns) for connection, ns, raw in reader.messages()]
        pwm = [reader.deserialize(raw, connection.msgtype)
               for connection, _, raw in reader.messages() if 'pwm' in connection.topic]
    assert sorted(found) == sorted(messages)
    assert pwm[7].pwm.tolist() == [107.0, 108.0, 109.0, 110.0]


def test_mcap_ros2_support_decodes_with_the_schemas_inside(tmp_path, store):
    write(tmp_path / 'flight', payloads(store))
    with data_file(tmp_path / 'flight').open('rb') as stream:
        found = list(make_reader(
            stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    sonar = [m for m in found if m.channel.topic == '/mambo/sonar/range']
    assert len(found) == 600 + 600 + 67
    assert sonar[3].decoded_message.range == 1.0 + 27 / 1024.0  # exact in float32
    assert sonar[3].message.log_time == sonar[3].message.publish_time == 27 * STEP


def test_publish_time_may_differ_from_log_time(tmp_path, store):
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/clock', TYPES['/clock'])
    writer.write('/clock', payloads(store, 0.005)[0][1], 70, 50)
    writer.close()
    with data_file(tmp_path / 'b').open('rb') as stream:
        (_, _, message), = make_reader(stream).iter_messages()
    assert (message.log_time, message.publish_time) == (70, 50)


def test_metadata_yaml_is_what_rosbag2_of_jazzy_writes(tmp_path, store):
    path = tmp_path / 'flight'
    writer = BagWriter(path)
    writer.add_topic('/mambo/sonar/range', TYPES['/mambo/sonar/range'], SENSOR_DATA)
    writer.add_topic('/mambo/motor_pwm', TYPES['/mambo/motor_pwm'], Qos(depth=100))
    writer.add_topic('/clock', TYPES['/clock'], TRANSIENT_LOCAL)
    for topic, data, ns in payloads(store, 1.0):
        if topic != '/clock':
            writer.write(topic, data, ns + 7 * SECOND)
    writer.close({'real_time_factor': '3.5'})
    text = (path / 'metadata.yaml').read_text()
    info = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert '&' not in text and list(info)[:2] == ['version', 'storage_identifier']
    assert (info['version'], info['storage_identifier'], info['ros_distro']) == (
        9, 'mcap', 'jazzy')
    assert info['starting_time']['nanoseconds_since_epoch'] == 7 * SECOND
    assert info['duration']['nanoseconds'] == 199 * STEP
    assert info['message_count'] == info['files'][0]['message_count'] == 200 + 23
    assert info['relative_file_paths'] == ['flight_0.mcap']
    assert info['custom_data'] == {'real_time_factor': '3.5'}
    topics = {entry['topic_metadata']['name']: entry
              for entry in info['topics_with_message_count']}
    assert list(topics) == ['/clock', '/mambo/motor_pwm', '/mambo/sonar/range']
    assert topics['/clock']['message_count'] == 0  # declared and silent: listed
    sonar = topics['/mambo/sonar/range']['topic_metadata']
    qos, = sonar['offered_qos_profiles']
    assert (qos['reliability'], qos['history'], qos['depth']) == ('best_effort', 'keep_last', 5)
    assert qos['lifespan'] == {'sec': 9223372036, 'nsec': 854775807}
    assert sonar['type_description_hash'].startswith('RIHS01_')
    with data_file(path).open('rb') as stream:
        channels = make_reader(stream).get_summary().channels.values()
    for channel in channels:  # the file alone says the same
        assert yaml.safe_load(channel.metadata['offered_qos_profiles']) == (
            topics[channel.topic]['topic_metadata']['offered_qos_profiles'])
        assert channel.metadata['topic_type_hash'] == (
            topics[channel.topic]['topic_metadata']['type_description_hash'])


def test_type_hash_is_that_of_an_independent_implementation():
    # rosbags computes the REP-2016 hash from the definition, we read the installed one
    types = get_typestore(Stores.ROS2_JAZZY)
    for name in ('sensor_msgs/msg/Imu', 'nav_msgs/msg/Odometry'):
        assert message_definition.type_hash(name) == types.hash_rihs01(name)


@pytest.mark.skipif(not DATA.is_dir(), reason='recordings of rosbag2 are not beside the repo')
def test_schema_equals_the_one_in_a_bag_of_rosbag2_itself():
    path = DATA / 'mcap_bags' / 'cub_stabilize_2025_11_13.mcap'
    with path.open('rb') as stream:
        schemas = make_reader(stream).get_summary().schemas.values()
    assert len(schemas) == 2
    for schema in schemas:
        assert schema.encoding == 'ros2msg'
        assert message_definition.full_text(schema.name).encode() == schema.data


def test_schema_holds_each_needed_type_once_behind_its_separator():
    # both Path and the PoseStamped in it have a Header
    text = message_definition.full_text('nav_msgs/msg/Path')
    heads = [line[5:] for line in text.splitlines() if line.startswith('MSG: ')]
    assert heads == [
        'geometry_msgs/PoseStamped', 'geometry_msgs/Pose', 'geometry_msgs/Point',
        'geometry_msgs/Quaternion', 'std_msgs/Header', 'builtin_interfaces/Time']
    assert text.count('\n' + '=' * 80 + '\nMSG: geometry_msgs/Point\n') == 1


def test_a_bag_without_messages_is_a_bag(tmp_path):
    write(tmp_path / 'empty', [])
    with AnyReader([tmp_path / 'empty']) as reader:
        assert reader.message_count == 0
        assert sorted(c.topic for c in reader.connections) == sorted(TYPES)


def test_attachments_and_metadata_come_back_and_carry_no_wall_clock(tmp_path, store):
    write(tmp_path / 'flight', payloads(store), metadata={'mambo': {'seed': '3'}},
          attachments={'scenario.yaml': 'a: 1\n', 'blob': b'\xff\x00'})
    with data_file(tmp_path / 'flight').open('rb') as stream:
        reader = make_reader(stream)
        attached = {a.name: a for a in reader.iter_attachments()}
        records = {m.name: m.metadata for m in reader.iter_metadata()}
    assert attached['scenario.yaml'].data == b'a: 1\n'
    assert attached['scenario.yaml'].media_type == 'application/yaml'
    assert attached['blob'].data == b'\xff\x00'
    assert all(a.create_time == a.log_time == 0 for a in attached.values())
    assert records['mambo'] == {'seed': '3'}
    inside = yaml.safe_load(records['rosbag2']['serialized_metadata'])
    assert inside['message_count'] == 1267


def test_names_that_are_not_utf_8_are_readable_in_a_bag(tmp_path, store):
    name = 'fl\udcfcg.json'
    write(tmp_path / 'flight', payloads(store), metadata={'import': {'source_file': name}},
          attachments={name: f'# {name}\n'})
    with data_file(tmp_path / 'flight').open('rb') as stream:
        reader = make_reader(stream)
        attached, = reader.iter_attachments()
        records = {m.name: m.metadata for m in reader.iter_metadata()}
    assert records['import'] == {'source_file': r'fl\xfcg.json'}
    assert (attached.name, attached.data) == (r'fl\xfcg.json', rb'# fl\xfcg.json' + b'\n')


def test_a_late_message_is_kept_and_counted(tmp_path, store):
    messages = payloads(store, 2.0)
    late = messages.pop(0)
    writer = write(tmp_path / 'flight', [*messages, late])
    assert writer.late == 1
    with AnyReader([tmp_path / 'flight']) as reader:
        assert reader.message_count == len(messages) + 1


def test_a_file_is_put_in_order_a_second_at_a_time(tmp_path, store, monkeypatch):
    messages = payloads(store, 8.0)
    late, held, write_until = messages.pop(0), [], BagWriter._write_until

    def watched(writer, end):
        held.append(len(writer._pending))
        write_until(writer, end)
    monkeypatch.setattr(BagWriter, '_write_until', watched)
    writer = write(tmp_path / 'flight', [*messages, late])
    assert writer.late == 1
    assert len(held) > 16 and max(held) < len(messages) / 3


def test_a_recorder_that_stalls_leaves_the_file_of_one_that_does_not(tmp_path, store):
    messages = payloads(store, 6.0)
    slow = max(TYPES)  # arrives after everything else, seconds late
    stalled = sorted(messages, key=lambda message: message[0] == slow)
    sound, late = write(tmp_path / 'sound', messages), write(tmp_path / 'late', stalled)
    assert sound.late == 0 < late.late
    assert data_file(tmp_path / 'sound').read_bytes() == data_file(tmp_path / 'late').read_bytes()
    assert sorted(file.name for file in (tmp_path / 'late').iterdir()) == [
        'late_0.mcap', 'metadata.yaml']


def test_seconds_are_whole_chunks_and_nothing_is_written_before_the_grace(tmp_path, store):
    path = tmp_path / 'flight'
    writer = BagWriter(path)
    for topic in TYPES:
        writer.add_topic(topic, TYPES[topic])
    sizes = {}
    for topic, data, ns in payloads(store, 3.0):
        writer.write(topic, data, ns)
        sizes[ns] = data_file(path).stat().st_size
    assert sizes[SECOND + GRACE - STEP] == sizes[0]
    assert sizes[SECOND + GRACE] > sizes[0]  # on disk, not in a buffer
    writer.close()
    with data_file(path).open('rb') as stream:
        chunks = [(r.message_start_time // SECOND, r.message_end_time // SECOND)
                  for r in StreamReader(stream, emit_chunks=True).records if isinstance(r, Chunk)]
    assert chunks == [(0, 0), (1, 1), (2, 2)]


KILLED = """
import os, signal, sys
from mambo_bags.writer import BagWriter
writer = BagWriter(sys.argv[1], attachments={'scenario.yaml': 'a: 1'})
writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
for step in range(740):  # 3.7 s
    ns = step * 5_000_000
    writer.write('/clock', b'\\0\\1\\0\\0' + (0).to_bytes(4, 'little') + ns.to_bytes(4, 'little'),
                 ns)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_recorder_leaves_every_second_but_the_open_one(tmp_path):
    path = tmp_path / 'killed'
    recorder = subprocess.Popen([sys.executable, '-c', KILLED, str(path)])
    assert recorder.wait() == -signal.SIGKILL
    info = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert info['custom_data'] == {  # recognisable, and whose it is
        'state': 'recording', 'process': str(recorder.pid)}
    times = []
    with data_file(path).open('rb') as stream, pytest.raises(EndOfFile):
        for record in StreamReader(stream).records:
            if isinstance(record, Message):
                times.append(record.log_time)
    assert times == [step * STEP for step in range(600)]  # 3 s of 3.7 s


def test_an_existing_path_is_refused_and_left_alone(tmp_path):
    for name, make in (('folder', Path.mkdir), ('file', Path.touch)):
        make(tmp_path / name)
        with pytest.raises(BagWriterError, match='exists: give another name'):
            BagWriter(tmp_path / name)
        assert not (tmp_path / name / 'metadata.yaml').exists()


def test_a_bag_stays_where_it_was_begun(tmp_path, store, monkeypatch):
    messages = payloads(store, 2.0)
    late = [*messages[1:], messages[0]]  # closing puts the file in order
    write(tmp_path / 'bag', late)
    (tmp_path / 'there').mkdir()
    (tmp_path / 'elsewhere').mkdir()
    monkeypatch.chdir(tmp_path / 'there')
    bag = BagWriter('bag')
    monkeypatch.chdir(tmp_path / 'elsewhere')  # as a component may
    for topic in TYPES:
        bag.add_topic(topic, TYPES[topic])
    for topic, data, ns in late:
        bag.write(topic, data, ns)
    bag.close()
    for name in ('bag_0.mcap', 'metadata.yaml'):
        assert (tmp_path / 'there' / 'bag' / name).read_bytes() == (
            tmp_path / 'bag' / name).read_bytes()
    assert not list((tmp_path / 'elsewhere').iterdir())


@pytest.mark.parametrize(('deed', 'said'), [
    (lambda file: file.unlink(), 'it has been moved or removed'),
    (lambda file: file.rename(file.with_suffix('.old')), 'it has been moved or removed'),
    (lambda file: (file.unlink(), file.write_bytes(b'')), 'another file is in its place')])
def test_a_file_that_is_taken_away_is_no_closed_bag(tmp_path, store, deed, said):
    bag = BagWriter(tmp_path / 'bag')
    for topic in TYPES:
        bag.add_topic(topic, TYPES[topic])
    for topic, data, ns in payloads(store, 2.0):
        bag.write(topic, data, ns)
    deed(bag.file)
    with pytest.raises(BagWriterError, match=f'cannot write .*bag_0.mcap: .*{said}$') as info:
        bag.close()
    assert info.value.exit_code == 1


def test_careless_use_is_named(tmp_path, store):
    writer = BagWriter(tmp_path / 'deep' / 'er' / 'bag')
    with pytest.raises(BagWriterError, match='declare topics before'):
        writer.write('/clock', b'', 0)
    writer.add_topic('/clock', TYPES['/clock'])
    with pytest.raises(BagWriterError, match='declared twice'):
        writer.add_topic('/clock', TYPES['/clock'])
    with pytest.raises(BagWriterError, match='must be absolute'):
        writer.add_topic('clock', TYPES['/clock'])
    with pytest.raises(message_definition.DefinitionError, match='no definition of no_msgs'):
        writer.add_topic('/a', 'no_msgs/msg/None')
    with pytest.raises(message_definition.DefinitionError, match='is not a message type'):
        writer.add_topic('/a', 'Clock')
    writer.write('/clock', payloads(store, 0.005)[0][1], 0)
    with pytest.raises(BagWriterError, match='not declared; known: /clock'):
        writer.write('/other', b'', 0)
    with pytest.raises(BagWriterError, match='declared after the first message'):
        writer.add_topic('/b', TYPES['/clock'])
    with pytest.raises(BagWriterError, match='negative time -1 ns'):
        writer.write('/clock', b'', -1)
    writer.close()
    writer.close()
    with pytest.raises(BagWriterError, match='the bag is closed'):
        writer.write('/clock', b'', 1)


def test_definitions_need_a_sourced_installation(monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    with pytest.raises(message_definition.DefinitionError, match='source ROS'):
        message_definition.full_text('std_msgs/msg/Header')


def test_of_several_publishers_on_one_topic_the_order_of_arrival_does_not_matter(tmp_path):
    files = []
    for number, order in enumerate(([b'a', b'b', b'c'], [b'c', b'a', b'b'])):
        bag = BagWriter(tmp_path / str(number) / 'bag')
        bag.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', shared=True)
        for data in order:
            bag.write('/diagnostics', data, 5)
        bag.close()
        files.append(bag.file.read_bytes())
    assert files[0] == files[1]


def blocks(messages):
    """Return messages as a whole flight is given: {topic: (stamps, blocks of bytes)}."""
    out = {}
    for topic in TYPES:
        mine = [(ns, data) for name, data, ns in messages if name == topic]
        out[topic] = (np.array([ns for ns, _ in mine]), [
            np.frombuffer(data, np.uint8)[None] for _, data in mine])
    return out


def test_a_whole_flight_at_once_gives_the_file_of_its_messages(tmp_path, store):
    messages = payloads(store)
    write(tmp_path / 'one', messages)
    many = BagWriter(tmp_path / 'many')
    for topic, name in TYPES.items():
        many.add_topic(topic, name)
    many.write_all(blocks(messages))
    many.close()
    assert many.counts == {topic: sum(m[0] == topic for m in messages) for topic in TYPES}
    assert data_file(tmp_path / 'many').read_bytes() == data_file(tmp_path / 'one').read_bytes()
    one, two = (yaml.safe_load((tmp_path / name / 'metadata.yaml').read_text().replace(
        f'{name}_0', 'x')) for name in ('one', 'many'))
    assert one == two


def test_a_whole_flight_goes_into_an_empty_bag_with_its_topics(tmp_path, store):
    messages = payloads(store, 0.1)
    bag = BagWriter(tmp_path / 'bag')
    for topic, name in TYPES.items():
        bag.add_topic(topic, name)
    with pytest.raises(BagWriterError, match='empty bag'):
        bag.write_all({'/other': (np.array([0]), [np.zeros((1, 4), np.uint8)])})
    bag.write_all(blocks(messages))
    with pytest.raises(BagWriterError, match='empty bag'):
        bag.write_all(blocks(messages))


def test_a_signal_while_a_bag_is_begun_leaves_none(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt
    monkeypatch.setattr(BagWriter, '_write_yaml', interrupt)
    with pytest.raises(KeyboardInterrupt):
        BagWriter(tmp_path / 'bag', attachments={'scenario.yaml': 'a: 1'})
    assert not (tmp_path / 'bag').exists()


def test_a_bag_whose_source_fails_is_removed(tmp_path):
    with pytest.raises(ZeroDivisionError), BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/chatter', 'std_msgs/msg/Header')
        bag.write('/chatter', bytes(8), 1 // 0)
    assert not list(tmp_path.iterdir())


def test_a_bag_that_the_disk_refuses_keeps_what_is_in_it(tmp_path, small_disk):
    data = np.random.default_rng(0).bytes(2000)
    with pytest.raises(BagWriterError, match='recover reads'), BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/chatter', 'std_msgs/msg/Header')
        small_disk(30_000)
        for k in range(100):
            bag.write('/chatter', data, k * 200_000_000)
    small_disk(resource.RLIM_INFINITY)
    assert recover(tmp_path / 'bag', tmp_path / 'saved').counts['/chatter'] >= 5


def test_a_disk_too_small_for_the_beginning_of_a_bag_keeps_nothing(tmp_path, small_disk):
    small_disk(1000)
    with pytest.raises(BagWriterError, match='bag_0.mcap: File too large$'):
        BagWriter(tmp_path / 'bag', attachments={'big': 'x' * 10_000})
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_is_wrong_input(tmp_path):
    (tmp_path / 'file').touch()
    for folder in ('file/bag', 'x' * 300, 'x' * 252):
        with pytest.raises(BagWriterError, match='cannot create the bag') as refused:
            BagWriter(tmp_path / folder)
        assert refused.value.exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ['file']
