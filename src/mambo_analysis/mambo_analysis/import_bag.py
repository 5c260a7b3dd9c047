"""
Anybody's bag under the names of this product: ``import_bag BAG OUT --map /theirs:=ours``.

Reads rosbag2 directories and files, MCAP and SQLite (``.db3``), whose messages are CDR. Without
``--map`` it lists the topics, and what each could become. Headers, values and log times are
copied; messages are written anew with the definitions installed here, fields that the source
lacks are 0. A pose can be taken from PoseStamped, PoseWithCovarianceStamped, TransformStamped or
Odometry. Poses with a value that is not finite or an orientation of length 0, as trackers give
for a lost body, are left out and counted. Stamps of 0 give way to the log time.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import closing
import dataclasses
import hashlib
import math
from pathlib import Path
import sqlite3
from typing import Any

from mambo_sim.bag_writer import BagWriter
import numpy as np
from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.store import Typestore
import yaml

from . import cdr
from .bag import bag_files, Messages, read_bag
from .cli import guard
from .importing import NAMESPACE, provenance, report, SECOND
from .mcap_file import BagError, Batch

ODOMETRY, POSE = 'nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped'
TARGETS = {
    'optitrack/pose': POSE, 'ground_truth/odom': ODOMETRY, 'estimate/odom': ODOMETRY,
    'onboard/odom': ODOMETRY, 'onboard/reference': POSE, 'imu/data_raw': 'sensor_msgs/msg/Imu',
    'sonar/range': 'sensor_msgs/msg/Range', 'battery': 'sensor_msgs/msg/BatteryState',
    'barometer/pressure': 'sensor_msgs/msg/FluidPressure',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'motor_pwm': 'mambo_interfaces/msg/MotorPwm', 'reference': 'mambo_interfaces/msg/Reference'}
"""Our topics, by their name in the drone's namespace, and their types."""
POSES = {
    POSE: ('pose.position', 'pose.orientation'), ODOMETRY: ('pose.pose.position',
                                                            'pose.pose.orientation'),
    'geometry_msgs/msg/PoseWithCovarianceStamped': ('pose.pose.position',
                                                    'pose.pose.orientation'),
    'geometry_msgs/msg/TransformStamped': ('transform.translation', 'transform.rotation')}
"""Types that hold a pose, and where."""
LOOSE_NORM = 0.1  # [-] how far from 1 an orientation may be


@dataclasses.dataclass(frozen=True)
class Foreign:
    """
    A bag of somebody else.

    Attributes
    ----------
    topics
        {absolute name: type}.
    messages
        {absolute name: Messages}, those with messages alone.
    sha256
        Of its files, one after another.

    """

    topics: dict[str, str]
    messages: dict[str, Messages]
    sha256: str


def could_become(type_name: str) -> list[str]:
    """Return our topics that a type can be mapped to."""
    return [topic for topic, wanted in TARGETS.items()
            if type_name == wanted or (wanted == POSE and type_name in POSES)]


def _checksum(files: list[Path]) -> str:
    """Return the SHA-256 of files, one after the other, as hex digits."""
    sha = hashlib.sha256()
    for file in files:
        sha.update(file.read_bytes())
    return sha.hexdigest()


def _sqlite_files(path: Path) -> list[Path]:
    """Return the SQLite files of a bag, none if it is of another storage."""
    if path.is_file():
        return [path] if path.suffix == '.db3' else []
    listing = path / 'metadata.yaml'
    if not listing.is_file():
        return sorted(path.glob('*.db3'))
    try:
        told = yaml.safe_load(listing.read_text(encoding='utf-8'))['rosbag2_bagfile_information']
        if told['storage_identifier'] != 'sqlite3':
            return []
        if told.get('compression_mode'):
            raise BagError(f'{path}: compressed; convert it with ros2 bag convert first')
        return [path / Path(name).name for name in told['relative_file_paths']]
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, OSError):
        return []  # the reader of MCAP bags says what is wrong


def _read_sqlite(path: Path, files: list[Path]) -> Foreign:
    """Read a bag of the storage sqlite3, with the definitions of Jazzy."""
    topics: dict[str, str] = {}
    raw: dict[str, list[tuple[int, int, bytes]]] = {}
    faults: dict[str, BagError] = {}
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in files:
        if not file.is_file():
            raise BagError(f'{file}: there is no such file')
        try:
            with closing(sqlite3.connect(
                    f'{file.resolve().as_uri()}?mode=ro', uri=True)) as database:
                names = {}
                for number, name, kind, form in database.execute(
                        'SELECT id, name, type, serialization_format FROM topics'):
                    names[number], topics[name] = name, kind
                    if form != 'cdr':
                        faults[name] = BagError(
                            f'{path}: {name}: messages are encoded as {form!r}, only cdr is read')
                    elif kind not in store.fielddefs:
                        faults[name] = BagError(
                            f'{path}: {name}: the definition of {kind} is not known')
                for number, time, data in database.execute(
                        'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'):
                    raw.setdefault(names[number], []).append((time, time, bytes(data)))
        except (sqlite3.Error, KeyError, TypeError, ValueError) as error:
            raise BagError(f'{file}: no rosbag2 file, or damaged ({error})') from None
    if not raw:
        raise BagError(f'{path}: the bag holds no messages')
    return Foreign(topics, {
        name: Messages(name, topics[name], faults.get(name, store), [Batch.of(messages)])
        for name, messages in raw.items()}, _checksum(files))


