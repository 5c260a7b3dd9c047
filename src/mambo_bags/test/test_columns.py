"""Messages made without ROS against the middleware's own serialiser."""

import importlib

from mambo_analysis.importers.minidrone import TOPICS
from mambo_bags import columns as cdr
import numpy as np
import pytest
from synthetic import TYPES

NAMES = sorted({*TOPICS.values(), *TYPES.values(), 'tf2_msgs/msg/TFMessage',
                'diagnostic_msgs/msg/DiagnosticArray', 'mambo_interfaces/msg/ControllerState'})


def fill(message, rng):
    """Set every field of a rclpy message to something that is not zero."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == 'string':
            setattr(message, name, 'x' * int(rng.integers(1, 9)))
        elif kind == 'boolean':
            setattr(message, name, True)
        elif kind == 'octet':
            setattr(message, name, bytes([int(rng.integers(1, 99))]))
        elif kind in ('float', 'double'):
            setattr(message, name, float(np.float32(rng.normal())))
        elif kind.rstrip('0123456789') in ('int', 'uint'):
            setattr(message, name, int(rng.integers(1, 99)))
        elif isinstance(value, np.ndarray):
            value[:] = rng.integers(1, 99, len(value))
        elif kind.endswith(']') and isinstance(value, list):
            setattr(message, name, [True] * len(value))
        elif kind.startswith('sequence<'):
            if '/' in kind:
                package, short = kind[9:-1].split('/')
                inner = getattr(importlib.import_module(f'{package}.msg'), short)()
                setattr(message, name, [fill(inner, rng)])
        else:
            fill(value, rng)
    return message


def copy(message, store, type_name):
    """Return the message as an object of the types that need no ROS."""
    fields = {}
    for name, kind in store.fielddefs[type_name][1]:
        value = getattr(message, name)
        if kind[0] == cdr.Nodetype.NAME:
            value = copy(value, store, kind[1])
        elif isinstance(value, list) and value and hasattr(value[0], 'SLOT_TYPES'):
            value = [copy(inner, store, kind[1][0][1]) for inner in value]
        elif isinstance(value, bytes):
            value = value[0]
        elif kind[0] != cdr.Nodetype.BASE and not isinstance(value, list):
            value = np.array(value)
        elif kind[0] != cdr.Nodetype.BASE and value and isinstance(value[0], bool):
            value = np.array(value)
        fields[name] = value
    return store.types[type_name](**fields)


def carries_value(store, type_name, data):
    """Return (n,) true for the bytes of a message that are not padding."""
    walk = cdr._Walk(store, data)
    walk.message(type_name)
    known = np.zeros(len(data), bool)
    known[:4] = True
    for offset in walk.lengths:
        known[offset:offset + 4] = True
    for column in walk.columns.values():
        count = 1 if column.count is None else column.count
        known[column.offset:column.offset + np.dtype(column.dtype).itemsize * count] = True
    return known


def rows(*messages):
    return np.array([list(data) for data in messages], np.uint8)


@pytest.mark.parametrize('type_name', NAMES)
def test_bytes_equal_those_of_the_middleware_and_columns_read_them(type_name):
    serialization = pytest.importorskip('rclpy.serialization', reason='rclpy is not installed')
    package, _, short = type_name.split('/')
    rng = np.random.default_rng(3)
    message = fill(getattr(importlib.import_module(f'{package}.msg'), short)(), rng)
    store = cdr.load_types([type_name])
    expected = serialization.serialize_message(message)
    ours = bytes(store.serialize_cdr(copy(message, store, type_name), type_name))
    # the middleware leaves padding as it finds it, and pads the end to four bytes
    table = rows(expected, expected)
    columns = cdr.layout(store, type_name, table)
    known = carries_value(store, type_name, expected)
    assert 0 <= len(expected) - len(ours) < 4
    assert known[:4].all() and not known[len(ours):].any()
    same = np.frombuffer(expected[:len(ours)], np.uint8) == np.frombuffer(ours, np.uint8)
    assert same[known[:len(ours)]].all()
    assert not np.frombuffer(ours, np.uint8)[~known[:len(ours)]].any()  # ours pads with zeros
    for path, column in columns.items():
        value = message
        for step in path.replace(']', '').replace('[', '.').split('.'):
            value = value[int(step)] if step.isdigit() else getattr(value, step)
        value = value[0] if isinstance(value, bytes) else value
        np.testing.assert_array_equal(cdr.take(table, column)[1], value)


def test_zero_is_the_empty_message_of_every_type():
    store = cdr.load_types(NAMES)
    imu = cdr.zero(store, 'sensor_msgs/msg/Imu')
    assert imu.header.frame_id == '' and imu.orientation.w == 0.0
    assert imu.angular_velocity_covariance.tolist() == [0.0] * 9
    assert cdr.zero(store, 'tf2_msgs/msg/TFMessage').transforms == []
    with pytest.raises(TypeError, match='has no field nonsense'):
        cdr.zero(store, 'sensor_msgs/msg/Imu', nonsense=1)


def test_big_endian_messages_are_left_to_the_decoder():
    store = cdr.load_types(['sensor_msgs/msg/Range'])
    message = bytes(store.serialize_cdr(
        cdr.zero(store, 'sensor_msgs/msg/Range'), 'sensor_msgs/msg/Range', little_endian=False))
    with pytest.raises(cdr.NoLayout):
        cdr.layout(store, 'sensor_msgs/msg/Range', rows(message))
    clock = cdr.load_types(['rosgraph_msgs/msg/Clock'])
    with pytest.raises(cdr.NoLayout):
        cdr.layout(clock, 'rosgraph_msgs/msg/Clock', rows(b'\0\0\0\0' + bytes(7) + b'\1'))


def test_a_message_longer_or_shorter_than_its_type_has_no_layout():
    store = cdr.load_types(['rosgraph_msgs/msg/Clock'])
    for size in (7, 12, 16):
        with pytest.raises(cdr.NoLayout):
            cdr.layout(store, 'rosgraph_msgs/msg/Clock', rows(b'\0\1\0\0' + bytes(size)))


def test_empty_sequences_of_wide_numbers_keep_their_place():
    # XCDR1 aligns the elements of a sequence, so an empty one aligns nothing
    pytest.importorskip('rclpy.serialization', reason='rclpy is not installed')
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import JointState
    data = serialize_message(JointState(effort=[1.5, 2.5]))  # behind two empty ones
    store = cdr.load_types(['sensor_msgs/msg/JointState'])
    table = rows(data)
    columns = cdr.layout(store, 'sensor_msgs/msg/JointState', table)
    assert cdr.take(table, columns['effort']).tolist() == [[1.5, 2.5]]
    assert cdr.take(table, columns['velocity']).shape == (1, 0)
    # the middleware reserved room for aligning what is empty, and left it behind the message
    assert len(data) > len(cdr.trimmed(store, 'sensor_msgs/msg/JointState', data)) == 52
