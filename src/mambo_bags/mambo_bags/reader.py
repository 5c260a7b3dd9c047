"""
Bags as numpy columns: a rosbag2 directory or one MCAP file, in the frames of the wire.

``read_bag(path)['estimate/odom'].position`` is (n, 3) in metres, z up. Names are relative to the
namespace of the drone, or absolute. A topic is decoded when it is first asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
import copyreg
from functools import cache, cached_property
from pathlib import Path
import re
from typing import Any, NoReturn, TYPE_CHECKING

from mambo_model import yaml_nodes
from mambo_model.schema import ParameterError
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
import yaml

from . import columns as cdr, mcap_reader
from .mcap_reader import BagError, Batch, check_regular

if TYPE_CHECKING:
    import pandas

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SECOND = 1_000_000_000
_FIELD = re.compile(r'\w+(\[\d{1,9}\])?(\.\w+(\[\d{1,9}\])?)*')  # dotted path of a field
SHORT_NAMES = {
    'position': ('pose.pose.position', 'pose.position', 'position'),
    'orientation': ('pose.pose.orientation', 'pose.orientation', 'attitude'),
    'velocity': ('twist.twist.linear', 'velocity'),
    'angular_velocity': ('twist.twist.angular', 'angular_velocity'),
    'acceleration': ('linear_acceleration', 'acceleration'),
    'pose_covariance': ('pose.covariance',),
    'twist_covariance': ('twist.covariance',),
    'pressure': ('fluid_pressure',),
}
"""Short attribute name: candidate fields, of which the first existing one is used."""


def _store_of(definitions: dict[str, Any]) -> Typestore:
    """Return a type store of message definitions, as rosbags holds them."""
    store = get_typestore(Stores.EMPTY)
    store.register(definitions)
    return store


# rosbags makes its message classes at run time, under names that pickle cannot find
copyreg.pickle(Typestore, lambda store: (_store_of, (dict(store.fielddefs),)))


class FieldError(BagError, KeyError, AttributeError):
    """The messages of a topic have no such field or constant."""

    def __str__(self) -> str:
        return str(self.args[0])


class Messages:
    """
    The messages of one topic, in the order of their log time.

    ``messages['pose.pose.position']`` is a field by its dotted path: (n,) for a number, (n, k)
    for an array or a message of k numbers (a quaternion is x y z w, as on the wire). The same as
    attribute, with the short names of ``SHORT_NAMES``: ``messages.position``. An array is kept and
    handed out again: copy it before you change it.

    Attributes
    ----------
    topic, type_name : str
    log_time, publish_time : (n,) int, ns

    """

    def __init__(
        self, topic: str, type_name: str, store: Typestore | BagError, batches: list[Batch],
    ) -> None:
        self.topic, self.type_name = topic, type_name
        nothing = np.empty(0, np.int64)
        log_times = np.concatenate([nothing, *(batch.log_time for batch in batches)])
        self._order = np.argsort(log_times, kind='stable')
        self.log_time: Ints = log_times[self._order]
        self.publish_time: Ints = np.concatenate(
            [nothing, *(batch.publish_time for batch in batches)])[self._order]
        self._batches = batches
        self._store = store
        self._place = ''  # of the bag, for messages to the user
        self._columns: dict[str, cdr.Column] = {}
        self._objects: list[Any] | None = None
        self._cache: dict[str, NDArray[Any]] = {}
        self._is_decoded = False

    def __len__(self) -> int:
        return len(self.log_time)

    def __repr__(self) -> str:
        span = (f', {(self.log_time[-1] - self.log_time[0]) / SECOND:.2f} s' if len(self) else '')
        return f'<{self.topic}: {len(self)} messages of {self.type_name}{span}>'

    def __dir__(self) -> list[str]:
        """Return the fields of the messages too, for tab completion."""
        names = [name for name, _ in self._decode().fielddefs[self.type_name][1]]
        short = [name for name, paths in SHORT_NAMES.items()
                 if any(path.split('.')[0] in names for path in paths)]
        return sorted({*super().__dir__(), *names, *short})

    def _ipython_key_completions_(self) -> list[str]:
        """Return the valid keys of ``messages['...']``, for tab completion."""
        return list(self.leaves())

    @cached_property
    def raw(self) -> list[bytes]:
        """Return the bytes of each message."""
        payloads = [data for batch in self._batches for _, _, data in batch]
        return [payloads[i] for i in self._order.tolist()]

    @cached_property
    def table(self) -> NDArray[np.uint8] | None:
        """Return the bytes of all messages, (n, size); None if they differ in length."""
        tables = [batch.data for batch in self._batches]
        sizes = {table.shape[1] if isinstance(table, np.ndarray) else 0 for table in tables}
        if len(sizes) != 1 or 0 in sizes:
            return None
        table = np.concatenate(tables) if len(tables) > 1 else tables[0]
        return table if (np.diff(self._order) == 1).all() else table[self._order]

    def _decode(self) -> Typestore:
        """Find the layout once, or fall back to one object per message; return the types."""
        if isinstance(self._store, BagError):
            raise self._store
        if not self._is_decoded:
            try:
                if self.table is None:
                    raise cdr.NoLayout
                self._columns = cdr.layout(self._store, self.type_name, self.table)
            except (cdr.NoLayout, KeyError, IndexError, RecursionError):
                self._objects = list(self.objects())
            self._is_decoded = True
        return self._store

    def objects(self) -> Iterator[Any]:
        """
        Yield every message as an object with the fields of its type.

        Raises
        ------
        BagError
            If a message does not match its type.

        """
        if isinstance(self._store, BagError):
            raise self._store
        for number, data in enumerate(self.raw):
            try:
                whole = cdr.trimmed(self._store, self.type_name, data)
                yield self._store.deserialize_cdr(whole, self.type_name)
            except Exception as error:  # the decoder may raise any error on invalid bytes
                reason = ' '.join(str(error).split())[:120]
                raise BagError(
                    f'{self._place}{self.topic}: message {number} is not a {self.type_name} '
                    f'({reason})') from None

    def readable(self) -> Messages:
        """
        Return the messages that match their type: these ones if all do.

        Raises
        ------
        BagError
            If the type is not known.

        """
        if isinstance(self._store, BagError):
            raise self._store
        try:
            self._decode()
        except BagError:
            times = self.log_time.tolist(), self.publish_time.tolist()
            kept = [row for row in zip(*times, self.raw, strict=True) if self._matches(row[2])]
            return Messages(self.topic, self.type_name, self._store, [Batch.of(kept)])
        return self

    def _matches(self, data: bytes) -> bool:
        """Return whether the bytes of a message can be decoded."""
        one = Messages(self.topic, self.type_name, self._store, [Batch.of([(0, 0, data)])])
        try:
            next(one.objects())
        except BagError:
            return False
        return True

    def __getitem__(self, path: str) -> NDArray[Any]:
        """Return a field by its dotted path; FieldError if there is no such field."""
        if not isinstance(path, str):
            raise FieldError(f'{self.topic}: a field is a name such as pose.position, not '
                             f'{path!r}; objects() yields messages')
        if path not in self._cache:
            self._decode()
            if not _FIELD.fullmatch(path):
                raise FieldError(f'{self.topic} ({self.type_name}) has no field {path!r}')
            self._cache[path] = self._field(path)
        return self._cache[path]

    def _field(self, path: str) -> NDArray[Any]:
        if path in self._columns and self.table is not None:
            return cdr.take(self.table, self._columns[path])
        parts = self._parts(path)
        if parts is None:
            return self._gather(path)
        if not parts:
            raise FieldError(f'{self.topic}: {path} has no fields')
        values = [self[f'{path}.{name}'] for name in parts]
        if any(value.dtype.kind not in 'fiub' or value.ndim != 1 for value in values):
            raise FieldError(
                f'{self.topic}: {path} is not a vector; its fields: {", ".join(parts)}')
        return np.stack(values, axis=1)

    def _parts(self, path: str) -> list[str] | None:
        """Return the fields of a nested message, None for a leaf; FieldError if there is none."""
        store, type_name = self._decode(), self.type_name
        steps = path.split('.')
        for number, step in enumerate(steps, 1):
            name, _, item = step.partition('[')
            fields = dict(store.fielddefs[type_name][1])
            if name not in fields:
                raise FieldError(
                    f'{self.topic} ({self.type_name}) has no field {path}; '
                    f'{type_name} has {", ".join(fields)}')
            node, detail = fields[name]
            if item:
                if node not in (cdr.Nodetype.ARRAY, cdr.Nodetype.SEQUENCE):
                    raise FieldError(f'{self.topic} ({self.type_name}): {path}: {name} has no '
                                     'items')
                node, detail = detail[0]
            if node != cdr.Nodetype.NAME:
                if number < len(steps):
                    raise FieldError(f'{self.topic} ({self.type_name}): {path}: {step} has no '
                                     'fields')
                return None
            type_name = detail
        return [name for name, _ in store.fielddefs[type_name][1]]

    def _gather(self, path: str) -> NDArray[Any]:
        """Return a field from message objects; ragged ones as an array of objects."""
        if self._objects is None:
            self._objects = list(self.objects())
        values = []
        for message in self._objects:
            for name, item in re.findall(r'([^.\[\]]+)(?:\[(\d+)\])?', path):
                message = getattr(message, name)
                if item and not int(item) < len(message):
                    raise FieldError(f'{self.topic}: {path}: message {len(values)} has '
                                     f'{len(message)} items there')
                message = message[int(item)] if item else message
            values.append(message)
        try:
            return np.array(values)
        except ValueError:
            ragged = np.empty(len(values), object)
            ragged[:] = values
            return ragged

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith('_'):
            raise AttributeError(name)
        for path in (*SHORT_NAMES.get(name, ()), name):
            try:
                return self[path]
            except KeyError as error:
                reason = error
        raise FieldError(str(reason.args[0]))

    @property
    def stamp(self) -> Ints:
        """Return the stamps, (n,) ns: of the header or clock, else the log times."""
        for path in ('header.stamp', 'clock'):
            try:
                return self[f'{path}.sec'].astype(np.int64) * SECOND + self[f'{path}.nanosec']
            except KeyError:
                continue
        return self.log_time

    @property
    def t(self) -> Floats:
        """Return the stamps, (n,) s."""
        return self.stamp * 1e-9

    def leaves(self, path: str = '') -> Iterator[str]:
        """Yield the paths of all leaf fields."""
        store = self._decode()
        names = self._parts(path) if path else [
            name for name, _ in store.fielddefs[self.type_name][1]]
        if names is None:
            yield path
            return
        for name in names:
            yield from self.leaves(f'{path}.{name}' if path else name)

    def to_pandas(self) -> pandas.DataFrame:
        """
        Return the messages as a table: one row each, one column a number or text.

        The index is the stamp [s], named ``t``; columns are dotted paths such as
        ``pose.pose.position.x``, items of arrays ``pwm[0]``. The stamp is only in the index.

        Raises
        ------
        BagError
            If pandas is not installed.

        """
        try:
            import pandas
        except ImportError:
            raise BagError('to_pandas needs pandas: python3 -m pip install pandas') from None
        columns: dict[str, Any] = {}
        for path in self.leaves():
            if path.startswith(('header.stamp.', 'clock.')):
                continue
            values = self[path]
            if values.ndim == 1:
                columns[path] = values
            else:
                columns |= {f'{path}[{i}]': values[:, i] for i in range(values.shape[1])}
        return pandas.DataFrame(columns, index=pandas.Index(self.t, name='t'))

    def constant(self, name: str) -> int | float | str | bool:
        """Return a constant of the message type, as ``PHASE_TRACK``; FieldError if it has none."""
        constants = {
            key: value for key, _, value in self._decode().fielddefs[self.type_name][0]}
        if name not in constants:
            raise FieldError(f'{self.topic} ({self.type_name}) has no constant {name}')
        return constants[name]


class Bag:
    """
    A bag in memory.

    Attributes
    ----------
    path : Path
    namespace : str
        Namespace of the drone, for example ``/mambo``; empty if no topic is namespaced.
    topics : dict[str, str]
        {absolute name: type}, including topics without messages.
    metadata : dict[str, dict[str, str]]
        MCAP metadata records by name.
    attachments : dict[str, str | bytes]
        Files inside the bag by name; text where it is UTF-8.
    custom_data : dict[str, str]
        Entries of metadata.yaml about the run, such as the real-time factor.
    notes : list[str]
        What a reader must know of the files, one line each: metadata.yaml of another bag.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.namespace = ''
        self.topics: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, str | bytes] = {}
        self.custom_data: dict[str, str] = {}
        self.notes: list[str] = []
        self._messages: dict[str, Messages] = {}

    def add(self, messages: Messages) -> None:
        """Add the messages of a topic."""
        self.topics[messages.topic] = messages.type_name
        self._messages[messages.topic] = messages
        messages._place = f'{self.path}: '

    def leave_out_unreadable(self) -> None:
        """
        Leave out messages that do not match their type, with a note for each topic that has some.

        A recorder keeps what anybody publishes, also messages that no node could read.
        """
        for topic, messages in self._messages.items():
            try:
                kept = messages.readable()
            except BagError:  # an unknown type: its messages are not decoded at all
                continue
            if left_out := len(messages) - len(kept):
                self.notes.append(
                    f'{left_out} of {len(messages)} messages of {topic} are not a '
                    f'{messages.type_name}: left out')
                self.add(kept)

    def name(self, topic: str) -> str:
        """Return the absolute name of a topic; BagError if it is not text."""
        if not isinstance(topic, str):
            raise BagError(f'{self.path}: a topic is a name, not {topic!r}')
        if topic in self.topics:
            return topic
        return topic if topic.startswith('/') else f'{self.namespace}/{topic}'

    def __contains__(self, topic: str) -> bool:
        """Return whether a topic has messages (that were read)."""
        return len(self._messages.get(self.name(topic), ())) > 0

    def __getitem__(self, topic: str) -> Messages:
        """Return the messages of a topic; BagError if there is no such topic."""
        found = self._messages.get(self.name(topic))
        if found is None:
            raise BagError(
                f'{self.path}: no topic {self.name(topic)}; it has '
                f'{", ".join(sorted(self.topics)) or "none"}')
        return found

    messages = __getitem__

    def __iter__(self) -> Iterator[Messages]:
        """Yield the messages of each topic that has any, by name."""
        for topic in sorted(self._messages):
            if topic in self:
                yield self[topic]

    def __repr__(self) -> str:
        lines = [f'{self.path}: {(self.end - self.start) / SECOND:.2f} s']
        for messages in self:
            seconds = (messages.log_time[-1] - messages.log_time[0]) / SECOND
            rate = f'{(len(messages) - 1) / seconds:8.1f} Hz' if seconds else ''
            lines.append(
                f'  {messages.topic:<32}{len(messages):>8}  {messages.type_name:<36}{rate}')
        return '\n'.join(lines)

    def _ipython_key_completions_(self) -> list[str]:
        """Return the valid keys of ``bag['...']``, for tab completion."""
        inside = f'{self.namespace}/'
        return sorted(topic.removeprefix(inside) for topic in self._messages if topic in self)

    @property
    def start(self) -> int:
        """Return the earliest log time, ns; 0 without messages."""
        return min((int(m.log_time[0]) for m in self._messages.values() if len(m)), default=0)

    @property
    def end(self) -> int:
        """Return the latest log time, ns; 0 without messages."""
        return max((int(m.log_time[-1]) for m in self._messages.values() if len(m)), default=0)

    @cached_property
    def scenario(self) -> dict[str, Any] | None:
        """Return the attached ``scenario.yaml``; None if there is none or it is not a mapping."""
        try:
            content = yaml_nodes.load(self.attachments.get('scenario.yaml', ''))
        except (yaml.YAMLError, TypeError):  # not YAML, or not text
            return None
        return content if isinstance(content, dict) else None


