"""
A flight with compiled code of a user, whose steps may never end.

Compiled code cannot be interrupted by a signal or by a thread of Python. Such a flight is flown
in a copy of this process, which writes into memory that both share. If it stops advancing, the
copy is killed, and the rows flown until then remain. Other flights are flown in this process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import mmap
import os
import pickle
import select
import signal
import struct
import threading
import time
from typing import Any
import warnings

from mambo_model import slots
from mambo_model.components import Component, own_components, where
from mambo_model.errors import JobError
from mambo_model.motion.vector import Vec3
from mambo_sim.world import WorldParams
import numpy as np

from . import closed_loop
from .closed_loop import Recording
from .scenario import Scenario
from .world import together
from .world.together import Together

HUNG = 10.0    # s of wall time in compiled code without a new step
_LOOK = 0.05   # s between two checks of the copy
_HEAD = struct.Struct('<q')  # length of each result of a copy in bytes
_NEVER = -1    # marks a row that has not been flown


def fly(flight: Scenario, inner: bool = False) -> tuple[Recording, str]:
    """
    Fly a scenario as :func:`closed_loop.fly`, and end it if compiled code of the user hangs.

    Returns
    -------
    recording
        All steps, or those before the one that did not end.
    fault
        Fault of a component of the user, one line with file and line; empty: no fault.

    Raises
    ------
    JobError
        If the first step does not end: nothing was flown.

    """
    slots.latest_fault()  # forget faults of earlier flights
    own = own_compiled(flight)
    if not own:
        with _staying():
            return closed_loop.fly(flight, inner), slots.latest_fault()
    out = _each(closed_loop.blank(flight, inner), _shared)
    out.reason.fill(_NEVER)
    closed_loop.run(flight, _each(out, lambda column: column[:0]))  # compile before the fork

    def work(give: Callable[[str], None]) -> None:
        closed_loop.run(flight, out)
        give(slots.latest_fault())
    given, ended = in_copy(work, lambda: _rows(out))
    if ended:
        return out, given[0]
    rows = _rows(out)
    text = _describe(own, rows)
    if not rows:
        raise JobError(text)
    return _each(out, lambda column: column[:rows]), text


def fly_together(
    flights: Sequence[Scenario], params: WorldParams, places: Sequence[Vec3],
) -> tuple[Together, str]:
    """
    Fly several drones as :func:`together.fly`, and end them if compiled code of the user hangs.

    Returns
    -------
    result
        All steps, or those that every drone flew before the one that did not end. Of a flight
        that was ended collisions and the exchange of names in the motion capture are not known.
    fault
        As of :func:`fly`.

    Raises
    ------
    JobError
        If the first step does not end: nothing was flown.

    """
    slots.latest_fault()  # forget faults of earlier flights
    own = list(dict.fromkeys(one for flight in flights for one in own_compiled(flight)))
    if not own:
        with _staying():
            return together.fly(flights, params, places), slots.latest_fault()
    out = [_each(closed_loop.blank(flight, inner=True), _shared) for flight in flights]
    for one in out:
        one.reason.fill(_NEVER)

    def flown() -> int:
        return min(_rows(one) for one in out)

    def work(give: Callable[[Any], None]) -> None:
        result = together.fly(flights, params, places, out)
        give((result.collisions, result.exchanges, slots.latest_fault()))
    given, ended = in_copy(work, flown)
    if ended:
        collisions, exchanges, fault = given[0]
        return Together(out, collisions, exchanges), fault
    rows = flown()
    text = _describe(own, rows)
    if not rows:
        raise JobError(text)
    return Together([_each(one, lambda column: column[:rows]) for one in out], [], []), text


def _rows(recording: Recording) -> int:
    """Return how many rows of a recording have been flown."""
    never = recording.reason == _NEVER
    return int(np.argmax(never)) if never.any() else len(never)


@contextlib.contextmanager
def _staying() -> Iterator[None]:
    """Be where one was afterwards, whatever code of the user does: outputs have relative paths."""
    here = os.open(os.curdir, os.O_PATH | os.O_DIRECTORY)
    try:
        yield
    finally:
        os.fchdir(here)
        os.close(here)


def own_compiled(flight: Scenario) -> list[Component]:
    """Return the user's components of a flight whose steps cannot be interrupted."""
    return [component for component in own_components(flight) if component.compiled]


