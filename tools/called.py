"""
Which functions of the product any of its programs calls, by the names in the code.

The programs are the entry points of ``setup.py``, what a module does when it is imported, launch
files, tools and examples. From there every name that a reached function mentions reaches all
functions, classes and methods of that name: too many rather than too few, so that what is not
reached is dead.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
import re
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
_PROGRAMS = ('src/*/setup.py', 'src/*/launch/*.py', 'tools/**/*.py', 'examples/**/*.py',
             'benchmarks/**/*.py', 'docs/**/*.py')
# decorators behind which a function is still to be called by its name; others register it
_PLAIN = {'jit', 'jit_inside', 'property', 'staticmethod', 'classmethod', 'cached_property',
          'contextmanager', 'lru_cache', 'cache', 'dataclass', 'setter'}
_DEFINED = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


class Definition(NamedTuple):
    """A function, method or class of the product."""

    file: Path
    name: str
    first: int  # line
    last: int
    uses: frozenset[str]


def _names(nodes: Iterable[ast.AST]) -> set[str]:
    """Return the names in code, those of nested functions too, without imports and docstrings."""
    out: set[str] = set()
    for top in nodes:
        for node in ast.walk(top):
            if isinstance(node, ast.Name):
                out.add(node.id)
            elif isinstance(node, ast.Attribute):
                out.add(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                if len(node.value) < 200:  # 'module:function', getattr, names in tables
                    out |= set(re.findall(r'\w+', node.value))
    return out


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(
        node.value.value, str)


def _walk(file: Path, body: list[ast.stmt], loose: set[str]) -> Iterator[Definition]:
    """Yield the definitions of a module or class; add what runs when it is imported to loose."""
    for node in body:
        if isinstance(node, _DEFINED):
            loose |= _names(node.decorator_list)
            if node.decorator_list and not _names(node.decorator_list) & _PLAIN:
                loose.add(node.name)
            if isinstance(node, ast.ClassDef):
                inside: set[str] = set()
                for method in (methods := list(_walk(file, node.body, inside))):
                    if node.bases or method.name.startswith('__'):
                        # Python and the base call some by themselves
                        inside |= {method.name} | method.uses
                yield from methods
                inside |= _names([*node.bases, *node.keywords])
            else:
                inside = _names(
                    part for part in (*node.body, node.args, node.returns)
                    if part is not None and not _is_docstring(part))
            yield Definition(file, node.name, node.lineno, node.end_lineno or node.lineno,
                             frozenset(inside))
        elif not isinstance(node, ast.Import | ast.ImportFrom) and not _is_docstring(node):
            loose |= _names([node])


def read(root: Path = ROOT) -> tuple[list[Definition], set[str]]:
    """Return every definition of the packages, and the names that the programs mention."""
    found: list[Definition] = []
    roots: set[str] = set()
    for file in sorted(root.glob('src/*/mambo_*/**/*.py')):
        found += _walk(file, ast.parse(file.read_text()).body, roots)
    for pattern in _PROGRAMS:
        for file in root.glob(pattern):
            roots |= _names([ast.parse(file.read_text())])
    return found, roots


def uncalled(definitions: list[Definition], roots: set[str]) -> list[Definition]:
    """Return the definitions that no program reaches; methods that Python calls do not count."""
    by_name: dict[str, list[Definition]] = {}
    for definition in definitions:
        by_name.setdefault(definition.name, []).append(definition)
    reached, left = set(roots), set(roots)
    while left:
        for definition in by_name.get(left.pop(), []):
            new = definition.uses - reached
            reached |= new
            left |= new
    return [definition for definition in definitions
            if definition.name not in reached and not definition.name.startswith('__')]
