"""The client over a simulated channel: jitter, loss, reordering, strangers and damage."""

import heapq

from mambo_mocap.client import ANEW, Client, RESTART
from mambo_mocap.natnet import handshake, wire
from mambo_mocap.natnet.frame import (
    encode_frame, Frame, MODELS_CHANGED, RigidBody, Times, TRACKED)
from mambo_mocap.natnet.model import BodyModel, encode_model
from mambo_mocap.parameters import NatNetServerNodeParams
from mambo_mocap.server import FREQUENCY, Server
from motive import FRAMES, INFOS, packet
import numpy as np
import pytest

EPOCH = 1_795_000_000_000_000_000  # ns
ADDRESS = ('10.0.0.2', 4000)
BODY = RigidBody(1, (0.5, 1.5, -0.25), (0.0, 0.6, 0.0, 0.8), 1e-4, TRACKED)


class Channel:
    """A server, a network and this host's clock, played without waiting."""

    def __init__(self, version='4.1', drift=0.0, jitter=5e-3, loss=0.1, damage=0.0, seed=1,
                 **given):
        self.server = Server(NatNetServerNodeParams(
            version=version, transmission='unicast', **given))
        self.client = Client()
        self.rng = np.random.default_rng(seed)
        self.drift, self.jitter, self.loss, self.damage = drift, jitter, loss, damage
        self.events, self.count, self.seen = [], 0, []

    def here(self, s):
        """Return this host's clock, ns, at a true time, s, which is the server's."""
        return EPOCH + round(s * (1.0 + self.drift) * 1e9)

    def send(self, now, to_server, data):
        """Put a packet on its way."""
        if self.rng.random() < self.loss:
            return
        if self.rng.random() < self.damage:
            data = bytearray(data)
            for _ in range(3):
                data[self.rng.integers(len(data))] = self.rng.integers(256)
            data = bytes(data[:self.rng.integers(1, len(data) + 1)])
        self.count += 1
        heapq.heappush(self.events, (
            now + 1e-4 + self.rng.uniform(0.0, self.jitter), self.count, to_server, data))

    def play(self, seconds, rate=120.0, begin=0.0):
        """Stream for some seconds; collect (true exposure, pose, arrival)."""
        for k in range(round(seconds * rate)):
            now = begin + k / rate
            while self.events and self.events[0][0] <= now:
                at, _, to_server, data = heapq.heappop(self.events)
                if to_server:
                    reply = self.server.answer(data, ADDRESS, round(at * 1e9))
                    if reply:
                        self.send(at, False, reply)
                else:
                    self.seen += [(at, one) for one in self.client.take(data, self.here(at))]
            exposure = now - 6e-3
            frame = Frame(k + 1 + round(begin * rate), Times(max(exposure, 0.0), *(
                max(round(t * FREQUENCY), 0) for t in (exposure, now - 1e-3, now))),
                bodies=(BODY,))
            for data, _ in self.server.packets(frame, round(now * 1e9)):
                self.send(now, False, data)
            if k % 2 == 0:
                for data in self.client.due(self.here(now)):
                    self.send(now, True, data)


@pytest.mark.parametrize('drift', [0.0, 60e-6])
@pytest.mark.parametrize('version', ['3.1', '4.2'])
def test_stamps_are_within_a_fifth_of_a_millisecond_of_the_exposure(version, drift):
    channel = Channel(version, drift)
    channel.play(25.0, rate=360.0)
    found = [(at, one) for at, one in channel.seen if at > 10.0]
    assert len(found) > 3000  # of 5400: a tenth is lost, others are overtaken by later ones
    stamps = np.array([one.stamp for _, one in found])
    frames = np.round(((stamps - EPOCH) * 1e-9 / (1.0 + drift) + 6e-3) * 360.0)
    truth = np.array([channel.here(k / 360.0 - 6e-3) for k in frames.tolist()])
    assert np.abs(stamps - truth).max() < 200_000
    assert (np.diff(stamps) > 0).all()
    latency = np.array([one.latency for _, one in found])
    late = np.array([channel.here(at) for at, _ in found]) - stamps
    np.testing.assert_allclose(latency, late * 1e-9, atol=2e-4)
    assert channel.client.counts['late frames'] > 100
    assert 6e-3 < channel.client.delays.total < 13e-3
    assert channel.client.delays.camera == pytest.approx(5e-3, abs=1e-6)
    assert channel.client.delays.software == pytest.approx(1e-3, abs=1e-6)


