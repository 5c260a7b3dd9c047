"""Bags of the storage sqlite3: what they hold, whose definitions count, and what is no bag."""

from contextlib import closing
import sqlite3

from mambo_analysis.importers import sqlite_bag
from mambo_analysis.importers.sqlite_bag import installed, read_sqlite
from mambo_bags import columns
from mambo_bags.mcap_reader import BagError
import pytest
from rosbags.typesys import get_typestore, Stores

VECTOR = 'geometry_msgs/msg/Vector3'
OWN = 'mambo_interfaces/msg/MotorPwm'
DEFINITION = 'float64 x\nfloat64 y\nfloat64 z\n'


def vector(x, y=0.0, z=0.0):
    store = columns.load_types([VECTOR])
    return bytes(store.serialize_cdr(store.types[VECTOR](x, y, z), VECTOR))


def database(path, topics, messages, definitions=None):
    """Write a file: topics (name, type, encoding), messages (topic number, ns, bytes)."""
    with closing(sqlite3.connect(path)) as db, db:
        db.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
                   'serialization_format TEXT, offered_qos_profiles TEXT)')
        db.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
                   'timestamp INTEGER, data BLOB)')
        db.executemany('INSERT INTO topics(name, type, serialization_format) VALUES(?, ?, ?)',
                       topics)
        db.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)', messages)
        if definitions is not None:
            db.execute('CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, '
                       'encoding TEXT, encoded_message_definition TEXT)')
            db.executemany('INSERT INTO message_definitions(topic_type, encoding, '
                           'encoded_message_definition) VALUES(?, ?, ?)', definitions)
    return path


def refused(path, wanted, topics, messages):
    database(path / 'a.db3', topics, messages)
    with pytest.raises(BagError) as caught:
        read_sqlite(path, [path / 'a.db3'])
    assert wanted in str(caught.value) and '\n' not in str(caught.value)


def test_messages_come_in_the_order_of_their_times_with_their_values(tmp_path):
    file = database(tmp_path / 'a.db3', [('/v', VECTOR, 'cdr'), ('/silent', VECTOR, 'cdr')], [
        (1, 30, vector(3.0)), (1, 10, vector(1.0)), (1, 20, vector(2.0))])
    topics, found = read_sqlite(tmp_path, [file])
    assert topics == {'/v': VECTOR, '/silent': VECTOR}
    assert list(found) == ['/v']                     # of those with messages
    assert found['/v']['x'].tolist() == [1.0, 2.0, 3.0]
    assert found['/v'].log_time.tolist() == [10, 20, 30]


def test_several_files_are_one_bag(tmp_path):
    topics = [('/v', VECTOR, 'cdr')]
    files = [database(tmp_path / f'{k}.db3', topics, [(1, k, vector(float(k)))])
             for k in range(3)]
    _, found = read_sqlite(tmp_path, files)
    assert found['/v']['x'].tolist() == [0.0, 1.0, 2.0]


def test_a_type_is_named_as_ros_2_does_whatever_the_file_says(tmp_path):
    file = database(tmp_path / 'a.db3', [('/v', 'geometry_msgs/Vector3', 'cdr')], [
        (1, 0, vector(1.0))])
    assert read_sqlite(tmp_path, [file])[0] == {'/v': VECTOR}


def test_a_definition_that_the_file_carries_counts_before_any_other(tmp_path):
    """The same bytes under other names of their fields: those of the file are used."""
    file = database(tmp_path / 'a.db3', [('/v', VECTOR, 'cdr')], [(1, 0, vector(1.0, 2.0, 3.0))],
                    [(VECTOR, 'ros2msg', 'float64 east\nfloat64 north\nfloat64 up\n')])
    message = read_sqlite(tmp_path, [file])[1]['/v']
    assert (message['east'][0], message['north'][0], message['up'][0]) == (1.0, 2.0, 3.0)


def test_a_foreign_type_is_read_by_the_definition_it_carries_and_refused_without(tmp_path):
    (tmp_path / 'with').mkdir()
    file = database(tmp_path / 'with' / 'a.db3', [('/v', 'other_msgs/msg/P', 'cdr')],
                    [(1, 0, vector(4.0))], [('other_msgs/msg/P', 'ros2msg', DEFINITION)])
    assert read_sqlite(tmp_path, [file])[1]['/v']['x'].tolist() == [4.0]
    file = database(tmp_path / 'a.db3', [('/v', 'other_msgs/msg/P', 'cdr')], [(1, 0, vector(4.0))])
    _, found = read_sqlite(tmp_path, [file])
    with pytest.raises(BagError, match='carries no definition of other_msgs/msg/P.*bag convert'):
        found['/v']['x']


