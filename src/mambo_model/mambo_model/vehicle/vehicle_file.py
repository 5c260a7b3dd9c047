"""
Vehicle files: YAML in which each value has its unit and its source.

A scenario file holds the parameters of one flight. A vehicle file documents a vehicle.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import yaml

from ..schema import build, check_field, flatten, ParameterError, unknown, walk
from ..yaml_nodes import dump_value, Reader
from .mass_properties import Point

P = TypeVar('P')

MARKER = {'mass': ('kg', 1), 'position': ('m', 3)}  # unit, how many numbers
LIMITS = {'mass': (0.0, 0.1), 'position': (-1.0, 1.0)}


class Text(NamedTuple):
    """A word of the file with its file and line."""

    value: str
    where: str


class Content(NamedTuple):
    """The content of a vehicle file."""

    base: Text | None
    values: dict[str, Any]  # by dotted name
    markers: list[Point]
    places: dict[str, str]  # file and line by dotted name


class _Reader(Reader):
    """Reads values with their unit and source; ``places`` has file and line of each by name."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.places: dict[str, str] = {}

    def entry(self, name: str, key: yaml.Node, node: yaml.Node, unit: str | None) -> yaml.Node:
        """Return the node of the value of ``name: {value, unit, source}``."""
        parts = self.mapping(node, name)
        wanted = ('value', 'source') if unit is None else ('value', 'unit', 'source')
        for part, (at, _) in parts.items():
            if part not in wanted:
                self.fail(at, name, f'has {part!r}; it takes {", ".join(wanted)}')
        for part in wanted:
            if part not in parts:
                self.fail(key, name, f'has no {part}; it takes {", ".join(wanted)}')
        self.text(parts['source'][1], f'{name}: source')
        if unit is not None and self.text(parts['unit'][1], name) != unit:
            self.fail(parts['unit'][1], name, f'is in {unit}, not in {parts["unit"][1].value}')
        return parts['value'][1]

    def value(self, name: str, field: dataclasses.Field, key: yaml.Node, node: yaml.Node) -> Any:
        """Return the checked value of a schema field."""
        at = self.entry(name, key, node, field.metadata.get('unit'))
        self.places[name] = self.where(at)
        return self.leaf('.'.join(['vehicle', *name.split('.')[:-1]]), name, field, at)

    def section(
        self, node: yaml.Node, prefix: str, fields: dict[str, dataclasses.Field],
    ) -> dict[str, Any]:
        """Return {dotted name: value} for all values below a node."""
        out = {}
        for part, (key, below) in self.mapping(node, prefix.rstrip('.')).items():
            name = f'{prefix}{part}'
            if name in fields:
                out[name] = self.value(name, fields[name], key, below)
            elif any(known.startswith(f'{name}.') for known in fields):
                out.update(self.section(below, f'{name}.', fields))
            else:
                raise ParameterError(f'{self.where(key)}: {unknown(name, fields)}')
        return out

    def marker(self, node: yaml.Node) -> Point:
        """Return mass in kg and position in m of one marker."""
        parts = self.mapping(node, 'markers')
        if set(parts) != set(MARKER):
            self.fail(node, 'markers', f'each takes {" and ".join(MARKER)}')
        out: list[Any] = []
        for name, (unit, count) in MARKER.items():
            key, (low, high) = f'markers: {name}', LIMITS[name]
            at = self.entry(key, *parts[name], unit)
            given = self.numbers(at, key, count) if count > 1 else (self.number(at, key),)
            if not all(low <= number <= high for number in given):
                self.fail(at, key, f'is outside [{low:g}, {high:g}] {unit}')
            out.append(given if count > 1 else given[0])
        return tuple(out)


def read(path: Path, params_type: type) -> Content:
    """
    Read a vehicle file.

    Parameters
    ----------
    path
        YAML file with ``description``, ``base``, ``markers`` and values, see
        :func:`mambo_model.vehicle.parameters.load`.
    params_type
        Parameter dataclass that defines names, units and ranges of the values.

    Raises
    ------
    ParameterError
        If something is wrong; the message names file, line and key.

    """
    reader = _Reader(path)
    root = reader.root()
    keys = reader.mapping(root, 'file')
    if 'description' not in keys:
        raise ParameterError(f'{path}: has no description')
    reader.text(keys['description'][1], 'description')
    base, markers = None, []
    if 'base' in keys:
        node = keys['base'][1]
        base = Text(reader.text(node, 'base'), f'{reader.where(node)}: base')
    if 'markers' in keys:
        node = keys['markers'][1]
        if not isinstance(node, yaml.SequenceNode):
            reader.fail(node, 'markers', 'must be a list')
        markers = [reader.marker(marker) for marker in node.value]
    root.value = [pair for pair in root.value if pair[0].value not in (
        'description', 'base', 'markers')]
    values = reader.section(root, '', dict(walk(params_type)))
    return Content(base, values, markers, reader.places)


def replace(params: P, values: dict[str, Any]) -> P:
    """
    Return parameters with some values replaced, given by dotted name.

    Raises
    ------
    ParameterError
        If the values contradict each other.

    """
    return build(type(params), {**flatten(params), **values})


def _scalar(value: Any) -> str:
    """Return a value as YAML; numbers read back exactly."""
    if isinstance(value, tuple):
        return f'[{", ".join(map(_scalar, value))}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    return dump_value(value)


def _lines(tree: dict[str, Any], indent: str) -> list[str]:
    """Return the lines of a section; leaves are finished texts."""
    out = []
    for key, below in tree.items():
        if isinstance(below, dict):
            out += [f'{indent}{key}:', *_lines(below, indent + '  ')]
        else:
            out.append(f'{indent}{key}: {below}')
    return out


def to_text(
    description: str, base: str, values: dict[str, tuple[Any, str]], params_type: type,
) -> str:
    """
    Return the text of a vehicle file that :func:`read` reads.

    Parameters
    ----------
    description
        Description of the vehicle in one line.
    base
        Name of the vehicle to start from.
    values
        {dotted name: (value, source)}; all other values are those of the base.
    params_type
        Parameter dataclass that defines names, units and ranges of the values.

    Raises
    ------
    ParameterError
        If a name is unknown or a value is out of range; the message names it.

    """
    fields, tree = dict(walk(params_type)), {}
    for name, (value, source) in values.items():
        if name not in fields:
            raise ParameterError(unknown(name, fields))
        check_field('.'.join(['vehicle', *name.split('.')[:-1]]), fields[name], value)
        unit = fields[name].metadata.get('unit')
        parts = [f'value: {_scalar(value)}', f'source: {_scalar(" ".join(source.split()))}']
        if unit is not None:
            parts.insert(1, f'unit: {_scalar(unit)}')
        *sections, last = name.split('.')
        below = tree
        for section in sections:
            below = below.setdefault(section, {})
        below[last] = f'{{{", ".join(parts)}}}'
    return '\n'.join([
        f'description: {_scalar(" ".join(description.split()))}', f'base: {_scalar(base)}', '',
        *_lines(tree, '')]) + '\n'
