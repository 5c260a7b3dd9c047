"""
Extension of griffe: how docstrings and fields of the sources are shown.

The reStructuredText of docstrings becomes Markdown, formulas become MathML. A field of a class is
described by the comment after it, a parameter by its declaration: unit, range and source. The
tuples that compiled code uses instead of parameters (``values_type``) show their fields.
"""

from __future__ import annotations

import ast
import importlib
import itertools
import re
from typing import Any

import griffe
from latex2mathml.converter import convert

_ROLE = re.compile(r':(?:attr|class|data|func|meth|mod):`~?([^`]+)`')
_LITERAL = re.compile(r'(?<!`)``(?!`)([^`]+)``(?!`)')
_FORMULA = re.compile(r':math:`([^`]+)`')
_DISPLAYED = re.compile(r'^( *)\.\. math::[ \n]((?:.+\n?)+)', re.MULTILINE)
_TABLE = re.compile(
    r'^( *)(=+(?: +=+)+ *\n(?:.*\n)*?\1=+(?: +=+)+ *\n'
    r'(?:(?:.*\S.*\n)+\1=+(?: +=+)+ *(?:\n|\Z))?)', re.MULTILINE)


def _displayed(found: re.Match[str]) -> str:
    """Return a displayed formula as MathML."""
    return f'{found[1]}{convert(" ".join(found[2].split()), display="block")}\n\n'


def _fenced(found: re.Match[str]) -> str:
    """Return a table of reStructuredText as preformatted text."""
    return f'{found[1]}```text\n{found[1]}{found[2].rstrip()}\n{found[1]}```\n'


def markdown(text: str) -> str:
    """Return a docstring as Markdown: convert roles, literals, formulas and tables."""
    text = _DISPLAYED.sub(_displayed, _TABLE.sub(_fenced, text))
    text = _FORMULA.sub(lambda found: convert(found[1]), text)
    return _LITERAL.sub(r'`\1`', _ROLE.sub(r'`\1`', text))


def _as_text(expression: ast.expr) -> str:
    """Return an argument of a declaration as text: its value, or its code."""
    try:
        return str(ast.literal_eval(expression))
    except ValueError:
        return ast.unparse(expression)


def declared(code: str) -> str:
    """Return the description of a parameter from the code of its declaration, else ''."""
    call = ast.parse(code, mode='eval').body
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute | ast.Name):
        return ''
    kind = call.func.attr if isinstance(call.func, ast.Attribute) else call.func.id
    arguments = [_as_text(argument) for argument in call.args]
    if kind == 'quantity' and len(arguments) == 5:
        return f'[{arguments[1]}] {arguments[2]} to {arguments[3]}; {arguments[4]}'
    if kind == 'choice' and len(arguments) == 3:
        return f'One of {arguments[1]}; {arguments[2]}'
    return arguments[1] if kind in ('flag', 'text') and len(arguments) == 2 else ''


def _comment(field: griffe.Attribute) -> str:
    """Return the comment after a field, with its continuation lines."""
    after = field.lines[-1].partition('  # ')[2] if field.lines else ''
    if not after:
        return ''
    follow = field.filepath.read_text(encoding='utf-8').splitlines()[field.endlineno:]
    more = itertools.takewhile(lambda line: line.lstrip().startswith('# '), follow)
    return ' '.join([after, *(line.strip(' #') for line in more)])


def _fields(found: griffe.Class) -> str:
    """Return the fields of a class as a section of its docstring, else ''."""
    lines = []
    for field in found.attributes.values():
        if field.is_alias or field.docstring or field.is_private or 'property' in field.labels:
            continue
        description = (declared(str(field.value))
                       if isinstance(field.value, griffe.ExprCall) else '')
        if description:
            field.value = field.value.arguments[0]  # the signature shows the default alone
        lines += [f'{field.name} : {field.annotation or ""}',
                  f'    {description or _comment(field) or "&nbsp;"}']
    return '\n'.join(['', '', 'Attributes', '----------', *lines]) if lines else ''


def compiled_fields(found: type) -> str:
    """Return the docstring of a NamedTuple that ``values_type`` made, with its fields."""
    lines = []
    for name, kind in found.__annotations__.items():
        shown = getattr(kind, '__forward_arg__', None) or getattr(kind, '__name__', str(kind))
        lines += [f'{name} : {shown}', f'    {getattr(found, name).__doc__}']
    return '\n'.join([found.__doc__ or '', '', 'Attributes', '----------', *lines])


class Docstrings(griffe.Extension):
    """Rewrites docstrings, and puts the fields of a class into its own."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Describe the fields of a ``values_type``."""
        made = attr.value
        if isinstance(made, griffe.ExprCall) and str(made.function) == 'values_type':
            module = importlib.import_module(attr.module.path)
            attr.docstring = griffe.Docstring(
                compiled_fields(getattr(module, attr.name)), parent=attr, parser='numpy',
                parser_options={'warn_unknown_params': False, 'warn_missing_types': False})

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Describe the fields of a class."""
        if cls.docstring and '\nAttributes\n---' not in cls.docstring.value:
            cls.docstring.value += _fields(cls)

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring:
            obj.docstring.value = markdown(obj.docstring.value)
