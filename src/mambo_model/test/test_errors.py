"""Every error of the product has one base, and an exit code that says whose fault it is."""

import ast
import builtins
from importlib import import_module
import os
from pathlib import Path

from mambo_model.errors import MamboError, readable, visible
import pytest

SRC = Path(__file__).parents[2]
ERRORS = [
    ('.'.join(file.relative_to(SRC).with_suffix('').parts[1:]), node.name)
    for file in sorted(SRC.glob('mambo_*/mambo_*/**/*.py'))
    for node in ast.parse(file.read_text()).body
    if isinstance(node, ast.ClassDef) and any(
        isinstance(base, ast.Name) and base.id.endswith(('Error', 'Exception', 'NoLayout'))
        for base in node.bases)
    and not node.name.startswith('_') and node.name not in (
        'MamboError', 'OverdueError')]  # that one is caught where it is raised


def test_the_errors_are_found():
    assert {'ParameterError', 'BagError', 'FlightError', 'IdentifyError'} <= {
        name for _, name in ERRORS}


@pytest.mark.parametrize('module, name', ERRORS)
def test_an_error_of_the_product_has_the_base_and_an_exit_code(module, name):
    error = getattr(import_module(module), name)
    assert issubclass(error, MamboError)
    assert error.exit_code in (1, 2)
    assert not hasattr(builtins, name)


def test_what_a_terminal_obeys_is_escaped_and_all_else_stays():
    assert visible('a\x1b[2Jb\u202ec\udcffd\x07\r') == r'a\x1b[2Jb\u202ec\xffd\x07\r'
    assert visible('é 飞行\t\n\\x') == 'é 飞行\t\n\\x'


def test_bytes_of_a_name_that_are_not_utf_8_are_escaped_and_all_else_stays():
    name = os.fsdecode(b'fl\xfcg \x80.csv')
    assert readable(name) == r'fl\xfcg \x80.csv'
    assert readable('\ud800\udc7f\udd00') == r'\ud800\udc7f\udd00'  # no bytes of a name
    assert readable('é 飞行 \U0001f681\t\x1b') == 'é 飞行 \U0001f681\t\x1b'
