"""Which bodies are published, and what the client reports when one has no pose."""

from mambo_mocap.client import Client
from mambo_mocap.natnet import handshake
from mambo_mocap.natnet.frame import encode_frame, Frame, RigidBody, Times
from mambo_mocap.natnet.model import BodyModel, encode_model
from mambo_mocap.parameters import NatNetServerNodeParams
from mambo_mocap.server import Server, ticks
from mambo_mocap.watch import AFTER, ERROR, OK, WARN, Watch
import pytest

EPOCH = 1_795_000_000_000_000_000  # ns
PERIOD = 10_000_000  # ns
INFO = Server(NatNetServerNodeParams(transmission='unicast')).info


def body(identifier, x=1.0, flags=1, y=0.0):
    return RigidBody(identifier, (x, y, 1.0), (0.0, 0.0, 0.0, 1.0), 0.0, flags)


class Stream:
    """A client with its watch, as in the node, that is fed packets."""

    def __init__(self, *wanted, server_time=False):
        self.client = Client(server_time=server_time)
        self.watch = Watch(wanted, server_time, 0.0)
        self.now, self.number, self.shift = 0, 0, 0
        self.poses = {name: [] for name in wanted}

    def take(self, data):
        arrived = EPOCH + self.now + self.shift
        for seen in self.client.take(data, arrived):
            self.watch.follow(self.client)
            for name in self.watch.names(seen.identifier):
                if self.watch.accept(name, seen.stamp, arrived, self.now * 1e-9):
                    self.poses[name].append((seen.stamp, seen.rho[0]))

    def meet(self, *bodies):
        self.take(handshake.encode_server_info(INFO))
        self.take(encode_model(tuple(BodyModel(name, number) for number, name in bodies), (4, 1)))
        return self

    def play(self, seconds, *bodies, ahead=0):
        for _ in range(round(seconds * 1e9) // PERIOD):
            self.now += PERIOD
            at = ticks(EPOCH + self.now)
            self.take(encode_frame(Frame(self.number, Times(
                self.number * PERIOD * 1e-9, at + ticks(ahead), at, at), bodies=bodies), (4, 1)))
            self.number += 1
        return self

    def report(self):
        self.watch.follow(self.client)
        return self.watch.report(self.client, '10.0.0.1:1510', '', self.now * 1e-9)


def test_a_body_without_poses_is_named_with_the_reason_and_the_time():
    stream = Stream('a', 'b').meet((1, 'a'), (2, 'b'))
    assert stream.play(2.0, body(1), body(2)).report() == (OK, '200 frames a second')
    for seconds, two, words in (
            (2.0, (body(2, flags=0),), 'no pose of b for 2.0 s: it is not tracked'),
            (1.0, (), 'no pose of b for 3.0 s: it is not in the frames'),
            (1.0, (body(2, y=float('nan')),), 'no pose of b for 4.0 s: its numbers are no pose'),
            (0.5, (body(2), body(2)),
             'no pose of b for 4.5 s: bodies of a frame share its identifier')):
        assert stream.play(seconds, body(1), *two).report() == (WARN, words)
    assert stream.play(1.0, body(1), body(2)).report()[0] == OK
    assert dict(stream.watch.poses) == {'a': 750, 'b': 300}


def test_many_missing_frames_are_told():
    stream = Stream('a').meet((1, 'a'))
    for step, said in ((1, (OK, '200 frames a second')),
                       (2, (WARN, '199 of 399 frames are missing'))):
        for _ in range(200):
            stream.play(0.01, body(1))
            stream.number += step - 1
        assert stream.report() == said


@pytest.mark.parametrize(('wanted', 'bodies', 'found'), [
    ('mambo', ((1, 'mambo'), (2, 'mambo')), r'mambo (1), mambo (2)'),
    ('mambo', ((1, 'mambo'), (1, 'other')), r'mambo (1), other (1)'),
    ('mambo', ((1, 'other'), (1, 'mambo')), r'other (1), mambo (1)'),
    ('7', ((3, '7'), (7, 'x')), '7 (3), x (7)'), ('7', ((7, 'x'), (7, 'y')), 'x (7), y (7)')])
def test_bodies_that_cannot_be_told_apart_are_refused(wanted, bodies, found):
    stream = Stream(wanted, 'fine').meet(*bodies, (9, 'fine'))
    level, line = stream.play(1.0, *(body(number) for number in {*dict(bodies)}), body(9)).report()
    assert (level, line) == (
        WARN, f'{wanted} is refused, as several bodies have its name or identifier: {found}')
    assert [*map(len, stream.poses.values())] == [0, 100]
    stream.meet((1, 'mambo'), (7, 'x'), (9, 'fine'))
    assert stream.play(1.0, body(1), body(7), body(9)).report()[0] == OK


def test_no_drone_gets_the_pose_of_another_while_definitions_are_missing():
    stream = Stream('a', 'b').meet((1, 'a'), (2, 'b')).play(1.0, body(1), body(2, 2.0))
    stream.client.due(EPOCH + stream.now + 10 * 10**9)  # the connection is lost
    stream.take(handshake.encode_server_info(INFO))
    stream.report()
    assert stream.play(1.0, body(2), body(1, 2.0)).report() == (
        WARN, 'the server has not answered which bodies it has: no pose of a, b')
    stream.meet((2, 'a'), (1, 'b')).play(1.0, body(2), body(1, 2.0))
    assert {x for _, x in stream.poses['a']} == {1.0} and len(stream.poses['b']) == 200


def test_a_number_needs_no_definitions():
    stream = Stream('7', '8')
    stream.take(handshake.encode_server_info(INFO))
    assert stream.play(1.0, body(7)).report() == (
        WARN, 'no pose of 8 for 1.0 s: it is not in the frames')
    assert len(stream.poses['7']) == 100
    stream.meet((3, 'x'))
    assert stream.play(1.0, body(7)).report() == (
        WARN, 'the server does not stream 8; it has: x')


def test_a_server_without_bodies_is_told():
    assert Stream('a').meet().play(0.1).report() == (
        WARN, 'the server does not stream a; it has: no rigid bodies')
    many = Stream(*(f'n{k}' for k in range(100))).meet((1, 'x')).play(0.1)
    assert many.report()[1] == (
        'the server does not stream n0, n1, n2, n3, n4 and 95 more; it has: x')


def test_a_timestamp_of_a_new_server_may_be_before_the_last_one():
    stream = Stream('a', server_time=True).meet((1, 'a')).play(5.0, body(1))
    stream.number = 0
    stream.client.due(EPOCH + stream.now + 10 * 10**9)
    stream.meet((1, 'a')).play(1.0, body(1))
    assert len(stream.poses['a']) == 600 and stream.report()[0] == OK


def test_a_server_that_begins_anew_within_patience_is_silent_for_half_a_second():
    stream = Stream('a', server_time=True).meet((1, 'a')).play(5.0, body(1))
    stream.number = 0
    stream.play(0.52, body(1))
    stream.meet((1, 'a')).play(1.0, body(1))  # the answer to the client's request
    assert len(stream.poses['a']) == 600 and stream.report()[0] == OK


def test_one_exposure_in_the_future_stops_no_pose():
    stream = Stream('a').meet((1, 'a')).play(1.0, body(1)).play(0.01, body(1), ahead=50 * 10**9)
    assert stream.play(1.0, body(1)).report() == (
        WARN, 'malformed packets: frame 100 was exposed 50 s after it arrived')
    assert len(stream.poses['a']) == 200
    assert stream.play(1.0, body(1)).report()[0] == OK  # since the last report


def test_a_clock_of_this_host_that_is_set_back_is_survived_and_told():
    stream = Stream('a').meet((1, 'a')).play(5.0, body(1))
    stream.report()
    stream.shift = -3600 * 10**9
    assert stream.play(1.0, body(1)).report() == (
        WARN, 'no pose of a for 1.0 s: its stamps are not after the last one')
    level, line = stream.play(9.0, body(1)).report()
    assert level == WARN and line.startswith('stamps went back by 359') and 'set' in line
    assert len(stream.poses['a']) == 1500 - AFTER // PERIOD
    assert stream.play(1.0, body(1)).report()[0] == OK


def test_an_equal_stamp_is_never_published_again():
    watch = Watch(['a'], True, 0.0)
    assert watch.accept('a', 5, EPOCH, 0.0)
    assert not any(watch.accept('a', 5, EPOCH + k * AFTER, k) for k in range(9))


def test_why_no_frame_is_of_use_is_told():
    stream = Stream('a')
    assert stream.report() == (
        ERROR, 'no reply from 10.0.0.1:1510: is streaming switched on there?')
    stream.take(handshake.encode_server_info(
        INFO._replace(sender=INFO.sender._replace(protocol=(5, 0, 0, 0)))))
    assert stream.report() == (
        ERROR, 'the reply of 10.0.0.1:1510 is of no use: NatNet 5.0 is unknown: set the server '
        'to a version from 2.5 to 4.2')
    stream.meet((1, 'a'))
    assert stream.report() == (ERROR, 'connected, but no frame comes')
    stream.take(encode_frame(Frame(1, Times(0.0), bodies=(body(1),)), (3, 0)))
    assert stream.report() == (
        ERROR, f'connected, but no frame is of use: {stream.client.problem}')
    stream.play(1.0, body(1)).report()
    stream.number = 5
    assert stream.play(0.1, body(1)).report() == (
        ERROR, 'connected, but all frames are older than one that came before')
    assert stream.watch.report(stream.client, '', 'port in use', 0.0) == (ERROR, 'port in use')
