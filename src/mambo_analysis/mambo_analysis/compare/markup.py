"""HTML parts of every page: tables and collapsible texts, accessible by keyboard and reader."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def _row(cells: Sequence[str]) -> str:
    first, *others = (escape(cell) for cell in cells)
    return f'<tr><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in others)}</tr>'


def table(
    caption: str, head: Sequence[str], rows: Sequence[Sequence[str]],
    texts: Sequence[tuple[str, str]] = (),
) -> str:
    """
    Return a table whose first column names its rows, in a frame that scrolls if it is narrow.

    Parameters
    ----------
    caption
        Text above it, also the name of the frame.
    head, rows
        Texts of the cells, not yet escaped.
    texts
        (name, text) of rows below those, each with one text over all columns.

    """
    cells = ''.join(f'<th scope="col">{escape(name)}</th>' for name in head)
    name = escape(caption, quote=True)
    wide = ''.join(
        f'<tr><th scope="row">{escape(first)}</th>'
        f'<td class="text" colspan="{len(head) - 1}">{escape(text)}</td></tr>'
        for first, text in texts)
    return (f'<div class="scroll" tabindex="0" role="group" aria-label="{name}">'
            f'<table><caption>{name}</caption><thead><tr>{cells}</tr></thead>'
            f'<tbody>{"".join(map(_row, rows))}{wide}</tbody></table></div>')


def details(name: str, text: str) -> str:
    """Return a preformatted text, collapsed under its name."""
    return (f'<details><summary>{escape(name)}</summary><pre tabindex="0" role="group" '
            f'aria-label="{escape(name, quote=True)}">{escape(text)}</pre></details>')
