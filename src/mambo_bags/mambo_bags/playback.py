"""Recorded messages of a bag in the order of their log time, for replay."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mambo_model import limits, schema, yaml_nodes
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
