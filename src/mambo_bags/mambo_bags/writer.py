"""
Write a rosbag2 directory whose bytes depend on the messages alone (no ROS here).

DDS keeps the order within a topic but not across topics, so two runs of one flight reach a
recorder in different orders. This writer holds messages back until their second of ROS time is
complete, sorts the second by (log time, topic, arrival within the topic) and writes it as one MCAP
chunk. Equal payloads give the same file, byte for byte. A killed recorder loses the open second
and the grace period after it, and nothing before.

The layout is that of rosbag2 in Jazzy: ``metadata.yaml`` of version 9 beside ``<name>_0.mcap``
with profile ``ros2``, cdr messages, ``ros2msg`` schemas, QoS and type hash on each channel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
import dataclasses
import errno
from itertools import groupby
import os
from pathlib import Path
from typing import Any, BinaryIO

from mambo_model.errors import MamboError, readable
from mambo_model.whole_file import is_wrong_path
from mcap.reader import make_reader
import numpy as np
from numpy.typing import NDArray
import yaml

from . import message_definition
from .mcap_writer import McapWriter, record, records

SECOND = 1_000_000_000  # [ns]
# [ns] a second is complete once a message later than its end by this much has arrived
GRACE = 250_000_000
PENDING_LIMIT = 1 << 26  # [byte] largest total of messages that are held back
CHUNK_LIMIT = 1 << 20  # [byte] a fuller second is cut into chunks of this size
INFINITE = (9223372036, 854775807)  # [s], [ns] RMW_DURATION_INFINITE
NO_TIME = 2**63 - 1  # [ns] starting time that rosbag2 gives to a bag without messages
RECORDING = {'state': 'recording'}
"""custom_data of metadata.yaml while a bag is not closed, with the process that writes it."""
NEVER = '(a bag is never overwritten)'
MEDIA_TYPES = {
    '.yaml': 'application/yaml', '.json': 'application/json', '.txt': 'text/plain',
    '.md': 'text/markdown'}


class BagWriterError(MamboError, ValueError):
    """A bag cannot be written as requested; the message names what, where and what to do."""


class BagDiskError(BagWriterError):
    """The disk cannot store a bag; the message names what and where."""

    exit_code = 1


@dataclasses.dataclass(frozen=True)
class Qos:
    """
    Offered quality of service of a topic, in rosbag2's terms.

    Attributes
    ----------
    reliability, durability, history
        As ``rmw`` names them: reliable, best_effort; volatile, transient_local; keep_last,
        keep_all, unknown.
    depth
        Samples kept.

    """

    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'
    depth: int = 10

    def profiles(self) -> list[dict[str, Any]]:
        """Return the list of one profile that rosbag2 stores."""
        def infinite() -> dict[str, int]:
            return {'sec': INFINITE[0], 'nsec': INFINITE[1]}
        return [{
            'history': self.history, 'depth': self.depth, 'reliability': self.reliability,
            'durability': self.durability, 'deadline': infinite(), 'lifespan': infinite(),
            'liveliness': 'automatic', 'liveliness_lease_duration': infinite(),
            'avoid_ros_namespace_conventions': False}]


RELIABLE = Qos()
SENSOR_DATA = Qos(reliability='best_effort', depth=5)
TRANSIENT_LOCAL = Qos(durability='transient_local', depth=1)


@dataclasses.dataclass
class _Topic:
    """A declared topic; ``channel`` is set once it is in the file."""

    type_name: str
    profiles: list[dict[str, Any]]
    type_hash: str
    encoding: str
    schema: bytes
    schema_encoding: str
    shared: bool = False
    channel: int = 0
    order: int = 0
    received: int = 0
    written: int = 0


class _PlainDumper(yaml.SafeDumper):
    """Writes equal parts in full, because rosbag2 uses no YAML anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _dump(data: Any) -> str:
    return yaml.dump(data, Dumper=_PlainDumper, sort_keys=False, width=1000)


def refuse_name(path: Path | None) -> None:
    """
    Refuse a path that cannot be that of a bag, before any work is done.

    Parameters
    ----------
    path
        Directory to create; None: there is no bag to write.

    Raises
    ------
    BagWriterError
        If its last part names no directory, or if it is not UTF-8.

    """
    if path is None:
        return
    if path.name in ('', '.', '..'):
        raise BagWriterError(f'{str(path)!r} cannot be the name of a bag: give a new directory')
    if (shown := readable(str(path))) != str(path):  # it is written into metadata.yaml
        raise BagWriterError(
            f'{shown} cannot be the name of a bag: it is not UTF-8: give another name')


