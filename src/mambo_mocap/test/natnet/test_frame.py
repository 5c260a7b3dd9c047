"""Frames: those of Motive, those of every version, and what is none."""

import math
import struct

from hypothesis import given, settings, strategies as st
from mambo_mocap.natnet import frame as frames
from mambo_mocap.natnet.frame import decode_frame, encode_frame
from mambo_mocap.natnet.wire import FRAME, message, PacketError
from motive import FRAMES, packet
import pytest
import samples


@pytest.mark.parametrize(('name', 'version'), FRAMES.items())
def test_a_frame_of_motive_is_read_and_written_to_the_byte(name, version):
    data = packet(name)
    assert encode_frame(decode_frame(data, version), version) == data


def test_the_fields_are_those_that_motives_own_client_printed():
    found = decode_frame(packet('mocapframe_packet_v3'), (3, 0))
    assert (found.number, round(found.times.timestamp, 2)) == (162734, 1356.12)
    body, = found.bodies
    assert (body.identifier, body.tracked) == (2, True)
    assert [round(x, 2) for x in (*body.position, *body.attitude)] == [
        0.17, 1.45, -0.73, -0.05, 0.51, 0.04, -0.86]
    assert [(one.identifier >> 16, one.identifier & 0xffff) for one in found.labelled] == [
        *((2, n) for n in range(1, 6)), (0, 50007)]
    assert all(one.flags & frames.SEEN for one in found.labelled)
    ticks = 3_312_787  # per second, of the server's reply in the same set
    times = found.times
    assert (times.transmitted - times.received) / ticks == pytest.approx(0.88e-3, abs=5e-6)
    assert (times.transmitted - times.exposure) / ticks == pytest.approx(5.50e-3, abs=5e-6)


def test_an_occluded_marker_has_its_flag():
    found = decode_frame(packet('mocapframe_packet_occluded_v3'), (3, 0))
    assert [bool(one.flags & frames.OCCLUDED) for one in found.labelled] == [
        True, False, False, False]
    assert [one.name for one in found.marker_sets] == ['FakeTree', 'all']


def same(a, b):
    """Return whether two contents are equal; NaN equals NaN."""
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


@pytest.mark.long
@given(samples.frame, st.sampled_from(samples.VERSIONS))
@settings(max_examples=150, deadline=None)
def test_what_is_written_is_read_again(frame, version):
    data = encode_frame(frame, version)
    found = decode_frame(data, version)
    assert encode_frame(found, version) == data
    if version >= (4, 1):
        wanted = frame._replace(
            bodies=tuple(one._replace(markers=()) for one in frame.bodies),
            skeletons=tuple(one._replace(bones=tuple(
                bone._replace(markers=()) for bone in one.bones)) for one in frame.skeletons),
            times=frame.times._replace(latency=0.0))
        assert same(found, wanted)


@pytest.mark.long
@given(samples.frame, st.sampled_from(samples.VERSIONS), st.data())
@settings(max_examples=150, deadline=None)
def test_a_cut_or_changed_packet_is_a_frame_or_one_error(frame, version, data):
    whole = encode_frame(frame, version)
    cut = whole[:data.draw(st.integers(0, len(whole) - 1))]
    with pytest.raises(PacketError):
        decode_frame(cut, version)
    with pytest.raises(PacketError):  # the same with a header that fits
        decode_frame(cut[:2] + struct.pack('<H', max(len(cut) - 4, 0)) + cut[4:], version)
    changed = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    try:
        decode_frame(bytes(changed), version)
    except PacketError as error:
        assert '\n' not in str(error)


@given(st.binary(max_size=300), st.sampled_from(samples.VERSIONS))
@settings(max_examples=150, deadline=None)
def test_noise_is_a_frame_or_one_error(noise, version):
    try:
        decode_frame(message(FRAME, noise), version)
    except PacketError:
        pass


@pytest.mark.parametrize('version', samples.VERSIONS)
@pytest.mark.parametrize('count', [-1, 2**31 - 1, 100_000])
def test_a_hostile_count_is_refused_before_anything_is_made_of_it(version, count):
    data = message(FRAME, struct.pack('<3i', 1, count, 4) + bytes(200))
    with pytest.raises(PacketError, match='do not fit'):
        decode_frame(data, version)


def test_nothing_may_follow_the_end():
    data = encode_frame(frames.Frame(1, frames.Times(0.0)), (3, 1))
    with pytest.raises(PacketError, match='1 bytes too many'):
        decode_frame(message(FRAME, data[4:] + b'!'), (3, 1))
    with pytest.raises(PacketError, match='does not end with zeros'):
        decode_frame(data[:-1] + b'!', (3, 1))


def test_what_does_not_fit_is_refused():
    times = frames.Times(0.0)
    with pytest.raises(PacketError, match='does not fit'):
        encode_frame(frames.Frame(2**31, times), (4, 1))
    with pytest.raises(PacketError, match='UDP'):
        encode_frame(frames.Frame(1, times, others=((0.0, 0.0, 0.0),) * 6000), (4, 1))
    with pytest.raises(PacketError, match=r'NatNet 5.0 is unknown: set the server'):
        encode_frame(frames.Frame(1, times), (5, 0))
