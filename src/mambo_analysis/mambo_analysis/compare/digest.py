"""Digest of the content of a figure, stored in its PNG to detect a stale figure."""

from __future__ import annotations

from collections.abc import Iterator
import hashlib
from pathlib import Path
import struct

from mambo_model.whole_file import PICTURE, replacing
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
import numpy as np

KEY = 'Shows'
"""Name of the text in the PNG."""
DIGITS = 6  # of numbers: the last bits may differ between machines


def _numbers(values: object) -> str:
    return np.array2string(np.round(np.asarray(values, float), DIGITS) + 0.0, threshold=2**31,
                           floatmode='maxprec')


def _parts(axes: Axes) -> Iterator[str]:
    """Yield the content drawn into axes, without what matplotlib chooses, such as ticks."""
    yield from (axes.get_xlabel(), axes.get_ylabel())
    yield from (axes.get_title(loc) for loc in ('left', 'center', 'right'))
    for line in axes.lines:
        yield f'{line.get_label()} {to_hex(line.get_color())} {line.get_linestyle()}'
        yield f'{line.get_marker()} {line.get_linewidth()} {_numbers(line.get_xydata())}'
    for patch in axes.patches:
        yield f'{to_hex(patch.get_edgecolor())} {to_hex(patch.get_facecolor(), True)}'
        yield _numbers(patch.get_path().transformed(patch.get_patch_transform()).vertices)
    for collection in axes.collections:
        yield str([to_hex(colour, True) for colour in collection.get_facecolor()])
        yield from (_numbers(path.vertices) for path in collection.get_paths())
    yield from (text.get_text() for text in axes.texts)


def digest(figure: Figure) -> str:
    """Return 16 hexadecimal digits that change with anything that a figure shows."""
    out = hashlib.sha256()
    for axes in figure.get_axes():
        for part in _parts(axes):
            out.update(part.encode() + b'\0')
    return out.hexdigest()[:16]


def of_text(*texts: str) -> str:
    """Return 16 hexadecimal digits that change with any of some texts."""
    return hashlib.sha256('\0'.join(texts).encode()).hexdigest()[:16]


def save(figure: Figure, path: Path, dpi: float, shows: str = '') -> None:
    """Save a figure as PNG with a digest of its content."""
    with replacing(path, PICTURE) as part:
        figure.savefig(part, format='png', dpi=dpi,
                       metadata={'Software': None, KEY: shows or digest(figure)})


def saved(path: Path) -> str | None:
    """
    Return the digest stored in a PNG; None if it has none.

    Raises
    ------
    OSError
        If it cannot be read.

    """
    data, at = path.read_bytes(), 8
    while at + 8 <= len(data):
        length, kind = struct.unpack_from('>I4s', data, at)
        if at + 12 + length > len(data):  # the file ends inside this chunk
            return None
        key, _, text = data[at + 8:at + 8 + length].partition(b'\0')
        if kind == b'tEXt' and key == KEY.encode():
            return text.decode('latin-1')
        at += length + 12
    return None