def read_foreign(path: Path) -> Foreign:
    """
    Read a bag of any of the storages.

    Raises
    ------
    BagError
        If there is none, or it is empty, damaged or foreign.

    """
    files = _sqlite_files(path)
    if files:
        found = _read_sqlite(path, files)
    else:
        files, _ = bag_files(path)
        bag = read_bag(path)
        found = Foreign(dict(bag.topics), {
            name: bag[name] for name in bag.topics if name in bag}, _checksum(files))
    faults = [_fault(messages) for messages in found.messages.values()]
    if faults and all(faults):
        raise BagError(faults[0])
    return found


def _fault(messages: Messages) -> str:
    """Return why a topic's messages cannot be read, by the first; empty if they can."""
    try:
        next(messages.objects())
    except BagError as error:
        return str(error)
    return ''


def _table(path: Path, bag: Foreign) -> list[str]:
    """Return the topics as lines of text."""
    width = max([len(name) for name in bag.topics] + [5])
    lines = [f'{path}: give --map /theirs:=ours, for example from', '',
             f'  {"topic":<{width}}  messages      Hz  type']
    for name, kind in sorted(bag.topics.items()):
        times = bag.messages[name].log_time if name in bag.messages else np.empty(0, np.int64)
        span = (times[-1] - times[0]) / SECOND if len(times) > 1 else 0.0
        rate = f'{(len(times) - 1) / span:.1f}' if span > 0.0 else '-'
        lines.append(f'  {name:<{width}}  {len(times):8d}  {rate:>6}  {kind}')
        fault = _fault(bag.messages[name]) if name in bag.messages else ''
        if fault:
            lines.append(f'  {"":<{width}}  cannot be read: {fault}')
        elif could_become(kind):
            lines.append(f'  {"":<{width}}  could be {", ".join(could_become(kind))}')
    return lines


def _pairs(path: Path, bag: Foreign, asked: Mapping[str, str]) -> None:
    """Check a map against the bag."""
    for theirs, ours in asked.items():
        if theirs not in bag.topics:
            raise BagError(
                f'{path}: no topic {theirs}; it has {", ".join(sorted(bag.topics)) or "none"}')
        if ours not in TARGETS:
            raise BagError(f'{ours} is not one of our topics: {", ".join(TARGETS)}')
        if ours not in could_become(bag.topics[theirs]):
            raise BagError(f'{path}: {theirs} is a {bag.topics[theirs]}, which cannot become '
                           f'{ours} ({TARGETS[ours]})')
        if theirs not in bag.messages or not len(bag.messages[theirs]):
            raise BagError(f'{path}: {theirs} has no messages')
    doubled = [ours for ours in asked.values() if list(asked.values()).count(ours) > 1]
    if doubled:
        raise BagError(f'{doubled[0]} is mapped to twice')


def _copied(store: Typestore, type_name: str, message: Any) -> Any:
    """Return a message of an installed type with the fields of another that it shares."""
    fields = {}
    for name, (node, detail) in store.fielddefs[type_name][1]:
        value = getattr(message, name, None)
        if value is None:
            continue
        fields[name] = _copied(store, detail, value) if node == cdr.Nodetype.NAME else value
    return cdr.zero(store, type_name, **fields)


def _inner(message: Any, path: str) -> Any:
    """Return a field of a field: the attributes of a dotted path."""
    for name in path.split('.'):
        message = getattr(message, name)
    return message


def _as_pose(store: Typestore, kind: str, message: Any) -> Any:
    """Return a PoseStamped of a message that holds a pose."""
    position, orientation = (_inner(message, path) for path in POSES[kind])
    types = store.types
    return types[POSE](
        _copied(store, 'std_msgs/msg/Header', message.header),
        types['geometry_msgs/msg/Pose'](
            types['geometry_msgs/msg/Point'](position.x, position.y, position.z),
            _copied(store, 'geometry_msgs/msg/Quaternion', orientation)))


def _is_lost(kind: str, message: Any) -> bool:
    """Return whether a pose is what a tracker says of a body that it does not see."""
    if kind not in POSES:
        return False
    p, q = (_inner(message, path) for path in POSES[kind])
    square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    return not (math.isfinite(p.x + p.y + p.z + square) and abs(square - 1.0) < LOOSE_NORM)


