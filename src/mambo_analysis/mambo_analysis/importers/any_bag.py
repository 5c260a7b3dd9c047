"""
Import of any bag with other topic names: ``import_bag BAG OUT --map /theirs:=ours``.

Reads rosbag2 directories and files of any version, MCAP and SQLite (``.db3``), plain or
compressed with zstd, whose messages are CDR. Without ``--map`` it lists the topics with
their possible names. Headers, values and log times are copied; messages are written anew with the
definitions installed here, fields that the source lacks are 0. A pose can be taken from
PoseStamped, PoseWithCovarianceStamped, TransformStamped or Odometry. Poses with a value that is
not finite or an orientation of length 0, as trackers give for a lost body, are left out and
counted; so are poses that no vehicle can reach (:mod:`mambo_signals.poses.outliers`), and frozen
ones (:mod:`mambo_signals.poses.frozen`). A velocity in the axes of the poses is turned into those
of the body (:mod:`.checks.world_twist`). A topic of several bodies or frames, and values that
cannot be in the units of their type, are refused; topics that contradict each other are told
(:mod:`.checks.bag_doubts`).

Times
    The stamp in the header is when something was measured, the log time when it was recorded. A
    stamp of 0 gives way to the log time, where both are on one clock. Stamps of two clocks in one
    bag (seconds since boot in a driver, wall time in a tracker or of the recorder) are refused:
    ``--time log`` stamps everything by its log time; ``--time header`` keeps the stamps, and puts
    messages without one on their clock.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import dataclasses
import hashlib
import math
from pathlib import Path
import tempfile
from typing import Any, NamedTuple

from mambo_bags import columns
from mambo_bags.command import guard, Parser, refuse_unused
from mambo_bags.compression import is_compressed, unpack
from mambo_bags.mcap_reader import BagError, check_regular
from mambo_bags.reader import Messages, read_bag, read_listing
from mambo_bags.writer import BagWriter
from mambo_model.errors import InputError
from mambo_ros import cdr
from mambo_signals.poses import frozen, outliers
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from .checks import assignments, bag_doubts, plausible, world_twist
from .common import NAMESPACE, provenance, quoted, report, SECOND, shortened, unused
from .sqlite_bag import read_sqlite

Ints = NDArray[np.int64]

ODOMETRY, POSE = 'nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped'
IMU = 'sensor_msgs/msg/Imu'
TARGETS = {
    'optitrack/pose': POSE, 'ground_truth/odom': ODOMETRY, 'estimate/odom': ODOMETRY,
    'onboard/odom': ODOMETRY, 'onboard/reference': POSE, 'imu/data_raw': IMU,
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
"""Types that hold a pose, with its field."""
NUMBERS = {
    **{kind: (*(f'{position}.{axis}' for axis in 'xyz'), *(f'{turn}.{axis}' for axis in 'xyzw'))
       for kind, (position, turn) in POSES.items()},
    IMU: (*(f'angular_velocity.{axis}' for axis in 'xyz'), 'linear_acceleration.z'),
    'sensor_msgs/msg/Range': ('range',), 'sensor_msgs/msg/FluidPressure': ('fluid_pressure',),
    'sensor_msgs/msg/BatteryState': ('voltage',)}
"""Fields that tell whether a message of ours is in the right unit."""
SINGLE = {
    'sensor_msgs/msg/Range': plausible.refuse_ranges,
    'sensor_msgs/msg/FluidPressure': plausible.refuse_pressure,
    'sensor_msgs/msg/BatteryState': plausible.refuse_voltage}
"""Checks of types with one number."""
CAPTURED = ('optitrack/pose', 'ground_truth/odom')
"""Topics of measured or true poses: those of an estimate may drift far."""
MOVING = (*CAPTURED, 'estimate/odom', 'onboard/odom', 'imu/data_raw')
"""Topics whose pace tells whether the unit of time is right."""
NOTED = ('lost', 'unstamped', 'backwards', 'repeated', 'not finite', 'turned')
"""What a summary says of messages, by topic; and the impossible and the frozen ones."""
LOOSE_NORM = 0.1  # [-] how far from 1 an orientation may be
ONE_CLOCK = 10 * SECOND  # [ns] by which stamps of one clock may be apart: no message is that late


@dataclasses.dataclass(frozen=True)
class Foreign:
    """
    A foreign bag.

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


