"""Worker processes that end with the process that started them, however that one ends."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import contextlib
import multiprocessing
from multiprocessing.connection import wait
import os
import signal
import time

from mambo_bags.cli.parent_end import end_with
from mambo_model.errors import JobError

_EXIT = 10.0  # s that workers may take to exit when their work is done
_WRITING = 2.0  # s that the thread of an executor may take to end after its workers


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

    After an error or Ctrl-C nobody takes the results of work under way, and it may never end: the
    workers are killed.

    Parameters
    ----------
    workers
        Number of processes.

    Raises
    ------
    mambo_model.errors.JobError
        If a worker is killed.

    """
    # workers inherit the blocked signals, as does the process that counts their semaphores: they
    # leave the end of a terminal to this process, and ignore Ctrl-C from their start
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        pool = ProcessPoolExecutor(
            workers, mp_context=multiprocessing.get_context('spawn'),
            initializer=_begin, initargs=(os.getpid(),))
        for _ in range(workers):
            pool.submit(_nothing)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    patience = _EXIT
    try:
        yield pool
    except BrokenProcessPool:
        raise JobError('a worker process was killed (out of memory?): start again, with fewer '
                       '--workers') from None
    except BaseException:
        patience = 0.0
        raise
    finally:
        _end(pool, patience)


def _end(pool: ProcessPoolExecutor, patience: float) -> None:
    """Let the workers exit, and kill those that take longer than a patience in s."""
    manager, queue = pool._executor_manager_thread, pool._call_queue
    sentinels = {process.sentinel: process for process in (pool._processes or {}).values()}
    pool.shutdown(wait=False, cancel_futures=True)
    until = time.monotonic() + patience
    while sentinels:
        gone = wait(sentinels, max(until - time.monotonic(), 0.0))
        for sentinel in gone:
            del sentinels[sentinel]
        if not gone:
            break
    for process in sentinels.values():
        process.kill()
    manager.join(_WRITING)
    if manager.is_alive():  # early Python 3.11 waits for ever to write to a killed worker
        queue._reader.close()
        manager.join()
