"""Atomic writing: a file is written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import os
from pathlib import Path
from typing import NamedTuple

from .errors import InputError, JobError, MamboError, readable


def is_wrong_path(error: OSError) -> bool:
    """Return whether the path itself is wrong: the user's to mend, not the disk's."""
    return isinstance(error, (
        FileExistsError, FileNotFoundError, IsADirectoryError, NotADirectoryError,
        PermissionError)) or error.errno in (errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS)


def exists(path: Path) -> bool:
    """
    Return whether a path has a file, a folder, or a link, also one that leads nowhere.

    Raises
    ------
    OSError
        If the path is too long, which ``os.path.lexists`` takes for a file that does not exist.

    """
    return path.exists() or path.is_symlink()


def refuse_existing(
        path: Path | None, instead: str = 'give another --output',
        error: type[MamboError] = InputError) -> None:
    """
    Refuse an output that :func:`exists`, before any work is done.

    Parameters
    ----------
    path
        None: there is no output.
    instead
        What the user can do besides removing it.
    error
        Its type.

    Raises
    ------
    mambo_model.errors.MamboError
        If it exists, or its name is too long for the file system.

    """
    try:
        there = path is not None and exists(path)
    except OSError as reason:
        raise error(f'{path}: {os.strerror(reason.errno)}') from None
    if there:
        raise error(f'{path} exists: {instead} or remove it')


class Kind(NamedTuple):
    """A kind of output that replaces an older file: of this kind, and no other file."""

    name: str
    endings: tuple[str, ...]  # of its name
    marks: tuple[bytes, ...]  # one of which it begins with, in lower case


PAGE = Kind('page', ('.html', '.htm'), (b'<!doctype html',))
PICTURE = Kind('PNG picture', ('.png',), (b'\x89png\r\n\x1a\n',))
COMPARISON = Kind('CSV file of a comparison', ('.csv',), (b'comparison,quantity,',))
JSON = Kind('JSON file', ('.json',), (b'{', b'['))
_OF_A_BAG = ('*.mcap', '*.db3', '*.zstd', 'metadata.yaml')
_SPACE = b'\xef\xbb\xbf \t\r\n'  # with the byte order mark


def is_named_as_of_a_bag(path: Path) -> bool:
    """Return whether the file at a path, links followed, has a name that parts of bags have."""
    place = Path(os.path.realpath(path))
    return any(place.match(end) for end in _OF_A_BAG)


def refuse_other_kind(path: Path, kind: Kind) -> None:
    """
    Refuse an output that would replace a file of another kind, or that is named as part of a bag.

    An empty file and what is no regular file, such as a device, may be written to.

    Raises
    ------
    InputError
        If it is one of these, or the file that exists cannot be read.

    """
    place = Path(os.path.realpath(path))
    if is_named_as_of_a_bag(place):
        raise InputError(f'{path} is part of a bag, which is never written over'
                         if os.path.isfile(place) else
                         f'{path} is a name of parts of a bag: choose another name')
    if not os.path.isfile(place):
        return
    try:
        with place.open('rb') as file:
            head = file.read(512)
    except OSError as error:
        raise _error(path, error) from None
    if head and not (place.suffix.lower() in kind.endings
                     and head.lstrip(_SPACE).lower().startswith(kind.marks)):
        raise InputError(f'{path} exists and is not a {kind.name}: choose another name')


@contextmanager
def replacing(path: Path, kind: Kind | None = None) -> Iterator[Path]:
    """
    Yield a temporary path to write to; at the end it is renamed to the given path in one step.

    Missing folders are created. A path that is not a regular file, such as ``/dev/stdout``, is
    written to directly.

    Parameters
    ----------
    path
        Path of the file; an older file is replaced, a link is followed.
    kind
        Of the file, see :func:`refuse_other_kind`; None: whatever is there is replaced.

    Raises
    ------
    InputError
        If the path cannot be a file, or has one of another kind.
    JobError
        If writing fails, for example because the disk is full. An older file is then unchanged.

    """
    if kind is not None:
        refuse_other_kind(path, kind)
    target = Path(os.path.realpath(path))
    is_plain = os.path.isfile(target) or not os.path.lexists(target)
    part = target.with_name(f'.{os.getpid()}.part') if is_plain else target
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield part
        if is_plain:
            os.replace(part, target)
    except OSError as error:
        raise _error(path, error) from None
    finally:
        if is_plain:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """
    Check that a file or folder can be made at a path, before work whose result goes there.

    Missing folders and a file are made and removed again. Errors as of :func:`replacing`.
    """
    target, made = Path(os.path.realpath(path)), []
    try:
        with suppress(FileNotFoundError):
            target.stat()
        folder = target if target.is_dir() else target.parent
        missing = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
        for one in reversed(missing):
            one.mkdir()
            made.append(one)
        if not target.exists() or target.is_file() or target.is_dir():  # no device
            part = folder / f'.{os.getpid()}.part'
            os.close(os.open(part, os.O_CREAT | os.O_WRONLY))
            part.unlink()
    except OSError as error:
        raise _error(path, error) from None
    finally:
        for one in reversed(made):
            with suppress(OSError):
                one.rmdir()


def _error(path: Path, error: OSError) -> InputError | JobError:
    """Return the error for a path that cannot be written."""
    reason = os.strerror(error.errno) if error.errno else error
    return (InputError if is_wrong_path(error) else JobError)(
        f'{path}: cannot be written ({reason})')


def write_text(path: Path, text: str, kind: Kind | None = None) -> Path:
    """
    Write a text file atomically, see :func:`replacing`; return its path.

    Characters that UTF-8 cannot encode, as in some file names, are escaped by
    :func:`mambo_model.errors.readable`.
    """
    with replacing(path, kind) as part:
        part.write_text(readable(text), encoding='utf-8')
    return path