def _files(path: Path) -> tuple[list[Path], str]:
    """Return the files of a bag, of any storage, and the distribution that recorded it."""
    check_regular(path)
    if path.is_file():
        return [path], ''
    if not path.is_dir():
        raise BagError(f'{path}: no such bag')
    listing = read_listing(path)
    files = [path / Path(name).name for name in listing.get('relative_file_paths', [])]
    files = files or sorted(file for file in path.iterdir() if file.name.endswith(
        tuple(f'{kind}{packed}' for kind in ('.db3', '.mcap') for packed in ('', '.zstd'))))
    for file in files:
        if not file.is_file():
            raise BagError(f'{file}: listed in metadata.yaml, but missing')
    return files, str(listing.get('ros_distro', ''))


def _is_sqlite(file: Path) -> bool:
    """Return whether a file is one of SQLite, by its first bytes or its name."""
    with file.open('rb') as stream:
        begin = stream.read(16)
    if begin.startswith(b'#ROSBAG'):
        raise BagError(f'{file}: a bag of ROS 1; convert it with rosbags-convert first')
    return begin.startswith(b'SQLite format 3') or file.suffix == '.db3'


def _read(
    path: Path, files: list[Path], distribution: str,
) -> tuple[dict[str, str], dict[str, Messages]]:
    """Return the topics and messages of a bag whose files are not compressed."""
    if any(map(_is_sqlite, files)):
        return read_sqlite(path, files, distribution)
    bag = read_bag(path)
    return dict(bag.topics), {name: bag[name] for name in bag.topics if name in bag}


def _unpack(file: Path, target: Path) -> None:
    """Write a file decompressed; BagError if it cannot be decompressed."""
    try:
        unpack(file, target)
    except ValueError as error:
        raise BagError(f'{file}: {error}') from None