_PARTS = {  # keys of metadata.yaml that are read
    'relative_file_paths': (list, 'a list of names'), 'storage_identifier': (str, 'a name'),
    'compression_mode': (str, 'a name'), 'compression_format': (str, 'a name'),
    'custom_data': (dict, 'names and values')}


def read_listing(path: Path) -> dict[str, Any]:
    """
    Return the content of a directory's metadata.yaml; empty if there is no such file.

    Raises
    ------
    BagError
        If it is not YAML, exceeds the limits of ``mambo_model.yaml_nodes``, or is not of a bag.

    """
    file = path / 'metadata.yaml'
    if not file.is_file():
        return {}

    def fail(reason: str) -> NoReturn:
        raise BagError(f'{file}: not the metadata of a rosbag2 bag ({reason})')
    try:
        content = yaml_nodes.load(yaml_nodes.read_text(file))
    except ParameterError as error:
        raise BagError(str(error)) from None
    except yaml.YAMLError as error:
        fail(yaml_nodes.reason(error))
    if not isinstance(content, dict) or not isinstance(
            content.get('rosbag2_bagfile_information'), dict):
        fail('it has no rosbag2_bagfile_information')
    content = content['rosbag2_bagfile_information']
    if 'relative_file_paths' not in content:
        fail('relative_file_paths is missing')
    content = {key: value for key, value in content.items() if value is not None}
    for key, (kind, wanted) in _PARTS.items():
        if key in content and not isinstance(content[key], kind):
            fail(f'{key} is not {wanted}')
    names = content.setdefault('relative_file_paths', [])
    if not all(isinstance(name, str) and '\0' not in name for name in names):
        fail('relative_file_paths is not a list of names')
    return content


