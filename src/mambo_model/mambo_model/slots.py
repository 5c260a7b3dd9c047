"""
Slots that let compiled code call a user's component, and that keep its faults.

A compiled component becomes part of the compiled loop. A component in plain Python is called by
the loop: the loop holds the number of a slot, and memory and parameters stay in Python. A
component that raises an error or returns an unusable result is not called again. Its slot keeps
a one-line fault with file and line.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
import dataclasses
import itertools
from pathlib import Path
import re
import signal
from typing import Any, NamedTuple

from .compiled import NumbaError, typeof
from .components import Component, where
from .errors import InputError
from .own_file import describe, fault_place, OverdueError, time_limit
from .schema import ParameterError, shown
from .script import python
from .values import values

LONGEST_STEP = 2.0   # s of wall time for one step of a component in Python
LONGEST_TRIAL = 300.0  # s, for the first one, which may compile
_COLOUR = re.compile(r'\x1b\[\d*m')  # of a compiler that takes every output for a terminal
_KEPT = 64  # slots, of the last flights of this process
_SLOTS: OrderedDict[int, Slot] = OrderedDict()
_NUMBERS = itertools.count()
_NUMBER = {float: 'a number', int: 'a whole number', bool: 'True or False'}


class UnusableError(InputError):
    """A component returned an unusable result; the message says why."""


class PlainValues(NamedTuple):
    """Stands in compiled code for parameters that stay in Python."""

    slot: int  # that holds them


class PlainMemory(NamedTuple):
    """Stands in compiled code for a memory that stays in Python."""

    slot: int  # that holds it


@dataclasses.dataclass
class Slot:
    """
    One component in one flight.

    Attributes
    ----------
    component, values
        The component and the values of its parameters.
    memory
        Its memory, if it runs in Python.
    fault
        Its fault in one line with file and line; empty: none.

    """

    component: Component
    values: Any
    memory: Any = None
    fault: str = ''


def open_slot(component: Component, values: Any) -> int:
    """Open a new slot and return its number."""
    number = next(_NUMBERS)
    _SLOTS[number] = Slot(component, values)
    while len(_SLOTS) > _KEPT:
        _SLOTS.popitem(last=False)
    return number


def fault(number: int) -> str:
    """Return the fault of the component of a slot in one line; empty: none."""
    return _SLOTS[number].fault


def latest_fault() -> str:
    """Return the first fault among the kept slots, or '', and clear the faults of all slots."""
    found = next((slot.fault for slot in _SLOTS.values() if slot.fault), '')
    for slot in _SLOTS.values():
        slot.fault = ''
    return found


def begin(number: int) -> None:
    """Start the memory of a component in Python."""
    slot = _SLOTS[number]
    if not slot.fault:
        _guarded(slot, lambda: setattr(slot, 'memory', slot.component.initial(slot.values)))


def call(memory: int, values: int, arguments: tuple, read: Callable[[Any], Any]) -> Any:
    """
    Run one step of a component in Python; return its result, or None after a fault.

    Parameters
    ----------
    memory, values
        Slots that hold the memory and the values.
    arguments
        Arguments of the step after the memory; None stands for the values.
    read
        Converts the result for compiled code; raises UnusableError if it is unusable.

    """
    slot, holder = _SLOTS[values], _SLOTS[memory]
    if slot.fault or holder.fault:
        return None
    given = tuple(slot.values if x is None else x for x in arguments)

    def step() -> Any:
        after, answer = _pair(slot.component.step(holder.memory, *given))
        out = read(answer)
        holder.memory = after
        return out
    return _guarded(slot, step)


def report(number: int, memory: Any, arguments: tuple, read: Callable[[Any], Any]) -> None:
    """Find the fault of a compiled step by repeating it in Python with the same arguments."""
    slot = _SLOTS[number]
    if slot.fault:
        return
    given = tuple(slot.values if x is None else x for x in arguments)
    _guarded(slot, lambda: read(_pair(python(slot.component.step)(memory, *given))[1]),
             LONGEST_TRIAL)  # what it calls may compile
    if not slot.fault:  # it shows in compiled arithmetic alone
        slot.fault = f'{where(slot.component.path, slot.component.step)}: the compiled step failed'


def tried(component: Component, arguments: tuple, read: Callable[[Any], Any]) -> None:
    """
    Take one step of a component before it is flown.

    Parameters
    ----------
    component
        From outside.
    arguments, read
        As of :func:`call`.

    Raises
    ------
    ParameterError
        In one line with file and line, if it raises, does not compile or answers something else.

    """
    own = values(component.params())
    given = tuple(own if x is None else x for x in arguments)
    slot, place = Slot(component, own), where(component.path, component.step)

    uncompiled = ''

    def work() -> tuple[Any, Any] | None:
        """Try a step; note in ``uncompiled`` that it does not compile."""
        nonlocal uncompiled
        try:
            memory = component.initial(own)
            return memory, component.step(memory, *given)
        except NumbaError as error:
            uncompiled = _uncompiled(error, component)
            return None
    found = _guarded(slot, work, LONGEST_TRIAL)
    if uncompiled:
        raise ParameterError(uncompiled)
    if slot.fault and component.compiled:  # compiled code does not say its line
        slot.fault = ''
        _guarded(slot, lambda: python(component.step)(
            python(component.initial)(own), *given), LONGEST_TRIAL)
        slot.fault = slot.fault or f'{place}: the compiled step fails'
    if slot.fault or found is None:
        raise ParameterError(f'{slot.fault}, in a trial at hover')
    memory, result = found
    try:
        read(_pair(result)[1])
    except UnusableError as error:
        raise ParameterError(f'{place}: {error}') from None
    if component.compiled and typeof(result[0]) != typeof(memory):
        raise ParameterError(
            f'{place}: the memory is {_kind(memory)} at start and {_kind(result[0])} after a '
            'step; in compiled code every number of it keeps its type')


def _pair(result: Any) -> tuple[Any, Any]:
    """Return memory and result of a step; raise UnusableError if it did not return two values."""
    if type(result) is not tuple or len(result) != 2:
        raise UnusableError('step must answer two things: the memory after it, and what the '
                            f'others get; it answers {_kind(result)}')
    return result


def typed(value: Any, like: Any) -> Any:
    """
    Return what a component answers in the types and the shape of another answer.

    Raises
    ------
    UnusableError
        Naming the part that has another shape, or a number that cannot have its type.

    """
    try:
        return _typed(value, like)
    except (TypeError, ValueError, OverflowError):
        raise UnusableError(f'step answers {_wrong(value, like, "")}') from None


def _typed(value: Any, like: Any) -> Any:
    """Return the same; TypeError, ValueError or OverflowError for what is wrong."""
    if not isinstance(like, tuple):
        kind = type(like)
        if isinstance(value, (str, bytes)) or kind is not float and kind(value) != value:
            raise TypeError
        return kind(value)
    if type(value) is tuple and len(value) == len(like) and (
            {*map(type, value)} == {*map(type, like)} == {float}):  # most of them, at once
        return value
    parts = [_typed(x, part) for x, part in zip(value, like, strict=True)]
    return type(like)(*parts) if hasattr(like, '_fields') else tuple(parts)


def _wrong(value: Any, like: Any, name: str) -> str:
    """Return which part of an answer has another type or shape, its value and what is wanted."""
    if not isinstance(like, tuple):
        return f'{name} = {shown(value)}: wanted {_NUMBER[type(like)]}'
    names = getattr(like, '_fields', None)
    try:
        parts = () if isinstance(value, (str, bytes)) else tuple(value)
    except TypeError:
        parts = ()
    if len(parts) != len(like):
        wanted = ', '.join(names) if names else f'{len(like)} numbers'
        return f'{name} = {shown(value)}: wanted {wanted}'
    for i, (x, part) in enumerate(zip(parts, like, strict=True)):
        try:
            _typed(x, part)
        except (TypeError, ValueError, OverflowError):
            inside = f'.{names[i]}' if names else f'[{i}]'
            return _wrong(x, part, f'{name}{inside}'.lstrip('.'))
    return name


def _kind(value: Any) -> str:
    """Return type and value in words, for a message."""
    return f'{type(value).__name__} {shown(value)}'


def _uncompiled(error: Exception, component: Component) -> str:
    """Return the compiler's message about a user's code in one line with file and line."""
    text = _COLOUR.sub('', str(error))
    path = component.path
    told = [f'{file}:{line}' for file, line in re.findall(r'File "([^"]+)", line (\d+)', text)
            if path is not None and Path(file).name == path.name]
    at = told[-1] if told else fault_place(path, error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    said = next((line for line in lines if 'nopython mode pipeline' not in line), 'no reason')
    return f'{at}: does not compile: {said}'


def _guarded(slot: Slot, work: Callable[[], Any], limit: float = LONGEST_STEP) -> Any:
    """Run work of a component; after an error or timeout note the fault and return None."""
    try:
        with time_limit(limit):
            return work()
    except BaseException as error:  # whatever a user's code raises, sys.exit() included
        if isinstance(error, KeyboardInterrupt) and _may_be_a_signal(error):
            raise
        slot.fault = f'{_place(slot.component, error)}: {_reason(error)}'
        return None


def _may_be_a_signal(end: KeyboardInterrupt) -> bool:
    """Tell whether the user may have ended the command; code can raise the same."""
    # the commands' handler names the signal, Python's own does not
    return bool(end.args) or signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _place(component: Component, error: BaseException) -> str:
    """Return file and line of what is wrong: of the step for what it returns."""
    if isinstance(error, UnusableError):
        return where(component.path, component.step)
    return fault_place(component.path, error)


def _reason(error: BaseException) -> str:
    """Return what a component did wrong, in one line."""
    if isinstance(error, OverdueError):
        return 'takes too long'
    if isinstance(error, NumbaError):  # its text has many lines, and types of the compiler
        return 'calls a compiled function with a value of a wrong type'
    return describe(error)