class BagWriter:
    """
    Write one bag; declare all topics, then write, then close.

    Parameters
    ----------
    path
        Directory of the bag; created here, with missing parents.
    attachments
        {file name: text or bytes}, e.g. the scenario; stored at the start of the file, so that a
        killed bag has them.
    metadata
        {record name: {key: text}}, MCAP metadata records, stored at the start likewise.
    library
        Name of the writing program in the file's header.

    Attributes
    ----------
    late
        Number of messages that arrived after their second had been written, for example because
        the recorder stalled. They are in a later chunk until :meth:`close` sorts the file.
    beyond
        Number of messages after the end given to :meth:`close`.

    Raises
    ------
    BagWriterError
        If the path exists (a bag is never overwritten) or cannot be created, and from every
        method after a disk error; what was written until then remains for ``recover``.

    """

    def __init__(
        self, path: Path | str, attachments: Mapping[str, str | bytes] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None, library: str = 'mambo',
    ) -> None:
        self.path = Path(path)
        self.late = self.beyond = 0
        self._topics: dict[str, _Topic] = {}
        self._pending: list[tuple[int, int, bytes, int, int, bytes]] = []
        self._pending_size = 0  # [byte]
        self._by_order: list[_Topic] = []
        self._written_until = -1  # [ns] log times below this are in the file
        self._newest = -1
        self._first, self._last = NO_TIME, -1
        self._closed = False
        self._library = library
        # method and arguments that add metadata and attachments
        self._extras: list[tuple[str, tuple]] = []
        self._stream = self._open()
        try:
            self._start(metadata or {}, attachments or {})
        except BaseException:  # the caller has no writer to close
            self._abandon()
            raise

    def _start(self, metadata: Mapping[str, Mapping[str, str]],
               attachments: Mapping[str, str | bytes]) -> None:
        """Write metadata and attachments at the start, so that a killed bag has them."""
        with self._disk():
            self._writer = self._begin(self._stream)
            for name, values in metadata.items():
                self.add_metadata(name, values)
            for name, data in attachments.items():
                self.add_attachment(name, data)
            self._writer.flush()
            self._write_yaml({**RECORDING, 'process': str(os.getpid())})

    def _abandon(self) -> None:
        """Remove a bag that has just been created."""
        self._closed = True
        with suppress(OSError):  # raised while flushing the rest
            self._stream.close()
        for path in self._folder.iterdir():
            path.unlink()
        self._folder.rmdir()

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Turn disk errors into BagWriterError, and leave the bag as it is."""
        try:
            yield
        except OSError as error:
            self._closed = True
            with suppress(OSError):  # raised while flushing the rest
                self._stream.close()
            left = '; recover reads what is in it' if self._by_order and not isinstance(
                error, FileExistsError) else ''
            if not (self._folder / self.file.name).exists():
                left = ': it has been moved or removed'
            raise BagDiskError(f'cannot write {self.file}: {error.strerror}{left}') from None

    def _begin(self, stream: BinaryIO) -> McapWriter:
        """Start a data file."""
        writer = McapWriter(stream, CHUNK_LIMIT)
        writer.start(profile='ros2', library=self._library)
        return writer

    def _add_extra(self, method: str, *arguments: Any) -> None:
        self._extras.append((method, arguments))
        with self._disk():
            getattr(self._writer, method)(*arguments)

    def _open(self):
        """Create the directory and open the data file; refuse an existing path."""
        if os.path.lexists(self.path):
            raise BagWriterError(
                f'{self.path} exists: give another name or remove it {NEVER}')
        refuse_name(self.path)
        self.file = self.path / f'{self.path.name}_0.mcap'
        try:
            self._folder = self.path.absolute()  # a component may go to another one
            self._folder.mkdir(parents=True)
            try:
                return (self._folder / self.file.name).open('xb')
            except OSError:
                self._folder.rmdir()
                raise
        except OSError as error:
            kind = BagWriterError if is_wrong_path(error) else BagDiskError
            raise kind(f'cannot create the bag {self.path}: {error.strerror}') from error

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """
        Append an MCAP metadata record; wall-clock values belong in :meth:`close`.

        Names that are not UTF-8 are escaped, see :func:`mambo_model.errors.readable`.
        """
        self._add_extra('add_metadata', readable(name), {
            readable(str(key)): readable(str(value)) for key, value in values.items()})

    def add_attachment(self, name: str, data: str | bytes, media_type: str = '') -> None:
        """
        Append a file to the bag; its times are 0, its media type follows from its suffix.

        Names that are not UTF-8 are escaped, see :func:`mambo_model.errors.readable`.
        """
        self._add_extra(
            'add_attachment', 0, 0, readable(name),
            media_type or MEDIA_TYPES.get(Path(name).suffix, 'application/octet-stream'),
            readable(data).encode() if isinstance(data, str) else bytes(data))

    def add_topic(
        self, name: str, type_name: str, qos: Qos | list[dict[str, Any]] = RELIABLE, *,
        schema: bytes | None = None, schema_encoding: str = 'ros2msg',
        type_hash: str | None = None, encoding: str = 'cdr', shared: bool = False,
    ) -> None:
        """
        Declare a topic; declare all topics before the first message, in any order.

        A topic without messages is listed with 0 messages, as in rosbag2.

        Parameters
        ----------
        name
            Absolute topic name.
        type_name
            ``package/msg/Name``.
        qos
            Offered profile, or rosbag2's list of profiles.
        shared
            Whether several nodes publish the topic: messages of equal stamps are then sorted by
            their bytes, because their order of arrival is random.
        schema, schema_encoding, type_hash, encoding
            Given when a bag is copied; otherwise looked up in the ament prefixes.

        Raises
        ------
        BagWriterError
            For a topic declared twice, a relative name or a declaration after the first message.
        DefinitionError
            For a type without definition.

        """
        if name in self._topics:
            raise BagWriterError(f'{self.path}: topic {name} is declared twice')
        if not name.startswith('/') and schema is None:
            raise BagWriterError(f'{self.path}: topic {name!r} must be absolute (begin with /)')
        if self._by_order or self._closed:
            raise BagWriterError(
                f'{self.path}: topic {name} is declared after the first message')
        if schema is None:
            schema = message_definition.full_text(type_name).encode()
        if type_hash is None:
            type_hash = message_definition.type_hash(type_name)
        profiles = qos.profiles() if isinstance(qos, Qos) else qos
        self._topics[name] = _Topic(
            type_name, profiles, type_hash, encoding, schema, schema_encoding, shared)

    def write(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None,
        now_ns: int | None = None,
    ) -> None:
        """
        Add one serialised message; it is written to the file once its second is complete.

        Parameters
        ----------
        topic
            A declared topic.
        data
            CDR with its 4-byte header, as DDS delivers it.
        log_time_ns, publish_time_ns
            ROS time; the publish time defaults to the log time.
        now_ns
            Current ROS time, which decides which seconds are complete; a message may be ahead of
            it. Default: the log time.

        Raises
        ------
        BagWriterError
            For an undeclared topic, a negative time, a closed bag or a full disk.

        """
        if not self._by_order:
            self._register()
        entry = self._topics.get(topic)
        if entry is None:
            raise BagWriterError(
                f'{self.path}: topic {topic} is not declared; known: {", ".join(self._topics)}')
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        if self._closed or log_time_ns < 0 or publish < 0:
            why = 'the bag is closed' if self._closed else f'negative time {log_time_ns} ns'
            raise BagWriterError(f'{self.path}: message on {topic} refused: {why}')
        if log_time_ns < self._written_until:
            self.late += 1
        data = bytes(data)
        rank = data if entry.shared else b''
        self._pending.append((log_time_ns, entry.order, rank, entry.received, publish, data))
        entry.received += 1
        self._pending_size += len(data)
        now = log_time_ns if now_ns is None else now_ns
        if now > self._newest:
            self._newest = now
            end = (now - GRACE) // SECOND * SECOND
            if end > self._written_until:
                self._write_until(end)
        if self._pending_size > PENDING_LIMIT:
            self._write_until(self._end_of_pending())

    def write_all(
        self, messages: Mapping[str, tuple[NDArray[np.int64], list[NDArray[np.uint8]]]],
    ) -> None:
        """
        Write all messages of a bag at once; the file equals that of repeated :meth:`write`.

        Parameters
        ----------
        messages
            {topic: (log times in ns, (n,) ascending; messages as blocks of (k, size) bytes, n
            messages in total)}.

        Raises
        ------
        BagWriterError
            If the bag has messages, or for an undeclared topic.

        """
        if not self._by_order:
            self._register()
        if self._newest >= 0 or self._closed or not messages.keys() <= self._topics.keys():
            raise BagWriterError(
                f'{self.path}: write a whole flight to an empty bag whose topics are declared')
        pieces: list[bytes] = []  # not views: 100 000 of those keep the garbage collector busy
        times, orders = [], []
        for name, (stamps, blocks) in sorted(messages.items()):
            topic = self._topics[name]
            done = 0
            for block in blocks:
                part = records(topic.channel, stamps[done:done + len(block)], done, block)
                flat, size = part.tobytes(), part.shape[1]
                pieces += [flat[i:i + size] for i in range(0, len(flat), size)]
                done += len(block)
            topic.received = topic.written = done
            times.append(stamps)
            orders.append(np.full(done, topic.order))
        if not pieces:
            return
        log_times, order = np.concatenate(times), np.concatenate(orders)
        ranks = np.lexsort((order, log_times))  # stable: keeps the order of arrival within a topic
        log_times, order = log_times[ranks], order[ranks]
        channels = np.array([topic.channel for topic in self._by_order])[order]
        cuts = np.flatnonzero(np.diff(log_times // SECOND)) + 1
        with self._disk():
            for part in np.split(np.arange(len(ranks)), cuts):
                self._writer.flush()
                self._writer.add_records(
                    channels[part], log_times[part], [pieces[i] for i in ranks[part].tolist()])
        self._first, self._last = int(log_times[0]), int(log_times[-1])
        self._newest, self._written_until = self._last, self._last + 1

    @property
    def counts(self) -> dict[str, int]:
        """Return {topic: messages added so far}."""
        return {name: topic.received for name, topic in self._topics.items()}

    def _register(self) -> None:
        """Write schemas and channels, ordered by topic name."""
        if not self._topics:
            raise BagWriterError(f'{self.path}: declare topics before the first message')
        with self._disk():
            self._register_topics()

    def _register_topics(self) -> None:
        schemas: dict[tuple[str, str, bytes], int] = {}
        self._topics = dict(sorted(self._topics.items()))
        for order, (name, topic) in enumerate(self._topics.items()):
            key = (topic.type_name, topic.schema_encoding, topic.schema)
            if key not in schemas:
                schemas[key] = self._writer.register_schema(*key)
            topic.order = order
            topic.channel = self._writer.register_channel(
                name, topic.encoding, schemas[key], {
                    'offered_qos_profiles': _dump(topic.profiles).rstrip('\n'),
                    'topic_type_hash': topic.type_hash})
            self._by_order.append(topic)

    def _end_of_pending(self) -> int:
        """Return the time [ns] just after the last held message and the time reached."""
        return max([self._newest, *(message[0] for message in self._pending)]) + 1

    def _write_until(self, end: int) -> None:
        """Write all whole seconds of ROS time before ``end`` [ns], a chunk each, and flush."""
        ready = sorted(
            (message for message in self._pending if message[0] < end), key=lambda m: m[:4])
        self._pending = [message for message in self._pending if message[0] >= end]
        self._pending_size = sum(len(message[5]) for message in self._pending)
        with self._disk():
            for _, second in groupby(ready, key=lambda message: message[0] // SECOND):
                self._writer.flush()
                self._write_at_once(list(second))
            self._writer.flush()
        self._written_until = max(self._written_until, end)

    def _write_at_once(self, messages: list[tuple[int, int, bytes, int, int, bytes]]) -> None:
        """Write the messages of one second, in order; one by one recording took 1.27 as long."""
        channels, pieces = [], []
        for log_time, order, _, _, publish, data in messages:
            topic = self._by_order[order]
            channels.append(topic.channel)
            pieces.append(record(topic.channel, topic.written, log_time, publish, data))
            topic.written += 1
        log_times = np.array([message[0] for message in messages], dtype=np.uint64)
        self._writer.add_records(np.array(channels), log_times, pieces)
        self._first = min(self._first, messages[0][0])
        self._last = max(self._last, messages[-1][0])

    def close(
        self, custom_data: Mapping[str, str] | None = None, end_ns: int | None = None,
    ) -> None:
        """
        Write pending messages, the index and the final ``metadata.yaml``; idempotent.

        Parameters
        ----------
        custom_data
            {key: text} for metadata.yaml alone, for values that differ from run to run, such as
            the real-time factor. The data file depends on the messages alone.
        end_ns
            ROS time at which the recording ended; later messages are logged at this time.

        Raises
        ------
        BagWriterError
            If the disk is full.

        """
        if self._closed:
            return
        if not self._by_order and self._topics:
            self._register()
        with self._disk():
            written = os.fstat(self._stream.fileno())
            if not os.path.samestat(written, os.stat(self._folder / self.file.name)):
                raise FileExistsError(errno.EEXIST, 'another file is in its place')
            self._finish()
            if self.late or (end_ns is not None and self._last > end_ns):
                self._put_in_order(end_ns)
            self._closed = True
            self._write_yaml(custom_data or {})

    def _finish(self) -> None:
        """Write pending messages and the index; nothing in the file depends on its own name."""
        self._write_until(self._end_of_pending())
        nameless = {**self._information({}), 'relative_file_paths': [], 'files': []}
        self._writer.add_metadata('rosbag2', {'serialized_metadata': _dump(nameless)})
        self._writer.finish()
        self._stream.close()

    def _put_in_order(self, end: int | None) -> None:
        """Rewrite the data file by seconds, as if no message had been late or after the end."""
        for topic in self._topics.values():
            topic.written = 0
        self._by_order, self._written_until, self._newest = [], -1, -1
        self._first, self._last = NO_TIME, -1
        file = self._folder / self.file.name
        ordered = file.with_suffix('.part')
        self._stream = ordered.open('wb')
        self._writer = self._begin(self._stream)
        for method, arguments in self._extras:
            getattr(self._writer, method)(*arguments)
        self._writer.flush()
        self._register()
        with file.open('rb') as stream:
            for _, channel, message in make_reader(stream).iter_messages():  # by log time
                log_time, publish_time = message.log_time, message.publish_time
                if end is not None and log_time > end:
                    log_time, publish_time = end, min(publish_time, end)
                    self.beyond += 1
                begin = log_time // SECOND * SECOND
                if begin > self._written_until:
                    self._write_until(begin)
                topic = self._topics[channel.topic]
                rank = message.data if topic.shared else b''
                self._pending.append((
                    log_time, topic.order, rank, message.sequence, publish_time, message.data))
        self._finish()
        os.replace(ordered, file)

    def _information(self, custom_data: Mapping[str, str]) -> dict[str, Any]:
        """Return the body of metadata.yaml in rosbag2's order of keys."""
        count = sum(topic.written for topic in self._topics.values())
        span = {
            'duration': {'nanoseconds': self._last - self._first if count else 0},
            'starting_time': {'nanoseconds_since_epoch': self._first}}
        topics = [
            {'topic_metadata': {
                'name': name, 'type': topic.type_name, 'serialization_format': topic.encoding,
                'offered_qos_profiles': topic.profiles, 'type_description_hash': topic.type_hash},
             'message_count': topic.written}
            for name, topic in sorted(self._topics.items())]
        file_span = {'starting_time': span['starting_time'], 'duration': span['duration']}
        return {
            'version': 9, 'storage_identifier': 'mcap', **span, 'message_count': count,
            'topics_with_message_count': topics, 'compression_format': '',
            'compression_mode': '', 'relative_file_paths': [self.file.name],
            'files': [{'path': self.file.name, **file_span, 'message_count': count}],
            'custom_data': {str(k): str(v) for k, v in custom_data.items()} or None,
            'ros_distro': 'jazzy'}

    def _write_yaml(self, custom_data: Mapping[str, str]) -> None:
        """Replace metadata.yaml atomically."""
        text = _dump({'rosbag2_bagfile_information': self._information(custom_data)})
        temporary = self._folder / 'metadata.yaml.part'
        temporary.write_text(text, encoding='utf-8')
        os.replace(temporary, self._folder / 'metadata.yaml')

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the bag; remove it if writing failed, because it would look complete."""
        if kind is None:
            self.close()
        elif not self._closed:  # left as it is after a disk error, for recover
            self._abandon()
