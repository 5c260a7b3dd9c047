"""Files of compiled code that are not trusted: a damaged or foreign one is compiled again."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import errno
import functools
import hashlib
import io
import pickle
import sys
from typing import Any, IO
import zlib

from numba.core.caching import IndexDataCacheFile


@functools.cache
def _say_full() -> None:
    """Say, once in a process, that there is no space."""
    sys.stderr.write('mambo: no space to keep compiled code, so that it is compiled again each '
                     'time: set MAMBO_CACHE_DIR to a folder with space\n')


@contextlib.contextmanager
def without_space() -> Iterator[None]:
    """Go on without keeping compiled code on a full disk: it is compiled again next time."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        _say_full()


def _digest(key: Any) -> bytes:
    """Return a digest of types and processor, whose text is theirs in every process."""
    return hashlib.blake2b(repr(key).encode(), digest_size=8).digest()


class CheckedFile(IndexDataCacheFile):
    """
    Files of compiled code that end with their checksum: a damaged one counts as missing.

    So does one that was compiled for other types. Two commands that compile at the same time may
    write the index of the one and the code of the other.
    """

    _SIZE = 4  # bytes of the checksum

    def save(self, key: Any, data: Any) -> None:
        """Save what was compiled for a key, with a digest of the key."""
        super().save(key, (_digest(key), data))

    def load(self, key: Any) -> Any:
        """Return what was compiled for a key; None if there is nothing."""
        found = super().load(key)
        mine = isinstance(found, tuple) and len(found) == 2 and found[0] == _digest(key)
        return found[1] if mine else None

    def _read(self, path: str) -> bytes:
        """Return a file without its checksum. FileNotFoundError if it is damaged, too."""
        with open(path, 'rb') as file:
            data = file.read()
        data, checksum = data[:-self._SIZE], data[-self._SIZE:]
        if not data or checksum != self._checksum(data):
            raise FileNotFoundError(path)
        return data

    def _checksum(self, data: bytes) -> bytes:
        return zlib.crc32(data).to_bytes(self._SIZE, 'little')

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[IO[bytes]]:
        """Yield a file that is written whole, and its checksum behind it."""
        with super()._open_for_write(filepath) as file:
            whole = io.BytesIO()
            yield whole
            file.write(whole.getvalue() + self._checksum(whole.getvalue()))

    def _load_index(self) -> dict:
        """
        Return the names of what is compiled.

        Nothing if the file is damaged, or names types of a user's module that is not here.
        """
        with contextlib.suppress(FileNotFoundError, ImportError, AttributeError):
            self._read(self._index_path)
            return super()._load_index()
        return {}

    def _load_data(self, name: str) -> Any:
        """Return what is compiled. FileNotFoundError if the file is damaged."""
        return pickle.loads(self._read(self._data_path(name)))
