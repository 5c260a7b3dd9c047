"""
What a page may send: where its camera is, and the values of its widgets. All else is dropped.

viser lets a client change any property of a widget, upload files, and ask for a tunnel to the
Internet that shares the page. A page of ours needs none of it, so a message of another kind, of
another property, with numbers that are not finite or with long texts never reaches viser.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
import math
from typing import Any

LARGEST = 1 << 20  # bytes of a message; a page sends some hundred
LONGEST = 2000  # characters of a text that is typed
MOST = 16  # numbers of a widget
CAMERA = {'wxyz': 4, 'position': 3, 'look_at': 3, 'up_direction': 3}
"""Vectors of a camera and how many numbers each has; its other fields are numbers."""


def _number(value: Any) -> bool:
    """Return whether a value is a finite number that a float can hold; a bool is one too."""
    try:
        return isinstance(value, int | float) and math.isfinite(float(value))
    except OverflowError:
        return False


def _numbers(value: Any, count: int | None = None) -> bool:
    """Return whether a value is a list of numbers, of a count or a few."""
    return isinstance(value, list) and all(map(_number, value)) and (
        len(value) <= MOST if count is None else len(value) == count)


def sound(message: Any) -> bool:
    """Return whether a decoded message is one that a page may send."""
    if not isinstance(message, dict):
        return False
    fields = {**message}
    kind = fields.pop('type', None)
    if kind == 'ViewerCameraMessage':
        return all(_numbers(value, CAMERA[name]) if name in CAMERA else _number(value)
                   for name, value in fields.items())
    if kind != 'GuiUpdateMessage' or fields.keys() != {'uuid', 'updates'}:
        return False
    updates = fields['updates']
    if not isinstance(fields['uuid'], str) or not isinstance(updates, dict) or (
            updates.keys() != {'value'}):
        return False
    value = updates['value']
    return len(value) <= LONGEST if isinstance(value, str) else (
        value is None or _number(value) or _numbers(value))


def screened(receive: Callable[[], Awaitable[Any]]) -> Callable[[], Awaitable[Any]]:
    """Return a ``recv`` of a websocket that passes on only what a page may send."""
    import msgspec  # of viser

    async def receive_sound() -> Any:
        """Return the next message that a page may send."""
        while True:
            data = await receive()
            try:
                if sound(msgspec.msgpack.decode(data)):
                    return data
            except (msgspec.DecodeError, TypeError, RecursionError, ValueError):
                return data  # no message at all: viser ends the connection
    return receive_sound
