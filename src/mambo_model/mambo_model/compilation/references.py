"""
Count references only in values that can hold one.

For each value that a function is done with, numba writes code that takes it apart, number by
number, to count down the references in it. LLVM removes that code for a tuple of numbers, as
there are none. Not written at all, it leaves less to compile for a flight.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import types
from numba.core.runtime.context import NRTContext

_of_numba = NRTContext.get_meminfos


@cache
def may_refer(kind: Any) -> bool:
    """Return whether values of a numba type may hold references, as numbers do not."""
    if isinstance(kind, types.BaseTuple):
        return any(may_refer(part) for part in set(kind.types))
    return not isinstance(kind, (types.Number, types.Boolean))


def get_meminfos(self: NRTContext, builder: Any, ty: Any, val: Any) -> list[tuple]:
    """Return type and place of each reference in a value, as the method of numba does."""
    return _of_numba(self, builder, ty, val) if may_refer(ty) else []