def _read_unpacked(
    path: Path, files: list[Path], distribution: str,
) -> tuple[dict[str, str], dict[str, Messages]]:
    """Return the same for a bag with compressed files, using a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        plain = [Path(folder) / file.name.removesuffix('.zstd') for file in files]
        try:
            for file, target in zip(files, plain, strict=True):
                if is_compressed(file):
                    _unpack(file, target)
                else:
                    target.symlink_to(file.resolve())
            return _read(Path(folder), plain, distribution)
        except BagError as error:
            raise BagError(str(error).replace(folder, str(path))) from None


def read_foreign(path: Path) -> Foreign:
    """
    Read a bag of any storage format.

    Raises
    ------
    BagError
        If there is none, or it is empty, damaged or foreign.

    """
    try:
        files, distribution = _files(path)
        read = _read_unpacked if any(map(is_compressed, files)) else _read
        found = Foreign(*read(path, files, distribution), _checksum(files))
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    faults = [_fault(messages) for messages in found.messages.values()]
    if faults and all(faults):
        raise BagError(faults[0])
    return found


def _fault(messages: Messages) -> str:
    """Return why the first message of a topic cannot be read; empty if it can."""
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
    """Return a message of an installed type with the fields that another has in common."""
    fields = {}
    for name, (node, detail) in store.fielddefs[type_name][1]:
        value = getattr(message, name, None)
        if value is None:
            continue
        fields[name] = _copied(store, detail, value) if node == columns.Nodetype.NAME else value
    return columns.zero(store, type_name, **fields)


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
    """Return whether a pose is the placeholder of a tracker for a lost body."""
    if kind not in POSES:
        return False
    p, q = (_inner(message, path) for path in POSES[kind])
    square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    return not (math.isfinite(p.x + p.y + p.z + square) and abs(square - 1.0) < LOOSE_NORM)


class Converted(NamedTuple):
    """The accepted messages of one topic, converted to our type."""

    log_time: list[int]  # ns
    stamps: list[int]  # ns, 0 without
    data: list[bytes]
    numbers: list[tuple[float, ...]]  # values of the fields of NUMBERS
    lost: int  # left out
    turned: bool = False  # the velocity, into the axes of the body

    def only(self, use: NDArray[np.bool_]) -> Converted:
        """Return those messages, (n,), that are to be used."""
        rows = np.flatnonzero(use).tolist()
        lists = ([column[row] for row in rows]
                 for column in (self.log_time, self.stamps, self.data, self.numbers))
        return Converted(*lists, self.lost, self.turned)


def _one_of(where: str, names: Mapping[str, set[str]]) -> None:
    """Refuse messages of several bodies or in several frames, {field: its values}."""
    for field, what in (('child_frame_id', 'bodies'), ('frame_id', 'frames')):
        found = sorted(names[field] - {''})  # some publishers leave it out at times
        if len(found) > 1:
            raise BagError(f'{where}: its messages are of {len(found)} {what}, {field} '
                           f'{shortened([quoted(name) for name in found])}: give each a topic of '
                           'its own')


def _vector(message: Any, names: str) -> list[float]:
    """Return fields of one letter each."""
    return [getattr(message, name) for name in names]


def _in_world(messages: Sequence[Any]) -> bool:
    """Return whether the velocity of odometry messages is in the axes of their poses."""
    pose, stamps = [m.pose.pose for m in messages], [m.header.stamp for m in messages]
    found = world_twist.axes_of(
        np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]),
        *(np.array(rows, float).reshape(len(messages), -1) for rows in (
            [_vector(one.position, 'xyz') for one in pose],
            [_vector(one.orientation, 'xyzw') for one in pose],
            [_vector(m.twist.twist.linear, 'xyz') for m in messages])))
    same = all(m.child_frame_id and m.child_frame_id == m.header.frame_id for m in messages)
    return found == 'world' or same and not found


def _turn_twist(message: Any) -> None:
    """Turn the twist of an odometry message from the axes of its pose into those of its body."""
    turn = Rotation.from_quat(_vector(message.pose.pose.orientation, 'xyzw')).inv().as_matrix()
    for part in (message.twist.twist.linear, message.twist.twist.angular):
        part.x, part.y, part.z = (turn @ _vector(part, 'xyz')).tolist()
    both = np.kron(np.eye(2), turn)
    covariance = both @ np.reshape(message.twist.covariance, (6, 6)) @ both.T
    message.twist.covariance = covariance.reshape(-1)


def _converted(
    store: Typestore, source: Path, messages: Messages, wanted: str,
) -> Converted:
    """Return the messages of a topic, converted to our type."""
    kind, objects = messages.type_name, list(messages.objects())
    out = Converted([], [], [], [], 0, kind == wanted == ODOMETRY and _in_world(objects))
    names: dict[str, set[str]] = {'child_frame_id': set(), 'frame_id': set()}
    for log_time, message in zip(messages.log_time.tolist(), objects):
        if _is_lost(kind, message):
            out = out._replace(lost=out.lost + 1)
            continue
        ours = (_copied(store, wanted, message) if kind == wanted
                else _as_pose(store, kind, message))
        if out.turned:
            _turn_twist(ours)
        stamp = ours.header.stamp.sec * SECOND + ours.header.stamp.nanosec
        if stamp < 0 or not 0 <= log_time < 2**63:
            raise BagError(f'{messages.topic}: a message of the impossible time '
                           f'{stamp if stamp < 0 else log_time} ns')
        out.log_time.append(log_time)
        out.stamps.append(stamp)
        out.data.append(bytes(store.serialize_cdr(ours, wanted)))
        out.numbers.append(tuple(_inner(ours, path) for path in NUMBERS.get(wanted, ())))
        names['frame_id'].add(ours.header.frame_id)
        names['child_frame_id'].add(getattr(message, 'child_frame_id', ''))
    _one_of(f'{source}: {messages.topic}', names)
    return out


def _possible(
    where: str, ours: str, stamps: list[int], found: Converted,
    beside: list[assignments.Turning],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], list[str]]:
    """
    Return which messages of a topic can be, which are no frozen poses, and lines on turned ones.

    Parameters
    ----------
    where
        File and their topic, for errors.
    ours
        Our topic.
    stamps
        ns, of each message.
    found
        Its messages.
    beside
        Sensors that turn with the body.

    Raises
    ------
    BagError
        If their times or values cannot be in the units of their type.

    """
    given = np.array(stamps, np.int64)
    each, first = np.unique(given, return_index=True)  # ascending
    values = np.array(found.numbers, float).reshape(len(stamps), -1)[first]
    times, kind = (each - each[0]) / SECOND, TARGETS[ours]
    if ours in MOVING:
        plausible.refuse_pace(f'{where}: its stamps', times)
    if kind == IMU:
        known = np.isfinite(values).all(axis=1)
        upward = values[known, 3]
        plausible.refuse_degrees(where, times[known], values[known, :3])
        plausible.refuse_g(where, upward if np.sum(upward) > 0.0 else -upward)
    elif kind in SINGLE:  # a range without an echo is infinite, a voltage may be unknown
        SINGLE[kind](where, values[np.isfinite(values[:, 0]), 0])
    elif ours == 'optitrack/pose':
        still, wrong, turned = plausible.doubtful_poses(
            where, ours, each / SECOND, values[:, :3], values[:, 3:], beside)
        return ~np.isin(given, each[wrong]), ~np.isin(given, each[still]), turned
    elif kind in POSES and ours != 'onboard/reference':
        wrong = outliers.refuse_most(where, times, values[:, :3], values[:, 3:])
        if ours in CAPTURED:
            plausible.refuse_far(where, values[~wrong, :3])
    every = np.ones(len(stamps), bool)
    return every, every, []


def _turnings(
    topics: Mapping[str, str], ready: Mapping[str, Converted], stamps: Mapping[str, list[int]],
) -> list[assignments.Turning]:
    """Return how the body turns by the gyro and by the onboard attitude, if they are there."""
    out = []
    for ours in ('imu/data_raw', 'onboard/odom'):
        for theirs in (name for name, target in topics.items() if target == ours):
            each, first = np.unique(np.array(stamps[theirs], np.int64), return_index=True)
            values = np.array(ready[theirs].numbers, float).reshape(len(stamps[theirs]), -1)[first]
            good = np.isfinite(values).all(axis=1)
            times, values = each[good] / SECOND, values[good]
            out.append(assignments.Turning('the gyro', times, values[:, :3])
                       if ours == 'imu/data_raw' else assignments.of_attitude(
                           f'the attitude of {ours}', times, values[:, 3:]))
    return out


def _apart(lag: int) -> str:
    """Return a difference of clocks in words, of ns."""
    seconds = abs(lag) / SECOND
    return f'{seconds / 86400.0:.1f} days' if seconds > 86400.0 else f'{seconds:.1f} s'


def _one_clock(source: Path, ready: Mapping[str, Converted]) -> tuple[Ints, Ints] | None:
    """
    Return log times and their lead over the stamps, of the topic with the most stamps.

    None without any stamp.

    Raises
    ------
    BagError
        If a stamp is on another clock than the one before or than another topic's.

    """
    lags = {}
    for theirs, found in ready.items():
        log_time, stamps = np.array(found.log_time, np.int64), np.array(found.stamps, np.int64)
        has = stamps > 0
        if not has.any():
            continue
        lag = log_time[has] - stamps[has]
        far = np.flatnonzero(np.minimum(  # a recorder that was paused has no jump of the stamps
            np.abs(np.diff(lag)), np.abs(np.diff(stamps[has]))) > ONE_CLOCK)
        if len(far):
            raise BagError(
                f'{source}: the stamps of {theirs} are on two clocks: one of them is '
                f'{_apart(lag[far[0] + 1] - lag[far[0]])} from the one before, at the same log '
                'time; --time log stamps all by their log time')
        lags[theirs] = log_time[has], lag
    if not lags:
        return None
    most = max(lags, key=lambda theirs: len(lags[theirs][1]))
    for theirs, (log_time, lag) in lags.items():
        apart = _lag_at(log_time, *lags[most]) - lag
        if abs(np.median(apart)) > ONE_CLOCK:
            raise BagError(
                f'{source}: the stamps of {theirs} and {most} are on two clocks, '
                f'{_apart(np.median(apart))} apart; --time log stamps all by their log time')
    return lags[most]


def _lag_at(times: Ints, known: Ints, lag: Ints) -> Ints:
    """Return a lag between its known times, ns; a float is too coarse for ns since 1970."""
    more = np.interp(times - known[0], known - known[0], lag - lag[0])
    return lag[0] + np.rint(more).astype(np.int64)


def _stamps(
    source: Path, ready: Mapping[str, Converted], time: str | None,
) -> dict[str, list[int]]:
    """Return the stamps to give to the messages of each topic, ns; BagError for two clocks."""
    if time == 'log':
        return {theirs: found.log_time for theirs, found in ready.items()}
    clock = _one_clock(source, ready)
    out = {}
    for theirs, found in ready.items():
        bare = np.array([
            at for stamp, at in zip(found.stamps, found.log_time) if not stamp], np.int64)
        lag = _lag_at(bare, *clock) if clock else np.zeros_like(bare)
        if time is None and (np.abs(lag) > ONE_CLOCK).any():
            raise BagError(
                f'{source}: {len(bare)} messages of {theirs} have no stamp, and their log time is '
                f'{_apart(np.abs(lag).max())} from the stamps of the others; --time header puts '
                'them on the clock of the stamps, --time log stamps all by their log time')
        given = iter((bare if time is None else bare - lag).tolist())
        out[theirs] = [stamp or next(given) for stamp in found.stamps]
        if min(out[theirs]) < 0:
            raise BagError(f'{source}: --time header puts a message of {theirs} before 0')
    return out


def _details(
    bag: Foreign, topics: Mapping[str, str], ready: Mapping[str, Converted],
    stamps: Mapping[str, list[int]],
) -> dict[str, Any]:
    """Return the numbers of imported and refused messages, for the bag's metadata."""
    details: dict[str, Any] = {}
    for theirs, ours in topics.items():
        details[f'map {ours}'] = f'{theirs} ({bag.topics[theirs]})'
        row = np.array(stamps[theirs], np.int64)
        numbers = np.array(ready[theirs].numbers, float).reshape(len(row), -1)
        measured = np.isfinite(numbers).any(axis=0)
        finite = np.isfinite(numbers[:, measured]).all(axis=1)
        without = sum(own == 0 != given for own, given in zip(
            ready[theirs].stamps, stamps[theirs]))
        counts = {'lost': ready[theirs].lost, 'unstamped': without,
                  'backwards': int((row < np.maximum.accumulate(row)).sum()),
                  'repeated': int((np.diff(row) == 0).sum()),
                  'not finite': int((~finite).sum()) if TARGETS[ours] == IMU else 0}
        details |= {f'{what} {ours}': count for what, count in counts.items() if count}
        if ready[theirs].turned:
            details[f'turned {ours}'] = ('its velocity was in the axes of its poses, and is now '
                                         'in those of the body')
    return details


