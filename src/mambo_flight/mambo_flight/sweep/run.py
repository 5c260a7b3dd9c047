"""Flights of a sweep on the cores of this machine, or on the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor, FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
import contextlib
import os
import time
from typing import Any, Protocol
import uuid

from mambo_model.components import own_components
from tqdm import tqdm

from ..scenario import Scenario
from ..worker_pool import worker_pool
from .guarded import fly, fly_packed, packed
from .table import batches, Journal, KEPT, SweepEndedError, SweepError

BATCH = 16  # largest number of flights in a batch for a worker
LOOK = 2.0  # [s] after which workers are looked for while nothing is finished
WORKERLESS = 30.0  # [s] without a worker that end a sweep
AHEAD = 3  # batches per worker that are flown or queued


class Numbered(Protocol):
    """A sequence of scenarios."""

    def __len__(self) -> int:
        """Return the number of scenarios."""

    def __getitem__(self, number: int) -> Scenario:
        """Return one scenario."""


@contextlib.contextmanager
def _processes(workers: int) -> Iterator[tuple[Executor, int, Callable[[], bool]]]:
    """Provide an executor of processes, their number, and whether there are any."""
    with worker_pool(workers) as pool:
        yield pool, workers, lambda: True


@contextlib.contextmanager
def _dask(address: str) -> Iterator[tuple[Executor, int, Callable[[], bool]]]:
    """Provide the executor of a Dask scheduler, the number of its threads, and if it has any."""
    try:
        from distributed import Client
    except ImportError:
        raise SweepError(
            '--dask needs Dask: pip install -r requirements/dask.txt') from None
    try:
        client = Client(address, timeout='10s', set_as_default=False)
    except (OSError, ValueError) as error:
        raise SweepError(f'--dask {address}: no scheduler answers: {error}') from None
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise SweepError(f'--dask {address}: the scheduler has no workers')
        yield client.get_executor(pure=False), workers, lambda: bool(client.nthreads())


def run(
    flights: Numbered, journal: Journal, ideal: bool, workers: int | None = None,
    dask: str | None = None,
) -> None:
    """
    Fly the flights that the journal does not have yet, and add them to it.

    Parameters
    ----------
    flights
        Scenarios by number, built when requested.
    journal
        Gets each row as it is finished.
    ideal
        Whether to fly without sensors.
    workers
        Processes on this machine; None: one for each core.
    dask
        Address of a scheduler whose workers fly instead, such as tcp://host:8786.

    Raises
    ------
    SweepError, SweepEndedError
        If a worker fails; finished flights are in the journal.

    """
    left = [number for number in range(len(flights)) if number not in journal.rows]
    with tqdm(total=len(flights), initial=len(journal.rows), unit='flight',
              desc='sweep', disable=None, leave=False) as bar:
        def keep(numbers: Sequence[int], rows: list[dict[str, Any]]) -> None:
            for number, row in zip(numbers, rows, strict=True):
                journal.add(number, row)
            bar.update(len(rows))

        if not dask and left:  # compile once, before the workers start
            keep(left[:1], fly([flights[left[0]]], ideal))
            left = left[1:]
        workers = min(workers or len(os.sched_getaffinity(0)), max(len(left), 1))
        if not dask and workers == 1:
            for number in left:
                keep([number], fly([flights[number]], ideal))
        elif left:
            with _dask(dask) if dask else _processes(workers) as (executor, count, alive):
                _spread(flights, left, ideal, executor, count, keep, alive)


def _next_done(under_way: Collection[Future], alive: Callable[[], bool]) -> set[Future]:
    """Return futures that are done, when there is one; SweepEndedError without a worker."""
    since = time.monotonic()
    while not (done := wait(under_way, LOOK, return_when=FIRST_COMPLETED).done):
        if alive():
            since = time.monotonic()
        elif time.monotonic() - since > WORKERLESS:
            raise SweepEndedError(
                f'the scheduler has had no worker for {WORKERLESS:g} s; {KEPT}')
    return done


def _spread(flights: Numbered, left: Sequence[int], ideal: bool, executor: Executor, count: int,
            keep: Any, alive: Callable[[], bool]) -> None:
    """Fly the numbers ``left`` on an executor, with at most AHEAD batches per worker."""
    size = max(1, min(BATCH, len(left) // (4 * count)))
    todo, under_way, sweep = batches(left, size), {}, uuid.uuid4().hex
    try:
        while True:
            while len(under_way) < AHEAD * count and (numbers := next(todo, None)):
                scenarios = [flights[number] for number in numbers]
                try:
                    future = executor.submit(fly_packed, sweep, packed(scenarios), ideal)
                except BrokenProcessPool as error:  # a worker was killed since the last result
                    raise _ended(error, scenarios) from None
                under_way[future] = (numbers, scenarios)
            if not under_way:
                return
            for future in _next_done(under_way, alive):
                numbers, scenarios = under_way.pop(future)
                keep(numbers, _result(future, scenarios))
    finally:
        for future in under_way:
            future.cancel()


def _result(future: Future, flights: Sequence[Scenario]) -> list[dict[str, Any]]:
    """Return the rows of a batch of flights; raise SweepEndedError if there are none."""
    try:
        return future.result()
    except Exception as error:  # a remote worker may raise anything
        raise _ended(error, flights) from None


def _ended(error: Exception, flights: Sequence[Scenario]) -> SweepEndedError:
    """Return what ends a sweep whose batch of flights ended in an error."""
    if not (isinstance(error, BrokenProcessPool) or type(error).__name__ == 'KilledWorker'):
        text = ' '.join(f'{type(error).__name__}: {error}'.split())
        return SweepEndedError(f'a worker failed: {text}; {KEPT}')
    own = sorted({str(part.path) for flight in flights for part in own_components(flight)})
    cause = f', perhaps by code of {" or ".join(own)}' if own else ''
    return SweepEndedError(f'a worker was killed{cause}; {KEPT}')
