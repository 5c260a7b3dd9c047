"""Every file and function that the pages name exists."""

import ast
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[2]
LAYOUT = ROOT / 'docs/explanation/layout.md'
EQUATIONS = ROOT / 'docs/reference/equations.md'
NAME = re.compile(r'`([a-z_0-9.]+)`', re.IGNORECASE)


def defined(file):
    """Return the names of the functions, classes and constants of a module."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def rows(page, header):
    """Yield the cells of each row below a header of a page's tables."""
    inside = False
    for line in page.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip().strip('|').split('|')]
        if cells[:len(header)] == header:
            inside = True
        elif not line.startswith('|'):
            inside = False
        elif inside and set(cells[0]) - set('-'):
            yield cells


@pytest.mark.parametrize('row', list(rows(LAYOUT, ['you look for', 'file', 'name'])),
                         ids=lambda row: row[0])
def test_a_topic_is_in_the_file_that_the_layout_names(row):
    _, file, name = row
    assert name.strip('`') in defined(ROOT / file.strip('`'))


def test_the_layout_has_the_topics_that_readers_look_for():
    assert len(list(rows(LAYOUT, ['you look for', 'file', 'name']))) >= 15


MODULES = {}
for module in (ROOT / 'src').glob('*/*/**/*.py'):
    if 'test' not in module.relative_to(ROOT).parts:
        MODULES.setdefault(module.stem, []).append(module)


@pytest.mark.parametrize('row', list(rows(EQUATIONS, ['equation', 'what', 'function'])),
                         ids=lambda row: row[0])
def test_an_equation_is_in_the_function_that_the_page_names(row):
    for name in NAME.findall(row[2]):
        *_, module, function = ['', *name.split('.')]
        if module in MODULES:
            assert any(function in defined(file) for file in MODULES[module]), name
        else:
            assert module == '' or name.startswith(('plant.', 'src')), name
