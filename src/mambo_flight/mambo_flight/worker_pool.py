"""Worker processes that end with the process that started them, however that one ends."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import contextlib
import multiprocessing
import os
import signal

from mambo_bags.cli.parent_end import end_with
from mambo_model.errors import JobError


def _nothing() -> None:
    """Do nothing; submitted to start a worker."""


def _begin(parent: int) -> None:
    """Let this worker ignore Ctrl-C, which its parent handles, and end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent)


@contextlib.contextmanager
def worker_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """
    Provide an executor whose workers are running; at its end, work not begun is cancelled.

    Parameters
    ----------
    workers
        Number of processes.

    Raises
    ------
    mambo_model.errors.JobError
        If a worker is killed.

    """
    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context('spawn'),
        initializer=_begin, initargs=(os.getpid(),))
    # a worker inherits the blocked signals and ignores Ctrl-C from its start
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        for _ in range(workers):
            pool.submit(_nothing)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield pool
    except BrokenProcessPool:
        raise JobError('a worker process was killed (out of memory?): start again, with fewer '
                       '--workers') from None
    finally:
        if pool._broken:  # early Python 3.11 waits for ever to write to a killed worker
            pool._call_queue._reader.close()
        pool.shutdown(wait=True, cancel_futures=True)
