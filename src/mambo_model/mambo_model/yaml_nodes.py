"""
YAML read with its line numbers, so that what is wrong is named by file, line and key.

For the files that people write: vehicles and scenarios.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
import re
from typing import Any, NoReturn

import yaml

from .schema import check_field, ParameterError

WORDS = yaml.SafeLoader.bool_values  # true and false, and the other words of YAML 1.1


class Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):
    """
    Safe, and reads 1e-3 as a number, as ROS does; YAML 1.1 wants 1.0e-3.

    Eight times faster where PyYAML has been compiled with its library.
    """


Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+.0123456789'))


class Reader:
    """Walks the nodes of one file, or of a text with a name, and knows where they are."""

    def __init__(self, path: Path | str) -> None:
        self.path = path

    def root(self) -> yaml.MappingNode:
        """
        Return the outermost node of the file.

        Raises
        ------
        ParameterError
            If there is no such file, or none of names and values.

        """
        try:
            return self.parse(Path(self.path).read_text(encoding='utf-8'))
        except OSError as error:
            raise ParameterError(f'{self.path}: {error.strerror}') from None
        except UnicodeDecodeError:
            raise ParameterError(f'{self.path}: not a text file') from None

    def parse(self, text: str) -> yaml.MappingNode:
        """Return the outermost node of a text; errors as those of :meth:`root`."""
        try:
            root = yaml.compose(text, Loader)
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1
            raise ParameterError(f'{self.path}:{line}: no YAML: {error.problem}') from None
        except yaml.YAMLError:
            raise ParameterError(f'{self.path}: not a text file') from None
        if not isinstance(root, yaml.MappingNode):
            raise ParameterError(f'{self.path}: holds no names and values')
        return root

    def where(self, node: yaml.Node) -> str:
        """Return file and line of a node."""
        return f'{self.path}:{node.start_mark.line + 1}'

    def fail(self, node: yaml.Node, key: str, reason: str) -> NoReturn:
        """Raise ParameterError naming file, line and key."""
        raise ParameterError(f'{self.where(node)}: {key}: {reason}')

    def mapping(self, node: yaml.Node, name: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Return {key: (its node, the node of its value)}; a key may stand there once."""
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, name, 'must hold names and values')
        out: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            word = self.text(key, name)
            if word in out:
                self.fail(key, word, 'stands there twice')
            out[word] = (key, value)
        return out

    def text(self, node: yaml.Node, name: str) -> str:
        """Return a word."""
        if not isinstance(node, yaml.ScalarNode) or not node.value.strip():
            self.fail(node, name, 'must be text')
        return node.value

    def number(self, node: yaml.Node, name: str) -> float:
        """Return a number; YAML takes 1e-4 for text, people do not."""
        word = self.text(node, name)
        try:
            return float(word)
        except ValueError:
            self.fail(node, name, f'{word!r} is not a number')

    def numbers(self, node: yaml.Node, name: str, count: int) -> tuple[float, ...]:
        """Return a list of so many numbers."""
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != count:
            self.fail(node, name, f'must be {count} numbers: [...]')
        return tuple(self.number(element, name) for element in node.value)

    def leaf(self, owner: str, name: str, field: dataclasses.Field, node: yaml.Node) -> Any:
        """Return the checked value of a field of the schema; errors name it under ``owner``."""
        if isinstance(field.default, tuple):
            out: Any = self.numbers(node, name, len(field.default))
        elif isinstance(field.default, int) and 'unit' in field.metadata:
            number = self.number(node, name)
            out = int(number) if number.is_integer() else number
        elif 'unit' in field.metadata:
            out = self.number(node, name)
        elif 'flag' in field.metadata:
            out = WORDS.get(self.text(node, name).lower(), node.value)
        elif isinstance(node, yaml.ScalarNode) and 'text' in field.metadata:
            out = node.value
        else:
            out = self.text(node, name)
        try:
            check_field(owner, field, out)
        except ParameterError as error:
            raise ParameterError(f'{self.where(node)}: {error}') from None
        return out
