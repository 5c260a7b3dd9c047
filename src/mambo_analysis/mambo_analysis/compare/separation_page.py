"""The page of a flight of several drones: all in one hall, and their distances over time."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from mambo_bags.reader import BagError
from mambo_flight.world import separation
from mambo_flight.world.separation import Pair
from mambo_model import palette
from mambo_model.frames import flip_vector
from mambo_signals import motion
from mambo_signals.flight_phases import Phases
from mambo_signals.metrics import Floats, Ints
from mambo_signals.motion import Motion
import numpy as np

from . import report
from .figures import Line, Panel, Plot
from .report import Report

_SHOWN = 6  # nearest pairs with a line of their own
_ROWS = 30  # of the table: the nearest pairs
_LEGEND = 8  # most drones whose paths have a colour of their own


def _motions(drones: Mapping[str, separation.Seen]) -> dict[str, Motion]:
    """Return the true motion of each drone in the frame of the hall, z up."""
    return {name: motion.read(bag, separation.TRUTH).moved(
        0, 0.0, np.array(flip_vector(place))) for name, (bag, place) in drones.items()}


def _line(name: str, stamps: Ints, values: Floats, role: str, dash: str = '-') -> Line:
    return Line(name, stamps * 1e-9, values, role, dash=dash, width=1.4)


def _distances(found: Sequence[Pair], limit: float) -> Plot:
    """Return the figure of the distances over time: those of pairs, and the smallest."""
    t, least = separation.smallest(found)
    collision = _line('collision', t[[0, -1]], np.full(2, limit), 'bad', '--')
    lines = [_line(' - '.join(pair.names), pair.t, pair.distance, role)
             for pair, role in zip(found[:_SHOWN], palette.SERIES, strict=False)]
    return Plot(
        'separation', 'Separation',
        f'Distance between the centres of {"the nearest" if len(found) > _SHOWN else "all"} '
        'pairs, the smallest distance of all pairs, and the distance of a collision, '
        f'{limit:g} m.', [Panel('pairs [m]', [collision, *lines]), Panel('smallest [m]', [
            collision, _line('smallest of all pairs', t, least, 'ink')])])


def of_several(path: Path) -> Report:
    """
    Return the report of a flight of several drones.

    Parameters
    ----------
    path
        Folder that holds the bag of each drone.

    Raises
    ------
    mambo_model.errors.MamboError
        If a bag cannot be read, or is not of a flight of several drones on one clock.

    """
    drones, hall = separation.read_drones([path])
    limit = hall.params.collision_distance
    found = separation.pairs(separation.tracks_of(drones))
    flown = _motions(drones)
    colours = {name: palette.SERIES[k % _LEGEND] for k, name in enumerate(flown)}
    moving = [(name, colours[name], m) for name, m in flown.items()]
    distance, at = found[0].least
    near = [pair for pair in found if pair.least[0] < limit]
    seconds = max(float(m.t[-1]) for m in flown.values())
    rows = [[' - '.join(pair.names), *(f'{value:.3f}' for value in (
        *pair.least, float(pair.distance.mean())))] for pair in found[:_ROWS]]
    notes = ['Positions are those of ground_truth/odom, moved to where each drone starts']
    if len(found) > _ROWS:
        notes.append(f'{len(found) - _ROWS} pairs that stay farther apart are not in the table')
    return Report(
        path.name, f'{len(flown)} drones in one hall, {seconds:.2f} s of flight.',
        [near[0].collided()] if near else [],
        [('smallest distance', f'{distance:.3f} m',
          f'{" - ".join(found[0].names)} at {at:.2f} s'),
         ('collision', f'{limit:g} m', 'and nearer'),
         ('pairs that collided', str(len(near)), f'of {len(found)}')],
        notes, [], [], report.replay_of(moving, moving), [_distances(found, limit)],
        Phases(None, None, ''),
        [('Distance of drones', ['drones', 'least [m]', 'at [s]', 'mean [m]'], rows)])


def write(page: Path, folder: Path) -> Path:
    """Write the page of :func:`of_several` into a file; return its path."""
    return report.write(page, of_several(folder))


def work(options: argparse.Namespace) -> None:
    """
    Print the distances of the drones in a folder of bags; write their page if asked.

    Parameters
    ----------
    options
        Command line of ``compare``; of its options only ``html`` applies.

    Raises
    ------
    mambo_model.errors.MamboError
        If there are other options, or as of :func:`of_several`.

    """
    if any(given for name, given in vars(options).items() if name not in ('bag', 'html')):
        raise BagError(f'{options.bag}: holds the bags of several drones, for which there is '
                       '--html alone: name one of the bags, or see mambo separation')
    tracks, limit = separation.read([options.bag])
    print(separation.table(separation.pairs(tracks), limit))
    if options.html:
        print(f'\npage: {write(options.html, options.bag)}')
