"""
Parameters that carry their own unit, range and source (no ROS here).

A component's parameters are a frozen dataclass whose fields are made by :func:`quantity`,
:func:`choice`, :func:`flag`, :func:`text` or :func:`group`. The same declaration becomes ROS
parameters (``mambo_ros.params``), sections of a scenario file and, through
:mod:`mambo_model.values`, the NamedTuple that compiled code reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import dataclasses
import difflib
import functools
import math
import re
from typing import Any, TypeVar

from .errors import InputError

P = TypeVar('P')
_fields = functools.cache(dataclasses.fields)  # of a type of parameters
_FEW = 30  # names that a message lists one by one


def quantity(default: Any, unit: str, low: float, high: float, source: str) -> Any:
    """
    Declare a number (float or int, by its default) or a tuple of floats.

    ``low`` and ``high`` bound the closed valid range, of every element for a tuple.
    """
    return dataclasses.field(
        default=default,
        metadata={'unit': unit, 'low': low, 'high': high, 'source': source})


def choice(default: str, options: tuple[str, ...], source: str) -> Any:
    """Declare a choice among ``options``; compiled code sees its index."""
    return dataclasses.field(default=default, metadata={'options': options, 'source': source})


def flag(default: bool, source: str) -> Any:
    """Declare a switch."""
    return dataclasses.field(default=default, metadata={'flag': True, 'source': source})


def text(default: str, source: str) -> Any:
    """Declare free text, a path or a name; compiled code does not see it."""
    return dataclasses.field(default=default, metadata={'text': True, 'source': source})


def group(params_type: type) -> Any:
    """Nest another parameter dataclass."""
    return dataclasses.field(default_factory=params_type, metadata={'group': params_type})


def component(default: str, registry: Any, source: str) -> Any:
    """
    Declare the name of a component: a built-in one, a file, or an installed one.

    ``registry`` is the :class:`mambo_model.components.Registry` that finds the component. The
    group of parameters with the same name holds its parameters.
    """
    return dataclasses.field(
        default=default, metadata={'component': registry, 'source': source})


class ParameterError(InputError):
    """A parameter is unknown, has a wrong type or is out of range; the message names it."""


def unknown(name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown name, with the nearest known names, or all or groups."""
    known = sorted(known)
    name = name if len(name) <= 200 else f'{name[:60]}...'
    close = [each for each in difflib.get_close_matches(name, known, n=3, cutoff=0.5)
             if '.' not in name or _alike(name, each)]
    if close:
        return f"{name}: unknown parameter; did you mean {', '.join(close)}?"
    if len(known) > _FEW:
        known = sorted({first + ('.*' if rest else '') for first, _, rest in (
            each.partition('.') for each in known)})
    return f"{name}: unknown parameter; known: {', '.join(known)}"


def _alike(name: str, known: str) -> bool:
    """Return whether dotted names are alike at one end: in their node, or in what they set."""
    return any(difflib.SequenceMatcher(None, *ends).ratio() > 0.75 for ends in (
        (name.partition('.')[0], known.partition('.')[0]),
        (name.rpartition('.')[2], known.rpartition('.')[2])))


def _as_float(value: float) -> float:
    """Return a number as float; an integer beyond the largest float becomes infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def shown(value: Any) -> str:
    """Return a value for an error message, shortened if it is long."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        return 'a number of more than 4300 digits'
    return text if len(text) <= 80 else f'{text[:60]}... ({len(text)} characters)'


def check_field(owner: str, field: dataclasses.Field, value: Any) -> None:
    """
    Check one value against the declaration of its field.

    Raises
    ------
    ParameterError
        Naming it as the user writes it, ``owner.name`` or ``name``, with value, unit and range.

    """
    meta, name = field.metadata, f'{owner}.{field.name}' if owner else field.name
    if 'options' in meta:
        if value not in meta['options']:
            raise ParameterError(
                f"{name} = {shown(value)} is not one of {', '.join(meta['options'])}")
    elif 'component' in meta:
        if not isinstance(value, str):
            raise ParameterError(f'{name} = {shown(value)} must be text')
        try:
            meta['component'].find(value)
        except ParameterError as error:
            raise ParameterError(f'{name}: {error}') from None
    elif 'flag' in meta:
        if not isinstance(value, bool):
            raise ParameterError(f'{name} = {shown(value)} must be true or false')
    elif 'text' in meta:
        if not isinstance(value, str):
            raise ParameterError(f'{name} = {shown(value)} must be text')
    elif 'unit' in meta:
        default = field.default
        elements = value if isinstance(default, tuple) else (value,)
        if isinstance(default, tuple) and (
                not isinstance(value, tuple) or len(value) != len(default)):
            raise ParameterError(f'{name} = {shown(value)} must be {len(default)} numbers')
        for element in elements:
            if not _is_number(element) or (
                    isinstance(default, int) and not isinstance(element, int)):
                kind = 'a whole number' if isinstance(default, int) else 'a number'
                raise ParameterError(f'{name} = {shown(value)} must be {kind}')
            if not (meta['low'] <= element <= meta['high']
                    and math.isfinite(_as_float(element))):
                unit = '' if meta['unit'] == '1' else f' {meta["unit"]}'
                raise ParameterError(
                    f'{name} = {shown(value)}{unit} is outside '
                    f'[{meta["low"]:g}, {meta["high"]:g}]')


