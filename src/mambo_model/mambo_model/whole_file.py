"""Atomic writing: a file is written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import os
from pathlib import Path

from .errors import InputError, JobError


def is_wrong_path(error: OSError) -> bool:
    """Return whether the path itself is wrong: the user's to mend, not the disk's."""
    return isinstance(error, (
        FileExistsError, FileNotFoundError, IsADirectoryError, NotADirectoryError,
        PermissionError)) or error.errno in (errno.ENAMETOOLONG, errno.ELOOP)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """
    Yield a temporary path to write to; at the end it is renamed to the given path in one step.

    Missing folders are created. A path that is not a regular file, such as ``/dev/stdout``, is
    written to directly.

    Parameters
    ----------
    path
        Path of the file; an older file is replaced, a link is followed.

    Raises
    ------
    InputError
        If the path cannot be a file.
    JobError
        If writing fails, for example because the disk is full. An older file is then unchanged.

    """
    target = Path(os.path.realpath(path))
    is_plain = os.path.isfile(target) or not os.path.lexists(target)
    part = target.with_name(f'.{os.getpid()}.part') if is_plain else target
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield part
        if is_plain:
            os.replace(part, target)
    except OSError as error:
        kind = InputError if is_wrong_path(error) else JobError
        reason = os.strerror(error.errno) if error.errno else error
        raise kind(f'{path}: cannot be written ({reason})') from None
    finally:
        if is_plain:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> Path:
    """
    Write a text file atomically, see :func:`replacing`; return its path.

    Characters that UTF-8 cannot encode, as in some file names, are escaped.
    """
    with replacing(path) as part:
        part.write_text(text, encoding='utf-8', errors='backslashreplace')
    return path
