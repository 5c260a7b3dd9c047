"""Recorded messages of a bag in the order of their log time, and how a replay plays them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from mambo_model import limits, schema, yaml_nodes
from mambo_ros import messages, topics
from mcap.exceptions import McapError
from mcap.reader import make_reader
import yaml


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


def not_in_bag(tick: bytes, played: Sequence[int]) -> str:
    """Return which samples a watermark announces beside those ``played``; empty: none."""
    counted = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)
    _, announced = messages.decode_sensor_tick(tick)
    lost = [f'{n - there} samples of {topic.name}'
            for topic, n, there in zip(counted, announced, played, strict=True) if n > there]
    return f'; not in the bag: {", ".join(lost)}' if lost else ''


class Hesitation:
    """
    Decides when a replay goes on without an answer: it may be late because a sample was lost.

    The estimator knows that only when it has a later sample of the same topic.
    """

    WAIT = 0.1  # s of wall time, before the first step without an answer
    BEHIND = 40  # steps without an answer: 0.2 s, two periods of the slowest sensor

    def __init__(self) -> None:
        self._newest = -1  # estimate after which answers are missing, ns
        self._steps = 0  # without an answer since then

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
