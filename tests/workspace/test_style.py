"""How the code is written: what ruff checks, and what it does not."""

import ast
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]
FILES = [
    file for folder in ('benchmarks', 'examples', 'src', 'tests', 'tools')
    for file in sorted((ROOT / folder).rglob('*.py'))
] + [ROOT / 'conftest.py', ROOT / 'tools/ros2']
SOURCES = [file for file in FILES if not {'test', 'tests'} & set(file.relative_to(ROOT).parts)]


def short(file):
    return str(file.relative_to(ROOT))


@pytest.mark.skipif(shutil.which('ruff') is None, reason='ruff is not installed')
def test_ruff_has_nothing_to_say():
    done = subprocess.run(['ruff', 'check', '--output-format', 'concise', '.'], cwd=ROOT,
                          text=True, capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr


def import_key(node, name):
    """Return where an import belongs: future, standard library, others, own package; by name."""
    if isinstance(node, ast.ImportFrom):
        name = '.' * node.level + (node.module or '')
    if name.startswith('.'):
        return 3, name.lower()
    if name == '__future__':
        return 0, ''
    return (1 if name.split('.')[0] in sys.stdlib_module_names else 2), name.lower()


def blocks(tree):
    """Yield the runs of import statements of a module."""
    block = []
    for node in [*tree.body, None]:
        if isinstance(node, ast.Import | ast.ImportFrom):
            block.append(node)
        elif block:
            yield block
            block = []


@pytest.mark.parametrize('file', FILES, ids=short)
def test_imports_are_in_order_whatever_the_case(file):
    for block in blocks(ast.parse(file.read_text())):
        keys = [import_key(node, node.names[0].name) for node in block]
        assert keys == sorted(keys), f'line {block[0].lineno}'
        for node in block:
            names = [alias.name.lower() for alias in node.names]
            assert names == sorted(names), f'line {node.lineno}'


def functions(file):
    """Yield every function of a file, with its first line after the docstring."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            documented = ast.get_docstring(node) is not None and len(node.body) > 1
            yield node, node.body[1 if documented else 0].lineno


@pytest.mark.parametrize('file', SOURCES, ids=short)
def test_a_function_fits_on_a_screen(file):
    assert not [f'{node.name} (line {node.lineno}): {node.end_lineno - first + 1} lines'
                for node, first in functions(file) if node.end_lineno - first + 1 >= 60]


def test_every_option_that_replaces_a_file_says_so_in_the_same_words():
    told, wrong = 0, []
    for file in SOURCES:
        text = re.sub(r"'\n +'", '', file.read_text())  # texts over several lines
        told += text.count('; an older file is replaced') + text.count('; older files are repl')
        wrong += [short(file)] * len(re.findall('over (?:an )?older|older ones? (?:is|are) repl',
                                                text))
    assert told >= 11 and not wrong, wrong


@pytest.mark.parametrize('file', FILES, ids=short)
def test_nothing_is_left_for_later(file):
    words = ('TO' + 'DO', 'FIX' + 'ME', 'X' * 3)
    assert not [word for word in words if word in file.read_text()]
