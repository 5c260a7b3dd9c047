"""
What compiled code reads of parameters: NamedTuples made from their declarations.

A parameter stands once, in its dataclass. What compiled code wants in another form (a period for
a rate, the cosine of an angle) is a method of the dataclass, marked with :func:`derived`::

    @dataclass(frozen=True)
    class SonarParams(Parameters):
        rate: float = quantity(25.0, 'Hz', 1.0, 200.0, 'data sheet')
        noise: float = quantity(0.005, 'm', 0.0, 1.0, 'measured')

        @derived('ns', 'rate')
        def period(self) -> int:
            '''Time between samples.'''
            return round(1e9 / self.rate)


    SonarValues = values_type(SonarParams)  # noise, period
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import Any, NamedTuple, TypeVar

from .schema import check

F = TypeVar('F', bound=Callable)


def derived(unit: str, *replaces: str) -> Callable[[F], F]:
    """
    Mark a method as a number that compiled code reads besides, or in place of, parameters.

    The method is a field of the compiled values under its own name, described by the first line
    of its docstring.

    Parameters
    ----------
    unit
        Of what it returns; empty for what has none.
    replaces
        Parameters that compiled code need not see, as it reads this instead.

    """
    def mark(method: F) -> F:
        method.derived = (unit, replaces)  # type: ignore[attr-defined]
        return method
    return mark


def _derived_of(params_type: type) -> dict[str, Callable]:
    """Return {name: method} of what a parameter dataclass derives, in the order of definition."""
    return {
        name: member for owner in reversed(params_type.__mro__)
        for name, member in vars(owner).items() if hasattr(member, 'derived')}


def values_type(params_type: type, name: str = 'Values', only: tuple[str, ...] = (),
                without: tuple[str, ...] = ()) -> type:
    """
    Return the NamedTuple that compiled code reads of a parameter dataclass.

    Its fields are the parameters in their order, but for text and what a :func:`derived` value
    replaces, then the derived values. Names out of a :func:`choice` are their index, groups the
    NamedTuple of theirs. Each field has its unit and source as its docstring. The type is kept as
    an attribute of the dataclass, by which it can be pickled.

    Parameters
    ----------
    params_type
        Declared with this module.
    name
        Of the attribute, where a dataclass has several such types.
    only
        Parameters that are fields; empty: all of them, and what is derived.
    without
        Parameters that are not.

    """
    if name in vars(params_type):
        return vars(params_type)[name]
    methods = {} if only else _derived_of(params_type)
    left = {*without, *(old for method in methods.values() for old in method.derived[1])}
    fields = [
        field for field in dataclasses.fields(params_type)
        if field.name not in left and 'text' not in field.metadata
        and (not only or field.name in only)]
    types = [(field.name, _compiled_type(field)) for field in fields]
    types += [(key, method.__annotations__.get('return', 'Any'))
              for key, method in methods.items()]
    title = params_type.__name__.removesuffix('Params') + name
    out = NamedTuple(title, types)  # type: ignore[misc]
    out.__module__, out.__qualname__ = params_type.__module__, f'{params_type.__qualname__}.{name}'
    out.__doc__ = f'What compiled code reads of :class:`{params_type.__name__}`.'
    for field in fields:
        getattr(out, field.name).__doc__ = _describe(field)
    for key, method in methods.items():
        unit, about = method.derived[0], (method.__doc__ or '').strip().partition('\n')[0]
        getattr(out, key).__doc__ = f'[{unit}] {about}' if unit else about
    setattr(params_type, name, out)
    return out


def _compiled_type(field: dataclasses.Field) -> Any:
    """Return the type that compiled code has for a parameter, as an annotation."""
    if 'options' in field.metadata:
        return 'int'
    return 'tuple' if 'group' in field.metadata else field.type


def _describe(field: dataclasses.Field) -> str:
    """Return what the declaration of a parameter says: unit and source, or the choices."""
    meta = field.metadata
    if 'unit' in meta:
        return f"[{meta['unit']}] {meta['source']}"
    if 'options' in meta:
        return f"Index in {', '.join(meta['options'])}; {meta['source']}"
    return meta.get('source') or f"Values of :class:`{meta['group'].__name__}`."


def values(params: Any, kind: type | None = None, /, **given: Any) -> Any:
    """
    Return what compiled code reads of parameters.

    Numbers get the type of their default, so that a whole number given for a float compiles
    nothing anew.

    Parameters
    ----------
    params
        A parameter dataclass.
    kind
        One of its NamedTuples, by default the first one of :func:`values_type`.
    given
        Fields that depend on more than these parameters.

    """
    kind = kind or getattr(type(params), 'Values', None) or values_type(type(params))
    fields = {field.name: field for field in dataclasses.fields(params)}
    return kind(*(
        given[name] if name in given
        else _compiled_value(fields[name], getattr(params, name)) if name in fields
        else getattr(params, name)() for name in kind._fields))


def _compiled_value(field: dataclasses.Field, value: Any) -> Any:
    """Return the value of one parameter as compiled code has it."""
    if 'group' in field.metadata:
        return value.values() if hasattr(value, 'values') else values(value)
    if 'options' in field.metadata:
        return field.metadata['options'].index(value)
    if isinstance(field.default, float):
        return float(value)
    if isinstance(field.default, tuple):
        return tuple(float(element) for element in value)
    return value


class Parameters:
    """Base of the parameter dataclasses: checked when made, readable by compiled code."""

    def __post_init__(self) -> None:
        check(self)

    def values(self) -> Any:
        """Return what compiled code reads, the NamedTuple of :func:`values_type`."""
        return values(self)
