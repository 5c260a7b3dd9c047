"""
NamedTuples of parameters for compiled code, made from their declarations.

A parameter is declared once, in its dataclass. A value that compiled code needs in another form
(a period for a rate, the cosine of an angle) is a method of the dataclass, marked with
:func:`derived`::

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
    Mark a method as a value that compiled code reads in addition to, or in place of, parameters.

    The method becomes a field of the compiled values under its own name, described by the first
    line of its docstring.

    Parameters
    ----------
    unit
        Unit of the value; empty if it has none.
    replaces
        Parameters that the value replaces in the compiled values.

    """
    def mark(method: F) -> F:
        method.derived = (unit, replaces)  # type: ignore[attr-defined]
        return method
    return mark


def _derived_of(params_type: type) -> dict[str, Callable]:
    """Return {name: method} of the derived values of a dataclass, in the order of definition."""
    return {
        name: member for owner in reversed(params_type.__mro__)
        for name, member in vars(owner).items() if hasattr(member, 'derived')}


def values_type(params_type: type, name: str = 'Values', only: tuple[str, ...] = (),
                without: tuple[str, ...] = ()) -> type:
    """
    Return the NamedTuple through which compiled code reads a parameter dataclass.

    Its fields are the parameters in order, except for text and those that a :func:`derived` value
    replaces, followed by the derived values. A :func:`choice` becomes its index and a group a
    NamedTuple. The docstring of a field holds its unit and source. The type is stored as an
    attribute of the dataclass, so that it can be pickled, and has the dataclass as ``made_from``.

    Parameters
    ----------
    params_type
        Dataclass declared with :mod:`mambo_model.schema`.
    name
        Name of the attribute, if a dataclass has several such types.
    only
        Parameters to include; empty: all of them and the derived values.
    without
        Parameters to leave out.

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
    out.made_from = params_type  # type: ignore[attr-defined]
    setattr(params_type, name, out)
    return out


def _compiled_type(field: dataclasses.Field) -> Any:
    """Return the type of a parameter in compiled code, as an annotation."""
    if 'options' in field.metadata:
        return 'int'
    return 'tuple' if 'group' in field.metadata else field.type


def _describe(field: dataclasses.Field) -> str:
    """Return unit and source of a parameter, or its choices."""
    meta = field.metadata
    if 'unit' in meta:
        return f"[{meta['unit']}] {meta['source']}"
    if 'options' in meta:
        return f"Index in {', '.join(meta['options'])}; {meta['source']}"
    return meta.get('source') or f"Values of :class:`{meta['group'].__name__}`."


def values(params: Any, kind: type | None = None, /, **given: Any) -> Any:
    """
    Return parameters as a NamedTuple for compiled code.

    Numbers get the type of their default, so that an integer given for a float does not trigger a
    new compilation.

    Parameters
    ----------
    params
        A parameter dataclass.
    kind
        One of its NamedTuples, by default the one that :func:`values_type` makes.
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
    """Return the value of one parameter for compiled code."""
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
    """Base of the parameter dataclasses: checks its fields and offers them to compiled code."""

    def __post_init__(self) -> None:
        check(self)

    def values(self) -> Any:
        """Return the values for compiled code, the NamedTuple of :func:`values_type`."""
        return values(self)