def import_bag(
    source: Path, target: Path, topics: Mapping[str, str], time: str | None = None,
) -> tuple[dict[str, int], dict[str, str], list[str]]:
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
    time
        ``header``: messages without a stamp are put on the clock of the others' stamps; ``log``:
        all stamps are the log times; default: the stamps, where there is one clock alone.

    Returns
    -------
    {topic: messages}; the metadata record ``import``; lines on poses with a turned body, and on
    those that are left out for long, which the record holds too.

    Raises
    ------
    BagError
        If the bag cannot be read, the map does not fit it, its stamps are on two clocks, a topic
        has several bodies or frames, or its values are in other units; nothing is written then.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    bag = read_foreign(source)
    _pairs(source, bag, topics)
    store = columns.load_types({TARGETS[ours] for ours in topics.values()})
    ready = {}
    for theirs, ours in topics.items():
        ready[theirs] = _converted(store, source, bag.messages[theirs], TARGETS[ours])
        if not ready[theirs].data:
            raise BagError(f'{source}: {theirs} holds no pose, the body is lost throughout')
    stamps = _stamps(source, ready, time)
    details = _details(bag, topics, ready, stamps)
    beside = _turnings(topics, ready, stamps)
    lines: list[str] = []
    for theirs, ours in topics.items():
        possible, moving, turned = _possible(
            f'{source}: {theirs}', ours, stamps[theirs], ready[theirs], beside)
        if turned:
            details[f'poses {ours}'] = '; '.join(turned)
            lines += turned
        for what, good in (('impossible', possible), ('frozen', moving)):
            if not good.all():
                details[f'{what} {ours}'] = int((~good).sum())
        if not (kept := possible & moving).all():
            ready[theirs] = ready[theirs].only(kept)
            stamps[theirs] = np.array(stamps[theirs], np.int64)[kept].tolist()
    details['time'] = time or 'header'
    details['ignored'] = ', '.join(sorted(set(bag.topics) - set(topics))) or 'nothing'
    record = provenance(source.name, bag.sha256, 'import_bag', 'rosbag2', details)
    with BagWriter(target, metadata=record) as writer:
        for ours in topics.values():
            writer.add_topic(f'{NAMESPACE}/{ours}', TARGETS[ours])
        everything = [
            (log_time, ours, cdr.restamped(data, stamp)) for theirs, ours in topics.items()
            for log_time, stamp, data in zip(
                ready[theirs].log_time, stamps[theirs], ready[theirs].data, strict=True)]
        for log_time, ours, data in sorted(everything, key=lambda entry: entry[0]):
            writer.write(f'{NAMESPACE}/{ours}', data, log_time)
        return writer.counts, record['import'], lines