def _describe(own: list[Component], rows: int) -> str:
    """Return the message for a step that did not end."""
    places = ' or '.join(where(c.path, c.step) for c in own)
    return (f'{places}: the compiled step at t = {rows * closed_loop.STEP_NS * 1e-9:.3f} s did '
            f'not end within {HUNG:g} s')


def _each(recording: Recording, change: Callable[[np.ndarray], np.ndarray]) -> Recording:
    """Return a recording with every array changed."""
    def changed(part: Any) -> Any:
        if part is None:
            return None
        return type(part)(*map(change, part)) if isinstance(part, tuple) else change(part)
    return Recording(*map(changed, recording))


def _shared(column: np.ndarray) -> np.ndarray:
    """Return an array of the same content in memory that copies of this process share."""
    memory = mmap.mmap(-1, max(column.nbytes, 1))
    out = np.frombuffer(memory, dtype=column.dtype, count=column.size).reshape(column.shape)
    out[...] = column
    return out


def in_copy(
    work: Callable[[Callable[[Any], None]], None], progress: Callable[[], Any] = lambda: None,
) -> tuple[list[Any], bool]:
    """
    Do work in a copy of this process that is killed if it stops advancing.

    Parameters
    ----------
    work
        Called in the copy with a function that sends one result to this process.
    progress
        Returns a value that changes while the work advances. Results and Python code that runs
        count as progress too.

    Returns
    -------
    results
        In the order in which they were sent.
    ended
        Whether the work ended; False: it did not advance for :data:`HUNG` and was killed.

    Raises
    ------
    BaseException
        The exception that the work raised; JobError if the copy was killed from outside.

    """
    beat = _shared(np.zeros(1, dtype=np.int64))
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', DeprecationWarning)  # the copy needs no other thread
        copy = os.fork()
    if not copy:
        _run_in_copy(work, beat, write)
    os.close(write)
    over = False
    try:
        with open(read, 'rb', buffering=0) as pipe:
            results, over = _collected(pipe, lambda: (progress(), int(beat[0])))
    finally:
        if not over:
            os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
    return results, over


def _collected(pipe: Any, progress: Callable[[], Any]) -> tuple[list[Any], bool]:
    """Return the results of a copy, and whether it ended."""
    results: list[Any] = []
    data, seen, since = b'', None, time.monotonic()
    while True:
        if select.select([pipe], [], [], _LOOK)[0]:
            part = pipe.read(1 << 16)
            if not part:
                raise JobError('the process of the flight was killed')
            data += part
        while len(data) >= _HEAD.size and len(data) >= (
                end := _HEAD.size + _HEAD.unpack_from(data)[0]):
            kind, value = pickle.loads(data[_HEAD.size:end])
            if kind == 'raised':
                raise value
            if kind == 'ended':
                return results, True
            results.append(value)
            data = data[end:]
        at = (progress(), len(results))
        if at != seen:
            seen, since = at, time.monotonic()
        elif time.monotonic() - since > HUNG:
            return results, False


def _run_in_copy(
    work: Callable[[Callable[[Any], None]], None], beat: np.ndarray, write: int,
) -> None:
    """Do the work, send its results or its error, and exit without Python's clean-up."""
    def live() -> None:
        """Count while Python runs: compiling and slow Python code do not count as hanging."""
        while True:
            beat[0] += 1
            time.sleep(_LOOK)

    def give(kind: str, value: Any) -> None:
        data = pickle.dumps((kind, value))
        pipe.write(_HEAD.pack(len(data)) + data)
    pipe = open(write, 'wb', buffering=0)
    try:
        threading.Thread(target=live, daemon=True).start()
        work(lambda value: give('result', value))
        give('ended', None)
    except BaseException as error:
        give('raised', error)
    finally:
        os._exit(0)
