"""
YAML read with its line numbers, so that errors name file, line and key.

For the files that people write, vehicles and scenarios, and for the YAML inside bags. A text of a
few hundred bytes can nest deeper than a parser's stack and, by aliases, expand to terabytes. It is
therefore read through :func:`load` and :func:`compose`, which measure it before they build it.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
import re
from typing import Any, NoReturn

import yaml

from . import limits
from .errors import readable
from .schema import check_field, ParameterError, shown

_BYTES = 160  # characters of a text for each node that it may have

WORDS = yaml.SafeLoader.bool_values  # true and false, and the other words of YAML 1.1


class Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):
    """
    Safe, and reads 1e-3 as a number, as ROS does; YAML 1.1 wants 1.0e-3.

    Eight times faster where PyYAML has been compiled with its library.
    """


Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+.0123456789'))


class _Dumper(yaml.SafeDumper):
    """Writes texts so that they can be read again: YAML has no surrogates, not even escaped."""


_Dumper.add_representer(
    str, lambda dumper, text: yaml.SafeDumper.represent_str(dumper, readable(text)))


def dump(data: Any, **options: Any) -> str:
    """
    Return data as YAML, mappings in their order; names that are not UTF-8 are made readable.

    Parameters
    ----------
    data
        Numbers, texts, lists and mappings.
    **options
        As of ``yaml.dump``.

    Raises
    ------
    yaml.YAMLError
        For data of another type.

    """
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, **options)


def dump_value(value: Any) -> str:
    """Return one value as YAML in one line, to stand behind its name."""
    # as a list: PyYAML ends a single scalar with a marker
    return dump([value], default_flow_style=True, width=10 ** 9)[1:-2]


def _measure(text: str) -> None:
    """Raise YAMLError where a text nests too deep, or has too many nodes with its aliases."""
    most, deepest = limits.YAML_NODES.value(), limits.YAML_DEPTH.value()
    if len(text) > _BYTES * most:
        raise yaml.YAMLError(
            f'longer than {_BYTES * most} characters; {limits.raised_by(limits.YAML_NODES)}')
    count, opened, sizes = 0, [], {}  # nodes so far, [(anchor, count before)], {anchor: nodes}
    for event in yaml.parse(text, Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append((event.anchor, count))
            count += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            sizes[anchor] = count - before
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            sizes[event.anchor] = 1
        elif isinstance(event, yaml.AliasEvent):
            if any(anchor == event.anchor for anchor, _ in opened):
                raise yaml.MarkedYAMLError(
                    problem=f'alias {event.anchor} refers to the node that contains it',
                    problem_mark=event.start_mark)
            count += sizes.get(event.anchor, 1)
        if len(opened) > deepest or count > most:
            raise yaml.MarkedYAMLError(
                problem=f'nested deeper than {deepest} levels; '
                f'{limits.raised_by(limits.YAML_DEPTH)}' if len(opened) > deepest else
                f'more than {most} values, those of its aliases counted; '
                f'{limits.raised_by(limits.YAML_NODES)}', problem_mark=event.start_mark)


def compose(text: str) -> yaml.Node | None:
    """Return the outermost node of a text of bounded size; yaml.YAMLError if it is not valid."""
    _measure(text)
    return yaml.compose(text, Loader)


def load(text: str) -> Any:
    """Return the value of a text of bounded size; yaml.YAMLError if it is not valid."""
    _measure(text)
    try:
        return yaml.load(text, Loader)  # a safe one
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # a tag, a date or a number that is not valid
        raise yaml.YAMLError(str(error)) from None


def reason(error: yaml.YAMLError) -> str:
    """Return the reason for an error in one line."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f'line {error.problem_mark.line + 1}: {error.problem}'
    return ' '.join(str(error).split())[:200]


