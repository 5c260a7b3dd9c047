"""Recorded messages of a bag in the order of their log time, and how a replay plays them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import NamedTuple

from mambo_model import limits, schema, yaml_nodes
from mambo_ros import cdr, messages, topics
from mcap.exceptions import McapError
from mcap.reader import make_reader
import numpy as np
from numpy.typing import NDArray
import yaml

from .reader import Bag, BagError, Messages

SENSORS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)
"""Topics whose samples ``sensor_tick`` counts, in its order."""
COUNTED = (*SENSORS, topics.OPTITRACK)
"""Topics whose samples some watermark counts."""
COUNTS = {
    topics.SENSOR_TICK: dict(zip(
        SENSORS, ('imu', 'sonar', 'optical_flow', 'barometer'), strict=True)),
    topics.CAPTURE_TICK: {topics.OPTITRACK: 'poses'}}
"""Topics that each watermark counts, and the field that does."""
_STEPS = (topics.IMU, topics.SENSOR_TICK)  # with one of them a step of a replay begins


def bag_files(path: Path) -> list[Path]:
    """
    Return the MCAP files of a bag in order.

    Raises
    ------
    mambo_model.schema.ParameterError
        If the path holds no MCAP file.

    """
    limits.check_regular(path)
    if path.is_file():
        return [path]
    listing = path / 'metadata.yaml'
    if listing.is_file():
        try:
            names = yaml_nodes.load(yaml_nodes.read_text(listing))[
                'rosbag2_bagfile_information']['relative_file_paths']
            files = [path / name for name in names]
        except (yaml.YAMLError, KeyError, TypeError) as error:
            raise schema.ParameterError(
                f"{listing}: not the metadata of a rosbag2 bag ({' '.join(str(error).split())})"
            ) from None
    else:
        files = sorted(path.glob('*.mcap')) if path.is_dir() else []
    missing = [str(file) for file in files if not file.is_file()]
    if missing or not files:
        raise schema.ParameterError(
            f'{missing[0]}: listed in metadata.yaml but missing' if missing
            else f'{path}: not a bag; give a rosbag2 directory or an .mcap file')
    return files


def recorded(path: Path, names: set[str]) -> Iterator[tuple[str, str, bytes]]:
    """
    Yield (topic, type name, bytes) of the named topics in the order of their log time.

    Raises
    ------
    mambo_model.schema.ParameterError
        If a file cannot be read to its end.

    """
    for file in bag_files(path):
        try:
            with file.open('rb') as stream:
                for kind, channel, message in make_reader(stream).iter_messages(
                        topics=list(names)):
                    yield channel.topic, kind.name, message.data
        except (McapError, OSError, ValueError, EOFError) as error:
            raise schema.ParameterError(
                f'{file}: not a readable MCAP file ({error}); try recover on it') from None


class Marks(NamedTuple):
    """
    The watermarks of a bag, each newer than those before it, and what they say of k topics.

    A recording that begins in flight counts from its first watermark.
    """

    t: NDArray[np.int64]  # (n,) ns, stamps
    due: NDArray[np.int64]  # (n, k) samples in the bag that each announces
    logged: NDArray[np.int64]  # (n, k) samples that were logged before it
    before: NDArray[np.int64]  # (k,) samples that were published before the recording


def watermarks(bag: Bag, tick: topics.Topic, namespace: str = '') -> Marks:
    """
    Return the recorded watermarks of a bag.

    Parameters
    ----------
    bag
        Read with them and with the topics that they count.
    tick
        ``sensor_tick`` or ``optitrack/tick``.
    namespace
        Of the topics; empty: that of the bag.

    Raises
    ------
    mambo_bags.reader.BagError
        If the topic is not there or has another type.

    """
    found = bag[f'{namespace}{tick.name}']
    if found.type_name != tick.type_name:
        raise BagError(f'{bag.path}: {found.topic} has the type {found.type_name}, expected '
                       f'{tick.type_name}')
    new = newer(found.stamp)
    names = [f'{namespace}{topic.name}' for topic in COUNTS[tick]]
    logged = np.stack([
        np.searchsorted(bag[name].log_time, found.log_time[new], 'right') if name in bag
        else np.zeros(new.sum(), np.int64) for name in names], axis=1)
    due = np.stack([found[field] for field in COUNTS[tick].values()],
                   axis=1).astype(np.int64)[new]
    before = np.zeros(len(names), np.int64)
    if len(due) and due[0, 0] > 1:
        before = due[0] - logged[0]
    return Marks(found.stamp[new], due - before, logged, before)


def counted(
    raw: Sequence[bytes], logged: NDArray[np.int64], due: NDArray[np.int64],
) -> NDArray[np.int64]:
    """
    Return the places of the samples of a topic without uncounted repeats, (k,).

    These only repeat the sample before them and are counted by no watermark: a merged or rewritten
    bag may hold such samples, and each would be taken for the next one.

    Parameters
    ----------
    raw
        The samples as bytes, in the order of the log.
    logged, due : (n,)
        As of :class:`Marks`.

    """
    out = np.ones(len(raw), np.bool_)
    if (logged > due).any():
        repeated = np.array([a == b for a, b in pairwise([b'', *raw])], np.bool_)
        begin, left = 0, 0
        for end, count in zip(logged.tolist(), due.tolist(), strict=True):
            places = begin + np.flatnonzero(repeated[begin:end])[:max(end - left - count, 0)]
            out[places] = False
            begin, left = max(begin, end), left + len(places)
    return np.flatnonzero(out)


def kept(found: Messages, marks: Marks, k: int) -> NDArray[np.int64] | None:
    """
    Return the places of :func:`counted` for the topic k of some watermarks; None: all are kept.

    ``marks.logged`` then counts those that are kept.
    """
    logged, due = marks.logged[:, k], marks.due[:, k]
    if not (logged > due).any():
        return None
    places = counted(found.raw, logged, due)
    marks.logged[:, k] = np.searchsorted(places, logged, 'left')
    return places


def before(bag: Bag, namespace: str) -> dict[topics.Topic, int]:
    """Return how many samples of each topic were published before a recording, as above."""
    return {
        topic: int(count)
        for tick, streams in COUNTS.items() if f'{namespace}{tick.name}' in bag
        for topic, count in zip(streams, watermarks(bag, tick, namespace).before, strict=True)}


def counted_from(data: bytes, tick: topics.Topic, before: Mapping[topics.Topic, int]) -> bytes:
    """Return a watermark that counts from the begin of a recording, see :func:`before`."""
    if tick is topics.CAPTURE_TICK:
        t, poses = messages.decode_capture_tick(data)
        return messages.capture_tick(t, max(poses - before[topics.OPTITRACK], 0))
    t, counts = messages.decode_sensor_tick(data)
    return messages.sensor_tick(t, *(
        max(count - before[topic], 0) for topic, count in zip(SENSORS, counts, strict=True)))


def uncounted(bag: Bag, namespace: str) -> dict[topics.Topic, set[int]]:
    """Return the places of the uncounted repeats of a bag by topic; arguments as above."""
    out = {}
    for tick, streams in COUNTS.items():
        if f'{namespace}{tick.name}' in bag:
            marks = watermarks(bag, tick, namespace)
            for k, topic in enumerate(streams):
                name = f'{namespace}{topic.name}'
                if name in bag and (places := kept(bag[name], marks, k)) is not None:
                    out[topic] = set(range(len(bag[name]))).difference(places.tolist())
    return out


def steps(
    played: Iterable[tuple[topics.Topic, bytes]], left_out: Mapping[topics.Topic, set[int]],
) -> Iterator[tuple[int, list[tuple[topics.Topic, bytes]]]]:
    """
    Yield the steps of a replay: stamp in ns, and messages in the order of the log.

    A step begins with an inertial sample or a watermark of the sensors that is newer than all
    before. A watermark that is not newer than those before it is left out.

    Parameters
    ----------
    played
        Messages in the order of the log.
    left_out
        Places of messages to leave out, by topic.

    """
    held: list[tuple[topics.Topic, bytes]] = []
    now, marks, places = -1, dict.fromkeys(COUNTS, -1), dict.fromkeys(left_out, -1)
    for topic, data in played:
        t = cdr.stamp_ns(data)
        if topic in places:
            places[topic] += 1
            if places[topic] in left_out[topic]:
                continue
        if topic in marks:
            if t <= marks[topic]:
                continue
            marks[topic] = t
        if topic in _STEPS and t > now:
            if now >= 0:
                yield now, held
                held = []
            now = t
        held.append((topic, data))
    if now >= 0:
        yield now, held


def newer(stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which of some stamps, ns, are newer than all before them."""
    return stamps > np.maximum.accumulate(np.append(-1, stamps))[:-1]


