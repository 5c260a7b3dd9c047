"""
The node that every node of the graph extends, and the loop that runs it.

``rclpy``'s executor rebuilds its wait set and makes a task for every message, which costs most
of a simulated step. Messages of the graph instead go through one wait set built once
(:class:`Loop`); timers, parameters and services keep their turn in an ordinary executor every
few milliseconds. Messages are published and taken as bytes (``mambo_ros.messages``).

Nodes that share a loop hand each other their messages directly, and the middleware gets only
what somebody outside reads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
import gc
import math
import os
from pathlib import Path
import resource
import signal
import sys
import time
import traceback
from typing import Any, Generic, NamedTuple, NoReturn, TypeVar

from mambo_interfaces.msg import NodeLinks
from mambo_model.schema import ParameterError
import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from . import diagnostics, leaving, params, peers, topics
from .intake import Intake

P = TypeVar('P')

QUEUE = topics.QUEUE
REFUSED = 'refused messages:'
"""Begin of the line that says how many."""

_HOUSEKEEPING = 0.02  # s, the longest wait at once
_TURN = 0.05  # s between turns of the ordinary executor, each of which costs most of a step
_LAZY = 0.005  # s between looks at topics that need not be prompt
_SOON = 0.0003  # s, within which what belongs to a prompt message follows it
_AT_ONCE = 100  # messages of one topic before timers and the other topics get their turn
_BYTES_AT_ONCE = 1_000_000  # likewise
_REPORT_EVERY = 1.0  # s between reports of refused messages
_QUIET = 0.1  # s without a message after which a stopping node has taken everything
_FLUSH = 2.0  # s in which readers acknowledge what a leaving process has published
_TEARDOWN = 1.0  # s that the middleware has to say goodbye; it has been seen to hang there
_NEAR = 2**32 - 1  # publishers found of a topic that the same process says
_PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'  # of the user, or ours
_REFUSALS = (ParameterError, FileNotFoundError, FileExistsError, _rclpy.RCLError)


class _Lean(CallbackGroup):
    """Entities that only :class:`Loop` serves: the ordinary executor passes them over."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


def qos(topic: topics.Topic, depth: int = QUEUE, reliable: bool = True) -> QoSProfile:
    """Return the quality of service of a topic: reliable, deep, volatile unless it says so."""
    durability = (DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local
                  else DurabilityPolicy.VOLATILE)
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=reliability, durability=durability)


def refusals_line(counts: Mapping[str, int]) -> str:
    """Return as one line how many messages were refused, by topic and reason."""
    return f'{REFUSED} ' + ', '.join(f'{count} {what}' for what, count in counts.items())


class Voice:
    """
    What a node says on one topic.

    Attributes
    ----------
    publisher
        Of the middleware; its readers are in other loops.
    near
        Callbacks of the readers in the same loop.
    shared : bool
        Whether nodes of other processes say the topic too.

    """

    def __init__(self, publisher: Publisher, shared: bool) -> None:
        self.publisher, self.shared = publisher, shared
        self.near: list[Callable[[bytes], None]] = []
        self.queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._publish = publisher.handle.publish_raw

    def __call__(self, data: bytes) -> None:
        """Publish a serialised message."""
        if self.near:
            for take in self.near:
                self.queue.append((take, data))
            if not self.publisher.handle.get_subscription_count():
                return
        self._publish(data)

    @property
    def matched(self) -> int:
        """Return how many readers the next message reaches."""
        return len(self.near) + self.publisher.get_subscription_count()


class Ear(NamedTuple):
    """What a node hears."""

    topic: topics.Topic
    name: str  # resolved
    take: Callable[[bytes], None] | Intake
    prompt: bool
    reliable: bool = True