def bag_files(path: Path) -> tuple[list[Path], dict[str, Any]]:
    """
    Return the MCAP files of a bag in order, and the content of its metadata.yaml.

    Raises
    ------
    BagError
        If the path is not an MCAP bag, or is one that another tool must convert first.

    """
    check_regular(path)
    if path.is_file():
        if path.name == 'metadata.yaml':
            raise BagError(f'{path}: give the directory of the bag, not its metadata.yaml')
        return [path], {}
    if not path.is_dir():
        raise BagError(f'{path}: no such bag')
    listing = read_listing(path)
    storage = listing.get('storage_identifier', 'mcap')
    mode, kind = (listing.get(f'compression_{what}', '').lower() for what in ('mode', 'format'))
    if storage != 'mcap' or mode == 'file' or (mode == 'message' and kind not in ('', 'zstd')):
        raise BagError(
            f'{path}: a bag of storage {storage}, compression {mode or "none"} {kind}'.rstrip()
            + '; import its topics with mambo import bag, or convert it to mcap with ros2 bag '
            'convert')
    if listing:
        files = [path / Path(name).name for name in listing['relative_file_paths']]
    else:
        files = sorted(path.glob('*.mcap'))
    if not files:
        raise BagError(f'{path}: not a bag; give a rosbag2 directory or an .mcap file')
    for file in files:
        if not file.is_file():
            raise BagError(f'{file}: listed in metadata.yaml, but missing')
    return files, listing


