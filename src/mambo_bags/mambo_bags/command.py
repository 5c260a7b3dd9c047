"""Shared by all commands: common options, one-line errors and exit codes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sized
import contextlib
import difflib
import errno
import os
from pathlib import Path
import re
import shutil
import signal
import stat
import sys
from typing import Any, TextIO
import warnings

from mambo_model.errors import InputError, MamboError, readable, visible
from mambo_model.whole_file import (
    check_writable, COMPARISON, is_named_as_of_a_bag, is_wrong_path, JSON, PAGE, PICTURE,
    refuse_other_kind, write_text)
import numpy as np

from .cli import drawing, supervisor

_WRITTEN = ('output', 'json', 'html', 'csv', 'figure', 'write')  # options naming a file to write
_KINDS = {'json': JSON, 'html': PAGE, 'csv': COMPARISON, 'figure': PICTURE}  # which replace a file
_NEGATIVE = re.compile(r'-(\d+\.?\d*(e[-+]?\d+)?|\.\d+(e[-+]?\d+)?|inf|nan)$', re.IGNORECASE)
_LITTLE = 1 << 20  # bytes left on a disk that is full for most purposes
_LONGEST = 2000  # longest error, characters, so that a huge name does not fill the screen


def one_line(text: str) -> str:
    """Return a text as one line of bounded length that any terminal shows as it is."""
    line = visible(' '.join(text.splitlines()))
    if len(line) > _LONGEST:
        line = f'{line[:_LONGEST // 2]} ... {line[-_LONGEST // 2:]}'
    return line


class _OutputError(Exception):
    """Standard output cannot be written."""


class _Output:
    """
    Standard output whose errors can be distinguished from those of a file.

    What a reader that has gone, such as ``head``, no longer takes is discarded: the files of a
    command are written all the same. ``lost`` tells that.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.lost = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write what a terminal can show; raise _OutputError on failure."""
        try:
            return self._stream.write(self._encodable(visible(text)))
        except BrokenPipeError:
            self._discard()
            return len(text)
        except OSError as error:
            raise _OutputError(error) from None

    def _encodable(self, text: str) -> str:
        """Return a text with what the encoding of the output does not have escaped."""
        encoding = getattr(self._stream, 'encoding', None) or 'utf-8'  # as of a text in memory
        return text.encode(encoding, 'backslashreplace').decode(encoding)

    def flush(self) -> None:
        """Flush, likewise."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._discard()
        except OSError as error:
            raise _OutputError(error) from None

    def _discard(self) -> None:
        self.lost = True
        _discard(self._stream)


_program: str | None = None


def set_program(name: str | None) -> None:
    """Set the name under which the user started this process, such as ``mambo fly``."""
    global _program
    _program = name


def program(name: str) -> str:
    """Return the name of a command in messages: as the user typed it, else its own name."""
    return _program or name


