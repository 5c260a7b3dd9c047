"""Columns of any messages are the messages' own numbers, or there are none."""

from hypothesis import given, strategies as st
from mambo_bags import columns
import numpy as np
import pytest

IMU, ODOMETRY = 'sensor_msgs/msg/Imu', 'nav_msgs/msg/Odometry'
STATUS = 'diagnostic_msgs/msg/DiagnosticArray'
STORE = columns.load_types([IMU, ODOMETRY, STATUS])
NUMBERS = st.floats(allow_nan=False)
# a text of CDR ends at its first zero; numpy's texts, padded with zeros, do too
FRAMES = st.text(st.characters(exclude_categories=('Cs',), exclude_characters='\0'), max_size=9)
STAMPS = st.integers(0, 2**31 * 10**9 - 1)


def header(stamp, frame):
    time = STORE.types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
    return STORE.types['std_msgs/msg/Header'](time, frame)


def vector(numbers):
    return STORE.types['geometry_msgs/msg/Vector3'](*numbers)


def table(messages, kind):
    """Return messages as rows of bytes; all have one length."""
    rows = [np.frombuffer(bytes(STORE.serialize_cdr(one, kind)), np.uint8) for one in messages]
    return np.stack(rows)


@given(FRAMES, st.lists(st.tuples(STAMPS, st.tuples(*[NUMBERS] * 3)), min_size=1, max_size=4))
def test_every_number_of_every_message_is_in_its_column(frame, samples):
    messages = [columns.zero(STORE, IMU, header=header(stamp, frame),
                             angular_velocity=vector(v)) for stamp, v in samples]
    rows = table(messages, IMU)
    found = columns.layout(STORE, IMU, rows)

    def column(name):
        return columns.take(rows, found[name]).tolist()

    assert column('header.stamp.sec') == [stamp // 10**9 for stamp, _ in samples]
    assert column('header.stamp.nanosec') == [stamp % 10**9 for stamp, _ in samples]
    assert [text.rstrip('\0') for text in column('header.frame_id')] == [frame] * len(samples)
    for axis, name in enumerate('xyz'):
        assert column(f'angular_velocity.{name}') == [v[axis] for _, v in samples]
        assert column(f'linear_acceleration.{name}') == [0.0] * len(samples)
    assert columns.take(rows, found['orientation_covariance']).shape == (len(samples), 9)


@given(st.lists(NUMBERS, min_size=36, max_size=36), FRAMES)
def test_an_array_of_numbers_is_one_column(numbers, frame):
    pose = columns.zero(STORE, 'geometry_msgs/msg/PoseWithCovariance',
                        covariance=np.array(numbers))
    message = columns.zero(STORE, ODOMETRY, pose=pose, child_frame_id=frame)
    rows = table([message], ODOMETRY)
    found = columns.layout(STORE, ODOMETRY, rows)
    assert columns.take(rows, found['pose.covariance'])[0].tolist() == numbers


@given(FRAMES, FRAMES)
def test_messages_of_different_texts_share_no_layout(one, other):
    """Two texts of different length shift all behind them: refused, not read from elsewhere."""
    rows = [bytes(STORE.serialize_cdr(columns.zero(STORE, IMU, header=header(0, frame)), IMU))
            for frame in (one, other)]
    width = max(map(len, rows))
    filled = np.stack([np.frombuffer(row.ljust(width, b'\0'), np.uint8) for row in rows])
    if len(one.encode()) == len(other.encode()):
        found = columns.take(filled, columns.layout(STORE, IMU, filled)['header.frame_id'])
        assert [text.rstrip('\0') for text in found] == [one, other]
    else:
        with pytest.raises(columns.NoLayout):
            columns.layout(STORE, IMU, filled)


@given(st.binary(max_size=400), st.sampled_from([IMU, ODOMETRY, STATUS]))
def test_any_bytes_have_a_layout_or_none(rest, kind):
    data = columns.HEADER + rest
    try:
        found = columns.layout(STORE, kind, np.frombuffer(data, np.uint8)[None, :])
    except columns.NoLayout:
        return
    for column in found.values():
        dtype = np.dtype(column.dtype)
        size = dtype.itemsize * (1 if column.count is None else column.count)
        assert 4 <= column.offset and column.offset + size <= len(data)


@given(st.binary(max_size=400), st.sampled_from([IMU, STATUS]))
def test_trimming_takes_nothing_but_the_end(rest, kind):
    data = columns.HEADER + rest
    short = columns.trimmed(STORE, kind, data)
    assert data.startswith(short)
    assert columns.trimmed(STORE, kind, short) == short


@given(STAMPS, FRAMES, st.binary(max_size=3))
def test_trimming_gives_back_the_message_without_its_padding(stamp, frame, rest):
    message = bytes(STORE.serialize_cdr(
        columns.zero(STORE, IMU, header=header(stamp, frame)), IMU))
    assert columns.trimmed(STORE, IMU, message + rest) == message