class MamboNode(Node, Generic[P]):
    """
    A node with schema parameters, byte topics and announced links.

    Parameters
    ----------
    name : str
        Node name; the namespace defaults to ``/mambo``.
    params_type : type
        Parameter dataclass (``mambo_model.schema``), declared and filled as ``self.params``.
    kwargs
        As of ``rclpy.node.Node``.

    Raises
    ------
    mambo_model.schema.ParameterError
        If a given parameter is unknown, of a wrong type or out of range.

    """

    def __init__(self, name: str, params_type: type[P], **kwargs: Any) -> None:
        kwargs.setdefault('namespace', 'mambo')
        super().__init__(name, **kwargs)
        self.params = params.declare(self, params_type)
        self.said: list[Voice] = []
        self.heard: list[Ear] = []
        self._lean = _Lean()
        self._sources: dict[str, Subscription] = {}  # by topic
        self._matched: list[int] | None = None
        self._refusals: dict[str, int] = {}  # by topic and reason, as last reported
        self._next_report = 0.0  # s of wall time
        self._links = self.create_publisher(
            topics.LINKS.msg_type, topics.LINKS.name, qos(topics.LINKS, 1))

    def say(self, topic: topics.Topic) -> Voice:
        """Advertise a topic; return what publishes serialised messages on it when called."""
        name = self.resolve_topic_name(topic.name)
        for voice in self.said:
            if voice.publisher.topic_name == name:
                return voice
        voice = Voice(
            self.create_publisher(topic.msg_type, topic.name, qos(topic)), topic.shared)
        self.said.append(voice)
        return voice

    def hear(self, topic: topics.Topic, callback: Callable[[bytes], None],
             prompt: bool = True) -> None:
        """
        Have ``callback`` get each serialised message of a topic, in order, from the loop on.

        Parameters
        ----------
        topic
            What to hear.
        callback
            Gets the bytes.
        prompt
            Whether the process wakes up for a message; otherwise it is taken together with the
            next prompt one, or some milliseconds later.

        """
        self.heard.append(Ear(topic, self.resolve_topic_name(topic.name), callback, prompt))

    def accept(self, topic: topics.Topic, decode: Callable[[bytes], tuple],
               callback: Callable[..., Any], prompt: bool = True, reliable: bool = True,
               **bounds: Any) -> Intake:
        """
        Have ``callback`` get what each usable message of a topic says; return its guard.

        Parameters
        ----------
        topic
            What to hear.
        decode
            From bytes to a tuple that begins with the stamp in ns.
        callback
            Gets that tuple as arguments.
        prompt
            As of :meth:`hear`.
        reliable
            Whether to ask for reliable delivery; a reader that does not also hears publishers
            that offer best effort only.
        bounds
            What can be used, as of ``intake.Intake``. What cannot is refused, with a warning and
            a count on ``/diagnostics``.

        """
        name = self.resolve_topic_name(topic.name)
        guard = Intake(name, decode, callback, **bounds)
        guard.publishers = partial(self.count_publishers, name)
        self.heard.append(Ear(topic, name, guard, prompt, reliable))
        self.say(topics.DIAGNOSTICS)
        return guard

    def subscribe(self, ear: Ear) -> Subscription:
        """Subscribe at the middleware what is to be heard."""
        self._sources[ear.name] = self.create_subscription(
            ear.topic.msg_type, ear.name, ear.take, qos(ear.topic, reliable=ear.reliable),
            callback_group=self._lean, raw=True)
        return self._sources[ear.name]

    @property
    def intakes(self) -> list[Intake]:
        """Return the guards of all inputs."""
        return [ear.take for ear in self.heard if isinstance(ear.take, Intake)]

    def refused(self) -> dict[str, int]:
        """Return how many messages were refused, by topic and reason."""
        return {f'{guard.topic} {reason}': count for guard in self.intakes
                for reason, count in sorted(guard.refused.items())}

    def ends(self) -> list[peers.End]:
        """Return the topics of this node as the graph has them."""
        return [
            *(peers.End(ear.name, ear.topic.shared, qos(ear.topic, reliable=ear.reliable), False)
              for ear in self.heard),
            *(peers.End(voice.publisher.topic_name, voice.shared, voice.publisher.qos_profile,
                        True) for voice in self.said)]

    def report_refusals(self, now: float) -> None:
        """
        Warn of messages that were refused since the last report, once a second.

        Parameters
        ----------
        now : s
            Wall time, of ``time.monotonic``.

        """
        counts = self.refused() if now >= self._next_report else self._refusals
        if counts == self._refusals:
            return
        self._refusals, self._next_report = counts, now + _REPORT_EVERY
        line = refusals_line(counts)
        self.get_logger().warning(line)
        stamp = max([0, *(guard.last for guard in self.intakes)])
        self.say(topics.DIAGNOSTICS)(diagnostics.report(
            stamp, f'{self.get_name()}: inputs', diagnostics.WARN, line, counts))

    def finish(self) -> None:
        """Do what is left after the last message; called once while the graph still works."""

    def announce(self) -> None:
        """Tell the graph which links of this node are matched, when that has changed."""
        matched = [voice.matched for voice in self.said] + [
            self._sources[ear.name].get_publisher_count() if ear.name in self._sources else _NEAR
            for ear in self.heard]
        if matched == self._matched:
            return
        self._matched = matched
        self._links.publish(NodeLinks(
            node=self.get_fully_qualified_name(), subscribed=[ear.name for ear in self.heard],
            published=[voice.publisher.topic_name for voice in self.said], matched=matched))

    def flush(self, seconds: float = _FLUSH) -> None:
        """Publish what is left; wait at most so long until every reader has acknowledged it."""
        self.report_refusals(math.inf)
        limit = time.monotonic() + seconds
        for voice in self.said:
            left = max(limit - time.monotonic(), 0.0)
            voice.publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=left))


