"""What the command line tools share: errors become one line and an exit code."""

from __future__ import annotations

from collections.abc import Callable
import os
import sys
from typing import Any, TextIO

from mambo_model.schema import ParameterError

from .mcap_reader import BagError
from .message_definition import DefinitionError
from .writer import BagWriterError

_LONGEST = 2000  # characters of an error, so that a name of a megabyte does not fill the screen


class _OutputError(Exception):
    """Standard output does not take what is written to it."""


class _Output:
    """Standard output whose failure is told from that of a file."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write; _OutputError if that is not taken."""
        try:
            return self._stream.write(text)
        except OSError as error:
            raise _OutputError(error) from None

    def flush(self) -> None:
        """Flush, likewise."""
        try:
            self._stream.flush()
        except OSError as error:
            raise _OutputError(error) from None


def guard(name: str, work: Callable[[], None], *expected: type[Exception]) -> int:
    """
    Run a tool; return its exit code: 0, or 1 behind one line on stderr that begins with its name.

    The errors of bags and parameters become that line, and those ``expected`` besides; what the
    disk or the memory refuses, too, and an output that is closed or full. Wrong usage ends in
    argparse, with exit code 2.
    """
    if sys.stdout is None:
        return _complain(name, 'the output is closed: send it to /dev/null to do without')
    plain = sys.stdout
    sys.stdout = _Output(plain)
    try:
        work()
        sys.stdout.flush()
    except _OutputError as error:
        return _lost_output(name, plain, error.args[0])
    except OSError as error:
        reason = error.strerror or str(error)
        return _complain(name, f'{error.filename}: {reason}' if error.filename else reason)
    except (BagError, BagWriterError, DefinitionError, ParameterError, *expected) as error:
        return _complain(name, str(error))
    except MemoryError:
        return _complain(name, 'the memory of this machine is too small for that')
    except RecursionError:
        return _complain(name, 'what is to be read is nested too deep')
    finally:
        sys.stdout = plain
    return 0


def _complain(name: str, text: str) -> int:
    """Write one line to stderr; return the exit code."""
    line = ' '.join(text.splitlines())
    if len(line) > _LONGEST:
        line = f'{line[:_LONGEST // 2]} ... {line[-_LONGEST // 2:]}'
    if sys.stderr is not None:
        print(f'{name}: {line}', file=sys.stderr)
    return 1


def _lost_output(name: str, stream: TextIO, error: OSError) -> int:
    """Drop what nobody takes, so that Python does not try again; return the exit code."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if isinstance(error, BrokenPipeError):  # the reader, such as head, has gone
        return 1
    return _complain(name, f'the output cannot be written: {error.strerror}')