def test_without_echoes_a_stamp_is_late_by_the_least_delay_alone():
    channel = Channel('3.1', loss=0.0, jitter=1e-3)
    channel.server._echo = lambda data, now: None
    channel.play(12.0)
    found = np.array([one.stamp for at, one in channel.seen if at > 10.0])
    late = (found - EPOCH) * 1e-9 + 6e-3  # behind the exposure
    assert np.abs(late - np.round(late * 120.0) / 120.0 - 1e-4).max() < 5e-5
    assert not channel.client.match.answered


def test_the_pose_is_in_our_axes_and_has_its_name():
    channel = Channel(loss=0.0, jitter=1e-4, body='drone')
    channel.play(3.0)
    seen = channel.seen[-1][1]
    assert (seen.name, seen.identifier) == ('drone', 1)
    assert seen.rho == pytest.approx((0.5, -0.25, -1.5))
    assert seen.q == pytest.approx((0.8, 0.0, 0.0, -0.6))
    assert channel.client.counts['frames'] == len(channel.seen)
    assert not channel.client.counts['missing frames']


def test_damage_is_counted_and_survived():
    channel = Channel(damage=0.3, seed=5)
    channel.play(20.0)
    client = channel.client
    assert client.counts['malformed'] > 100 and client.problem
    assert client.counts['frames'] > 500
    assert client.info is not None and client.names == {1: 'mambo'}


def test_a_server_that_comes_back_is_found_again():
    channel = Channel(loss=0.0)
    channel.play(3.0)
    channel.server = Server(NatNetServerNodeParams(version='3.1', transmission='unicast'))
    before = len(channel.seen)
    channel.play(6.0, begin=10.0)
    assert channel.client.version == (3, 1)
    assert channel.client.counts['lost connection'] == 1
    assert len(channel.seen) - before > 300


def test_only_frames_of_known_kind_and_order_are_used():
    client = Client()
    client.take(handshake.encode_server_info(Server(NatNetServerNodeParams(
        version='3.0')).info), EPOCH)
    for number, used in ((5, 1), (5, 0), (4, 0), (8, 1), (8 - RESTART, 1)):
        data = encode_frame(Frame(number, Times(0.1, 1, 2, 3), bodies=(BODY,)), (3, 0))
        assert len(client.take(data, EPOCH + 10**8)) == used, number
    assert client.counts['late frames'] == 2 and client.counts['missing frames'] == 2
    for bad in (BODY._replace(attitude=(0.0,) * 4), BODY._replace(flags=0),
                BODY._replace(position=(float('nan'), 0.0, 0.0)),
                BODY._replace(position=(float('inf'), 0.0, 0.0))):
        data = encode_frame(Frame(9, Times(0.1, 1, 2, 3), bodies=(bad,)), (3, 0))
        client._last = 8
        assert client.take(data, EPOCH) == []
    assert client.counts['bodies without a pose'] == 3
    assert client.counts['bodies not tracked'] == 1
    for time in (float('nan'), float('inf'), -1.0):
        data = encode_frame(Frame(9, Times(time, 1, 2, 3), bodies=(BODY,)), (3, 0))
        assert client.take(data, EPOCH) == []
    assert client.counts['malformed'] == 3 and 'has no time' in client.problem


