"""Components defined in a script or a notebook: their source, and functions as components."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import hashlib
import inspect
from pathlib import Path
from typing import Any

from .schema import ParameterError
from .values import Parameters


_LEFT = ('memory', 'gains', 'values')  # arguments of a step that a function does without


def python(function: Callable) -> Callable:
    """Return a function as Python has it, compiled or not."""
    return getattr(function, 'py_func', function)


def script_source(thing: Any) -> tuple[Path, str]:
    """
    Return file and sha256 of the source of a function, a class or an object of a script.

    If there is no source, as for code typed at the prompt, the hash is that of the byte code.

    Raises
    ------
    ParameterError
        If it is not written in Python.

    """
    given = thing
    thing = python(thing)
    if not (inspect.isroutine(thing) or inspect.ismodule(thing) or isinstance(thing, type)):
        thing = type(thing)
    code = getattr(thing, '__code__', None)
    try:
        source = inspect.getsource(thing)
        path = Path(inspect.getsourcefile(thing) or '')
    except (OSError, TypeError):
        parts = [code] if code else [
            member.__code__ for member in getattr(thing, '__dict__', {}).values()
            if inspect.isfunction(member)]
        if not parts:
            raise ParameterError(
                f'{given!r} is not written in Python: call it in a function of yours') from None
        source = repr([(part.co_code, part.co_names) for part in parts])
        path = Path(parts[0].co_filename)
    return path, hashlib.sha256(source.encode()).hexdigest()


def signature(function: Callable, title: str) -> inspect.Signature:
    """Return the arguments of a function; ParameterError naming it if Python cannot tell them."""
    try:
        return inspect.signature(python(function))
    except (TypeError, ValueError):
        raise ParameterError(f'{title}: Python cannot tell its arguments: call it in a function '
                             'of yours') from None


class WithoutMemory:
    """A function of a script as a component that has no parameters and keeps nothing."""

    @dataclasses.dataclass(frozen=True)
    class Params(Parameters):
        """None."""

    def __init__(self, function: Callable, arguments: tuple[str, ...], title: str) -> None:
        taken = [i for i, name in enumerate(arguments) if name not in _LEFT]
        wanted = ', '.join(arguments[i] for i in taken)
        found = signature(function, title)
        try:
            found.bind(*taken)
        except TypeError:
            has = ', '.join(found.parameters)
            raise ParameterError(f'{title}({has}) must take {len(taken)} arguments: {wanted}'
                                 ) from None
        def step(*arguments: Any) -> tuple[None, Any]:
            """Return no memory, and what the function answers."""
            return None, python(function)(*(arguments[i] for i in taken))
        step.__wrapped__ = python(function)  # type: ignore[attr-defined]  # its place in the file
        step.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in arguments])
        self.step = step

    def initial(self, values: Any) -> None:
        """Return the memory at start: none."""
