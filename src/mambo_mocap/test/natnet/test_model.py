"""Model definitions: that of Motive, those of every version, and what is none."""

import struct

from hypothesis import given, settings, strategies as st
from mambo_mocap.natnet import model as models
from mambo_mocap.natnet.model import bodies, decode_model, encode_model
from mambo_mocap.natnet.wire import message, MODEL, PacketError
from motive import packet
import pytest
import samples


def test_the_definitions_of_motive_are_read_and_written_to_the_byte():
    data = packet('modeldef_packet_v3')
    found = decode_model(data, (3, 0))
    assert encode_model(found, (3, 0)) == data
    assert bodies(found) == ((2, 'RaceQuad'),)
    body, one, every = found
    assert (body.name, body.identifier, body.parent) == ('RaceQuad', 2, models.NO_PARENT)
    assert [round(x, 4) for x in body.markers[0].position] == [0.1612, 0.0351, -0.0322]
    assert one == models.MarkerSetModel('RaceQuad', tuple(f'Marker{n}' for n in range(1, 6)))
    assert every == models.MarkerSetModel('all', tuple(f'RaceQuad_{n}' for n in range(1, 6)))


@given(samples.model, st.sampled_from(samples.VERSIONS))
@settings(max_examples=100, deadline=None)
def test_what_is_written_is_read_again(model, version):
    data = encode_model(model, version)
    found = decode_model(data, version)
    assert encode_model(found, version) == data
    assert [one.name for one in found] == [one.name for one in model]


@given(samples.model, st.sampled_from(samples.VERSIONS), st.data())
@settings(max_examples=100, deadline=None)
def test_a_cut_or_changed_packet_is_a_model_or_one_error(model, version, data):
    whole = encode_model(model, version)
    cut = whole[:data.draw(st.integers(0, len(whole) - 1))]
    with pytest.raises(PacketError):
        decode_model(cut[:2] + struct.pack('<H', max(len(cut) - 4, 0)) + cut[4:], version)
    changed = bytearray(whole)
    changed[data.draw(st.integers(0, len(changed) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        decode_model(bytes(changed), version)
    except PacketError as error:
        assert '\n' not in str(error)


def definitions():
    """Return what is kept as bytes, in the layouts of version 3.0."""
    bone = b'hip\0' + struct.pack('<2i3fi', 1, -1, 0.0, 0.0, 0.0, 0)
    yield models.SKELETON, b'man\0' + struct.pack('<2i', 1, 1) + bone
    yield models.FORCE_PLATE, struct.pack('<i', 1) + b'serial\0' + bytes(158 * 4) + struct.pack(
        '<3i', 1, 0, 2) + b'x\0y\0'
    yield models.DEVICE, struct.pack('<i', 1) + b'adc\0serial\0' + struct.pack(
        '<3i', 1, 0, 1) + b'volt\0'
    yield models.CAMERA, b'Prime\0' + bytes(28)


@pytest.mark.parametrize(('kind', 'data'), list(definitions()))
def test_other_definitions_are_passed_over(kind, data):
    other = models.OtherModel(kind, data)
    body = models.BodyModel('mambo', 7)
    for version in ((3, 0), (3, 1), (4, 1), (4, 2)):
        found = decode_model(encode_model((other, body), version), version)
        assert found == (other, body)


def test_an_unknown_kind_is_passed_over_where_it_tells_its_size():
    model = (models.OtherModel(6, b'12345'), models.BodyModel('mambo', 7))
    assert decode_model(encode_model(model, (4, 1)), (4, 1)) == model
    with pytest.raises(PacketError, match='definition of unknown kind 6'):
        decode_model(encode_model(model, (4, 0)), (4, 0))


@pytest.mark.parametrize('count', [-1, 2**31 - 1])
def test_a_hostile_count_is_refused(count):
    with pytest.raises(PacketError, match='do not fit'):
        decode_model(message(MODEL, struct.pack('<i', count) + bytes(40)), (4, 1))
