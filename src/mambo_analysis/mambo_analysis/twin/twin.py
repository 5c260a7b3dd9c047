"""
Cross-validation of a model of one drone on unseen flights: ``twin BAG BAG...``, of one vehicle.

Each flight is left out once, and predicted by a model that is identified on the others.

Translation: windows of half a second from recorded states, with the recorded attitude, commands
and battery (:mod:`.windows`). With ``--motors``: the same from commands and battery alone,
attitude too (:mod:`.motors`). With ``--loop``: the whole flight, the reference flown by a model of
drone and controller (:mod:`.loop`). Of the flight itself a model takes the mounting of the
markers, two angles, and with ``--past`` what accelerometer and gyro showed in the second before
each window. ``--html`` writes a page with the tables, and with ``--loop`` the paths and a replay.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import combinations
import json
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, write_json
from mambo_model.errors import InputError
import numpy as np

from . import agreement, beside, loop, motors
from ..identify.regression import IdentifyError
from .force import fit_force
from .identify_flight import reading_notes
from .motors import MotorWindows, predict_all
from .recorded import read_flight, Recorded
from .torque import fit_torque
from .windows import HORIZON, PAST, predict, Windows

OTHER_BATTERY = 1.3  # between means of flights: a lithium cell is empty at 3.0 V and full at 4.2
OTHER_COMMANDS = 2.0  # likewise of commands: 85 flights of one Crazyflie are within 1.2


class Row(NamedTuple):
    """
    One flight, predicted by a model fitted to the others.

    ``loops`` are simulations of the whole flight: by its true state, and by its own estimate; None
    for what the recording does not hold.
    """

    flight: Recorded
    windows: Windows
    motors: MotorWindows | None = None
    loops: tuple[loop.Flown | None, loop.Flown | None] = (None, None)

    @property
    def name(self) -> str:
        """Return the name of the flight."""
        return self.flight.name


def _loops(flight: Recorded, force: Any) -> tuple[loop.Flown | None, loop.Flown | None]:
    if flight.onboard is None:
        return None, None
    own = loop.fly(flight, force, True) if loop.has_estimate(flight) else None
    return loop.fly(flight, force, False), own


def leave_one_out(
    paths: Sequence[Path], horizon: float, past: float, by_motors: bool = False,
    in_loop: bool = False,
) -> list[Row]:
    """
    Return the prediction of every flight by a model of the others.

    Raises
    ------
    mambo_model.errors.InputError
        For fewer than two flights, or one that is given twice.
    mambo_analysis.identify.regression.IdentifyError, mambo_bags.reader.BagError
        If a bag is no usable flight.

    """
    if len(paths) < 2:
        raise InputError('one flight: at least two of the same vehicle are needed, as each is '
                         'predicted by the others')
    flights = [read_flight(path) for path in paths]
    refuse_unlike_commands(flights)
    for (path, one), (again, other) in combinations(zip(paths, flights, strict=True), 2):
        if all(np.array_equal(mine, theirs, equal_nan=True) for mine, theirs in (
                (one.position, other.position), (one.force, other.force))):
            raise InputError(f'{again}: the same flight as {path}: a flight is predicted by the '
                             'others, so give each once')
    out = []
    for one in flights:
        others = [f for f in flights if f is not one]
        force = fit_force(*others, blocks=0).model
        row = Row(one, predict(one, force, horizon, past))
        if by_motors:
            torque = fit_torque(others, force, horizon, past)
            row = row._replace(motors=predict_all(one, force, torque, horizon, past))
        if in_loop:
            row = row._replace(loops=_loops(one, force))
        out.append(row)
    return out


def translation(rows: Sequence[Row], horizon: float) -> beside.Table:
    """Return the errors of the windows with recorded attitude, in mm."""
    return (f'position after {horizon:g} s, mean absolute error in x, y, z [mm]',
            ['flight', *(f'model {a}' for a in 'xyz'), *(f'constant velocity {a}' for a in 'xyz'),
             'ratio of distances', 'windows'],
            [[row.name, *(f'{1e3 * x:.1f}' for x in (*row.windows.mae, *row.windows.constant_mae)),
              f'{row.windows.ratio:.2f}', str(len(row.windows.model))] for row in rows])


def table(rows: Sequence[Row], horizon: float) -> str:
    """Return the errors of the windows with recorded attitude as text."""
    width = max(len(row.name) for row in rows)
    head = f'{"flight":<{width}}  {"model [mm]":^24}  {"constant velocity":^24}  ratio  windows'
    lines = [f'position after {horizon:g} s, mean absolute error in x, y, z; ratio of distances',
             head]
    for row in rows:
        model, constant = (''.join(f'{1e3 * x:7.1f} ' for x in values)
                           for values in (row.windows.mae, row.windows.constant_mae))
        lines.append(f'{row.name:<{width}}  {model:<24}  {constant:<24}  '
                     f'{row.windows.ratio:5.2f}  {len(row.windows.model):7d}')
    return '\n'.join(lines)


def _tables(rows: Sequence[Row], horizon: float) -> list[beside.Table]:
    """Return the tables after the first."""
    out = []
    by_motors = [(row.name, row.motors) for row in rows if row.motors is not None]
    if by_motors:
        out.append(motors.table(by_motors, horizon))
    if any(row.loops[0] is not None for row in rows):
        out.append(loop.table([(row.flight, *row.loops) for row in rows]))
    return out


def as_text(content: beside.Table) -> str:
    """Return a table as text, a column for each head."""
    caption, head, rows = content
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows)]
    lines = ['  '.join([row[0].ljust(widths[0]), *(
        cell.rjust(width) for cell, width in zip(row[1:], widths[1:]))]) for row in (head, *rows)]
    return '\n'.join([caption, *lines])


def as_json(rows: Sequence[Row], horizon: float, past: float) -> str:
    """Return all numbers as JSON."""
    flights = []
    for row in rows:
        one: dict[str, Any] = {
            'name': row.name, 'mae_m': row.windows.mae.tolist(), 'ratio': row.windows.ratio,
            'constant_velocity_mae_m': row.windows.constant_mae.tolist(),
            'windows': len(row.windows.model)}
        if row.motors is not None:
            one['motors'] = {name: float(getattr(row.motors, name).mean())
                             for name in MotorWindows._fields}
        for name, flown in zip(('loop_rms_m', 'loop_by_estimate_rms_m'), row.loops):
            if flown is not None:
                one[name] = dict(zip(('horizontal', 'vertical', 'total'), flown.rms(row.flight)))
        flights.append(one)
    return json.dumps({'horizon_s': horizon, 'past_s': past, 'flights': flights}, indent=2)


def parser() -> Parser:
    """Return the command line."""
    out = Parser('twin', __doc__.split('\n\n')[0])
    out.add_argument('bags', type=Path, nargs='+', metavar='BAG', help='flights of one vehicle')
    out.add_argument('--motors', action='store_true',
                     help='predict the attitude, too, from the motor commands')
    out.add_argument('--loop', action='store_true',
                     help='fly the reference of each recording in closed loop, too')
    out.add_argument('--agree', action='store_true',
                     help='identify each flight alone, too, and count the pairs that agree')
    out.add_argument('--horizon', type=real(0.05, 3.0, 's'), default=HORIZON, metavar='S',
                     help='length of a window (default: %(default)g)')
    out.add_argument('--past', type=real(0.0, 5.0, 's'), default=PAST, metavar='S',
                     help='before a window, in which accelerometer and gyro correct the model; 0: '
                          'not at all (default: %(default)g)')
    out.add_argument('--html', type=Path, metavar='FILE',
                     help='write a page for a browser; an older file is replaced')
    out.add_json()
    return out


def unlike_batteries(flights: Sequence[Recorded]) -> list[str]:
    """Return a note if the batteries of some flights are no more of the same kind."""
    volts = {flight.name: float(np.nanmean(flight.voltage[flight.air])) for flight in flights
             if np.isfinite(flight.voltage[flight.air]).any()}
    if not volts:
        return []
    low, high = min(volts, key=volts.__getitem__), max(volts, key=volts.__getitem__)
    if volts[high] < OTHER_BATTERY * volts[low]:
        return []
    return [f'the battery of {low} shows {volts[low]:.3g} V in the mean, that of {high} '
            f'{volts[high]:.3g} V: check unit and channel, or give flights of one kind of battery']


def refuse_unlike_commands(flights: Sequence[Recorded]) -> None:
    """
    Refuse flights whose motors have commands of another size: one vehicle hovers at one command.

    Raises
    ------
    IdentifyError
        Naming both flights.

    """
    hover = {flight.name: float(np.nanmean(flight.command[flight.air])) for flight in flights}
    low, high = min(hover, key=hover.__getitem__), max(hover, key=hover.__getitem__)
    if hover[high] > OTHER_COMMANDS * hover[low]:
        raise IdentifyError(
            f'the motors of {low} have a command of {hover[low]:.3g} in the mean, those of {high} '
            f'of {hover[high]:.3g}: they are not of one vehicle, or in other units')


def _work(options: argparse.Namespace) -> None:
    """Predict every flight, print and write the errors."""
    rows = leave_one_out(
        options.bags, options.horizon, options.past, options.motors, options.loop)
    if options.loop and not any(row.loops[0] is not None for row in rows):
        raise InputError(f'--loop: no reference (onboard/reference) in {options.bags[0]}, nor in '
                         'the other bags')
    more = _tables(rows, options.horizon)
    if options.agree:
        more.append(agreement.table(agreement.identified([row.flight for row in rows])))
    notes = [line for row in rows for line in reading_notes(row.flight)]
    notes += unlike_batteries([row.flight for row in rows])
    notes += motors.doubts([(row.name, row.motors) for row in rows if row.motors is not None])
    notes += [line for row in rows if row.loops[0] is not None for line in loop.doubts(row.flight)]
    if options.json != '-':
        print('\n\n'.join([table(rows, options.horizon), *map(as_text, more)]))
        print(''.join(f'note: {line}\n' for line in notes), end='')
    if options.json and (path := write_json(
            options.json, as_json(rows, options.horizon, options.past))):
        print(f'wrote {path}')
    if options.html:
        pairs = [beside.Beside(row.flight, row.loops[1] or row.loops[0]) for row in rows]
        path = beside.write(
            options.html, pairs, [translation(rows, options.horizon), *more],
            (*NOTES, *notes))
        if options.json != '-':
            print(f'wrote {path}')


NOTES = (
    'windows begin at recorded states; mean errors at their end',
    'in closed loop the controller is told what the estimate of the drone was wrong by, where the '
    'recording has it',
)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``twin``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('twin', lambda: _work(options))


if __name__ == '__main__':
    raise SystemExit(main())
