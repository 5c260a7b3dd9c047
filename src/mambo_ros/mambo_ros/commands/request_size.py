"""
Service requests whose size is checked before they become Python objects.

rclpy converts a request element by element, 25 us for each parameter, before it calls anybody: one
of 200 000 parameters would keep a node from its steps for five seconds. Here the generated C
structure of the request is looked at first. This needs requests that begin with a sequence, as
those of the parameter services of ``rcl_interfaces`` do.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

_Converter = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_pointer = ctypes.pythonapi.PyCapsule_GetPointer
_pointer.restype, _pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
_capsule = ctypes.pythonapi.PyCapsule_New
_capsule.restype = ctypes.py_object
_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]

STRING = (3, (1,))
"""Words of an element of a sequence of strings, and which of them are lengths."""
PARAMETER = (24, (1, 7, 10, 13, 16, 19, 22))
"""The same of ``rcl_interfaces/Parameter``: its name, its string and its five arrays."""


class TooLarge:
    """
    A request that was not read.

    Attributes
    ----------
    reason : str
        What of it is too large.
    count : int
        Elements that it begins with.

    """

    def __init__(self, reason: str, count: int) -> None:
        self.reason, self.count = reason, count


def bounded(srv_type: Any, element: tuple[int, tuple[int, ...]], most: int, largest: int,
            what: str) -> Any:
    """
    Return a service type whose requests are read only where they are small.

    Parameters
    ----------
    srv_type
        Generated class of the service.
    element
        ``STRING`` or ``PARAMETER``: what the sequence at the beginning of the request holds.
    most
        Elements.
    largest
        Characters and elements of arrays in all of them.
    what
        Name of the elements, in the plural.

    Returns
    -------
    type
        To be used as ``srv_type`` of a ``rclpy.service.Service``, whose callback then gets a
        :class:`TooLarge` in place of a request that is too large.

    """
    generated = type(srv_type.Request)
    convert = _Converter(_pointer(generated._CONVERT_TO_PY, None))

    def read(address: int) -> Any:
        """Convert the request at an address, as rclpy asks."""
        try:
            first, count = (ctypes.c_size_t * 2).from_address(address)
            if count > most:
                return TooLarge(f'more than {most} {what} in one request', count)
            if _length(first, count, *element) > largest:
                return TooLarge(f'more than {largest} characters and numbers in one request',
                                count)
            return convert(address)
        except Exception as error:  # nothing above this could report it
            return TooLarge(f'the request cannot be read: {error}', 0)

    kept = _Converter(read)
    request = type(generated)('BoundedRequestType', (type,), {
        '_CREATE_ROS_MESSAGE': generated._CREATE_ROS_MESSAGE,
        '_DESTROY_ROS_MESSAGE': generated._DESTROY_ROS_MESSAGE,
        '_CONVERT_TO_PY': _capsule(ctypes.cast(kept, ctypes.c_void_p), None, None),
        '_kept': kept})
    return type('BoundedService', (), {
        'Request': request('BoundedRequest', (), {}), 'Response': srv_type.Response})


def _length(first: int, count: int, words: int, lengths: tuple[int, ...]) -> int:
    """Return how many characters and numbers so many elements hold, the first at an address."""
    if not count:
        return 0
    block = (ctypes.c_size_t * (count * words)).from_address(first)
    return int(np.frombuffer(block, np.uintp).reshape(count, words)[:, lengths].sum())