@pytest.mark.parametrize(('name', 'version'), FRAMES.items())
def test_the_frames_of_motive_are_poses(name, version):
    info = next(one for one, of in INFOS.items() if of == version)
    client = Client(server_time=True)
    assert client.take(packet(name), EPOCH) == []
    assert client.counts == {'before the connection': 1}
    client.take(packet(info), EPOCH)
    seen, = client.take(packet(name), EPOCH)
    assert abs(sum(x * x for x in seen.q) - 1.0) < 1e-9 and seen.stamp > 0
    if version == (3, 0):
        client.take(packet('modeldef_packet_v3'), EPOCH)
        assert client.names == {2: 'RaceQuad'}


def test_an_unknown_version_is_one_clear_line():
    client = Client()
    info = handshake.ServerInfo(handshake.Sender('Motive', (4, 0, 0, 0), (5, 0, 0, 0)), 10)
    client.take(handshake.encode_server_info(info), EPOCH)
    assert client.info is None
    assert client.problem == (
        'NatNet 5.0 is unknown: set the server to a version from 2.5 to 4.2')


def test_an_echo_that_nobody_asked_for_is_not_believed():
    client = Client()
    client.take(handshake.encode_server_info(Server(NatNetServerNodeParams()).info), EPOCH)
    for sent in (EPOCH + 1, EPOCH - 10**11, 0, 2**64 - 1):
        client.take(handshake.encode_echo_response(sent, 5), EPOCH)
    assert client.counts['malformed'] == 4 and client.match.line is None
    assert client.take(wire.message(55, b''), EPOCH) == [] and client.counts['unknown'] == 1


def test_an_echo_of_a_server_without_a_clock_is_not_believed():
    client = Client()
    info = Server(NatNetServerNodeParams(version='2.9')).info
    client.take(handshake.encode_server_info(info), EPOCH)
    assert client.version == (2, 9)
    client.take(handshake.encode_echo_response(EPOCH, 5), EPOCH + 1)
    assert client.counts['malformed'] == 1 and client.match.line is None


@pytest.mark.parametrize(('exposure', 'side'), [
    (0, 'before'), (10**15 + 10**6, 'after'), (2**64 - 1, 'after')])
def test_a_frame_of_an_impossible_time_has_no_pose(exposure, side):
    client = Client()
    client.take(handshake.encode_server_info(Server(NatNetServerNodeParams()).info), EPOCH)
    now = 10**15  # ticks
    body = RigidBody(1, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.0)

    def frame(number, exposed):
        times = Times(1.0, exposed, now, now)
        return encode_frame(Frame(number, times, bodies=(body,)), (4, 1))
    assert client.take(frame(1, exposure), EPOCH) == []
    assert f's {side} it arrived' in client.problem and client.counts['frames'] == 0
    assert client.take(frame(2, now), EPOCH + 1)[0].stamp == EPOCH
    assert client.take(frame(3, now + 10**5), EPOCH + 2)  # 10 ms of clock error


def connected(names=((1, 'mambo'),), **given):
    """Return a client that has the definitions of its server."""
    client = Client(**given)
    client.take(handshake.encode_server_info(Server(NatNetServerNodeParams()).info), EPOCH)
    client.take(definitions(*names), EPOCH)
    return client


def definitions(*names):
    return encode_model(tuple(BodyModel(name, number) for number, name in names), (4, 1))


def shown(client, number, k, bodies=(BODY,), flags=0):
    """Return what a client sees in a frame of a number that comes after k periods of 10 ms."""
    at = k * 100_000
    return client.take(encode_frame(Frame(
        number, Times(number * 0.01, at, at, at), bodies=bodies, flags=flags), (4, 1)),
        EPOCH + k * 10_000_000)


def test_a_server_that_begins_anew_within_patience_is_noticed_within_a_second():
    client = connected()
    assert all(shown(client, k, k) for k in range(900))
    assert client.servers == 1
    used = [bool(shown(client, k, 920 + k)) for k in range(800)]
    assert used.index(True) == ANEW // 10_000_000 and all(used[used.index(True):])
    assert client.servers == 2 and client.counts['late frames'] == used.index(True)
    assert client.names == {} and client.due(EPOCH + 10**10).count(
        wire.message(wire.REQUEST_MODEL, b'')) == 1


