"""Connecting, the server's reply and the echo: Motive's packets and what is none."""

from mambo_mocap.natnet import handshake
from mambo_mocap.natnet.handshake import (
    decode_connect, decode_echo_request, decode_echo_response, decode_server_info,
    encode_connect, encode_echo_request, encode_echo_response, encode_server_info, Sender,
    ServerInfo)
from mambo_mocap.natnet.wire import DISCOVERY, message, PacketError, SERVER_INFO
from motive import INFOS, packet
import pytest

CLIENT = Sender('NatNetLib', (3, 0, 0, 0), (3, 0, 0, 0))


def test_a_client_of_motive_is_read_and_written_to_the_byte():
    for name, number in (('connect_packet_v3', 0), ('discovery_packet_v3', DISCOVERY)):
        data = packet(name)
        sender = decode_connect(data, number)
        assert sender.name == 'NatNetLib' and sender.version == (3, 0)
        assert encode_connect(sender, number) == data


@pytest.mark.parametrize(('name', 'version'), INFOS.items())
def test_the_reply_of_motive_is_read_and_written_to_the_byte(name, version):
    data = packet(name)
    info = decode_server_info(data)
    assert info.sender.version == version
    end = data.index(b'\0', 4)  # what is left in the field behind the name has no meaning
    clean = data[:end] + bytes(4 + handshake.NAME - end) + data[4 + handshake.NAME:]
    assert encode_server_info(info) == clean


def test_the_fields_of_the_reply_are_those_of_the_session():
    info = decode_server_info(packet('serverinfo_packet_v3'))
    assert info == ServerInfo(
        Sender('Motive', (2, 1, 0, 0), (3, 0, 0, 0)), 3_312_787, 1511, True, '239.255.42.99')


def test_the_echo_of_motive_is_read_and_written_to_the_byte():
    data = packet('echorequest_packet_v3')
    sent = decode_echo_request(data)
    assert encode_echo_request(sent) == data
    answer = packet('echoresponse_packet_v3')
    assert decode_echo_response(answer)[0] == sent
    assert encode_echo_response(*decode_echo_response(answer)) == answer


@pytest.mark.parametrize('read', [
    decode_connect, decode_server_info, decode_echo_request, decode_echo_response])
@pytest.mark.parametrize('data', [b'', b'\1', b'\1\0\0\0', bytes(268), b'\1\0\0\1' + bytes(256)])
def test_what_is_cut_off_is_one_error(read, data):
    with pytest.raises(PacketError):
        read(data + b'!')
    with pytest.raises(PacketError):
        read(data[:-1])


def test_a_reply_without_a_clock_is_refused():
    info = ServerInfo(CLIENT, 0)
    with pytest.raises(PacketError, match='no frequency'):
        decode_server_info(encode_server_info(info))
    with pytest.raises(PacketError, match='cut off'):
        decode_server_info(message(SERVER_INFO, encode_connect(CLIENT)[4:]))


def test_a_long_name_is_cut():
    long = CLIENT._replace(name='x' * 1000)
    assert decode_connect(encode_connect(long)).name == 'x' * 255