def read_text(path: Path) -> str:
    """
    Return the text of a file to be read as YAML.

    Raises
    ------
    ParameterError
        If there is no such file, or if it is not text or too long.

    """
    most = _BYTES * limits.YAML_NODES.value()
    limits.check_regular(path)
    try:
        with path.open(encoding='utf-8') as stream:
            text = stream.read(most + 1)
    except OSError as error:
        raise ParameterError(f'{_shown(path)}: {error.strerror}') from None
    except UnicodeDecodeError:
        raise ParameterError(f'{path}: not a text file') from None
    except ValueError:  # a path with a zero
        raise ParameterError(f'{_shown(path)}: not a file name') from None
    if len(text) > most:
        raise ParameterError(
            f'{path}: longer than {most} characters; {limits.raised_by(limits.YAML_NODES)}')
    return text


def _shown(path: Path) -> str:
    """Return a path for a message, in one line of bounded length."""
    text = repr(str(path))[1:-1]
    return text if len(text) <= 200 else f'{text[:60]}...{text[-60:]}'


class Reader:
    """Reads the nodes of a file or of a named text, and names file and line in errors."""

    def __init__(self, path: Path | str) -> None:
        self.path = path

    def root(self) -> yaml.MappingNode:
        """
        Return the root node of the file.

        Raises
        ------
        ParameterError
            If there is no such file, or it does not hold names and values.

        """
        return self.parse(read_text(Path(self.path)))

    def parse(self, text: str) -> yaml.MappingNode:
        """Return the root node of a text; errors as for :meth:`root`."""
        try:
            root = compose(text)
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise ParameterError(f'{self.path}:{line}: not valid YAML: {error.problem}') from None
        except yaml.YAMLError as error:
            is_text = not isinstance(error, yaml.reader.ReaderError)
            what = reason(error) if is_text else 'not a text file'
            raise ParameterError(f'{self.path}: {what}') from None
        if not isinstance(root, yaml.MappingNode):
            raise ParameterError(f'{self.path}: must hold names and values')
        return root

    def where(self, node: yaml.Node) -> str:
        """Return file and line of a node."""
        return f'{self.path}:{node.start_mark.line + 1}'

    def fail(self, node: yaml.Node, key: str, reason: str) -> NoReturn:
        """Raise ParameterError naming file, line and key."""
        raise ParameterError(f'{self.where(node)}: {key[:200]}: {reason[:1000]}')

    def mapping(self, node: yaml.Node, name: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Return {key: (its node, the node of its value)}; ParameterError for a duplicate key."""
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, name, 'must hold names and values')
        out: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            word = self.text(key, name)
            if word in out:
                self.fail(key, word, 'duplicate key')
            out[word] = (key, value)
        return out

    def text(self, node: yaml.Node, name: str) -> str:
        """Return the text of a scalar node that is not empty."""
        if not isinstance(node, yaml.ScalarNode) or not node.value.strip():
            self.fail(node, name, 'must be text')
        return node.value

    def number(self, node: yaml.Node, name: str) -> float:
        """Return a number; 1e-4, which YAML 1.1 takes for text, is one too."""
        word = self.text(node, name)
        try:
            return float(word)
        except ValueError:
            self.fail(node, name, f'{shown(word)} is not a number')

    def numbers(self, node: yaml.Node, name: str, count: int) -> tuple[float, ...]:
        """Return a list of ``count`` numbers."""
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != count:
            self.fail(node, name, f'must be {count} numbers: [...]')
        return tuple(self.number(element, name) for element in node.value)

    def leaf(self, owner: str, name: str, field: dataclasses.Field, node: yaml.Node) -> Any:
        """Return the checked value of a field; errors name it as :func:`check_field` does."""
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
        elif 'component' in field.metadata:
            out = field.metadata['component'].absolute(
                self.text(node, name), Path(self.path).parent)
        else:
            out = self.text(node, name)
        try:
            check_field(owner, field, out)
        except ParameterError as error:
            raise ParameterError(f'{self.where(node)}: {error}') from None
        return out
