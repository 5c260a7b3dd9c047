"""The variables of a MATLAB file of version 7.3, which is HDF5, as scipy gives older ones."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

MISSING = ('it is of version 7.3; save it with -v7 in MATLAB first, or pip install -r '
           'requirements/logs.txt')
DAMAGED = 'it is of version 7.3; save it with -v7 in MATLAB first: its HDF5 is damaged'
DEEPEST = 8   # structures and cells in each other that are looked into


def load(content: bytes) -> dict[str, Any]:
    """
    Return the variables of a file's content: arrays, texts, dictionaries and lists of such.

    Arrays of one row or column are (n,), others have the axes of MATLAB. What is something else,
    such as a function, is None.

    Raises
    ------
    ValueError
        If h5py is not installed, or the content is damaged.

    """
    try:
        import h5py
    except ImportError:
        raise ValueError(MISSING) from None
    try:
        with h5py.File(BytesIO(content), 'r') as file:
            return {name: _value(file, file[name], 0) for name in file
                    if not name.startswith('#')  # #refs# holds what cells refer to
                    and not isinstance(file.get(name, getlink=True), h5py.ExternalLink)}
    except MemoryError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError):
        raise ValueError(DAMAGED) from None


def _value(file: Any, item: Any, depth: int) -> Any:
    """Return a group as a dictionary, or as a list of such; a dataset as what it holds."""
    if depth > DEEPEST:
        return None
    if hasattr(item, 'keys'):
        below = {name: _value(file, item[name], depth + 1) for name in item}
        # a structure of several elements has a list in each field
        counts = {len(value) if isinstance(value, list) else -1 for value in below.values()}
        if counts and counts != {-1} and len(counts) == 1 and 'MATLAB_fields' in item.attrs \
                and all(_refers(item[name]) for name in item):
            return [{name: value[i] for name, value in below.items()}
                    for i in range(counts.pop())]
        return below
    kind = bytes(item.attrs.get('MATLAB_class', b'')).decode('ascii', 'replace')
    if item.attrs.get('MATLAB_empty', 0):
        return '' if kind == 'char' else np.empty(0)
    if _refers(item):
        return [_value(file, file[one], depth + 1) for one in np.ravel(item[()], order='F')]
    if item.dtype.kind not in 'fiub':
        return None
    values = np.squeeze(np.asarray(item[()]).T)
    if kind == 'char':
        return ''.join(map(chr, np.ravel(values).tolist()))
    return values


def _refers(item: Any) -> bool:
    """Return whether a dataset holds references to others."""
    import h5py
    dtype = getattr(item, 'dtype', None)
    return dtype is not None and h5py.check_ref_dtype(dtype) is not None  # text is no reference