@dataclasses.dataclass
class Tally:
    """What became of one topic's messages."""

    lost: int = 0
    unstamped: int = 0
    backwards: int = 0
    newest: int = -1


def _converted(
    store: Typestore, messages: Messages, wanted: str, tally: Tally,
) -> Iterator[tuple[int, bytes]]:
    """Yield log time and CDR of the messages that stay."""
    kind = messages.type_name
    for log_time, message in zip(messages.log_time.tolist(), messages.objects()):
        if _is_lost(kind, message):
            tally.lost += 1
            continue
        out = (_copied(store, wanted, message) if kind == wanted
               else _as_pose(store, kind, message))
        stamp = out.header.stamp.sec * SECOND + out.header.stamp.nanosec
        if stamp < 0 or not 0 <= log_time < 2**63:
            raise BagError(f'{messages.topic}: a message of the impossible time '
                           f'{stamp if stamp < 0 else log_time} ns')
        if stamp == 0:
            tally.unstamped += 1
            stamp = log_time
            out.header.stamp = store.types['builtin_interfaces/msg/Time'](
                *divmod(log_time, SECOND))
        tally.backwards += stamp < tally.newest
        tally.newest = max(tally.newest, stamp)
        yield log_time, bytes(store.serialize_cdr(out, wanted))


def import_bag(
    source: Path, target: Path, topics: Mapping[str, str],
) -> tuple[dict[str, int], dict[str, str]]:
    """
    Write a bag from a foreign one.

    Parameters
    ----------
    source
        rosbag2 directory, .mcap or .db3 file.
    target
        Directory to make.
    topics
        {their absolute name: ours, one of ``TARGETS``}.

    Returns
    -------
    {topic: messages}; the metadata record ``import``.

    Raises
    ------
    BagError
        If the bag cannot be read or the map does not fit it; nothing is written then.
    mambo_sim.bag_writer.BagWriterError
        If the target exists.

    """
    bag = read_foreign(source)
    _pairs(source, bag, topics)
    store = cdr.load_types({TARGETS[ours] for ours in topics.values()})
    ready, details = {}, {}
    for theirs, ours in topics.items():
        tally = Tally()
        ready[ours] = list(_converted(store, bag.messages[theirs], TARGETS[ours], tally))
        if not ready[ours]:
            raise BagError(f'{source}: {theirs} holds no pose, the body is lost throughout')
        details[f'map {ours}'] = f'{theirs} ({bag.topics[theirs]})'
        for what in ('lost', 'unstamped', 'backwards'):
            if getattr(tally, what):
                details[f'{what} {ours}'] = getattr(tally, what)
    record = provenance(source.name, bag.sha256, 'import_bag', 'rosbag2', details)
    with BagWriter(target, metadata=record) as writer:
        for ours in ready:
            writer.add_topic(f'{NAMESPACE}/{ours}', TARGETS[ours])
        everything = [(log_time, ours, data) for ours, messages in ready.items()
                      for log_time, data in messages]
        for log_time, ours, data in sorted(everything, key=lambda entry: entry[0]):
            writer.write(f'{NAMESPACE}/{ours}', data, log_time)
        return writer.counts, record['import']


def _map(text: str) -> tuple[str, str]:
    """Return the two names of an argument ``THEIRS:=OURS``."""
    theirs, found, ours = text.partition(':=')
    if not (theirs and found and ours):
        raise argparse.ArgumentTypeError(f'{text} is not of the form /their/topic:=ours')
    return theirs, ours.removeprefix(f'{NAMESPACE}/')


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_bag``."""
    parser = argparse.ArgumentParser(
        prog='import_bag', description=__doc__.strip().split('\n')[0])
    parser.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    parser.add_argument('output', type=Path, nargs='?', help='bag to make')
    parser.add_argument('--map', type=_map, action='append', default=[], metavar='/THEIRS:=OURS',
                        help='a topic to take, and its name here; without: list the topics')
    options = parser.parse_args(arguments)
    if options.map and options.output is None:
        parser.error('give the bag to make behind the one to read')

    def work() -> None:
        """Import, or list the topics where none is mapped."""
        if not options.map:
            print('\n'.join(_table(options.bag, read_foreign(options.bag))))
            return
        if len(dict(options.map)) < len(options.map):
            raise BagError('a topic is mapped twice: give each --map once')
        counts, told = import_bag(options.bag, options.output, dict(options.map))
        report(options.bag, options.output, counts, *(
            f'{key}: {value}' for key, value in told.items()
            if key.startswith(('lost', 'unstamped', 'backwards'))))

    return guard('import_bag', work)


if __name__ == '__main__':
    raise SystemExit(main())
