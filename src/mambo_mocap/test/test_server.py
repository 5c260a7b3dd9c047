"""What a server answers, to whom it sends, and what hostile commands do to it."""

from hypothesis import given, settings, strategies as st
from mambo_mocap.natnet import handshake, wire
from mambo_mocap.natnet.frame import decode_frame, Frame, Times
from mambo_mocap.natnet.model import bodies, decode_model
from mambo_mocap.parameters import NatNetServerNodeParams
from mambo_mocap.server import FREQUENCY, MOST_CLIENTS, Server, SILENT, ticks
from mambo_model.schema import ParameterError
import pytest

HERE = ('127.0.0.1', 4000)
FRAME = Frame(1, Times(0.5, 1, 2, 3))


def server(**given):
    return Server(NatNetServerNodeParams(**given))


@pytest.mark.parametrize('hello', [
    handshake.encode_connect(handshake.Sender('NatNetLib', (3, 0, 0, 0), (3, 0, 0, 0))),
    b'\0\0\4\0', b'\0\0\5\0Ping\0', b'\0\0\0\0'])  # of Motive's client and those of others
@pytest.mark.parametrize('version', ['2.9', '3.1', '4.2'])
def test_a_client_learns_version_ports_and_clock(hello, version):
    info = handshake.decode_server_info(server(version=version).answer(hello, HERE, 0))
    assert info.sender.version == tuple(map(int, version.split('.')))
    if version != '2.9':
        assert (info.frequency, info.data_port, info.multicast) == (FREQUENCY, 1511, True)
        assert info.group == '239.255.42.99'


def test_the_definitions_and_the_time_are_answered():
    one = server(version='4.1', body='drone', body_id=3)
    found = decode_model(one.answer(b'\4\0\0\0', HERE, 0), (4, 1))
    assert bodies(found) == ((3, 'drone'),)
    answer = one.answer(handshake.encode_echo_request(77), HERE, 1_234_567_800)
    assert handshake.decode_echo_response(answer) == (77, ticks(1_234_567_800)) == (77, 12_345_678)


def test_frames_go_to_the_group_or_to_each_client():
    assert [address for _, address in server().packets(FRAME, 0)] == [('239.255.42.99', 1511)]
    one = server(transmission='unicast')
    assert one.packets(FRAME, 0) == []
    for port in (4000, 4001):
        one.answer(b'\0\0\0\0', ('127.0.0.1', port), 0)
    assert [address for _, address in one.packets(FRAME, 0)] == [HERE, ('127.0.0.1', 4001)]
    one.answer(wire.message(wire.DISCONNECT, b''), HERE, 0)
    assert [address for _, address in one.packets(FRAME, 0)] == [('127.0.0.1', 4001)]
    fixed = server(transmission='unicast', unicast_to='data_port')
    for port in (4000, 4001):
        fixed.answer(b'\2\0\0\0', ('127.0.0.1', port), 0)
    assert [address for _, address in fixed.packets(FRAME, 0)] == [('127.0.0.1', 1511)]


def test_a_client_that_stops_its_signs_of_life_leaves():
    one = server(transmission='unicast')
    one.answer(b'\0\0\0\0', HERE, 0)
    assert len(one.packets(FRAME, 10 * SILENT)) == 1  # some clients never send any
    one.answer(wire.message(wire.KEEP_ALIVE, b''), HERE, 10 * SILENT)
    assert len(one.packets(FRAME, 11 * SILENT)) == 1
    assert one.packets(FRAME, 11 * SILENT + 1) == []


def test_the_number_of_clients_is_bounded():
    one = server(transmission='unicast')
    for port in range(1, 5000):
        one.answer(b'\0\0\0\0', ('127.0.0.1', port), port)
    assert len(one.clients) == MOST_CLIENTS == len(one.packets(FRAME, 0))
    assert ('127.0.0.1', 4999) in one.clients


def test_a_client_chooses_the_version_of_its_frames():
    one = server(transmission='unicast', version='4.1')
    one.answer(b'\0\0\0\0', HERE, 0)
    assert one.answer(b'\2\0\0\0Bitstream,3.1\0', HERE, 0) == wire.message(
        wire.RESPONSE, b'\0\0\0\0')
    (data, _), = one.packets(FRAME, 0)
    assert decode_frame(data, (3, 1)) == FRAME
    for words in (b'Bitstream', b'Bitstream,9.9', b'Bitstream,x.y', b'Nonsense'):
        assert wire.kind(one.answer(b'\2\0\0\0' + words + b'\0', HERE, 0)) == wire.UNRECOGNISED
    assert one.refused['unknown'] == 4
    assert one.answer(b'\2\0\0\0FrameRate\0', HERE, 0)[4:] == b'\0\0\xf0B'  # 120 as float


@given(st.lists(st.tuples(st.integers(0, 120), st.binary(max_size=2000)), max_size=20))
@settings(max_examples=100, deadline=None)
def test_hostile_commands_are_survived(commands):
    one = server(transmission='unicast')
    for number, payload in commands:
        reply = one.answer(number.to_bytes(2, 'little') + payload, HERE, 0)
        assert reply is None or len(reply) <= wire.LARGEST
    assert len(one.clients) <= 1
    assert handshake.decode_server_info(one.answer(b'\0\0\0\0', HERE, 0))


def test_what_cannot_be_read_is_counted():
    one = server()
    for data in (b'', b'\0', bytes(5000), b'\x0c\0\0\0', b'\x63\0\0\0'):
        one.answer(data, HERE, 0)
    assert one.refused == {'malformed': 3, 'too long': 1, 'unknown': 1}


def many(count, name):
    return ','.join(f'{name}{k}=/d{k}/truth' for k in range(count))


@pytest.mark.parametrize(('count', 'name'), [(256, 'drone'), (60, 'n' * 200)])
def test_bodies_that_fit_into_no_packet_are_refused_at_the_start(count, name):
    with pytest.raises(ParameterError, match=f'^{count} bodies of these names may not fit into '
                                             'one packet: a message of .*: give fewer bodies'):
        server(bodies=many(count, name))


def test_the_bodies_of_a_full_hall_fit_for_every_client():
    one = server(bodies=many(64, 'drone'), transmission='unicast')
    assert len(one.answer(wire.message(wire.REQUEST_MODEL, b''), HERE, 0)) > 10_000