class Watermarks:
    """
    The watermarks of a bag that has none: how many samples of each stream they announce.

    Real hardware may stamp a sample after the inertial sample that it was logged with. Such a
    sample, and all of its stream after it, is announced by a later watermark, so that none
    announces a sample of its own future. A stamp that is over 0.1 s ahead waits for one watermark,
    which may come after a gap of the inertial samples; if it is still as far ahead, it is wrong.

    """

    def __init__(self, streams: int) -> None:
        self._waiting = [deque[int]() for _ in range(streams)]
        self._is_far = [False] * streams  # the first that waits was over 0.1 s ahead
        self._counts = [0] * streams

    def add(self, stream: int, stamp: int) -> None:
        """Add the next sample of a stream, in the order of the log; stamp in ns."""
        self._waiting[stream].append(stamp)

    def announced(self, t: int) -> tuple[int, ...]:
        """Return how many samples of each stream the watermark of ``t``, ns, announces."""
        for stream, waiting in enumerate(self._waiting):
            while waiting:
                far = waiting[0] > t + limits.AHEAD_NS
                if waiting[0] > t and not (far and self._is_far[stream]):
                    self._is_far[stream] = far
                    break
                waiting.popleft()
                self._is_far[stream] = False
                self._counts[stream] += 1
        return tuple(self._counts)


