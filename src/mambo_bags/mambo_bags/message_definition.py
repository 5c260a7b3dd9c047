"""Definitions and type hashes of ROS messages, looked up in the ament prefixes."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re

from mambo_model.errors import MamboError

SEPARATOR = '=' * 80
MAX_DEPTH = 50  # rosbag2's own limit
PRIMITIVES = frozenset((
    'bool', 'byte', 'char', 'float32', 'float64', 'int8', 'uint8', 'int16', 'uint16', 'int32',
    'uint32', 'int64', 'uint64', 'string', 'wstring'))
TYPE_NAME = re.compile(r'([a-zA-Z0-9_]+)/(?:msg/)?([a-zA-Z0-9_]+)')
FIELD_TYPE = re.compile(r'^[ \t]*([a-zA-Z0-9_/]+)(?:<=\d+)?(?:\[[^\]]*\])?[ \t]+', re.MULTILINE)


class DefinitionError(MamboError, ValueError):
    """A message type has no readable definition; the message names it and what to do."""


def _split(type_name: str) -> tuple[str, str]:
    match = TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise DefinitionError(
            f'{type_name!r} is not a message type: expected package/msg/Name')
    return match[1], match[2]


def find_file(type_name: str, suffix: str) -> Path:
    """
    Return ``share/<package>/msg/<Name><suffix>`` of the first ament prefix that has it.

    Raises
    ------
    DefinitionError
        If no prefix of AMENT_PREFIX_PATH has it.

    """
    package, name = _split(type_name)
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        path = Path(prefix) / 'share' / package / 'msg' / f'{name}{suffix}'
        if prefix and path.is_file():
            return path
    raise DefinitionError(
        f'no definition of {type_name} ({package}/msg/{name}{suffix}) in AMENT_PREFIX_PATH: '
        'source ROS and this workspace (env.bash) first')


def dependencies(text: str, package: str) -> list[str]:
    """Return the message types (``package/Name``, sorted) used by the fields of a .msg text."""
    lines = '\n'.join(line.partition('#')[0] + ' ' for line in text.splitlines())
    found = {match[1] for match in FIELD_TYPE.finditer(lines)} - PRIMITIVES
    return sorted(name if '/' in name else f'{package}/{name}' for name in found)


def full_text(type_name: str) -> str:
    """
    Return the ``ros2msg`` schema of a type as rosbag2 writes it.

    The root's .msg text, then each message it needs, depth first and once each, preceded by a
    line of 80 equal signs and ``MSG: package/Name``.

    Raises
    ------
    DefinitionError
        If a definition is missing or the nesting is deeper than rosbag2 allows.

    """
    seen: set[str] = set()

    def append(name: str, depth: int) -> str:
        """Return a definition followed by those it needs that have not been added yet."""
        if depth > MAX_DEPTH:
            raise DefinitionError(f'{type_name}: definitions nested deeper than {MAX_DEPTH}')
        package, _ = _split(name)
        text = find_file(name, '.msg').read_text(encoding='utf-8')
        result = text
        for needed in dependencies(text, package):
            if needed not in seen:
                seen.add(needed)
                result += f'\n{SEPARATOR}\nMSG: {needed}\n' + append(needed, depth + 1)
        return result

    return append(type_name, 1)


def type_hash(type_name: str) -> str:
    """
    Return the REP-2016 hash (``RIHS01_...``) from the installed type description.

    Raises
    ------
    DefinitionError
        If the description is missing or does not hold the type.

    """
    path = find_file(type_name, '.json')
    package, name = _split(type_name)
    try:
        hashes = {entry['type_name']: entry['hash_string']
                  for entry in json.loads(path.read_text(encoding='utf-8'))['type_hashes']}
        return hashes[f'{package}/msg/{name}']
    except (ValueError, KeyError, TypeError) as error:
        raise DefinitionError(
            f'{path}: no type hash of {type_name}: rebuild {package}') from error
