"""Files of compiled code that are not trusted: a damaged one is compiled again."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import io
import pickle
from typing import Any, IO
import zlib

from numba.core.caching import IndexDataCacheFile


class CheckedFile(IndexDataCacheFile):
    """Files of compiled code that end with their checksum: a damaged one counts as missing."""

    _SIZE = 4  # bytes of the checksum

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