def type_name(name: str) -> str:
    """Return ``package/msg/Name``, given that or ``package/Name``."""
    package, _, rest = name.partition('/')
    return name if '/' in rest else f'{package}/msg/{rest}'


def _types(schema: Any, encoding: str, where: str) -> Typestore | BagError:
    """Return the types of a schema, or the error to raise when its messages are read."""
    if encoding != 'cdr':
        return BagError(f'{where}: messages are encoded as {encoding!r}, only cdr is read')
    if schema is not None and not schema.data and schema.name.startswith('mambo_interfaces/'):
        return cdr.load_types([type_name(schema.name)])
    if schema is None or not schema.data:
        return BagError(f'{where}: the bag has no schema for these messages')
    return definition_types(schema.data, schema.encoding, type_name(schema.name), where)


def definition_types(data: bytes, kind: str, name: str, where: str) -> Typestore | BagError:
    """
    Return the types of a message definition in a bag, or the error in it.

    Parameters
    ----------
    data
        The text.
    kind
        ``ros2msg`` or ``ros2idl``.
    name
        Name of the type, ``package/msg/Name``.
    where
        Name of the topic, for the error.

    """
    if kind not in ('ros2msg', 'ros2idl'):
        return BagError(f'{where}: schema of kind {kind!r}, only ros2msg and ros2idl are read')
    try:
        return _parsed(data, kind, name)
    except Exception as error:  # the parser may raise any error on an invalid schema
        reason = str(error).split('\n')[0]
        return BagError(f'{where}: the schema of {name} cannot be read ({reason})')