class _Entry(NamedTuple):
    """A subscription that a loop serves."""

    handle: Any
    msg_type: type
    take: Callable[..., None]
    guarded: bool  # whether it wants to know the number of a message


def _take_all(entry: _Entry) -> bool:
    """Handle what the middleware has of a topic; return whether there was anything."""
    handle, msg_type, callback, guarded = entry
    size = 0
    for _ in range(_AT_ONCE):
        taken = handle.take_message(msg_type, True)
        if taken is None:
            break
        data, about = taken
        if guarded:
            callback(data, about['publication_sequence_number'])
        else:
            callback(data)
        size += len(data)
        if size > _BYTES_AT_ONCE:
            break
    return size > 0


class Loop:
    """
    What runs some nodes of one process: their wait set, and the queue between them.

    A topic that a node of the loop says is heard from there by the others, in the order in which
    everything was said; at the middleware they subscribe only topics that nobody in the loop
    says, and shared ones, which nodes elsewhere say too.

    Attributes
    ----------
    stopping : bool
        Set by :meth:`stop` or a signal; :meth:`run` then takes what has arrived and returns.
    urgent : bool
        Set by a second signal: what has arrived is left.

    """

    def __init__(self, *nodes: MamboNode) -> None:
        self.stopping = self.urgent = False
        self._nodes = nodes
        self._executor = SingleThreadedExecutor()
        self._queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        for node in nodes:
            self._executor.add_node(node)
            for voice in node.said:
                voice.queue = self._queue
        far = [(node, ear) for node in nodes for ear in node.heard if not self._near(ear)]
        far.sort(key=lambda pair: pair[1].prompt)  # when a prompt one wakes, the others are first
        self._entries = [self._entry(node, ear) for node, ear in far]
        self._prompt = [
            entry for entry, (_, ear) in zip(self._entries, far, strict=True) if ear.prompt]
        self._longest = _HOUSEKEEPING if len(self._prompt) == len(far) else _LAZY
        self._mixed = 0 < len(self._prompt) < len(far)
        self._stirred = False
        self._context = rclpy.get_default_context()
        with self._context.handle:
            self._wait_set = _rclpy.WaitSet(
                len(self._prompt), 0, 0, 0, 0, 0, self._context.handle)
        self._next_turn = 0.0
        self._peers = [peers.Peers(node, node.ends()) for node in nodes]

    def _entry(self, node: MamboNode, ear: Ear) -> _Entry:
        """Subscribe what is to be heard from elsewhere."""
        guarded = isinstance(ear.take, Intake)
        entry = _Entry(node.subscribe(ear).handle, ear.topic.msg_type, ear.take, guarded)
        if guarded:
            ear.take.pull = partial(_take_all, entry)
        return entry

    def _near(self, ear: Ear) -> bool:
        """Join an ear to the voices of this loop; return whether there are any."""
        voices = [voice for node in self._nodes for voice in node.said
                  if voice.publisher.topic_name == ear.name and not voice.shared]
        for voice in voices:
            voice.near.append(ear.take)
        return bool(voices)

    def stop(self) -> None:
        """Ask :meth:`run` to return."""
        self.stopping = True

    def once(self, timeout: float) -> bool:
        """
        Wait for messages and handle all that have arrived.

        Parameters
        ----------
        timeout : s
            Longest wait; 0 returns at once.

        Returns
        -------
        handled : bool
            Whether any message was handled.

        """
        now = time.monotonic()
        if now >= self._next_turn:
            self.turn()
            self._next_turn = now + _TURN
        queue = self._queue
        handled = bool(queue)
        for _ in range(_AT_ONCE):
            if not queue:
                break
            take, data = queue.popleft()
            take(data)
        if not handled:  # topics are not in order: a prompt message may overtake a lazy one
            self._wait(min(timeout, _SOON if self._stirred else self._longest))
        taken = self._take()
        self._stirred = taken and self._mixed
        return taken or handled

    def _wait(self, timeout: float) -> None:
        """Wait for a prompt message of the middleware."""
        if not self._prompt:  # an empty wait set cannot wait
            time.sleep(timeout)
            return
        wait_set = self._wait_set
        wait_set.clear_entities()
        for entry in self._prompt:
            wait_set.add_subscription(entry.handle)
        wait_set.wait(int(timeout * 1e9))

    def _take(self) -> bool:
        """Handle what the middleware has; return whether there was anything."""
        handled = False
        for entry in self._entries:
            handled = _take_all(entry) or handled
        return handled

    def run(self) -> None:
        """Handle messages until :meth:`stop`, then what has arrived by then."""
        while not self.stopping and self._context.ok():
            self.once(_HOUSEKEEPING)
        self.drain()

    def drain(self) -> None:
        """Handle messages until none has come for a moment, or a second signal has."""
        limit = time.monotonic() + 5.0
        quiet_since = time.monotonic()
        while not self.urgent and (
                time.monotonic() < min(limit, quiet_since + _QUIET)):
            if self.once(_HOUSEKEEPING):
                quiet_since = time.monotonic()

    def turn(self) -> None:
        """Announce links, report; give timers, parameters and services their turn."""
        now = time.monotonic()
        for node in self._nodes:
            node.announce()
            node.report_refusals(now)
        for watch in self._peers:
            watch.look()
        self._executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Release the executor."""
        self._executor.shutdown()


def _line(error: BaseException) -> str:
    """Return what an error says as one line, without places in the sources of ROS."""
    return ' '.join(str(error).split(', at /')[0].split())


def main(node_type: type[MamboNode], args: list[str] | None = None,
         run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """Run one node as a process, as :func:`compose`: entry point of every ``*_node``."""
    compose((node_type,), args, run)


def compose(node_types: Sequence[type[MamboNode]], args: list[str] | None = None,
            run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """
    Run nodes as one process.

    SIGINT, SIGTERM and SIGHUP let the nodes take what has arrived, finish and leave; a second one
    lets them leave the rest. A wrong parameter or parameter file ends them with one line and exit
    code 2. The process leaves as soon as it has finished and flushed, even where the middleware
    hangs in its teardown.

    Parameters
    ----------
    node_types
        Classes of the nodes.
    args
        Command line, default ``sys.argv``.
    run
        What to do with the last node and the loop; returns the exit code. Default: serve
        messages.

    """
    loop: Loop | None = None
    stopped = ''
    nodes: list[MamboNode] = []

    def stop(number: int, _: Any) -> None:
        nonlocal stopped
        again, stopped = bool(stopped), stopped or signal.Signals(number).name
        if loop is not None:
            loop.urgent = again
            loop.stop()
        elif not again:
            raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, stop)
    os.environ.setdefault(_PROFILES, str(Path(__file__).with_name('fastdds.xml')))
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        for node_type in node_types:
            nodes.append(node_type())
        loop = Loop(*nodes)
    except BaseException as error:  # stopped while numerics compile, the compiler raises anything
        for node in nodes:
            node.finish()
        if stopped:
            _leave(nodes, 0)
        if not isinstance(error, _REFUSALS):
            traceback.print_exc()
            _leave(nodes, 1)
        print(f'{node_types[len(nodes)].__name__}: {_line(error)}', file=sys.stderr)
        _leave(nodes, 2)
    if stopped:
        loop.stop()
    code = 1
    try:
        code = _serve(nodes, loop, run, lambda: stopped) or 0
    except BaseException:  # an error of a node, whose process leaves like any other
        traceback.print_exc()
    _leave(nodes, code, loop)


def _leave(nodes: Sequence[MamboNode], code: int, loop: Loop | None = None) -> NoReturn:
    """End the process; the middleware says goodbye to the graph if it does so in time."""
    leaving.exit_after(_TEARDOWN, code)
    try:
        sys.stdout.flush()
        sys.stderr.flush()
        if loop is not None:
            loop.close()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    finally:  # nor through what the middleware does when an interpreter ends
        os._exit(code)


def _serve(nodes: list[MamboNode], loop: Loop,
           run: Callable[[Any, Loop], int | None] | None,
           stopped: Callable[[], str]) -> int | None:
    """Run nodes to their end in order, say what that took and by what; return the exit code."""
    code: int | None = 0
    before = time.process_time()  # with the threads of the middleware
    gc.freeze()  # what is loaded stays: the collector need not look at it while time runs
    try:
        if run is None:
            loop.run()
        else:
            code = run(nodes[-1], loop)
        if len(nodes) > 1:
            loop.drain()
    finally:
        if stopped():
            print(f'ended by {stopped()}', flush=True)
        for node in nodes:  # a bag is closed before anything that may hang
            node.finish()
        limit = time.monotonic() + _FLUSH
        for node in nodes:
            node.flush(limit - time.monotonic())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(f'used {time.process_time() - before:.2f} s of CPU and {memory} MB', flush=True)
    return code
