"""
A flight with compiled code of a user, whose steps may never end.

Compiled code cannot be interrupted by a signal or by a thread of Python. Such a flight is flown
in a copy of this process, which writes into memory that both share. If it stops advancing, the
copy is killed, and the rows flown until then remain. Other flights are flown in this process.
"""

from __future__ import annotations

from collections.abc import Callable
import mmap
import os
import pickle
import select
import signal
import threading
import time
from typing import Any
import warnings

from mambo_model import slots
from mambo_model.components import Component, own_components, where
from mambo_model.errors import JobError
import numpy as np

from . import closed_loop
from .closed_loop import Recording
from .scenario import Scenario

HUNG = 10.0    # s of wall time in compiled code without a new step
_LOOK = 0.05   # s between two checks of the copy
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
    own = [c for c in own_components(flight) if c.compiled]
    if not own:
        return closed_loop.fly(flight, inner), slots.latest_fault()
    out = _each(closed_loop.blank(flight, inner), _shared)
    out.reason.fill(_NEVER)
    closed_loop.run(flight, _each(out, lambda column: column[:0]))  # compile before the fork
    fault = _watched(flight, out)
    if fault is not None:
        return out, fault
    rows = int(np.argmax(out.reason == _NEVER))
    text = _describe(own, rows)
    if not rows:
        raise JobError(text)
    return _each(out, lambda column: column[:rows]), text


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


def _watched(flight: Scenario, out: Recording) -> str | None:
    """Fly in a copy of this process; return the fault of a component, None if a step hangs."""
    beat = _shared(np.zeros(1, dtype=np.int64))
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', DeprecationWarning)  # the copy needs no other thread
        copy = os.fork()
    if not copy:
        _run_in_copy(flight, out, beat, write)
    os.close(write)
    ended = False
    try:
        with open(read, 'rb') as pipe:
            seen, since = (0, 0), time.monotonic()
            while not select.select([pipe], [], [], _LOOK)[0]:
                at = (int(np.argmax(out.reason == _NEVER)), int(beat[0]))
                if at != seen:
                    seen, since = at, time.monotonic()
                elif time.monotonic() - since > HUNG:
                    return None
            data = pipe.read()
        ended = True
    finally:
        if not ended:
            os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
    result = pickle.loads(data) if data else JobError('the process of the flight was killed')
    if isinstance(result, BaseException):
        raise result
    return result


def _run_in_copy(flight: Scenario, out: Recording, beat: np.ndarray, write: int) -> None:
    """Fly, send the fault or the error, and exit at once, without Python's clean-up."""
    def live() -> None:
        """Count while Python runs: compiling and slow Python code do not count as hanging."""
        while True:
            beat[0] += 1
            time.sleep(_LOOK)
    result: Any = ''
    try:
        threading.Thread(target=live, daemon=True).start()
        closed_loop.run(flight, out)
        result = slots.latest_fault()
    except BaseException as error:
        result = error
    finally:
        try:
            os.write(write, pickle.dumps(result))
        finally:
            os._exit(0)
