"""Our bytes equal the middleware's bytes except for its undefined alignment bytes."""

from mambo_interfaces.msg import MotorPwm
from mambo_ros import topics
from mambo_ros.cdr import serialize
from mambo_ros.layout import Layout, LayoutError
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu
from tf2_msgs.msg import TFMessage

FIXED = [topic for topic in topics.RECORDED if topic not in (topics.TF, topics.DIAGNOSTICS)]


def numbers(layout, rng):
    """Return random valid leaf values of a layout."""
    out = []
    for name, where in layout.slices.items():
        width = where.stop - where.start
        if name.endswith(('phase', 'status', 'reason', 'quality', 'radiation_type', 'saturated',
                          'shutdown', 'health')):
            out += rng.integers(0, 2, width).tolist()
        elif name.endswith(('sec', 'imu', 'sonar', 'optical_flow', 'barometer', 'refused',
                            'invalid_samples', 'not_finite', 'dropped')):
            out += rng.integers(0, 1000, width).tolist()
        else:
            out += np.float32(rng.normal(size=width)).astype(float).tolist()
    return out


def whole_words(count):
    """Return the number of bytes that Fast DDS sends for so many (RTPS 2.2, 9.4.2.12)."""
    return 4 * -(-count // 4)


@pytest.mark.parametrize('topic', FIXED, ids=lambda topic: topic.name)
def test_the_middleware_reads_what_we_write(topic):
    texts = {'header__frame_id': 'base_link'} if 'header' in (
        topic.msg_type.get_fields_and_field_types()) else {}
    layout = Layout(topic.msg_type, **texts)
    values = numbers(layout, np.random.default_rng(1))
    data = layout.pack(*values)
    message = deserialize_message(data, topic.msg_type)
    assert len(serialize_message(message)) == layout.nbytes
    assert len(data) == whole_words(layout.nbytes)
    assert serialize(message) == data
    np.testing.assert_array_equal(layout.unpack(data), values)
    np.testing.assert_array_equal(layout.unpack(serialize_message(message)), values)


def test_a_leaf_is_found_by_its_dotted_name():
    layout = Layout(Imu, header__frame_id='base_link')
    message = Imu()
    message.header.frame_id = 'base_link'
    message.angular_velocity.y = 2.5
    assert layout.unpack(serialize(message))[layout.slices['angular_velocity.y']] == (2.5,)


def test_another_frame_name_is_read_too():
    layout = Layout(Imu, header__frame_id='base_link')
    message = Imu()
    message.header.frame_id = 'imu_link_of_another_driver'
    message.linear_acceleration.z = 9.81
    values = layout.unpack(serialize_message(message))
    assert values[layout.slices['linear_acceleration.z']] == (9.81,)


def test_a_frame_name_of_equal_length_is_read_too():
    layout = Layout(Odometry, header__frame_id='odom', child_frame_id='base_link')
    message = Odometry()
    message.header.frame_id, message.child_frame_id = 'hall', 'body_link'
    message.pose.pose.position.x = -3.0
    assert layout.unpack(serialize(message))[layout.slices['pose.pose.position.x']] == (-3.0,)


def test_bytes_are_read_with_and_without_padding():
    layout = Layout(MotorPwm)
    values = numbers(layout, np.random.default_rng(2))
    data = layout.pack(*values)
    assert len(data) > layout.nbytes
    for short in (data, data[:layout.nbytes], data[:-1]):
        assert layout.unpack(short) == tuple(values)


@pytest.mark.parametrize('frame', ['map', 'a_frame_with_a_long_name', ''])
def test_other_frame_names_are_decoded_as_fast_after_the_first(frame, monkeypatch):
    ours = Layout(Odometry, header__frame_id='odom', child_frame_id='base_link')
    theirs = Layout(Odometry, header__frame_id=frame, child_frame_id='base_link')
    values = tuple(numbers(theirs, np.random.default_rng(3)))
    assert ours.unpack(theirs.pack(*values)) == values
    monkeypatch.setattr(Layout, '_unpack_slowly', None)
    assert ours.unpack(theirs.pack(*values)) == ours.unpack(ours.pack(*values)) == values


def test_bytes_of_something_else_are_refused_by_name():
    with pytest.raises(LayoutError, match='Imu'):
        Layout(Imu).unpack(b'\x00\x01\x00\x00 too short')


def test_a_type_with_sequences_has_no_layout():
    with pytest.raises(LayoutError, match='transforms'):
        Layout(TFMessage)


def test_an_unknown_text_field_is_named():
    with pytest.raises(LayoutError, match='frame'):
        Layout(MotorPwm, frame='x')


@pytest.mark.parametrize('topic', FIXED, ids=lambda topic: topic.name)
def test_many_messages_at_once_are_those_one_by_one(topic):
    texts = {'header__frame_id': 'odom'} if 'header' in (
        topic.msg_type.get_fields_and_field_types()) else {}
    layout = Layout(topic.msg_type, **texts)
    values = [numbers(layout, np.random.default_rng(seed)) for seed in range(5)]
    columns = [np.array(column) for column in zip(*values)]
    columns[-1] = values[0][-1]  # a number stands for all messages
    rows = layout.rows(*columns)
    assert [row.tobytes() for row in rows] == [
        layout.pack(*row[:-1], values[0][-1]) for row in values]
    stamps = np.array([7, 1_500_000_000])
    assert [row.tobytes() for row in layout.stamped(stamps, *values[0][2:])] == [
        layout.stamped(stamp, *values[0][2:]) for stamp in stamps.tolist()]


def test_no_message_at_once_is_no_row():
    layout = Layout(MotorPwm)
    count = len(numbers(layout, np.random.default_rng(1)))
    rows = layout.rows(*[np.empty(0)] * count)
    assert rows.shape == (0, len(layout.rows(*[np.zeros(2)] * count)[0]))
    assert layout.rows(np.empty(0), *[1.0] * (count - 1)).shape == rows.shape
    assert layout.stamped(np.empty(0, np.int64), *[1.0] * (count - 2)).shape == rows.shape
