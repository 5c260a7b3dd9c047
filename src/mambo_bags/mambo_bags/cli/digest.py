"""
Tell whether two bags hold the same messages: ``digest BAG...``.

Prints the SHA-256 of topics, types, log times and bytes of all messages; where they differ, the
exit code is 1. Files of equal messages
can differ, as versions of the compression library write them differently.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from mambo_model.errors import JobError

from ..command import guard, Parser
from ..reader import Bag, read_bag


def digest(bag: Bag) -> str:
    """
    Return the SHA-256 of all messages of a bag, 64 hexadecimal digits.

    Topics count in the order of their names and messages in the order of their log times, so
    that the bag of a graph and that of the closed loop in one process have the same.

    Raises
    ------
    BagError
        If a message cannot be read.

    """
    whole = hashlib.sha256()
    for topic in sorted(topic for topic in bag.topics if topic in bag):
        messages = bag[topic]
        part = hashlib.sha256(f'{topic} {messages.type_name} {len(messages)}'.encode())
        part.update(messages.log_time.astype('<i8').tobytes())
        for data in messages.raw:
            part.update(len(data).to_bytes(8, 'little') + data)
        whole.update(part.digest())
    return whole.hexdigest()


def parser() -> Parser:
    """Return the command line."""
    out = Parser('digest', __doc__.split('\n\n')[1].replace('\n', ' '))
    out.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                     help='rosbag2 directory or .mcap file')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``digest``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        """Print the digest of each bag; JobError if one holds other messages than the first."""
        found = []
        for path in options.bags:
            found.append(digest(read_bag(path)))
            print(f'{found[-1]}  {path}', flush=True)
        for path, one in zip(options.bags, found):
            if one != found[0]:
                raise JobError(f'{path} holds other messages than {options.bags[0]}')
    return guard('digest', work)


if __name__ == '__main__':
    raise SystemExit(main())
