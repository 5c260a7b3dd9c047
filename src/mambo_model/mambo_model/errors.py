"""What goes wrong: every error of this product has one base and is one line."""

from __future__ import annotations

from typing import ClassVar


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