def test_own_types_are_those_installed_here(tmp_path):
    store = installed(OWN)
    assert OWN in store.fielddefs
    assert installed('no_such_msgs/msg/Nothing') is None


@pytest.mark.parametrize('distribution', ['', 'humble', 'rolling'])
def test_the_definition_is_that_by_which_the_first_message_is_whole(tmp_path, distribution):
    """Foxy's time of a JointTrajectory is the same; its Range has no field ``variance``."""
    name = 'sensor_msgs/msg/Range'
    old, new = (get_typestore(Stores(f'ros2_{which}')) for which in ('humble', 'jazzy'))
    assert len(old.fielddefs[name][1]) + 1 == len(new.fielddefs[name][1])
    for store, fields in ((old, 6), (new, 7)):
        message = columns.zero(store, name, range=1.25)
        file = database(tmp_path / f'{fields}.db3', [('/r', name, 'cdr')], [
            (1, 0, bytes(store.serialize_cdr(message, name)))])
        found = read_sqlite(tmp_path, [file], distribution)[1]['/r']
        assert found['range'].tolist() == [1.25]
        known = sqlite_bag._known(name, distribution, bytes(store.serialize_cdr(message, name)))
        assert len(known.fielddefs[name][1]) == fields


def test_another_encoding_is_refused_when_it_is_asked_for(tmp_path):
    file = database(tmp_path / 'a.db3', [('/v', VECTOR, 'json'), ('/w', VECTOR, 'cdr')], [
        (1, 0, b'{}'), (2, 0, vector(1.0))])
    _, found = read_sqlite(tmp_path, [file])
    assert found['/w']['x'].tolist() == [1.0]
    with pytest.raises(BagError, match="/v: messages are encoded as 'json', only cdr is read"):
        found['/v']['x']


@pytest.mark.parametrize(('topics', 'messages', 'wanted'), [
    ([('/v', VECTOR, 'cdr')], [], 'the bag has no messages'),
    ([(None, VECTOR, 'cdr')], [(1, 0, b'')], 'the topic 1 has no name, type or encoding'),
    ([('/v', VECTOR, 'cdr')], [(7, 0, b'')], 'a message of the topic 7, which is not listed'),
    ([('/v', VECTOR, 'cdr')], [(1, -5, b'')], 'a message of the impossible time -5'),
    ([('/v', VECTOR, 'cdr')], [(1, 'noon', b'')], 'a message of the impossible time noon'),
    ([('/v', VECTOR, 'cdr')], [(1, 0, 'text')], 'a message that is no sequence of bytes')])
def test_what_is_damaged_is_named(tmp_path, topics, messages, wanted):
    refused(tmp_path, wanted, topics, messages)


def test_a_file_that_is_none_or_not_there_is_named(tmp_path):
    (tmp_path / 'text.db3').write_text('no database, but long enough to be looked at\n' * 9)
    for name in ('text.db3', 'none.db3'):
        with pytest.raises(BagError, match=f'{name}: no rosbag2 file, or damaged'):
            read_sqlite(tmp_path, [tmp_path / name])
    assert not (tmp_path / 'none.db3').exists()  # read only: none is made


def test_a_view_that_a_stranger_made_is_not_run(tmp_path):
    """A view may compute for ever: only tables are read."""
    with closing(sqlite3.connect(tmp_path / 'a.db3')) as db, db:
        db.execute('CREATE TABLE t(id INTEGER, name TEXT, type TEXT, serialization_format TEXT)')
        db.execute('CREATE VIEW topics AS SELECT * FROM t')
        db.execute('CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, '
                   'data BLOB)')
    with pytest.raises(BagError, match='a.db3: no rosbag2 file, or damaged'):
        read_sqlite(tmp_path, [tmp_path / 'a.db3'])


def test_nothing_is_written_into_the_file(tmp_path):
    file = database(tmp_path / 'a.db3', [('/v', VECTOR, 'cdr')], [(1, 0, vector(1.0))])
    before = file.read_bytes()
    read_sqlite(tmp_path, [file])
    assert file.read_bytes() == before and sorted(tmp_path.iterdir()) == [file]
