"""Every file, function and command that the pages name exists."""

import ast
import importlib
from pathlib import Path
import re
import shlex

from mambo_bringup import mambo
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


PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
COMMAND = re.compile(r'(?:\./)?mambo [a-z].*')
BLOCK = re.compile(r'^```bash[^\n]*\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def commands(text):
    """Return the command lines of a page, in the text and in blocks, without what follows them."""
    found = re.findall(r'`((?:\./)?mambo [a-z][^`\n]*)`', text)
    indented = '\n'.join(line.strip() for line in text.splitlines() if line.startswith('    '))
    for block in (*BLOCK.findall(text), indented):
        found += [line for line in block.replace('\\\n', ' ').splitlines()
                  if COMMAND.fullmatch(line)]
    return [re.split(r' (?:#|\||&&|>|--(?= )) ?|;', line)[0] for line in found]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_a_command_of_a_page_is_one_with_options_that_it_has(page, capsys):
    for line in commands(page.read_text()):
        name, rest = mambo.find(shlex.split(line)[1:])  # LookupError: no such command
        entry = mambo.COMMANDS[name]
        if not rest or mambo.is_script(entry):
            continue  # the name alone
        try:
            importlib.import_module(entry.module).parser().parse_args(rest)
        except SystemExit as end:
            assert not end.code, f'{line}: {capsys.readouterr().err}'


def test_commands_are_found_in_text_and_blocks():
    text = ('call `mambo fly x -o y`:\n\n    mambo run  # now\n\n```bash\nmambo a \\\n  b > c\n'
            'ls mambo\n```\n')
    assert commands(text) == ['mambo fly x -o y', 'mambo a    b', 'mambo run ']
