"""Sweeps from a script."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import tempfile
from typing import Any

from mambo_flight.sweep import command
import pandas
import yaml


def sweep(
    what: Mapping[str, Any] | Path | str, *, ideal: bool = False, workers: int | None = None,
    output: Path | str | None = None,
) -> pandas.DataFrame:
    """
    Fly a scenario many times; return a row per flight.

    Parameters
    ----------
    what
        A sweep file, or its content as a mapping.
    ideal
        Whether to fly without sensors, on the true state.
    workers
        Processes; default: one for each core.
    output
        Parquet file to keep, with the PNG of its percentiles beside it; default: none.

    Raises
    ------
    InputError
        For a wrong file or mapping, naming line and key, or if the output exists.

    """
    with tempfile.TemporaryDirectory(prefix='mambo_') as folder:
        file = Path(what) if not isinstance(what, Mapping) else Path(folder) / 'sweep.yaml'
        if isinstance(what, Mapping):
            file.write_text(yaml.safe_dump(dict(what), sort_keys=False))
        out = Path(output) if output is not None else Path(folder) / 'sweep.parquet'
        return pandas.DataFrame(command.sweep(file, out, ideal, workers))
