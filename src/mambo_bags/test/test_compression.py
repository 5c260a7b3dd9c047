"""What zstd packed: whole again, in bounded memory, and refused in words if it is damaged."""

from hypothesis import given, strategies as st
from mambo_bags.compression import is_compressed, message, unpack, ZSTD
import pytest
import zstandard

MB = 10**6


def packed(data):
    return zstandard.ZstdCompressor().compress(data)


@given(st.binary(max_size=20_000))
def test_a_message_is_what_it_was(data):
    assert message(packed(data), MB) == data
    if not data.startswith(ZSTD):
        assert message(data, 0) is data  # as it is: nothing to unpack, nothing to bound


@pytest.mark.parametrize('size', [0, 1, 4095, 4096, 4097, 3 * (1 << 20) + 5])
def test_a_file_is_what_it_was_whatever_the_pieces_it_is_read_in(tmp_path, size):
    data = bytes(range(256)) * (size // 256 + 1)
    (tmp_path / 'a.zstd').write_bytes(packed(data[:size]))
    unpack(tmp_path / 'a.zstd', tmp_path / 'a')
    assert (tmp_path / 'a').read_bytes() == data[:size]


def test_a_file_is_told_by_its_first_four_bytes(tmp_path):
    for content, compressed in (
            (packed(b'x'), True), (ZSTD, True), (ZSTD[:3], False), (b'', False),
            (b'\x89MCAP0\r\n', False)):
        (tmp_path / 'a').write_bytes(content)
        assert is_compressed(tmp_path / 'a') is compressed
    assert packed(b'x')[:4] == ZSTD


def test_exactly_as_much_as_is_allowed_is_unpacked():
    assert len(message(packed(bytes(1000)), 1000)) == 1000
    with pytest.raises(ValueError, match='^a compressed message: it unpacks to more than 0 MB'):
        message(packed(bytes(1001)), 1000)


def test_a_small_file_that_would_fill_the_memory_is_stopped_on_the_way(tmp_path, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '1')
    (tmp_path / 'a.zstd').write_bytes(packed(bytes(60 * MB)))
    with pytest.raises(ValueError, match='it unpacks to more than 1 MB; .*MAMBO_MAX_UNPACKED_MB'):
        unpack(tmp_path / 'a.zstd', tmp_path / 'a')
    assert (tmp_path / 'a').stat().st_size <= 1 * MB


def test_a_frame_that_is_cut_off_anywhere_is_refused():
    whole = packed(bytes(range(256)) * 40)
    for size in range(4, len(whole)):
        with pytest.raises(ValueError, match='^a compressed message: .*(cut off|damaged)'):
            message(whole[:size], MB)


def test_damage_is_refused_or_changes_nothing():
    data = bytes(range(256)) * 4
    whole = zstandard.ZstdCompressor(write_checksum=True).compress(data)
    for at in range(4, len(whole)):
        broken = whole[:at] + bytes([whole[at] ^ 0x40]) + whole[at + 1:]
        try:
            assert message(broken, MB) == data
        except ValueError as error:
            assert '\n' not in str(error)


def test_what_stands_behind_the_frame_is_left_out():
    assert message(packed(b'message') + b'\0' * 9000, MB) == b'message'
    assert message(packed(b''), MB) == b''