def announced(
    t: NDArray[np.int64], logged: NDArray[np.int64], stamps: Sequence[NDArray[np.int64]],
) -> NDArray[np.int64]:
    """
    Return how many samples the watermarks of a bag that has none announce, (n, streams).

    Parameters
    ----------
    t : (n,) ns
        Stamps of the watermarks, increasing.
    logged : (n, streams)
        How many samples of each stream were logged before.
    stamps
        Of the samples of each stream, in ns.

    """
    marks, out = Watermarks(len(stamps)), []
    if not any((np.repeat(t, np.diff(n, prepend=0)) < stamp[:n[-1]]).any()
               for n, stamp in zip(logged.T, stamps, strict=True) if len(n)):
        return logged  # none is ahead
    streams = [iter(stamp.tolist()) for stamp in stamps]
    for now, new in zip(t.tolist(), np.diff(logged, axis=0, prepend=0).tolist(), strict=True):
        for stream, (waiting, more) in enumerate(zip(streams, new, strict=True)):
            for stamp in islice(waiting, more):
                marks.add(stream, stamp)
        out.append(marks.announced(now))
    return np.array(out)


class Losses:
    """
    What the watermarks announce and a replay has not played: it is not in the bag.

    The estimator waits for a lost sample until it has a later one of the same topic, and takes no
    step without a watermark. So the steps until then have no answer.

    """

    def __init__(self, captured: bool = False) -> None:
        self._captured = captured  # whether the bag has watermarks of the motion capture
        self._capture_t = -1  # ns, stamp of the newest of these
        self._played = dict.fromkeys(COUNTED, 0)
        self._announced: dict[topics.Topic, int] = {}
        self._before: dict[topics.Topic, int] = {}  # published before the recording began
        self._lost = dict.fromkeys(COUNTED, 0)
        self._known = dict.fromkeys(COUNTED, 0)  # those that a later sample has told of
        self._ticked = False

    def play(self, topic: topics.Topic, data: bytes) -> None:
        """Count a message that is played."""
        if topic in self._played:
            self._played[topic] += 1
            self._known[topic] = self._lost[topic]
        elif topic is topics.SENSOR_TICK:
            self._ticked = True
            _, counts = messages.decode_sensor_tick(data)
            self._announced.update(zip(SENSORS, counts, strict=True))
        elif topic is topics.CAPTURE_TICK:
            self._capture_t, self._announced[topics.OPTITRACK] = (
                messages.decode_capture_tick(data))

    def answered(self, t: int) -> bool:
        """End the step of a stamp, ns; return whether it is answered."""
        for topic, count in self._announced.items():
            if topic not in self._before:
                first = self._announced[topic if topic is topics.OPTITRACK else topics.IMU]
                self._before[topic] = count - self._played[topic] if first > 1 else 0
            self._lost[topic] = max(count - self._before[topic] - self._played[topic], 0)
        ticked, self._ticked = self._ticked, False
        return ticked and (not self._captured or t <= self._capture_t) and all(
            lost <= self._known[topic] for topic, lost in self._lost.items())

    def __str__(self) -> str:
        """Return the losses as the end of a sentence; empty without any."""
        lost = [f'{n} samples of {topic.name}' for topic, n in self._lost.items() if n > 0]
        return f'; not in the bag: {", ".join(lost)}' if lost else ''


class Hesitation:
    """
    Decides when a replay goes on without an answer: it may be late because a sample was lost.

    The estimator knows that only when it has a later sample of the same topic.
    """

    WAIT = 0.1  # s of wall time, before the first step without an answer
    LONGEST = 1.0  # s that count as waiting, of a time in which the process was suspended
    BEHIND = 40  # steps without an answer: 0.2 s, two periods of the slowest sensor

    def __init__(self) -> None:
        self._newest = -1  # estimate after which answers are missing, ns
        self._steps = 0  # without an answer since then
        self._stamps: dict[topics.Topic, int] = {}  # of the newest samples, ns

    def ends_gap(self, held: list[tuple[topics.Topic, bytes]], newest: int) -> bool:
        """
        Return whether a sample of a step ends a gap that the estimator waits in.

        Such a sample has to come after the watermarks of the gap, or its stamp seems wrong.

        Parameters
        ----------
        held
            Messages of the step.
        newest : ns
            Newest estimate.

        """
        found = False
        for topic, data in held:
            if topic in COUNTED:
                t = cdr.stamp_ns(data)
                before = self._stamps.get(topic, t)
                found |= t - max(before, newest) > limits.AHEAD_NS
                self._stamps[topic] = max(before, t)
        return found

    def over(self, newest: int) -> bool:
        """Return whether there is no need to wait again; ``newest`` estimate in ns."""
        return newest == self._newest and self._steps < self.BEHIND

    def goes_on(self, newest: int, waited: float) -> bool:
        """Return whether to go on after some s, which then counts as a step."""
        if newest != self._newest:
            if waited <= self.WAIT:
                return False
            self._newest, self._steps = newest, 0
        self._steps += 1
        return self._steps <= self.BEHIND
