"""
Distance of drones over time: ``mambo separation BAG...``.

Drones of one flight have one clock, so positions are compared at equal stamps.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import itertools
import json
from pathlib import Path
from typing import NamedTuple

from mambo_bags.command import guard, Parser, refuse_existing, write_json
from mambo_bags.reader import Bag, read_bag
from mambo_model.errors import InputError, JobError
from mambo_model.frames import flip_vector
from mambo_model.motion.vector import Vec3
from mambo_sim.world import MOST
import numpy as np
from numpy.typing import NDArray

from . import world_file

Array = NDArray[np.float64]
TRUTH = 'ground_truth/odom'
PICTURES = ('.png', '.svg', '.pdf')
_ROWS = 30  # of the table: the nearest pairs


class Track(NamedTuple):
    """Where a drone was in the hall."""

    t: NDArray[np.int64]  # (n,) ns, rising
    position: Array  # (n, 3) m, inertial NED of the hall


class Pair(NamedTuple):
    """Two drones over time."""

    names: tuple[str, str]
    t: NDArray[np.int64]  # (n,) ns, stamps that both have
    distance: Array  # (n,) m, between their centres

    @property
    def least(self) -> tuple[float, float]:
        """Return the least distance in m and its time in s."""
        k = int(self.distance.argmin())
        return float(self.distance[k]), float(self.t[k]) * 1e-9

    def collided(self) -> str:
        """Return that the pair collided, as one line."""
        distance, t = self.least
        return f'{" and ".join(self.names)} collided: {distance:.3f} m apart at t = {t:.3f} s'


def pairs(tracks: Mapping[str, Track]) -> list[Pair]:
    """
    Return the distance of each pair over time, the nearest pair first.

    Raises
    ------
    InputError
        If two drones have no stamp in common.

    """
    out = []
    for (name, one), (other_name, other) in itertools.combinations(tracks.items(), 2):
        t, mine, theirs = np.intersect1d(one.t, other.t, return_indices=True)
        if not len(t):
            raise InputError(f'{name} and {other_name} have no stamp in common: they did not fly '
                             'on one clock')
        gap = one.position[mine] - other.position[theirs]
        out.append(Pair((name, other_name), t, np.sqrt((gap * gap).sum(axis=1))))
    return sorted(out, key=lambda pair: pair.least)


def smallest(found: Sequence[Pair]) -> tuple[NDArray[np.int64], Array]:
    """Return the smallest distance of any pair over time: stamps (n,) ns, distances (n,) m."""
    t, index = np.unique(np.concatenate([pair.t for pair in found]), return_inverse=True)
    distance = np.full(len(t), np.inf)
    np.minimum.at(distance, index, np.concatenate([pair.distance for pair in found]))
    return t, distance


def table(found: Sequence[Pair], limit: float) -> str:
    """Return the least distance of each pair as text, the nearest pairs; marks those below m."""
    width = max(len(' - '.join(pair.names)) for pair in found) + 2
    lines = [f'{"drones":<{width}}{"least [m]":>10}{"at [s]":>10}{"mean [m]":>10}']
    for pair in found[:_ROWS]:
        distance, t = pair.least
        lines.append(f'{" - ".join(pair.names):<{width}}{distance:10.3f}{t:10.3f}'
                     f'{pair.distance.mean():10.3f}{"  collision" if distance < limit else ""}')
    if len(found) > _ROWS:
        lines.append(f'and {len(found) - _ROWS} pairs that stay farther apart')
    return '\n'.join(lines)


class Seen(NamedTuple):
    """A drone of a hall."""

    bag: Bag  # with its ground truth
    place: Vec3  # (3,) m, where it starts, inertial NED of the hall


def tracks_of(drones: Mapping[str, Seen]) -> dict[str, Track]:
    """Return the track of each drone in the hall."""
    return {name: _track(*drone) for name, drone in drones.items()}


def _track(bag: Bag, place: Vec3) -> Track:
    """Return the track of a drone from its bag, whose axes are z-up."""
    odometry = bag[TRUTH]
    position = np.column_stack(flip_vector(tuple(odometry.position.T))) + np.array(place)
    good = np.isfinite(position).all(axis=1)
    t, first = np.unique(odometry.stamp[good], return_index=True)
    return Track(t, position[good][first])


def read(paths: Sequence[Path]) -> tuple[dict[str, Track], float]:
    """
    Return the tracks of the drones in bags, by namespace, and the distance of a collision in m.

    Parameters and errors are those of :func:`read_drones`.
    """
    drones, limit = read_drones(paths)
    return tracks_of(drones), limit


def read_drones(paths: Sequence[Path]) -> tuple[dict[str, Seen], float]:
    """
    Return the drones of one hall, by namespace, and the distance of a collision in m.

    Parameters
    ----------
    paths
        A bag of each drone, or the folder that holds them.

    Raises
    ------
    mambo_model.errors.MamboError
        If a bag cannot be read, says nothing about its hall, or holds a drone of another bag.

    """
    bags = list(itertools.chain.from_iterable(map(_bags, paths)))
    if not 2 <= len(bags) <= MOST:
        raise InputError(f'{len(bags)} bags: give those of 2 to {MOST} drones')
    drones: dict[str, Seen] = {}
    limit = 0.0
    for path in bags:
        bag = read_bag(path, [TRUTH])
        text, name = bag.attachments.get(world_file.NAME), bag.namespace
        if not isinstance(text, str):
            raise InputError(f'{path}: holds no {world_file.NAME}: it is not of a flight of '
                             'several drones')
        hall = world_file.parse(text, str(path))
        if name in drones:
            raise InputError(f'{path}: {name} is in another bag, too')
        if name not in hall.places:
            raise InputError(f'{path}: {world_file.NAME} has no place for {name}')
        limit = max(limit, hall.params.collision_distance)
        drones[name] = Seen(bag, hall.places[name])
    return drones, limit


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder of bags, not a bag."""
    return not (path / 'metadata.yaml').exists() and any(path.glob('*/metadata.yaml'))


def _bags(path: Path) -> list[Path]:
    """Return the bags in a folder of bags, or the path itself."""
    if not is_folder(path):
        return [path]
    return sorted(file.parent for file in path.glob('*/metadata.yaml'))


def report(found: Sequence[Pair], limit: float) -> dict[str, object]:
    """Return the result for JSON."""
    return {'collision_distance': limit, 'pairs': [
        {'drones': list(pair.names), 'least': pair.least[0], 'at': pair.least[1],
         'mean': float(pair.distance.mean())} for pair in found]}


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    if options.output and options.output.suffix.lower() not in PICTURES:
        raise InputError(
            f'{options.output}: the name of a picture must end in {", ".join(PICTURES)}')
    tracks, limit = read(options.bags)
    found = pairs(tracks)
    if options.json:
        write_json(options.json, json.dumps(report(found, limit), indent=2))
    if options.json != '-':
        print(table(found, limit))
    if options.output:
        from .plot_separation import draw
        draw(options.output, found, limit)
        if options.json != '-':
            print(f'picture: {options.output}')
    if found[0].least[0] < limit:
        raise JobError(found[0].collided())


def parser() -> Parser:
    """Return the command line."""
    out = Parser('separation', __doc__)
    out.add_argument('bags', metavar='BAG', nargs='+', type=Path,
                     help='bags of the drones of one flight, or the folder that holds them')
    out.add_output('PNG', 'picture to draw: distance of the nearest pairs over time')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo separation``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('separation', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
