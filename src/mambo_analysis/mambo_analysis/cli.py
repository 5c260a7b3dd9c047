"""What the command line tools share: errors become one line and an exit code."""

from __future__ import annotations

from collections.abc import Callable
import os
import sys

from mambo_model.schema import ParameterError
from mambo_sim.bag_writer import BagWriterError
from mambo_sim.message_definition import DefinitionError

from .mcap_file import BagError


def guard(name: str, work: Callable[[], None], *expected: type[Exception]) -> int:
    """
    Run a tool; return its exit code: 0, or 1 behind one line on stderr that begins with its name.

    The errors of bags and parameters become that line, and those ``expected`` besides. Wrong
    usage ends in argparse, with exit code 2.
    """
    try:
        work()
        sys.stdout.flush()
    except (BagError, BagWriterError, DefinitionError, ParameterError, *expected) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader of our output, such as head, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0