def _map(text: str) -> tuple[str, str]:
    """Return the two names of an argument ``THEIRS:=OURS``."""
    theirs, found, ours = text.partition(':=')
    if not (theirs and found and ours):
        raise argparse.ArgumentTypeError(f'{text} is not of the form /their/topic:=ours')
    return theirs, ours.removeprefix(f'{NAMESPACE}/')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('import_bag', __doc__.split('\n\n')[0])
    out.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    out.add_output('BAG', 'bag to create', positional=True)
    out.add_argument('--map', type=_map, action='append', default=[], metavar='/THEIRS:=OURS',
                     help='a topic to take, and its name here; without: list the topics')
    out.add_argument('--time', choices=('header', 'log'),
                     help='header: messages without a stamp are put on the clock of the '
                          'others; log: all are stamped by their log time (default: as they '
                          'are, refused where they are on two clocks)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_bag``; return the exit code."""
    command = parser()
    options = command.parse_args(arguments)

    def work() -> None:
        """Import, or list the topics if none is mapped."""
        if not options.map:
            found = read_foreign(options.bag)
            refuse_unused(command, options, ('output', 'time'),
                          'without --map the topics are only listed')
            print('\n'.join(_table(options.bag, found)))
            return
        if options.output is None:
            raise InputError('give the bag to create behind the one to read')
        if len(dict(options.map)) < len(options.map):
            raise BagError('a topic is mapped twice: give each --map once')
        counts, details, lines = import_bag(
            options.bag, options.output, dict(options.map), options.time)
        ignored = [] if details['ignored'] == 'nothing' else details['ignored'].split(', ')
        notes = [f'{key}: {value}' for key, value in details.items() if key.startswith(NOTED)]
        notes += [about.describe(key.split()[1], int(count))
                  for what, about in (('impossible', outliers), ('frozen', frozen))
                  for key, count in details.items() if key.startswith(f'{what} ')]
        notes += lines + bag_doubts.imported(options.output)
        report(options.bag, options.output, counts, *notes, *unused(ignored))

    return guard('import_bag', work)


if __name__ == '__main__':
    raise SystemExit(main())
