"""Messages that were displaced in a full queue are counted, and the node is told."""

from dataclasses import dataclass

from mambo_ros import loop as loops, messages, topics
from mambo_ros.graph.publisher_guard import LOST, UNREAD
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
import pytest
from rclpy.duration import Duration
from ros_helpers import until


@dataclass(frozen=True)
class NoParams:
    """Nothing to set."""


def one_heard():
    """Return publisher, loop and guard of a topic, what was heard, one message, and told."""
    simulator, reader = MamboNode('sim', NoParams), MamboNode('reader', NoParams)
    publish = simulator.advertise(topics.CLOCK)
    heard, told = [], []
    reader.subscribe(topics.CLOCK, heard.append, single=True)
    (guard,) = reader.input_guards
    guard.incomplete = lambda *what: told.append(what)
    loop = Loop(reader)
    until(lambda: publish.publisher.get_subscription_count(), 'the reader')
    publish(messages.clock(0))
    until(lambda: heard, 'the first message', lambda: loop.once(0.01))
    return publish, loop, guard, heard, told


@pytest.mark.usefixtures('ros')
@pytest.mark.parametrize('sent, lost', [(topics.QUEUE, 0), (topics.QUEUE + 500, 500)])
def test_what_a_full_queue_displaced_is_counted(sent, lost):
    publish, loop, guard, heard, told = one_heard()
    for k in range(1, sent + 1):
        publish(messages.clock(k))
    until(lambda: heard[-1] == messages.clock(sent), 'the last message', lambda: loop.once(0.01))
    loop.close()
    assert len(heard) == sent + 1 - lost and guard.refused[LOST] == lost
    assert told == [(guard, LOST)] * bool(lost)


@pytest.mark.usefixtures('ros')
@pytest.mark.parametrize('alone', [True, False], ids=['one first', 'all at once'])
def test_messages_that_the_use_of_one_takes_are_not_lost(alone):
    simulator, reader = MamboNode('sim', NoParams), MamboNode('reader', NoParams)
    publish = simulator.advertise(topics.CLOCK)
    heard = []

    def use(*message):
        """Take what has come meanwhile, as an input does that waits for its clock."""
        heard.append(message)
        if len(heard) % 3 == 1:
            guard.pull()

    reader.subscribe(topics.CLOCK, use, single=True)
    (guard,) = reader.input_guards
    loop = Loop(reader)
    until(lambda: publish.publisher.get_subscription_count(), 'the reader')
    if alone:
        publish(messages.clock(0))
        until(lambda: heard, 'the first message', lambda: loop.once(0.01))
    for k in range(alone, 10):
        publish(messages.clock(k))
    until(lambda: len(heard) == 10, 'the last message', lambda: loop.once(0.01))
    for k in range(10, 12):
        publish(messages.clock(k))
    until(lambda: len(heard) == 12, 'the messages after it', lambda: loop.once(0.01))
    loop.close()
    assert not guard.refused


@pytest.mark.usefixtures('ros')
@pytest.mark.parametrize('urgent', [False, True])
@pytest.mark.parametrize(('longest', 'unread'), [(5.0, False), (0.0, True)])
def test_what_an_ending_node_did_not_read_is_told(monkeypatch, longest, unread, urgent):
    """A slow disk keeps a recorder from what has arrived, or a second signal does."""
    monkeypatch.setattr(loops, '_LONGEST', longest)
    publish, loop, guard, heard, told = one_heard()
    for k in range(1, 300):
        publish(messages.clock(k))
    until(lambda: loops.any_waiting(loop._entries, loop._context), 'the others')
    loop.urgent = urgent
    loop.drain()
    loop.close()
    assert told == [(guard, UNREAD)] * (unread or urgent)
    assert (len(heard) == 300) == (not told)


@pytest.mark.usefixtures('ros')
@pytest.mark.parametrize('more', [0, 1])
def test_what_waits_of_a_second_publisher_is_not_missed(more):
    """A stranger goes on while a recorder ends: only messages of its own publisher count."""
    publish, loop, guard, heard, told = one_heard()
    stranger = MamboNode('stranger', NoParams)
    foreign = stranger.advertise(topics.CLOCK)
    until(lambda: foreign.publisher.get_subscription_count(), 'the reader')
    for k in range(1, 300):
        foreign(messages.clock(k))
    if more:
        publish(messages.clock(1))
    for output in (foreign, publish):  # acknowledged: they wait
        assert output.publisher.wait_for_all_acked(Duration(seconds=20.0))
    loop.urgent = True
    loop.drain()
    loop.close()
    assert len(heard) == 1
    assert told == [(guard, UNREAD)] * more
