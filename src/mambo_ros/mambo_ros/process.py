"""A process of the graph: its entry point, its signals and its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
import gc
import os
from pathlib import Path
import resource
import signal
import sys
import time
import traceback
from types import FrameType
from typing import Any, NoReturn

from mambo_model.schema import ParameterError
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.signals import SignalHandlerOptions

from . import leaving, usage
from .loop import Loop
from .node import FLUSH, MamboNode

_TEARDOWN = 1.0  # s that the middleware has to say goodbye; it has been seen to hang there
_PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'  # of the user, or ours
_REFUSALS = (ParameterError, FileNotFoundError, FileExistsError, _rclpy.RCLError,
             _rclpy.UnknownROSArgsError)


def _line(error: BaseException) -> str:
    """Return what an error says as one line, without places in the sources of ROS."""
    text = ' '.join(str(error).split(', at /')[0].split())
    if isinstance(error, _rclpy.UnknownROSArgsError):  # whose text is the list of them
        return f'unknown arguments after --ros-args: {text}'
    return text


def _say(text: str) -> None:
    """Print a line, if anybody takes it: a closed or full output must not cost a bag its end."""
    with suppress(OSError):
        print(text, flush=True)


def main(node_type: type[MamboNode], args: list[str] | None = None,
         run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """Run one node as a process, as :func:`compose`: entry point of every ``*_node``."""
    compose((node_type,), args, run)


def compose(node_types: Sequence[type[MamboNode]], args: list[str] | None = None,
            run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """
    Run nodes as one process.

    ``--help`` prints what they are and returns. SIGINT, SIGTERM and SIGHUP let the nodes take
    what has arrived, finish and leave; a second one lets them leave the rest. A wrong parameter
    or parameter file ends them with one line and exit code 2. The process leaves as soon as it
    has finished and flushed, even where the middleware hangs in its teardown.

    Parameters
    ----------
    node_types
        Classes of the nodes.
    args
        Command line, default ``sys.argv``.
    run
        What to do with the last node and the loop; returns the exit code. Default: serve
        messages.

    """
    if usage.asked(sys.argv[1:] if args is None else args):
        _say(_help(node_types))
        return
    loop: Loop | None = None
    stopped = ''
    starting = True
    nodes: list[MamboNode] = []

    def stop(number: int, where: FrameType | None) -> None:
        """Ask the loop to stop; at a second signal, or before there is a loop, at once."""
        nonlocal stopped
        again, stopped = bool(stopped), stopped or signal.Signals(number).name
        if loop is not None:
            loop.urgent = again
            loop.stop()
        elif starting and not again and where is not None and where.f_code is not compose.__code__:
            raise KeyboardInterrupt  # not between a node and its place in the list: it has a bag

    code = 0
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup
                signal.signal(number, stop)
        os.environ.setdefault(_PROFILES, str(Path(__file__).with_name('fastdds.xml')))
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        for node_type in node_types:
            if not stopped:
                nodes.append(node_type())
        if not stopped:
            loop = Loop(*nodes)
    except BaseException as error:  # stopped while numerics compile, the compiler raises anything
        starting = False
        if not stopped:
            code = _refuse(error, node_types[min(len(nodes), len(node_types) - 1)])
    starting = False
    try:
        if loop is None:
            _finish(nodes, stopped)
        else:
            code = _serve(nodes, loop, run, lambda: stopped) or 0
    except SystemExit as end:  # a node has said why
        code = end.code
    except BaseException:  # an error of a node, whose process leaves like any other
        _complain()
        code = 1
    _leave(nodes, code, loop)


def _complain() -> None:
    """Print the error at hand with its place, if anybody takes it."""
    with suppress(OSError):
        traceback.print_exc()


def _refuse(error: BaseException, node_type: type[MamboNode]) -> int:
    """Say why a node does not start; return the exit code."""
    if not isinstance(error, _REFUSALS):
        _complain()
        return 1
    with suppress(OSError):
        print(f'{node_type.__name__}: {_line(error)}', file=sys.stderr)
    return 2


def _help(node_types: Sequence[type[MamboNode]]) -> str:
    """Return the help of this process, by the path of its executable if it has several nodes."""
    package, *_, executable = node_types[0].__module__.split('.')
    if len(node_types) > 1:
        package, executable = Path(sys.argv[0]).parts[-2:]
    return usage.text(node_types, package, executable)


def _leave(nodes: Sequence[MamboNode], code: int, loop: Loop | None = None) -> NoReturn:
    """End the process; the middleware says goodbye to the graph if it does so in time."""
    with suppress(OSError):  # a system without a timer to give
        leaving.exit_after(_TEARDOWN, code)
    try:
        sys.stdout.flush()
        sys.stderr.flush()
        if loop is not None:
            loop.close()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    finally:  # nor through what the middleware does when an interpreter ends
        os._exit(code)


def _finish(nodes: Sequence[MamboNode], stopped: str) -> None:
    """Say what signal ended a process, if one did; let every node finish, whatever others do."""
    if stopped:
        _say(f'ended by {stopped}')
    with ExitStack() as stack:  # a bag is closed before anything that may hang
        for node in reversed(nodes):
            stack.callback(node.finish)


def _serve(nodes: list[MamboNode], loop: Loop,
           run: Callable[[Any, Loop], int | None] | None,
           stopped: Callable[[], str]) -> int | None:
    """Run nodes to their end in order, say what that took and by what; return the exit code."""
    code: int | None = 0
    before = time.process_time()  # with the threads of the middleware
    gc.freeze()  # what is loaded stays: the collector need not look at it while time runs
    if stopped():
        loop.stop()
    try:
        if run is None:
            loop.run()
        else:
            code = run(nodes[-1], loop)
        if any(node.fault for node in nodes):
            code = 1
        if len(nodes) > 1:
            loop.drain()
    finally:
        _finish(nodes, stopped())
        limit = time.monotonic() + FLUSH
        for node in nodes:
            node.flush(limit - time.monotonic())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        _say(f'used {time.process_time() - before:.2f} s of CPU and {memory} MB')
    return code
