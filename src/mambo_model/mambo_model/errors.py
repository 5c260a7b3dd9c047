"""What goes wrong: every error of this product has one base and is one line."""

from __future__ import annotations

import re
from typing import ClassVar

_HIDDEN = re.compile(  # what a terminal obeys, does not show, or cannot be encoded
    '[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff'
    '\ud800-\udfff]')


class MamboError(Exception):
    """
    An error whose text is the one line that a user sees: what, where and what to do.

    Attributes
    ----------
    exit_code : int
        With which a command ends: 2 for wrong input (a parameter, an unknown name, a file that is
        unreadable, foreign or damaged), 1 for a job that failed.

    """

    exit_code: ClassVar[int] = 2


class InputError(MamboError, ValueError):
    """Options or files that cannot be used together or at all."""


class JobError(MamboError, RuntimeError):
    """The input was right, but the job could not be done."""

    exit_code = 1


def visible(text: str) -> str:
    r"""
    Return a text with an escape such as ``\x1b`` for each character that a terminal would obey.

    Names in recordings and of files may hold sequences that clear the screen, hide a word or turn
    the direction of writing.
    """
    return _HIDDEN.sub(lambda found: found[0].encode('unicode_escape').decode(), text)
