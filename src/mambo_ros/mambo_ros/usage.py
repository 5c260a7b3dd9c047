"""The ``--help`` text of a node, made from its class without starting ROS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
import inspect
from typing import Any, get_args

from mambo_model import schema

from . import parameter_texts
from .commands.table import Service
from .graph.wire import WireParams
from .topics import Topic


def asked(words: Sequence[str]) -> bool:
    """Return whether a command line asks for help before ``--ros-args``."""
    own = words[:words.index('--ros-args')] if '--ros-args' in words else words
    return '-h' in own or '--help' in own


def _params_type(node_type: type) -> type:
    """Return the parameter dataclass of ``class Name(MamboNode[Params])``."""
    return get_args(node_type.__orig_bases__[0])[0]


def _default(field: dataclasses.Field) -> str:
    """Return a default value as written on the command line."""
    if isinstance(field.default, bool):
        return str(field.default).lower()
    if isinstance(field.default, tuple):
        return '[' + ', '.join(map(str, field.default)) + ']'
    return str(field.default) if field.default != '' else "''"


def _parameter(name: str, field: dataclasses.Field) -> Iterator[str]:
    """Yield the two lines of a parameter: default, unit and range; what it is and source."""
    meta = field.metadata
    unit = f' {meta["unit"]}' if meta.get('unit', '-') != '-' else ''
    bounds = ''
    if 'unit' in meta:
        bounds = f' (range {meta["low"]:g} to {meta["high"]:g})'
    elif 'options' in meta:
        bounds = f" (one of: {', '.join(meta['options'])})"
    elif 'component' in meta:
        bounds = f" (one of: {', '.join(meta['component'].names)}, or FILE.py[:NAME])"
    yield f'  {name} = {_default(field)}{unit}{bounds}'
    what = parameter_texts.describe(name)
    yield '      ' + '; '.join(filter(None, (what, meta['source'])))


def _topics(heading: str, listed: Sequence[Topic | Service]) -> Iterator[str]:
    """Yield a list of topics or services with their types."""
    yield heading
    for topic in listed:
        yield f'  {topic.name}  {topic.type_name}'
    if not listed:
        yield '  none'


def _node(node_type: Any) -> Iterator[str]:
    """Yield the purpose, topics and parameters of a node."""
    yield inspect.getdoc(node_type) or ''
    yield ''
    yield from _topics('publishes:', node_type.publishes)
    yield from _topics('subscribes to:', node_type.subscribes)
    if node_type.serves:
        yield from _topics('serves:', node_type.serves)
    if node_type.calls:
        yield from _topics('calls:', node_type.calls)
    yield 'parameters:'
    for name, field in schema.walk(_params_type(node_type)):
        yield from _parameter(name, field)
    for name, field in schema.walk(WireParams):
        yield from _parameter(f'wire.{name}', field)


def text(node_types: Sequence[Any], package: str, executable: str) -> str:
    """
    Return the help of an executable.

    Parameters
    ----------
    node_types
        Classes of its nodes, each with ``publishes``, ``subscribes`` and ``example``.
    package, executable
        As ``ros2 run`` knows them.

    """
    command = f'ros2 run {package} {executable}'
    lines = [f'usage: {command} [--ros-args -p NAME:=VALUE ... --params-file FILE]', '']
    for node_type in node_types:
        if len(node_types) > 1:
            lines += [f'--- {node_type.__module__.split(".")[-1]} ---']
        lines += [*_node(node_type), '']
    example = ('--ros-args --params-file FILE  # a section for each node'
               if len(node_types) > 1 else node_types[0].example)
    return '\n'.join([*lines, 'example:', f'  {command} {example}'.rstrip()])
