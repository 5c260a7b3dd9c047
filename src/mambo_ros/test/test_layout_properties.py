"""For random contents of any message our bytes and the middleware's decode to equal numbers."""

import re
import struct

from hypothesis import given, settings, strategies as st
from mambo_ros import topics
from mambo_ros.cdr import restamped, serialize, stamp_ns
from mambo_ros.layout import Layout, LayoutError
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

EVERY = sorted({topic.msg_type for topic in (*topics.RECORDED, topics.LINKS)},
               key=lambda kind: kind.__name__)
VARIABLE = {'TFMessage', 'DiagnosticArray', 'NodeLinks'}
FIXED = [kind for kind in EVERY if kind.__name__ not in VARIABLE]
WIDTHS = {'int8': 8, 'int16': 16, 'int32': 32, 'int64': 64}
# surrogates cannot be encoded; a text of CDR ends at its first zero
TEXTS = st.text(st.characters(exclude_categories=('Cs',), exclude_characters='\0'), max_size=20)
STAMPS = st.integers(0, 2**31 * 10**9 - 1)


def primitives(kind):
    """Return every value of a primitive type; a float is any 32 bits that are no NaN."""
    if kind.removeprefix('u') in WIDTHS:
        width = WIDTHS[kind.removeprefix('u')]
        low = 0 if kind.startswith('u') else -2**(width - 1)
        return st.integers(low, low + 2**width - 1)
    return {
        'boolean': st.booleans(), 'octet': st.binary(min_size=1, max_size=1), 'string': TEXTS,
        'float': st.floats(width=32, allow_nan=False), 'double': st.floats(allow_nan=False)}[kind]


def values(kind):
    """Return every value that a field of a kind takes."""
    many = re.fullmatch(r'sequence<(.+?)>|(.+)\[(\d+)\]', kind)
    if many and many[1]:
        return st.lists(values(many[1]), max_size=3)
    if many:
        return st.lists(values(many[2]), min_size=int(many[3]), max_size=int(many[3]))
    if '/' in kind:
        package, name = kind.split('/')
        return messages(getattr(__import__(f'{package}.msg', fromlist=[name]), name))
    return primitives(kind)


def messages(kind):
    """Return every message of a type."""
    return st.builds(kind, **{
        name: values(field) for name, field in kind.get_fields_and_field_types().items()})


ANY = st.sampled_from(EVERY).flatmap(messages)
ANY_FIXED = st.sampled_from(FIXED).flatmap(messages)


def leaves(layout, message):
    """Return the numbers of a message in the order of a layout, and its texts."""
    numbers = []
    for name in layout.slices:
        value = message
        for part in name.split('.'):
            value = getattr(value, part)
        numbers += list(value) if np.ndim(value) and not isinstance(value, bytes) else [value]
    return tuple(numbers)


@settings(max_examples=150)
@given(ANY)
def test_the_middleware_reads_every_message_that_we_write(message):
    data = serialize(message)
    assert deserialize_message(data, type(message)) == message
    theirs = serialize_message(message)
    assert 0 <= len(data) - len(theirs) < 4 and len(data) % 4 == 0


@settings(max_examples=150)
@given(ANY_FIXED)
def test_a_layout_reads_every_message_of_the_middleware(message):
    layout = Layout(type(message))
    assert layout.unpack(serialize_message(message)) == leaves(layout, message)
    assert layout.unpack(serialize(message)) == leaves(layout, message)


@given(ANY_FIXED)
def test_a_layout_and_the_general_serialiser_write_the_same_bytes(message):
    texts = {}
    for name in ('header__frame_id', 'child_frame_id'):
        value = message
        for part in name.split('__'):
            value = getattr(value, part, None)
        if value is not None:
            texts[name] = value
    layout = Layout(type(message), **texts)
    data = layout.pack(*leaves(layout, message))
    assert data == serialize(message)
    assert layout.unpack(data) == leaves(layout, message)


@given(ANY_FIXED, st.data())
def test_a_message_cut_short_is_refused_by_name(message, data):
    """A message cut short at any length never yields numbers."""
    whole = serialize_message(message)
    layout = Layout(type(message))
    layout.unpack(whole)  # its texts are cached from here on
    left = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(LayoutError, match=type(message).__name__) as refused:
        layout.unpack(whole[:left])
    assert '\n' not in str(refused.value)


@given(ANY_FIXED, st.binary(max_size=300))
def test_any_bytes_are_numbers_or_one_error(message, noise):
    layout = Layout(type(message))
    try:
        assert len(layout.unpack(noise)) == layout.size
    except LayoutError as error:
        assert type(message).__name__ in str(error)
    try:  # the same for a message with some of its bytes replaced
        whole = bytearray(serialize_message(message))
        whole[4:4 + len(noise)] = noise[:len(whole) - 4]
        assert len(layout.unpack(bytes(whole))) == layout.size
    except LayoutError as error:
        assert type(message).__name__ in str(error)


@given(ANY_FIXED.filter(lambda message: hasattr(message, 'header')), STAMPS)
def test_a_stamp_is_nanoseconds_of_seconds_and_rest(message, stamp):
    """Stamps up to the last of the year 2038, that of 31 bits of seconds."""
    before = serialize(message)
    data = restamped(before, stamp)
    assert stamp_ns(data) == stamp
    assert data[:4] == before[:4] and data[12:] == before[12:]
    read = deserialize_message(data, type(message))
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == divmod(stamp, 10**9)


@given(STAMPS)
def test_a_stamp_is_read_in_either_byte_order(stamp):
    seconds, rest = divmod(stamp, 10**9)
    for order, mark in (('<', b'\x00\x01'), ('>', b'\x00\x00')):
        data = mark + b'\x00\x00' + struct.pack(f'{order}iI', seconds, rest)
        assert stamp_ns(data) == stamp
        assert stamp_ns(restamped(data, 7)) == 7
        behind = data[:4] + b'\x01\x00\x00\x00' + data[4:]
        assert stamp_ns(behind, 4) == stamp


@given(STAMPS)
def test_a_message_of_another_byte_order_is_read_too(stamp):
    layout = Layout(topics.CLOCK.msg_type)  # it has no text whose length reveals the byte order
    data = b'\x00\x00\x00\x00' + struct.pack('>iI', *divmod(stamp, 10**9))
    assert layout.unpack(data) == divmod(stamp, 10**9)
    assert layout.unpack(layout.stamped(stamp)) == divmod(stamp, 10**9)


@given(st.lists(STAMPS, min_size=1, max_size=5), st.floats(allow_nan=False, width=32))
def test_many_stamps_at_once_are_those_one_by_one(stamps, value):
    layout = Layout(topics.BAROMETER.msg_type, header__frame_id='base_link')
    rows = layout.stamped(np.array(stamps), value, 0.0)
    assert [row.tobytes() for row in rows] == [
        layout.stamped(stamp, value, 0.0) for stamp in stamps]
    assert [stamp_ns(row.tobytes()) for row in rows] == stamps


@pytest.mark.parametrize('stamp', [-2**31 * 10**9 - 1, 2**31 * 10**9])
def test_a_stamp_that_no_message_holds_is_an_error(stamp):
    layout = Layout(topics.BAROMETER.msg_type)
    with pytest.raises(struct.error):
        layout.stamped(stamp, 0.0, 0.0)
    with pytest.raises(struct.error):
        restamped(layout.stamped(0, 0.0, 0.0), stamp)