@cache
def _parsed(data: bytes, encoding: str, name: str) -> Typestore:
    """Return the types of a schema; ValueError if it does not define ``name``."""
    store, text = get_typestore(Stores.EMPTY), data.decode()
    store.register(
        get_types_from_msg(text, name) if encoding == 'ros2msg' else get_types_from_idl(text))
    if name not in store.fielddefs:
        raise ValueError(f'it does not define {name}')
    return store


def _namespace(topics: Collection[str], path: Path, wanted: str | None) -> str:
    """Return the requested namespace, or the only one of a drone in the bag, or an empty one."""
    if wanted is not None:
        wanted = f"/{wanted.strip('/')}"
        if not any(topic.startswith(f'{wanted}/') for topic in topics):
            raise BagError(
                f'{path}: nothing in the namespace {wanted}; topics: {", ".join(topics)}')
        return wanted
    known = {
        'imu/data_raw', 'estimate/odom', 'ground_truth/odom', 'optitrack/pose', 'motor_pwm',
        'sonar/range', 'optical_flow', 'barometer/pressure', 'onboard/odom', 'sensor_tick'}
    found = sorted({
        topic[:-len(name) - 1] for topic in topics for name in known
        if topic.endswith('/' + name)})
    if len(found) > 1:
        raise BagError(
            f'{path}: several drones, in the namespaces {", ".join(found)}; choose one '
            '(namespace=..., on the command line --namespace)')
    return found[0] if found else ''


