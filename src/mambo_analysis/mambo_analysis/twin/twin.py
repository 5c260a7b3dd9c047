"""
Cross-validation of a model of one drone on unseen flights: ``twin BAG BAG...``, of one vehicle.

Each flight is left out once. The model is identified on the others (:mod:`.force`) and predicts
windows of half a second of the one left out (:mod:`.windows`), from its recorded states,
attitudes, commands and battery. Of the flight itself it takes the mounting of the markers, two
angles, and with ``--past`` what the accelerometer showed in the second before each window.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, write_json
from mambo_model.errors import InputError

from .force import fit_force
from .recorded import read_flight
from .windows import HORIZON, PAST, predict, Windows


class Row(NamedTuple):
    """One flight, predicted by a model fitted to the others."""

    name: str
    windows: Windows


def leave_one_out(paths: list[Path], horizon: float, past: float) -> list[Row]:
    """
    Return the prediction of every flight by a model of the others.

    Raises
    ------
    mambo_model.errors.InputError
        For fewer than two flights.
    mambo_analysis.identify.regression.IdentifyError, mambo_bags.reader.BagError
        If a bag is no usable flight.

    """
    if len(paths) < 2:
        raise InputError('one flight: at least two of the same vehicle are needed, as each is '
                         'predicted by the others')
    flights = [read_flight(path) for path in paths]
    return [Row(one.name, predict(one, fit_force(*(f for f in flights if f is not one)).model,
                                  horizon, past)) for one in flights]


def table(rows: list[Row], horizon: float) -> str:
    """Return the mean absolute errors as text."""
    width = max(len(row.name) for row in rows)
    head = f'{"flight":<{width}}  {"model [mm]":^20}  {"constant velocity":^20}  ratio  windows'
    lines = [f'position after {horizon:g} s, mean absolute error in x, y, z; ratio of distances',
             head]
    for row in rows:
        model, constant = (''.join(f'{1e3 * x:6.1f} ' for x in values)
                           for values in (row.windows.mae, row.windows.constant_mae))
        lines.append(f'{row.name:<{width}}  {model:<20}  {constant:<20}  '
                     f'{row.windows.ratio:5.2f}  {len(row.windows.model):7d}')
    return '\n'.join(lines)


def as_json(rows: list[Row], horizon: float, past: float) -> str:
    """Return the same as JSON."""
    return json.dumps({'horizon_s': horizon, 'past_s': past, 'flights': [
        {'name': row.name, 'mae_m': row.windows.mae.tolist(), 'ratio': row.windows.ratio,
         'constant_velocity_mae_m': row.windows.constant_mae.tolist(),
         'windows': len(row.windows.model)} for row in rows]}, indent=2)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('twin', __doc__.split('\n\n')[0])
    out.add_argument('bags', type=Path, nargs='+', metavar='BAG', help='flights of one vehicle')
    out.add_argument('--horizon', type=real(0.05, 3.0, 's'), default=HORIZON, metavar='S',
                     help='length of a window (default: %(default)g)')
    out.add_argument('--past', type=real(0.0, 5.0, 's'), default=PAST, metavar='S',
                     help='before a window, in which the accelerometer corrects the model; 0: not '
                          'at all (default: %(default)g)')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``twin``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        """Predict every flight and print the errors."""
        rows = leave_one_out(options.bags, options.horizon, options.past)
        if options.json != '-':
            print(table(rows, options.horizon))
        if options.json and (path := write_json(
                options.json, as_json(rows, options.horizon, options.past))):
            print(f'wrote {path}')
    return guard('twin', work)


if __name__ == '__main__':
    raise SystemExit(main())
