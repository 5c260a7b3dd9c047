"""A process of the graph: entry point, signal handling and shutdown."""

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
from types import FrameType
from typing import Any, NoReturn

import rclpy

from . import usage
from .graph import exit_timer, loopback, start_failure
from .graph.ending_signals import ending
from .loop import Loop
from .node import FLUSH, MamboNode

_TEARDOWN = 1.0  # s for the middleware to shut down, which may hang


def _print_line(text: str) -> None:
    """Print a line; ignore a closed or full output, so that a bag is still finished."""
    with suppress(OSError):
        print(text, flush=True)


def main(node_type: type[MamboNode], args: list[str] | None = None,
         run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """Run one node as a process, like :func:`compose`; the entry point of every ``*_node``."""
    compose((node_type,), args, run)


def compose(node_types: Sequence[type[MamboNode]], args: list[str] | None = None,
            run: Callable[[Any, Loop], int | None] | None = None) -> None:
    """
    Run nodes as one process.

    ``--help`` prints their help and returns. After SIGINT, SIGTERM or SIGHUP the nodes handle the
    messages that have arrived, finish and exit; after a second signal they skip those messages. A
    wrong parameter or parameter file ends them with one line and exit code 2. The process exits as
    soon as it has finished and flushed, even if the middleware hangs while it shuts down.

    Parameters
    ----------
    node_types
        Classes of the nodes, or partial ones with arguments of the node.
    args
        Command line, default ``sys.argv``.
    run
        What to do with the last node and the loop; returns the exit code. Default: serve.

    """
    if usage.asked(sys.argv[1:] if args is None else args):
        _print_line(_help(node_types))
        return
    loop: Loop | None = None
    stopped = ''
    starting = True
    nodes: list[MamboNode] = []

    def stop(number: int, where: FrameType | None) -> None:
        """Ask the loop to stop; stop at once after a second signal, or before there is a loop."""
        nonlocal stopped
        again, stopped = bool(stopped), stopped or signal.Signals(number).name
        if loop is not None:
            loop.urgent = again
            loop.stop()
        elif starting and not again and where is not None and where.f_code is not compose.__code__:
            # not before a new node is in the list: it may have an open bag
            raise KeyboardInterrupt

    code = 0
    try:
        for number in ending():
            signal.signal(number, stop)
        loopback.check()
        loopback.configure()
        start_failure.init(args)
        for node_type in node_types:
            if not stopped:
                nodes.append(node_type())
        if not stopped:
            loop = Loop(*nodes)
    except BaseException as error:  # a signal during compilation can raise any error
        starting = False
        if not stopped:
            code = start_failure.report(error, node_types[min(len(nodes), len(node_types) - 1)])
    starting = False
    try:
        if loop is None:
            _finish(nodes, stopped)
        else:
            code = _serve(nodes, loop, run, lambda: stopped) or 0
    except SystemExit as end:  # the node has logged the reason
        code = end.code
    except BaseException:  # an error in a node; its process still exits in order
        start_failure.print_traceback()
        code = 1
    _exit(nodes, code, loop)


def _help(node_types: Sequence[type[MamboNode]]) -> str:
    """Return the help of this process, named after its executable if it has several nodes."""
    package, *_, executable = node_types[0].__module__.split('.')
    if len(node_types) > 1:
        package, executable = Path(sys.argv[0]).parts[-2:]
    return usage.text(node_types, package, executable)


def _exit(nodes: Sequence[MamboNode], code: int, loop: Loop | None = None) -> NoReturn:
    """Shut the middleware down, within a time limit, and end the process."""
    with suppress(OSError):  # the system provides no timer
        exit_timer.exit_after(_TEARDOWN, code)
    try:
        sys.stdout.flush()
        sys.stderr.flush()
        if loop is not None:
            loop.close()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    finally:  # skip the exit handlers, in which the middleware may hang
        os._exit(code)


def _finish(nodes: Sequence[MamboNode], stopped: str) -> None:
    """Print the signal that ended the process, if any; finish all nodes, even if one fails."""
    if stopped:
        _print_line(f'ended by {stopped}')
    with ExitStack() as stack:  # bags are closed before anything that may hang
        for node in reversed(nodes):
            stack.callback(node.finish)


def _serve(nodes: list[MamboNode], loop: Loop,
           run: Callable[[Any, Loop], int | None] | None,
           stopped: Callable[[], str]) -> int | None:
    """Run nodes to their end, print the CPU time and memory used; return the exit code."""
    code: int | None = 0
    before = time.process_time()  # includes the threads of the middleware
    gc.freeze()  # loaded objects stay: the garbage collector can skip them
    if stopped():
        loop.stop()
    try:
        if run is None:
            loop.run()
        else:
            code = run(nodes[-1], loop)
        if len(nodes) > 1:
            loop.drain()
    finally:
        _finish(nodes, stopped())
        if any(node.fault for node in nodes):
            code = 1
        limit = time.monotonic() + FLUSH
        for node in nodes:
            node.flush(limit - time.monotonic())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        _print_line(f'used {time.process_time() - before:.2f} s of CPU and {memory} MB')
    return code
