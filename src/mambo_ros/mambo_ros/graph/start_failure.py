"""Start ROS for a node, and say in one line why a node does not start."""

from __future__ import annotations

from contextlib import suppress
import errno
import os
from pathlib import Path
import sys
import traceback
from typing import TYPE_CHECKING

from mambo_model.errors import InputError, JobError, MamboError
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

if TYPE_CHECKING:
    from ..node import MamboNode

_REFUSALS = (MamboError, FileNotFoundError, FileExistsError, ParameterException,
             _rclpy.RCLError, _rclpy.UnknownROSArgsError)

KEY = b'ros__parameters'
_LARGEST = 10_000_000  # bytes of a parameter file that are looked at


def _line(error: BaseException) -> str:
    """Return the message of an error as one line, without locations in the sources of ROS."""
    text = ' '.join(str(error).split(', at /')[0].split())
    if isinstance(error, _rclpy.UnknownROSArgsError):  # its text is the list of arguments
        return f'unknown arguments after --ros-args: {text}'
    return text


def _refuse_without_parameters(args: list[str]) -> None:
    """Raise InputError for a parameter file without any, which ROS takes without a word."""
    for flag, path in zip(args, args[1:]):
        if flag == '--params-file':
            with suppress(OSError), open(path, 'rb') as file:  # ROS says what cannot be read
                if KEY not in file.read(_LARGEST):
                    raise InputError(f'{path}: no parameters in it: a section NODE: '
                                     f'{KEY.decode()}: is needed')


def _refuse_other(words: list[str]) -> None:
    """Raise InputError for arguments that are not of ROS, which a node has no use for."""
    if other := remove_ros_args(words):
        raise InputError(f'{other[0][:80]!r} is no argument of a node: it takes those of ROS, '
                         'behind --ros-args; --help lists its parameters')


def init(args: list[str] | None) -> None:
    """
    Start ROS.

    Raises
    ------
    InputError
        For arguments of no use.
    JobError
        If ROS cannot write its log, or gets no thread.

    """
    words = sys.argv if args is None else args
    words = words[1:] if words[:1] == sys.argv[:1] else words  # without the program
    _refuse_without_parameters(words)
    _refuse_other(words)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        text = _line(error)
        logs = 'initialize logging' in text or 'Failed opening file' in text
        if isinstance(error, _REFUSALS) and not logs:
            raise
        hint = ': set ROS_LOG_DIR to a folder that can be written' if logs else ''
        raise JobError(f'ROS cannot start: {text}{hint}') from None


def print_traceback() -> None:
    """Print the traceback of the current error; ignore a closed output."""
    with suppress(OSError):
        traceback.print_exc()


def report(error: BaseException, node_type: type[MamboNode]) -> int:
    """Print why a node does not start; return the exit code."""
    lacks = isinstance(error, (MemoryError, OSError)) or (  # something the machine is out of
        isinstance(error, RuntimeError) and os.strerror(errno.EAGAIN) in str(error))
    if not lacks and not isinstance(error, _REFUSALS):
        print_traceback()
        return 1
    made = getattr(node_type, 'func', node_type)  # a class with some of its arguments
    name = made.__module__.rpartition('.')[2].replace('__main__', Path(sys.argv[0]).stem)
    with suppress(OSError):
        print(f'{name}: {_line(error) or "out of memory"}', file=sys.stderr)
    return getattr(error, 'exit_code', 2 if isinstance(error, _REFUSALS) else 1)