def test_late_frames_alone_are_no_new_server():
    client = connected()
    for k in range(1000):  # of two ways one takes longer
        shown(client, k, 2 * k)
        shown(client, max(k - 100, 0), 2 * k + 1)
    assert client.servers == 1 and client.counts['late frames'] == 1000
    for k in range(100):  # the last one comes again and again
        assert not shown(client, 999, 2000 + k)
    assert client.servers == 1


def test_names_of_another_server_or_of_changed_definitions_are_forgotten():
    client = connected(((1, 'a'), (2, 'b')))
    assert shown(client, 0, 0)[0].name == 'a'
    client.due(EPOCH + 20 * 10**9)
    assert client.info is None
    client.take(handshake.encode_server_info(
        Server(NatNetServerNodeParams()).info), EPOCH + 21 * 10**9)
    assert client.servers == 2 and shown(client, 1, 2100)[0].name == ''
    client.take(definitions((2, 'a'), (1, 'b')), EPOCH + 21 * 10**9)
    assert shown(client, 2, 2101)[0].name == 'b'
    assert shown(client, 3, 2102, flags=MODELS_CHANGED)[0].name == ''
    assert client.defined is None
    client.take(definitions((1, 'a')), EPOCH + 21 * 10**9)
    # the flag may stay for some frames: names are those of the answer, and asked for again
    assert shown(client, 4, 2103, flags=MODELS_CHANGED)[0].name == 'a'
    assert not client._known and client.defined == ((1, 'a'),)


@pytest.mark.parametrize('lost', [1, RESTART + 5])
def test_definitions_are_asked_for_again_when_the_frame_that_says_so_may_be_missing(lost):
    request = wire.message(wire.REQUEST_MODEL, b'')
    client = connected(((1, 'a'), (2, 'b')))
    client.due(EPOCH)
    assert shown(client, 0, 0)[0].name == shown(client, 1, 1)[0].name == 'a'
    assert request not in client.due(EPOCH + 2 * 10**9)
    assert shown(client, 2 + lost, 202)[0].name == 'a'  # until there is an answer
    assert request in client.due(EPOCH + 22 * 10**8)
    client.take(definitions((2, 'a'), (1, 'b')), EPOCH + 22 * 10**8)
    assert shown(client, 3 + lost, 221)[0].name == 'b'
    assert request not in client.due(EPOCH + 33 * 10**8)


def test_two_bodies_of_one_identifier_in_a_frame_have_no_pose():
    client = connected()
    other = BODY._replace(identifier=2)
    seen = shown(client, 0, 0, (BODY, BODY._replace(position=(5.0, 0.0, 0.0)), other))
    assert [one.identifier for one in seen] == [2]
    assert client.unusable == {1: 'that share their identifier'}
    assert client.counts['bodies that share their identifier'] == 2
    shown(client, 1, 1, (BODY._replace(flags=0),))
    assert client.unusable == {1: 'not tracked'}
    assert shown(client, 2, 2) and client.unusable == {}


def test_patience_begins_when_the_clock_of_this_host_is_set_back():
    client = connected()
    shown(client, 0, 0)
    back = EPOCH - 3600 * 10**9
    client.due(back)
    assert client.info is not None
    client.due(back + 3 * 10**9)
    assert client.info is None and client.counts['lost connection'] == 1


@pytest.mark.parametrize('version', ['2.9', '4.1'])
def test_a_clock_of_the_server_that_is_set_back_is_matched_at_once(version):
    info = Server(NatNetServerNodeParams(version=version)).info
    client = Client()
    client.take(handshake.encode_server_info(info), EPOCH)
    for k in range(1000):
        at = 1.0 + k * 0.01 - (0.9 if k >= 500 else 0.0)
        times = Times(at, *(round(at * FREQUENCY),) * 3)
        here = EPOCH + k * 10_000_000
        seen, = client.take(encode_frame(
            Frame(k, times, bodies=(BODY,)), info.sender.version), here)
        assert abs(here - seen.stamp) < 1000, k  # ns; no delay, so that it is the exposure
    assert client.servers == 2 and not client.match.answered