def read_bag(
    path: Path | str, topics: Collection[str] | None = None, namespace: str | None = None,
) -> Bag:
    """
    Read a bag.

    Parameters
    ----------
    path
        Directory of a rosbag2 bag (one or several MCAP files) or an MCAP file.
    topics
        Topics to read, absolute or relative; default: all. With ``()`` only the metadata and
        the list of topics are read.
    namespace
        Namespace of the drone; default: the only one in the bag.

    Raises
    ------
    BagError
        If there is no bag, or it is of another format, empty, damaged or was never closed.

    """
    path = Path(path)
    files, listing = bag_files(path)

    def is_wanted(topic: str) -> bool:
        return topics is None or any(
            topic == name or topic.endswith(f'/{name}') for name in topics)

    contents = [mcap_reader.scan(file, is_wanted) for file in files]
    for file, content in zip(files, contents):
        if not content.complete:
            raise BagError(
                f'{file}: damaged: {content.damage[0]}; save what is readable with: '
                f'mambo recover {path} NEW_BAG')
    return _assemble(path, list(zip(files, contents)), listing, topics, namespace)


def _assemble(
    path: Path, parts: list[tuple[Path, mcap_reader.Contents]], listing: dict[str, Any],
    topics: Collection[str] | None, namespace: str | None,
) -> Bag:
    """Combine the files of a bag."""
    bag = Bag(path)
    bag.custom_data = {
        str(key): str(value) for key, value in (listing.get('custom_data') or {}).items()}
    bag.notes = _contradictions(listing, [content for _, content in parts])
    gathered: dict[str, list[Batch]] = {}
    schemas: dict[str, tuple[mcap_reader.Schema | None, str]] = {}
    for file, content in parts:
        for record in content.metadata:
            bag.metadata.setdefault(record.name, {}).update(record.metadata)
        for attachment in content.attachments:
            bag.attachments[attachment.name] = _text(attachment.data)
        for number, channel in content.channels.items():
            schema = content.schemas.get(channel.schema_id)
            kind = type_name(schema.name) if schema else ''
            if bag.topics.setdefault(channel.topic, kind) != kind:
                raise BagError(
                    f'{file}: {channel.topic} is both {bag.topics[channel.topic]} and {kind}')
            gathered.setdefault(channel.topic, []).extend(content.messages[number])
            schemas.setdefault(channel.topic, (schema, channel.message_encoding))
    if not any(content.count for _, content in parts):
        raise BagError(f'{path}: the bag has no messages')
    bag.namespace = _namespace(bag.topics, path, namespace)
    wanted = None if topics is None else {bag.name(topic) for topic in topics}
    for topic, batches in gathered.items():
        if wanted is None or topic in wanted:
            bag.add(Messages(
                topic, bag.topics[topic], _types(*schemas[topic], f'{path}: {topic}'), batches))
    return bag


def _contradictions(
    listing: dict[str, Any], contents: Collection[mcap_reader.Contents],
) -> list[str]:
    """
    Return a line if metadata.yaml states other numbers of messages than the files have.

    None for a recording by the clock that lacks messages alone and begins as stated: it was cut.
    """
    found: dict[str, int] = {}
    for content in contents:
        for number, channel in content.channels.items():
            found[channel.topic] = found.get(channel.topic, 0) + content.counts.get(number, 0)
    stated = _stated(listing.get('topics_with_message_count'))
    wrong = [name for name in stated if stated[name] != found.get(name, 0)]
    start = listing.get('starting_time')
    begin = start.get('nanoseconds_since_epoch') if isinstance(start, dict) else None
    if not wrong or (begin and begin in [content.begin for content in contents] and all(
            found.get(name, 0) < stated[name] for name in wrong)):
        return []
    first = max(wrong, key=lambda name: abs(stated[name] - found.get(name, 0)))
    more = f' (and {len(wrong) - 1} more topics differ)' if len(wrong) > 1 else ''
    has = 'file has' if len(contents) == 1 else 'files have'
    return [f'metadata.yaml says {stated[first]} messages of {first}, the {has} '
            f'{found.get(first, 0)}{more}: the {has.split()[0]} may be of another bag']


def _stated(entries: Any) -> dict[str, int]:
    """Return the number of messages of each topic that metadata.yaml states well."""
    out = {}
    for entry in entries if isinstance(entries, list) else ():
        topic = entry.get('topic_metadata') if isinstance(entry, dict) else None
        name = topic.get('name') if isinstance(topic, dict) else None
        if isinstance(name, str) and type(count := entry.get('message_count')) is int:
            out[name] = count
    return out


def _text(data: bytes) -> str | bytes:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data
