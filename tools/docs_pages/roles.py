"""Extension of griffe: the reStructuredText of docstrings becomes Markdown, formulas MathML."""

from __future__ import annotations

import re
from typing import Any

import griffe
from latex2mathml.converter import convert

_ROLE = re.compile(r':(?:attr|class|data|func|meth|mod):`~?([^`]+)`')
_LITERAL = re.compile(r'(?<!`)``(?!`)([^`]+)``(?!`)')
_FORMULA = re.compile(r':math:`([^`]+)`')
_DISPLAYED = re.compile(r'^( *)\.\. math::[ \n]((?:.+\n?)+)', re.MULTILINE)
_TABLE = re.compile(r'^( *)(=+(?: +=+)+ *\n(?:.*\n)*?\1=+(?: +=+)+ *\n(?:(?:.*\S.*\n)+\1=+(?: +=+)+'
                    r' *(?:\n|\Z))?)', re.MULTILINE)


def _displayed(found: re.Match[str]) -> str:
    """Return a displayed formula; a comma and a backslash part it, as print does."""
    return f'{found[1]}{convert(" ".join(found[2].split()), display="block")}\n\n'


def _fenced(found: re.Match[str]) -> str:
    """Return a table of reStructuredText as it stands."""
    return f'{found[1]}```text\n{found[1]}{found[2].rstrip()}\n{found[1]}```\n'


def markdown(text: str) -> str:
    """Return a docstring with its roles, literals, formulas and tables as Markdown has them."""
    text = _DISPLAYED.sub(_displayed, _TABLE.sub(_fenced, text))
    text = _FORMULA.sub(lambda found: convert(found[1]), text)
    return _LITERAL.sub(r'`\1`', _ROLE.sub(r'`\1`', text))


class Roles(griffe.Extension):
    """Rewrites each docstring when its object has been read."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring:
            obj.docstring.value = markdown(obj.docstring.value)
