"""
Take a serialised message from the middleware together with the identity of its publisher.

``rclpy`` hands over the bytes of a message, its times and its numbers, but not the global
identifier (GID) of its publisher, which the middleware knows. So a guarded input calls
``rcl_take_serialized_message`` itself, with the structures of ``rmw/types.h`` and
``rcutils/types/uint8_array.h`` of ROS 2 Jazzy.
"""

from __future__ import annotations

import ctypes
from typing import Any
import weakref

_TAKEN = 0  # RCL_RET_OK
_NOTHING = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED: there is no message
_GID = 16  # bytes, RMW_GID_STORAGE_SIZE
_ROOM = 1024  # bytes of the initial buffer; the middleware enlarges it when a message needs it


class _Gid(ctypes.Structure):
    _fields_ = [('implementation_identifier', ctypes.c_char_p), ('data', ctypes.c_uint8 * _GID)]


class _MessageInfo(ctypes.Structure):
    _fields_ = [
        ('source_timestamp', ctypes.c_int64), ('received_timestamp', ctypes.c_int64),
        ('publication_sequence_number', ctypes.c_uint64),
        ('reception_sequence_number', ctypes.c_uint64), ('publisher_gid', _Gid),
        ('from_intra_process', ctypes.c_bool)]


class _Allocator(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class _Bytes(ctypes.Structure):
    _fields_ = [('buffer', ctypes.c_void_p), ('buffer_length', ctypes.c_size_t),
                ('buffer_capacity', ctypes.c_size_t), ('allocator', _Allocator)]


# PyDLL keeps the GIL: taking a message does not block, and releasing the lock costs more
_rcl, _rcutils = ctypes.PyDLL('librcl.so'), ctypes.PyDLL('librcutils.so')
_take = _rcl.rcl_take_serialized_message
_take.argtypes = [ctypes.c_void_p] * 4
_default_allocator = _rcutils.rcutils_get_default_allocator
_default_allocator.restype = _Allocator
_init = _rcutils.rcutils_uint8_array_init
_init.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]
_fini = _rcutils.rcutils_uint8_array_fini
_fini.argtypes = [ctypes.c_void_p]
_string_at = ctypes.string_at


class MessageTaker:
    """
    Takes the serialised messages of one subscription.

    Parameters
    ----------
    handle
        Handle of an ``rclpy`` subscription; it is not destroyed while this object exists.
    largest
        Largest number of bytes of a message that are copied.

    Attributes
    ----------
    close
        Releases the subscription; done once, at the latest with this object.

    Raises
    ------
    MemoryError
        If there is no memory for a message.

    """

    def __init__(self, handle: Any, largest: int) -> None:
        handle.__enter__()
        self._handle = handle  # keeps the address valid
        self._largest = largest
        self._bytes, self._info = _Bytes(), _MessageInfo()
        allocator = _default_allocator()
        if _init(ctypes.byref(self._bytes), _ROOM, ctypes.byref(allocator)):
            raise MemoryError(f'no {_ROOM} bytes for a message')
        self._subscription = handle.pointer
        self._bytes_at, self._info_at = map(ctypes.addressof, (self._bytes, self._info))
        self._gid_at = self._info_at + _MessageInfo.publisher_gid.offset + _Gid.data.offset
        self.close = weakref.finalize(self, _release, handle, self._bytes)

    def __call__(self) -> tuple[bytes, int, bytes] | None:
        """
        Take the next message.

        Returns
        -------
        taken : (data, size, publisher) or None
            The serialised message, or the beginning of one longer than ``largest``; the size of
            the complete message in bytes; the GID of the publisher, (16,), as in
            ``TopicEndpointInfo.endpoint_gid``. None if there is no message.

        Raises
        ------
        RuntimeError
            If the middleware fails, with the code of ``rcl/types.h``.

        """
        result = _take(self._subscription, self._bytes_at, self._info_at, None)
        if result != _TAKEN:
            if result == _NOTHING:
                return None
            raise RuntimeError(f'rcl_take_serialized_message failed with code {result}')
        size = self._bytes.buffer_length
        return (_string_at(self._bytes.buffer, min(size, self._largest)), size,
                _string_at(self._gid_at, _GID))

    @property
    def number(self) -> int:
        """Return the number of the message taken last among those of its publisher."""
        return self._info.publication_sequence_number


def _release(handle: Any, data: _Bytes) -> None:
    """Release the memory and the handle of a :class:`MessageTaker`."""
    _fini(ctypes.byref(data))
    handle.__exit__(None, None, None)
