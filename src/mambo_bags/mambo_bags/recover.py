"""
Recover a bag whose recorder was killed: ``recover BAG NEW_BAG``.

The source is not changed. Everything before the damage, and every intact chunk after it, is
written to a new, properly closed bag with the same topics, types, times and attachments.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from mambo_model.yaml_nodes import load
import yaml

from . import mcap_reader
from .command import guard, Parser
from .mcap_reader import BagError
from .reader import bag_files
from .writer import BagWriter

OWN_RECORD = 'rosbag2'  # created by the writer


@dataclasses.dataclass(frozen=True)
class Recovered:
    """
    Result of a recovery.

    Attributes
    ----------
    counts
        {topic: messages}.
    start, end
        ns, log times of the first and last message.
    lost
        What could not be read, one line each.
    wrong
        Other contradictions in the source; ``lost`` and ``wrong`` are empty if it was intact.

    """

    counts: dict[str, int]
    start: int
    end: int
    lost: list[str]
    wrong: list[str]

    def __str__(self) -> str:
        total, span = sum(self.counts.values()), (self.end - self.start) * 1e-9
        lines = [f'saved {total} messages over {span:.3f} s']
        lines += [f'  {count:8d}  {topic}' for topic, count in sorted(self.counts.items())]
        lines += [f'lost: {what}' for what in self.lost]
        lines += [f'damaged: {what}' for what in self.wrong]
        if not self.lost and not self.wrong:
            lines.append('nothing was lost: the source is intact')
        return '\n'.join(lines)


def _profiles(text: str) -> list[dict[str, Any]]:
    """Return the QoS profiles of a channel, parsed from YAML; none if unreadable."""
    try:
        profiles = load(text)
    except yaml.YAMLError:
        return []
    return profiles if isinstance(profiles, list) else []


def declare(writer: BagWriter, contents: mcap_reader.Contents, known: dict[str, bytes]) -> None:
    """Declare the topics of one file, except the known ones, {topic: definition}."""
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        definition = schema.data if schema else b''
        if channel.topic in known:
            if known[channel.topic] != definition:
                raise BagError(f'{channel.topic} has two types in one bag; recover file by file')
            continue
        known[channel.topic] = definition
        writer.add_topic(
            channel.topic, schema.name if schema else '',
            _profiles(channel.metadata.get('offered_qos_profiles', '')), schema=definition,
            schema_encoding=schema.encoding if schema else '',
            type_hash=channel.metadata.get('topic_type_hash', ''),
            encoding=channel.message_encoding)


def in_order(part: mcap_reader.Contents) -> list[tuple[str, int, int, bytes]]:
    """Return topic, log time, publish time [ns] and bytes of each message by log time."""
    return sorted(
        ((part.channels[number].topic, *message)
         for number, batches in part.messages.items() for batch in batches
         for message in batch),
        key=lambda message: message[1])


def extras(parts: list[mcap_reader.Contents]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the attachments and the metadata of a bag, {name: content} each."""
    return ({entry.name: entry.data for part in parts for entry in part.attachments},
            {record.name: record.metadata for part in parts for record in part.metadata
             if record.name != OWN_RECORD})


def recover(source: Path, target: Path) -> Recovered:
    """
    Write everything readable in a bag or MCAP file to a new bag.

    Parameters
    ----------
    source
        Directory or MCAP file; not changed.
    target
        Directory to create.

    Raises
    ------
    BagError
        If no message can be read.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    files, _ = bag_files(source)
    parts = [mcap_reader.scan(file) for file in files]
    if not any(part.count for part in parts):
        raise BagError(f'{source}: no message can be read; there is nothing to recover')
    lost, wrong = (
        [f'{file.name}: {what}' for file, part in zip(files, parts)
         for what in getattr(part, kind)] for kind in ('lost', 'wrong'))
    attachments, metadata = extras(parts)
    counts: dict[str, int] = {}
    times: list[int] = []
    with BagWriter(target, attachments, metadata) as writer:
        known: dict[str, bytes] = {}
        for part in parts:
            declare(writer, part, known)
        for topic in known:
            counts[topic] = 0
        for part in parts:
            for topic, log_time, publish_time, data in in_order(part):
                writer.write(topic, data, log_time, publish_time)
                counts[topic] += 1
                times.append(log_time)
        writer.close({'recovered_from': source.name})
    return Recovered(counts, min(times), max(times), lost, wrong)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('recover', __doc__.split('\n\n')[0])
    out.add_argument('bag', type=Path, help='rosbag2 directory or .mcap file; not changed')
    out.add_output('NEW_BAG', 'bag to create', required=True, positional=True)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``recover``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('recover', lambda: print(recover(options.bag, options.output)))


if __name__ == '__main__':
    raise SystemExit(main())
