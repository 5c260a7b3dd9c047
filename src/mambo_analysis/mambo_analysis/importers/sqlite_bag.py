"""
Bags of the storage sqlite3 (``.db3``), rosbag2's default before Iron.

From Iron on such a file carries the definitions of its messages. Before, it holds only names of
types: types of this product are taken as installed here, others from the distribution named
in metadata.yaml, or from the newest distribution whose definition fits the first message.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import sqlite3

from mambo_bags import columns, compression
from mambo_bags.mcap_reader import BagError, Batch
from mambo_bags.message_definition import DefinitionError
from mambo_bags.reader import definition_types, Messages, type_name
from mambo_model import limits
from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.store import Typestore

OWN = 'mambo_interfaces/msg/'
DISTRIBUTIONS = ('kilted', 'jazzy', 'iron', 'humble', 'galactic', 'foxy', 'eloquent', 'dashing')
_LATEST = 2**63  # [ns]


def _message(data: bytes, most: int) -> bytes:
    """Return the bytes of a message, which may be compressed each by itself; ValueError."""
    if not isinstance(data, bytes):
        raise ValueError('a message that is no sequence of bytes')
    return compression.message(data, most)


def _is_plain_read(action: int, *about: str | None) -> int:
    """Authorize reading tables only: a view or a function in a file could run for ever."""
    plain = action in (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ) and about[-1] is None
    return sqlite3.SQLITE_OK if plain else sqlite3.SQLITE_DENY


def _carried(database: sqlite3.Connection) -> dict[str, tuple[bytes, str]]:
    """Return {type: definition, its kind} that a file carries."""
    try:
        rows = database.execute('SELECT topic_type, encoded_message_definition, encoding '
                                'FROM message_definitions').fetchall()
    except sqlite3.OperationalError:  # before Iron
        return {}
    return {type_name(str(name)): (str(text).encode(), str(kind))
            for name, text, kind in rows if text}


def installed(name: str) -> Typestore | None:
    """Return the definition of a type as it is installed here, None without."""
    try:
        return columns.load_types([name])
    except DefinitionError:
        return None


def _is_whole(store: Typestore, name: str, data: bytes) -> bool:
    """Return whether a message is one of a type, to its last byte."""
    try:
        whole = columns.trimmed(store, name, data)
        again = store.serialize_cdr(store.deserialize_cdr(whole, name), name)
    except Exception:  # the decoder may raise any error on invalid bytes
        return False
    return 0 <= len(whole) - len(again) < 4  # a middleware pads to four bytes


def _known(name: str, distribution: str, first: bytes | None) -> Typestore | None:
    """Return a definition for a type that the bag does not define; None if there is none."""
    own = installed(name)
    if name.startswith(OWN):
        return own
    named = [distribution] if distribution in DISTRIBUTIONS else []
    stores = [get_typestore(Stores(f'ros2_{which}')) for which in (*named, *DISTRIBUTIONS)]
    found = [store for store in (*stores[:len(named)], own, *stores[len(named):])
             if store is not None and name in store.fielddefs]
    fitting = (store for store in found if first is None or _is_whole(store, name, first))
    return next(fitting, found[0] if found else None)


class _Bag:
    """Content of all files of one bag."""

    def __init__(self) -> None:
        self.topics: dict[str, str] = {}
        self.forms: dict[str, str] = {}
        self.messages: dict[str, list[tuple[int, int, bytes]]] = {}
        self.definitions: dict[str, tuple[bytes, str]] = {}

    def add(self, database: sqlite3.Connection, most: int) -> None:
        """
        Read a file, with a limit for the total of unpacked bytes.

        Of one that is damaged sqlite3.Error or ValueError.
        """
        self.definitions |= _carried(database)
        names: dict[int, str] = {}
        for number, name, kind, form in database.execute(
                'SELECT id, name, type, serialization_format FROM topics'):
            if not all(isinstance(text, str) for text in (name, kind, form)):
                raise ValueError(f'the topic {number} has no name, type or encoding')
            names[number], self.topics[name], self.forms[name] = name, type_name(kind), form
        for number, time, data in database.execute(
                'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'):
            if number not in names:
                raise ValueError(f'a message of the topic {number}, which is not listed')
            if not isinstance(time, int) or not 0 <= time < _LATEST:
                raise ValueError(f'a message of the impossible time {time}')
            plain = _message(data, most)
            most -= 0 if plain is data else len(plain)
            self.messages.setdefault(names[number], []).append((time, time, plain))


def _types(where: str, bag: _Bag, topic: str, distribution: str) -> Typestore | BagError:
    """Return the definition of a topic's type, or the reason why it is missing."""
    name, form = bag.topics[topic], bag.forms[topic]
    if form != 'cdr':
        return BagError(f'{where}: messages are encoded as {form!r}, only cdr is read')
    if name in bag.definitions:
        return definition_types(*bag.definitions[name], name, where)
    messages = bag.messages.get(topic)
    found = _known(name, distribution, messages[0][2] if messages else None)
    return BagError(
        f'{where}: the bag carries no definition of {name} and none is installed; source the '
        'workspace that has it, or convert the bag there: ros2 bag convert') if (
        found is None) else found


def read_sqlite(
    path: Path, files: list[Path], distribution: str = '',
) -> tuple[dict[str, str], dict[str, Messages]]:
    """
    Read the files of a bag.

    Parameters
    ----------
    path
        Of the bag, for errors.
    files
        Its files, uncompressed.
    distribution
        Of ROS 2 that it was recorded with, if known.

    Returns
    -------
    {topic: type}; {topic: Messages}, of those with messages.

    Raises
    ------
    BagError
        If a file is missing, damaged or none of rosbag2, or there are no messages.

    """
    bag = _Bag()
    for file in files:
        try:
            with closing(sqlite3.connect(
                    f'{file.resolve().as_uri()}?mode=ro', uri=True)) as database:
                database.set_authorizer(_is_plain_read)
                bag.add(database, limits.unpacked(file.stat().st_size))
        except (sqlite3.Error, ValueError, OverflowError, UnicodeDecodeError) as error:
            raise BagError(
                f'{path}: {file.name}: no rosbag2 file, or damaged ({error})') from None
    if not bag.messages:
        raise BagError(f'{path}: the bag has no messages')
    return bag.topics, {
        topic: Messages(topic, bag.topics[topic],
                        _types(f'{path}: {topic}', bag, topic, distribution), [Batch.of(messages)])
        for topic, messages in bag.messages.items()}
