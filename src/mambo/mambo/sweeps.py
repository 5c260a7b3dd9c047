"""Sweeps from a script."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
import re
import tempfile
from typing import Any
import warnings

from mambo_bags.cli.option_types import MOST_WORKERS
from mambo_flight.course import course_file
from mambo_flight.sweep import command, design
from mambo_model.components import look_again
from mambo_model.errors import InputError, readable
import pandas
import yaml

from . import given


def sweep(
    what: Mapping[str, Any] | Path | str, *, ideal: bool = False, workers: int | None = None,
    output: Path | str | None = None,
) -> pandas.DataFrame:
    """
    Fly a scenario many times; return a row per flight.

    Before the flights one UserWarning names the courses that their vehicle cannot fly.

    Parameters
    ----------
    what
        A sweep file, or its content as a mapping, whose relative paths start at the current
        directory.
    ideal
        Whether to fly without sensors, on the true state.
    workers
        Processes; default: one for each core.
    output
        Parquet file to keep, with the PNG of its percentiles beside it; default: none.

    Raises
    ------
    InputError
        For a wrong file or mapping, naming line and key, a wrong number of workers, or if the
        output exists.

    """
    look_again()
    warn = partial(warnings.warn, stacklevel=3)  # at the line that calls this function
    if workers is not None:
        workers = given.whole('workers', workers, 1, MOST_WORKERS)
    with tempfile.TemporaryDirectory(prefix='mambo_') as folder:
        out = Path(folder) / 'sweep.parquet' if output is None else given.path(output, 'output')
        if not isinstance(what, Mapping):
            return pandas.DataFrame(
                command.sweep(given.path(what, 'sweep'), out, ideal, workers, warn=warn))
        file = Path(folder) / 'sweep.yaml'
        file.write_text(_text(what))
        try:
            return pandas.DataFrame(command.sweep(file, out, ideal, workers, warn=warn))
        except InputError as error:  # the user has not written this file
            raise type(error)(
                re.sub(rf'{re.escape(str(file))}(:\d+)?', 'sweep', str(error))) from None


def _text(what: Mapping[str, Any]) -> str:
    """Return a sweep file with the content of a mapping, in which paths are absolute."""
    content = given.plain(what)
    if isinstance(name := content.get('scenario'), str):
        content['scenario'] = _utf8(design.scenario_in(name, Path.cwd()))
    if 'vary' in content:
        content['vary'] = _absolute(content['vary'])
    try:
        return yaml.safe_dump(content, sort_keys=False)
    except yaml.YAMLError as error:
        raise InputError(f'sweep: {" ".join(map(str, error.args))}') from None


def _absolute(value: Any) -> Any:
    """Return values in which files of vehicles, courses and components have absolute paths."""
    if isinstance(value, Mapping):
        return {key: _absolute(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(_absolute, value))
    return _utf8(course_file.absolute(value, Path.cwd())) if isinstance(value, str) else value


def _utf8(name: str) -> str:
    """Return a name; InputError if it is not UTF-8, as no sweep file can hold it then."""
    if (shown := readable(name)) != name:
        raise InputError(f'sweep: {shown} is not UTF-8: rename the file or folder')
    return name