def check(params: Any) -> None:
    """
    Check every field of a parameter dataclass; call it from ``__post_init__``.

    Raises
    ------
    ParameterError
        If a value is wrong; the message names the field, its value, unit and range.

    """
    for field in _fields(type(params)):
        if 'group' in field.metadata:
            continue
        value = getattr(params, field.name)
        if type(value) is type(field.default) is float and math.isfinite(value) and (
                field.metadata['low'] <= value <= field.metadata['high']):
            continue  # as nearly all are: sweeps build thousands of scenarios
        check_field('', field, value)


def walk(params_type: type, prefix: str = '') -> Iterator[tuple[str, dataclasses.Field]]:
    """Yield (dotted name, field) of every leaf parameter of a dataclass type."""
    for field in _fields(params_type):
        if 'group' in field.metadata:
            yield from walk(field.metadata['group'], f'{prefix}{field.name}.')
        else:
            yield prefix + field.name, field


def flatten(params: Any, prefix: str = '') -> dict[str, Any]:
    """Return {dotted name: value} of every leaf parameter."""
    out: dict[str, Any] = {}
    for field in _fields(type(params)):
        value = getattr(params, field.name)
        if 'group' in field.metadata:
            out.update(flatten(value, f'{prefix}{field.name}.'))
        else:
            out[prefix + field.name] = value
    return out


def extended(params_type: type[P], given: Mapping[str, Any]) -> type[P]:
    """
    Return a parameter dataclass extended by the groups of the users' components selected.

    Parameters
    ----------
    params_type
        Dataclass declared with this module.
    given
        Values by name; missing ones keep their defaults.

    Raises
    ------
    ParameterError
        If a component is not found or is not valid, or has the name of something else.

    """
    groups = {}
    declared = getattr(params_type, _EXTENDS, params_type)
    for field in _fields(params_type):
        value = given.get(field.name, field.default)
        if 'component' in field.metadata and isinstance(value, str) and (
                field.metadata['component'].is_own(value)):
            try:
                found = field.metadata['component'].find(value)
            except ParameterError as error:
                raise ParameterError(f'{field.name}: {error}') from None
            if hasattr(declared, found.name) or found.name in declared.__dataclass_fields__:
                raise ParameterError(
                    f'{field.name}: {found.path}: {found.name} is a name of the node itself: '
                    'rename the file, or give the component as file.py:Name')
            groups[found.name] = found.params
    known = {field.name for field in _fields(params_type)}
    return _with_groups(params_type, tuple(
        (name, kind) for name, kind in groups.items() if name not in known))


_EXTENDS = '_extends'  # attribute of an extended dataclass: the one that it extends


@functools.cache
def _with_groups(params_type: type, groups: tuple[tuple[str, type], ...]) -> type:
    if not groups:
        return params_type
    return dataclasses.make_dataclass(
        params_type.__name__, [(name, kind, group(kind)) for name, kind in groups],
        bases=(params_type,), frozen=True, namespace={
            '__module__': params_type.__module__, '__doc__': params_type.__doc__,
            _EXTENDS: params_type,
            '__reduce__': lambda self: (build, (params_type, flatten(self)))})


def component_fields(params: Any) -> Iterator[tuple[dataclasses.Field, str]]:
    """Yield field and value of every parameter that selects a component, at any depth."""
    for field in _fields(type(params)):
        value = getattr(params, field.name)
        if 'group' in field.metadata:
            yield from component_fields(value)
        elif 'component' in field.metadata:
            yield field, value


def build(params_type: type[P], values: Mapping[str, Any], where: str = '') -> P:
    """
    Fill a parameter dataclass from a nested mapping; missing keys keep their defaults.

    Parameters
    ----------
    params_type
        Dataclass declared with this module.
    values
        Nested mapping, or flat mapping with dotted names; lists stand for tuples.
    where
        File or section that the values come from; error messages begin with it.

    Raises
    ------
    ParameterError
        If a key is unknown (with the known ones), a type is wrong or a value is out of range.

    """
    nested: dict[str, Any] = {}
    for key, value in values.items():
        head, _, tail = str(key).partition('.')
        new = {tail: value} if tail else value
        if head not in nested:
            nested[head] = {**new} if isinstance(new, Mapping) else new
        elif isinstance(new, Mapping) and isinstance(nested[head], Mapping):
            nested[head].update(new)
        else:
            section = new if isinstance(nested[head], Mapping) else nested[head]
            raise ParameterError(
                f'{where}{head} = {shown(section)} must be a section of parameters')
    try:
        params_type = extended(params_type, nested)
    except ParameterError as error:
        raise ParameterError(f'{where}{error}') from None
    fields = {field.name: field for field in _fields(params_type)}
    filled: dict[str, Any] = {}
    for key, value in nested.items():
        name = f'{where}{key}'
        if key not in fields:
            raise ParameterError(f'{where}{unknown(key, fields)}')
        field = fields[key]
        if 'group' in field.metadata:
            if not isinstance(value, Mapping):
                raise ParameterError(f'{name} = {shown(value)} must be a section of parameters')
            filled[key] = build(field.metadata['group'], value, f'{name}.')
            continue
        if isinstance(value, list):
            value = tuple(value)
        if 'component' in field.metadata and isinstance(value, str):
            value = field.metadata['component'].absolute(value)
        if isinstance(field.default, float) and _is_number(value):
            value = _as_float(value)
        elif isinstance(field.default, tuple) and isinstance(value, tuple) and all(
                map(_is_number, value)):
            value = tuple(map(_as_float, value))
        filled[key] = value
    try:
        return params_type(**filled)
    except ParameterError as error:
        named = re.match(r'\w*', str(error))[0] in fields  # the message begins with the parameter
        place = where if named or not where else f'{where.rstrip(".: ")}: '
        raise ParameterError(f'{place}{error}') from None
