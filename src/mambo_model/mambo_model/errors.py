"""Base classes of all errors of this product; every message is one line."""

from __future__ import annotations

import re
from typing import ClassVar

_HIDDEN = re.compile(  # control and invisible characters
    '[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]')
_SURROGATE = re.compile('[\ud800-\udfff]')


class MamboError(Exception):
    """
    An error whose message is the one line shown to the user: what, where and what to do.

    Attributes
    ----------
    exit_code : int
        Exit code of the command: 2 for wrong input (a parameter, an unknown name, a file that is
        unreadable, damaged or of another kind), 1 for a job that failed.

    """

    exit_code: ClassVar[int] = 2


class InputError(MamboError, ValueError):
    """Options or files are wrong or cannot be used together."""


class JobError(MamboError, RuntimeError):
    """The input was correct, but the job failed."""

    exit_code = 1


def readable(text: str) -> str:
    r"""
    Return a text that UTF-8 can encode: what it cannot is escaped, a byte as ``\xfc``.

    Python reads a byte of a file name that is not UTF-8 as a surrogate, U+DC80 to U+DCFF. Another
    surrogate is escaped as ``\ud800``.
    """
    return _SURROGATE.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f'\\x{code - 0xdc00:02x}' if 0xdc80 <= code <= 0xdcff else f'\\u{code:04x}'


def visible(text: str) -> str:
    r"""
    Escape control and invisible characters of a text, for example as ``\x1b``.

    Names in recordings and of files may hold sequences that clear the screen, hide a word or
    reverse the direction of writing. What UTF-8 cannot encode is as of :func:`readable`.
    """
    return _HIDDEN.sub(
        lambda found: found[0].encode('unicode_escape').decode(), readable(text))
