"""Decompression of rosbag2's zstd modes: whole files, or each message by itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from mambo_model import limits
import zstandard

ZSTD = b'\x28\xb5\x2f\xfd'
"""First bytes of a zstd frame; a CDR message begins with a zero."""
_PIECE = 1 << 20
_STEP = 4096  # bytes of a piece, which bounds the output before it is counted


def is_compressed(path: Path) -> bool:
    """Return whether a file begins with a zstd frame."""
    with path.open('rb') as stream:
        return stream.read(4) == ZSTD


def unpack(source: Path, target: Path) -> None:
    """
    Decompress a file.

    Raises
    ------
    ValueError
        If it is damaged, truncated or unpacks to more than ``MAMBO_MAX_UNPACKED_MB`` (default 512)
        or 20 times its size, whichever is more.

    """
    most = limits.unpacked(source.stat().st_size)
    with source.open('rb') as packed, target.open('wb') as out:
        for data in _plain(iter(lambda: packed.read(_PIECE), b''), most):
            out.write(data)


def message(data: bytes, most: int) -> bytes:
    """
    Return a message as it was sent, decompressed if necessary.

    Parameters
    ----------
    data
        Bytes as recorded.
    most : byte
        Largest accepted size.

    Raises
    ------
    ValueError
        If its compression is damaged or truncated, or it unpacks to more than ``most``.

    """
    if not data.startswith(ZSTD):
        return data
    try:
        return b''.join(_plain([data], most))
    except ValueError as error:
        raise ValueError(f'a compressed message: {error}') from None


def _plain(pieces: Iterable[bytes], most: int) -> Iterator[bytes]:
    """Yield decompressed pieces; ValueError if damaged or larger than ``most``."""
    decompressor, size = zstandard.ZstdDecompressor().decompressobj(), 0
    try:
        for piece in pieces:
            for begin in range(0, len(piece), _STEP):
                if decompressor.eof:
                    return
                data = decompressor.decompress(piece[begin:begin + _STEP])
                size += len(data)
                if size > most:
                    raise ValueError(f'it unpacks to more than {most / 1e6:.0f} MB; '
                                     f'{limits.raised_by(limits.UNPACKED_MB)}')
                yield data
    except zstandard.ZstdError as error:
        raise ValueError(f'damaged compression ({error})') from None
    if not decompressor.eof:
        raise ValueError('its compression is cut off')
