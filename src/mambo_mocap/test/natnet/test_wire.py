"""The bounded reader."""

from mambo_mocap.natnet.wire import INT, kind, message, PacketError, payload, Reader, text
import pytest


def test_nothing_is_read_beyond_the_end():
    reader = Reader(b'\1\0\0\0\2\0\0\0', end=6)
    assert reader.take(INT, 'it') == (1,)
    with pytest.raises(PacketError, match='it is cut off: 4 bytes wanted, 2 left'):
        reader.take(INT, 'it')
    with pytest.raises(PacketError, match='does not end'):
        Reader(b'abc\0', end=3).string('the name')
    with pytest.raises(PacketError, match='-1 bytes'):
        reader.raw(-1, 'it')


def test_a_sized_section_ends_where_it_says():
    reader = Reader(INT.pack(3) + b'abcdef')
    part = reader.section(True, 'it')
    assert part.raw(2, 'it') == b'ab'
    with pytest.raises(PacketError, match='1 bytes too many'):
        part.close('it')
    assert reader.raw(3, 'the rest') == b'def'
    for size in (-1, 100):
        with pytest.raises(PacketError):
            Reader(INT.pack(size) + b'abc').section(True, 'it')


def test_the_header_must_fit_its_packet():
    data = message(7, b'abc')
    assert payload(data, 7).raw(3, 'it') == b'abc'
    for wrong in (data + b'!', data[:-1]):
        with pytest.raises(PacketError, match='announces 3 bytes'):
            payload(wrong, 7)
    with pytest.raises(PacketError, match='message 7 instead of 5'):
        payload(data, 5)
    with pytest.raises(PacketError, match='no header'):
        kind(b'\7\0')


def test_a_text_that_is_no_utf8_comes_back_as_it_was():
    name = Reader(b'caf\xe9\0').string('it')
    assert text(name) == b'caf\xe9\0'
    assert text('a\0b') == b'a\0'
