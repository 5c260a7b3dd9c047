"""Pieces of HTML that every page has: tables and folded texts, usable by keyboard and reader."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def _row(cells: Sequence[str]) -> str:
    first, *others = (escape(cell) for cell in cells)
    return f'<tr><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in others)}</tr>'


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """
    Return a table whose first column names its rows, in a frame that scrolls if it is narrow.

    Parameters
    ----------
    caption
        Text above it, also the name of the frame.
    head, rows
        Texts of the cells, not yet escaped.

    """
    cells = ''.join(f'<th scope="col">{escape(name)}</th>' for name in head)
    name = escape(caption, quote=True)
    return (f'<div class="scroll" tabindex="0" role="group" aria-label="{name}">'
            f'<table><caption>{name}</caption><thead><tr>{cells}</tr></thead>'
            f'<tbody>{"".join(map(_row, rows))}</tbody></table></div>')


def details(name: str, text: str) -> str:
    """Return a text as it is, folded under its name."""
    return (f'<details><summary>{escape(name)}</summary><pre tabindex="0" role="group" '
            f'aria-label="{escape(name, quote=True)}">{escape(text)}</pre></details>')