def own_process() -> None:
    """Prepare a process that runs one command and nothing else: its pictures, a user's code."""
    drawing.draw_files_only()
    supervisor.enable()


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean X?`` for a word that is close to a known one, else nothing."""
    close = difflib.get_close_matches(word, list(known), 1, 0.6)
    return f'; did you mean {close[0]}?' if close else ''


def _is_file(name: str | Path) -> bool:
    """Return whether a name is that of a file, not a folder, a device or what no file can have."""
    try:
        return os.path.isfile(name)
    except ValueError:
        return False


def _is_pipe(mode: int) -> bool:
    """Return whether a file of this mode is a pipe, with or without a name, or a socket."""
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


def _is_part_of_a_bag(path: Path) -> bool:
    """Return whether a path is a file of a bag, or one that would seem to be in its folder."""
    return is_named_as_of_a_bag(path) and (
        _is_file(path) or _is_file(Path(os.path.realpath(path)).parent / 'metadata.yaml'))


def _json_file(text: str) -> str:
    if text != '-' and os.path.isfile(text) and not text.endswith('.json'):
        raise argparse.ArgumentTypeError(
            f'{text} exists and is not a .json file: put a --json without FILE last')
    return text


def _plain(text: str) -> str:
    """Return a docstring without its markup: roles such as :mod:`x`, and quotes of code."""
    return re.sub(r':\w+:`~?([^`]+)`', r'\1', text).replace('``', '')


class Parser(argparse.ArgumentParser):
    """
    Command line of a command: errors are one line with a suggestion, and exit code 2.

    Parameters
    ----------
    name : str
        Name of the command, used if :func:`set_program` was not called.
    description : str
        Text of ``--help`` before the options; line breaks are kept.
    epilog : str
        Text of ``--help`` after the options.

    """

    def __init__(self, name: str, description: str, epilog: str | None = None) -> None:
        super().__init__(prog=program(name), description=_plain(description.strip()),
                         epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter)
        self._needs_output, self._takes_last = False, False
        self._negative_number_matcher = _NEGATIVE  # argparse takes -1e-3 for an option

    def add_output(self, metavar: str, help: str, default: Path | None = None,
                   required: bool = False, positional: bool = False) -> None:
        """
        Add ``-o/--output``, and its older name ``--out``.

        Parameters
        ----------
        metavar, help
            As of ``add_argument``.
        default
            Path if the option is not given.
        required
            Whether the option is required.
        positional
            Whether the path can also be given as the last positional argument.

        """
        self.add_argument('-o', '--output', type=Path, metavar=metavar, help=help,
                          default=default)
        self.add_argument('--out', type=Path, dest='output', default=argparse.SUPPRESS,
                          help=argparse.SUPPRESS)
        if positional:
            self.add_argument('last', type=Path, nargs='?', metavar=metavar,
                              help='the same as --output')
        self._needs_output, self._takes_last = required, positional

    @staticmethod
    def complete(names: Iterable[str], option: argparse.Action) -> None:
        """Let the shell complete names for an option that also accepts other values."""
        option.completer = lambda **_: list(names)  # type: ignore[attr-defined]

    def add_json(self) -> None:
        """Add ``--json [FILE]``; see :func:`write_json`."""
        self.add_argument('--json', type=_json_file, nargs='?', const='-', metavar='FILE',
                          help='write the numbers as JSON; an older file is replaced; without '
                          'FILE or with -: print them, and nothing else')

    def parse_args(  # type: ignore[override]
        self, args: list[str] | None = None, namespace: argparse.Namespace | None = None,
    ) -> argparse.Namespace:
        """Parse; print one line and exit with code 2 on an error."""
        if args is None:
            own_process()
        options, rest = self.parse_known_args(args, namespace)
        if self._takes_last:
            if options.last is None and len(rest) == 1 and not rest[0].startswith('-'):
                options.last = Path(rest.pop())  # given after an option
            if options.last is not None and options.output is not None:
                self.error(f'{options.last}: --output is given already')
            options.output = options.last if options.output is None else options.output
            del options.last
        if rest:
            word = next((word for word in rest if word.startswith('-')), rest[0])
            known = [name for action in self._actions for name in action.option_strings]
            what = 'option' if word.startswith('-') else 'argument'
            self.error(f'{word}: unknown {what}{nearest(word.partition("=")[0], known)}')
        if self._needs_output and options.output is None:
            self.error('-o/--output is missing')
        self._refuse_wrong_kind(vars(options))
        self._refuse_overwriting(vars(options))
        self._refuse_unwritable(vars(options))
        return options

    def _refuse_wrong_kind(self, options: dict[str, Any]) -> None:
        """Exit with code 2 if there is a folder or a pipe where a file is to be written, or so."""
        folders = {action.dest for action in self._actions if action.metavar == 'DIR'}
        for name in _WRITTEN:
            path = options.get(name)
            if path is None or path == '-' or '\0' in str(path):
                continue
            if name in folders:
                if os.path.exists(path) and not os.path.isdir(path):
                    self.error(f'--{name}: {path} is not a folder: give another')
            elif name != 'output' and os.path.isdir(path):
                self.error(f'--{name}: {path} is a folder: give the name of a file')
            if os.path.exists(path) and _is_pipe(os.stat(path).st_mode):
                self.error(f'--{name}: {path} is a pipe or socket: give the name of a file')

    def _refuse_overwriting(self, options: dict[str, Any]) -> None:
        """Exit with code 2 if a file to write is an input, another output or part of a bag."""
        others = [value for name, value in options.items() if name not in _WRITTEN]
        taken = {os.path.realpath(one): 'an input' for value in others
                 for one in (value if isinstance(value, list) else [value])
                 if isinstance(one, (str, Path)) and _is_file(one)}
        for name in _WRITTEN:
            path = options.get(name)
            if str(path) == '-' and name != 'json':
                self.error(f'--{name}: - is not the name of a file')
            if path is None or path == '-' or '\0' in str(path) or os.path.isdir(path):
                continue
            place = os.path.realpath(path)
            if place in taken:
                self.error(f'--{name}: {path} is {taken[place]}: give another')
            if _is_part_of_a_bag(path):
                self.error(f'--{name}: {path} is part of a bag, which is never written over')
            if name in _KINDS:
                try:
                    refuse_other_kind(Path(path), _KINDS[name])
                except InputError as error:
                    self.error(f'--{name}: {error}')
            taken[place] = f'also that of --{name}'

    def _refuse_unwritable(self, options: dict[str, Any]) -> None:
        """Exit behind one line if a file to write cannot be written, before any work is done."""
        for name in _WRITTEN:
            path = options.get(name)
            if path is None or path == '-':
                continue
            try:
                check_writable(Path(path))
            except MamboError as error:
                self.exit(error.exit_code, f'{self.prog}: --{name}: {one_line(str(error))}\n')
            except ValueError:  # a name that no file can have
                self.error(f'--{name}: {path}: no file can have this name')

    def print_help(self, file: Any = None) -> None:
        """Print the help; if the output cannot be written, print one line and exit with code 1."""
        if code := guard(self.prog, lambda: print(self.format_help(), end='', file=file)):
            self.exit(code)

    def error(self, message: str) -> Any:
        """Write one line to stderr and exit with code 2."""
        self.exit(2, f'{self.prog}: {one_line(message.removeprefix("argument "))}; '
                     f'{self.prog} --help says more\n')

    def _get_values(self, action: argparse.Action, words: list[str]) -> Any:
        if action.option_strings and '--' in words:  # argparse reads it as the end of the options
            raise argparse.ArgumentError(action, "'--' is not a value")
        return super()._get_values(action, words)

    def _get_value(self, action: argparse.Action, text: str) -> Any:
        if '\0' in text:  # from a script: no shell can give it
            raise argparse.ArgumentError(
                action, f'{text!r} has a null character, which no file can have')
        if not text and (action.type is Path or action.dest in _WRITTEN):
            raise argparse.ArgumentError(action, "'' is not the name of a file")
        convert = self._registry_get('type', action.type, action.type)
        try:
            return convert(text)
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentError(action, str(error)) from None
        except (TypeError, ValueError):
            raise argparse.ArgumentError(action, f'{text!r} is not a number') from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            raise argparse.ArgumentError(
                action, f'{value!r} is not one of {", ".join(known)}{nearest(str(value), known)}')


def refuse_unused(
    parser: argparse.ArgumentParser, options: argparse.Namespace, names: Iterable[str],
    reason: str,
) -> None:
    """
    Refuse options without effect.

    Parameters
    ----------
    parser, options
        Of the command.
    names
        Of the options as attributes, such as ``mass_error``.
    reason
        Why they have none, after "as".

    Raises
    ------
    InputError
        Naming the first that has another value than its default.

    """
    for name in names:
        action = next(one for one in parser._actions if one.dest == name)
        if getattr(options, name) != action.default:
            raise InputError(
                f'{action.option_strings[-1]}: has no effect, as {reason}: leave it out')


def interrupted(end: KeyboardInterrupt, kept: str) -> KeyboardInterrupt:
    """Return an interrupt with the same signal, which also says what is kept."""
    return KeyboardInterrupt(end.args[0] if end.args else signal.SIGINT, kept)


@contextlib.contextmanager
def counted(
    done: Sized, total: int, what: str = 'flights', kept: str = 'none is kept',
) -> Iterator[None]:
    """
    Let an interrupt of the work inside say how much of it was done.

    Parameters
    ----------
    done
        What the work fills, one entry for each item.
    total
        Number of items.
    what
        Name of the items, for the message.
    kept
        What becomes of those that are done, for the message.

    """
    try:
        yield
    except KeyboardInterrupt as end:
        raise interrupted(end, f'{len(done)} of {total} {what} were done, {kept}') from None


def write_json(target: str, text: str) -> Path | None:
    """Print the JSON text or write it to its file, with missing folders; return the path."""
    if target == '-':
        print(text)
        return None
    return write_text(Path(target), f'{text}\n', JSON)


def guard(name: str, work: Callable[[], None]) -> int:
    """
    Run a command and return its exit code; on failure print one line with its name to stderr.

    The code is that of a :class:`mambo_model.errors.MamboError`, 2 for a path that is missing, not
    permitted or of the wrong kind, and 1 for other disk errors, exhausted memory, and an output
    that is closed or full. If its reader goes before the end, as of a pipe, the work is done all
    the same, and the code is 1 without a line.
    """
    name = program(name)
    if sys.stdout is None:
        return _complain(name, 'the output is closed: redirect it to /dev/null to discard it')
    plain = sys.stdout
    sys.stdout = output = _Output(plain)
    try:
        with np.errstate(all='ignore'), warnings.catch_warnings():  # absurd numbers: inf or nan
            warnings.filterwarnings('ignore', r'Glyph \d+ .* missing')  # a box is drawn instead
            work()
        sys.stdout.flush()
    except _OutputError as error:
        return _lost_output(name, plain, error.args[0])
    except OSError as error:
        reason, place = error.strerror or str(error), error.filename or _full(error)
        if error.errno in (errno.EMFILE, errno.ENFILE):
            reason += ': this shell allows too few (ulimit -n)'
        return _complain(name, f'{place}: {reason}' if place else reason,
                         2 if is_wrong_path(error) else 1)
    except MamboError as error:
        return _complain(name, str(error), error.exit_code)
    except MemoryError:
        return _complain(name, 'out of memory')
    except np.linalg.LinAlgError as error:
        return _complain(name, f'the numbers are too extreme to compute with ({error})', 2)
    except RecursionError:
        return _complain(name, 'the input is nested too deeply', 2)
    except UnicodeEncodeError as error:
        if error.encoding != 'utf-8':
            raise
        return _complain(name, f'{_unreadable(error)} is not UTF-8: rename it', 2)
    except RuntimeError as error:
        if 'start new thread' not in str(error):
            raise
        return _complain(name, 'this user may have no more processes and threads (ulimit -u)')
    finally:
        sys.stdout = plain
        if not isinstance(sys.exc_info()[1], SystemExit):  # which no code of ours raises in a job
            supervisor.ended()
    return int(output.lost)


def _unreadable(error: UnicodeEncodeError) -> str:
    """Return the name that could not be encoded: its line, if it is in a longer text."""
    before, after = error.object[:error.start], error.object[error.start:]
    return readable(before.rpartition('\n')[2] + after.partition('\n')[0])


def _full(error: OSError) -> str:
    """Return the folder without space that an error may be of: the working or a temporary one."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        for folder in (os.environ.get('TMPDIR', '/tmp'), os.curdir, '/dev/shm'):
            with contextlib.suppress(OSError):
                if shutil.disk_usage(folder).free < _LITTLE:
                    return folder
    return ''


def _complain(name: str, text: str, exit_code: int = 1) -> int:
    """Write one line to stderr; return the exit code."""
    if sys.stderr is not None:
        print(f'{name}: {one_line(text)}', file=sys.stderr)
    return exit_code


def _discard(stream: TextIO) -> None:
    """Let what is still written to a stream go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _lost_output(name: str, stream: TextIO, error: OSError) -> int:
    """Discard unwritten output, so that Python does not try again; return the exit code."""
    _discard(stream)
    return _complain(name, f'the output cannot be written: {error.strerror}')
