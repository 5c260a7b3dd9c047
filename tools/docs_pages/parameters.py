"""Tables of every parameter, from the declarations that the nodes themselves use."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import Any

from mambo_bags.recorder_parameters import RecorderNodeParams
from mambo_bags.replay_node import ReplayNodeParams
from mambo_description.description_node import DescriptionNodeParams
from mambo_flight import scenario_file
from mambo_flight.scenario import Scenario
from mambo_flight.sweep import design
from mambo_mocap.parameters import NatNetClientNodeParams, NatNetServerNodeParams
from mambo_model import schema
from mambo_ros.parameter_texts import describe
from mambo_view.view_node import ViewNodeParams

from .source import table

HEAD = ('parameter', 'default', 'unit', 'range or choices', 'meaning, source')


def _limit(value: float) -> str:
    return str(value) if isinstance(value, int) else f'{value:g}'


def default(value: Any) -> str:
    """Return a default as it is written in a scenario file."""
    if isinstance(value, tuple):
        return f'[{", ".join(map(str, value))}]'
    if isinstance(value, bool):
        return str(value).lower()
    return (value or "''") if isinstance(value, str) else str(value)


def _limits(meta: Any) -> tuple[str, str]:
    """Return unit and range of a parameter."""
    if 'unit' in meta:
        return meta['unit'], f'{_limit(meta["low"])} to {_limit(meta["high"])}'
    if 'options' in meta:
        return '', ', '.join(f'`{option}`' for option in meta['options'])
    if 'component' in meta:
        return '', ', '.join([*(f'`{name}`' for name in meta['component'].names), 'a file'])
    return '', '`true`, `false`' if 'flag' in meta else 'text'


def row(name: str, field: dataclasses.Field, what: str = '') -> tuple[str, ...]:
    """Return the line of one parameter; what: it is, if its source does not say so."""
    breakable = name.replace('.', '.<wbr>')
    return (f'<code>{breakable}</code>', f'`{default(field.default)}`', *_limits(field.metadata),
            '; '.join(filter(None, (what, field.metadata['source']))))


def nodes() -> dict[str, type]:
    """Return the parameter dataclass of every node, by the name of the node."""
    flown = {field.name: field.metadata['group'] for field in dataclasses.fields(Scenario)}
    return {**flown, 'recorder_node': RecorderNodeParams, 'replay_node': ReplayNodeParams,
            'natnet_server_node': NatNetServerNodeParams,
            'natnet_client_node': NatNetClientNodeParams, 'view_node': ViewNodeParams,
            'description_node': DescriptionNodeParams}


def _sections(params_type: type) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """Yield (prefix, rows) of each group of parameters that belongs together."""
    groups: dict[str, list[tuple[str, ...]]] = {}
    for name, field in schema.walk(params_type):
        groups.setdefault(name.rpartition('.')[0], []).append(
            row(name, field, describe(name)))
    yield from groups.items()


def all_parameters() -> str:
    """Return a chapter for each node and a table for each of its groups of parameters."""
    out = []
    for node, params_type in nodes().items():
        out += [f'## {node} {{: #{node} }}', '']
        for prefix, rows in _sections(params_type):
            if prefix:
                out += [f'### {prefix} {{: #{node}.{prefix} }}', '']
            out += [table(HEAD, rows), '']
    count = sum(len(dict(schema.walk(params_type))) for params_type in nodes().values())
    return '\n'.join([f'There are {count} parameters.', '', *out])


def _of(fields: dict[str, dataclasses.Field]) -> str:
    return table(HEAD, [row(name, field) for name, field in fields.items()])


def scenario_settings() -> str:
    """Return the keys of a scenario file."""
    return _of(scenario_file.FIELDS)


def sweep_settings() -> str:
    """Return the keys of a sweep file besides ``vary``."""
    return _of(design.HEAD)
