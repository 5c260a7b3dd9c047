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
from typing import Any, NamedTuple

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.reader import Bag, read_bag
from mambo_model import schema
from mambo_model.errors import InputError, JobError
from mambo_model.frames import flip_vector
from mambo_model.motion.vector import Vec3
from mambo_model.whole_file import refuse_existing
from mambo_sim.parameters import STEP_NS
from mambo_sim.world import MOST
import numpy as np
from numpy.typing import NDArray

from . import world_file
from .world_file import Hall

Array = NDArray[np.float64]
TRUTH = 'ground_truth/odom'
PICTURES = ('.png', '.svg', '.pdf')
_ROWS = 30  # of the table: the nearest pairs
LEAST_LACK = 0.1  # s of flight without a distance, from which it is told


class Track(NamedTuple):
    """Where a drone was in the hall."""

    t: NDArray[np.int64]  # (n,) ns, rising
    position: Array  # (n, 3) m, inertial NED of the hall


class Pair(NamedTuple):
    """Two drones over time."""

    names: tuple[str, str]
    t: NDArray[np.int64]  # (n,) ns, stamps that both have
    distance: Array  # (n,) m, between their centres
    lacking: float = 0.0  # s of flight that only one of the bags holds

    @property
    def least(self) -> tuple[float, float]:
        """Return the least distance in m and its time in s."""
        k = int(self.distance.argmin())
        return float(self.distance[k]), float(self.t[k]) * 1e-9

    def collided(self) -> str:
        """Return that the pair collided, as one line."""
        distance, t = self.least
        return (f'{" and ".join(self.names)} collided: {distance:.3f} m apart at their nearest, '
                f'at t = {t:.3f} s')


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
        lacking = (len(np.union1d(one.t, other.t)) - len(t)) * STEP_NS * 1e-9
        gap = one.position[mine] - other.position[theirs]
        out.append(Pair((name, other_name), t, np.sqrt((gap * gap).sum(axis=1)), lacking))
    return sorted(out, key=lambda pair: pair.least)


def smallest(found: Sequence[Pair]) -> tuple[NDArray[np.int64], Array]:
    """Return the smallest distance of any pair over time: stamps (n,) ns, distances (n,) m."""
    t, index = np.unique(np.concatenate([pair.t for pair in found]), return_inverse=True)
    distance = np.full(len(t), np.inf)
    np.minimum.at(distance, index, np.concatenate([pair.distance for pair in found]))
    return t, distance


def incomplete(found: Sequence[Pair]) -> str:
    """Return which pairs lack a distance for a while, as one line; '': none."""
    lacking = [pair for pair in found if pair.lacking > LEAST_LACK]
    if not lacking:
        return ''
    pair = max(lacking, key=lambda pair: pair.lacking)
    return (f'{len(lacking)} of {len(found)} pairs have no distance for a part of the flight, '
            f'{" and ".join(pair.names)} for {pair.lacking:.2f} s: one of their bags is shorter, '
            'or has gaps')


def table(found: Sequence[Pair], limit: float) -> str:
    """
    Return the least distance of each pair as text, the nearest pairs; marks those below m.

    Its last line is a warning where distances are incomplete.
    """
    width = max(len(' - '.join(pair.names)) for pair in found) + 2
    lines = [f'{"drones":<{width}}{"least [m]":>10}{"at [s]":>10}{"mean [m]":>10}']
    for pair in found[:_ROWS]:
        distance, t = pair.least
        lines.append(f'{" - ".join(pair.names):<{width}}{distance:10.3f}{t:10.3f}'
                     f'{pair.distance.mean():10.3f}{"  collision" if distance < limit else ""}')
    if len(found) > _ROWS:
        lines.append(f'and {len(found) - _ROWS} pairs that stay farther apart')
    if lack := incomplete(found):
        lines.append(f'warning: {lack}')
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
    drones, hall = read_drones(paths)
    return tracks_of(drones), hall.params.collision_distance


def read_drones(paths: Sequence[Path]) -> tuple[dict[str, Seen], Hall]:
    """
    Return the drones of one hall, by namespace, and the hall, which may have more drones.

    Parameters
    ----------
    paths
        A bag of each drone, or the folder that holds them.

    Raises
    ------
    mambo_model.errors.MamboError
        If a bag cannot be read, says nothing about its hall, is of another flight or holds a drone
        of another bag, or if a folder alone lacks drones of its hall.

    """
    bags = list(itertools.chain.from_iterable(map(_bags, paths)))
    if len(bags) < 2 and len(paths) == 1:
        raise InputError(f"{paths[0]}: {'one drone' if bags else 'no bag in it'}: give a folder "
                         f'with the bags of 2 to {MOST} drones, or each of them')
    if not 2 <= len(bags) <= MOST:
        raise InputError(f'{len(bags)} bags: give those of 2 to {MOST} drones')
    drones: dict[str, Seen] = {}
    first: _Flight | None = None
    for path in bags:
        bag = read_bag(path, [TRUTH])
        text, name = bag.attachments.get(world_file.NAME), bag.namespace
        if not isinstance(text, str):
            raise InputError(f'{path}: holds no {world_file.NAME}: it is not of a flight of '
                             'several drones')
        hall = world_file.parse(text, str(path))
        if name not in hall.places:
            raise InputError(f'{path}: {world_file.NAME} has no place for {name}')
        flight = _flight(bag, hall)
        first = first or flight
        for what, value, expected in zip(_Flight._fields, flight, first, strict=True):
            if value != expected:
                raise InputError(f'{path}: is not of the flight of {bags[0]}: '
                                 f'{_difference(what, value, expected)}')
        if name in drones:
            raise InputError(f'{path}: {name} is in another bag, too')
        drones[name] = Seen(bag, hall.places[name])
    if len(paths) == 1 and (lost := missing(drones, hall)):
        raise InputError(f'{paths[0]}: {lost}: fly it again, or give mambo separation the bags '
                         'that there are, one by one')
    return drones, hall


def missing(drones: Mapping[str, Seen], hall: Hall) -> str:
    """Return which drones of a hall are not there, in a few words; empty if none is missing."""
    lost = [name for name in hall.places if name not in drones]
    verb = 'is' if len(lost) == 1 else 'are'
    return (f'{", ".join(lost)} of the {len(hall.places)} drones of the hall {verb} missing'
            if lost else '')


class _Flight(NamedTuple):
    """What the bags of one flight have in common."""

    hall: Hall
    seed: int | None  # of the first drone; None if the bag does not say
    duration: float | None  # s, likewise
    trajectory: str | None  # likewise


def _parameters(bag: Bag, node: str) -> dict[str, Any]:
    """Return the parameters of a node that a bag holds; none if it does not say."""
    section: Any = (bag.scenario or {}).get(f'{bag.namespace}/{node}')
    values = section.get('ros__parameters') if isinstance(section, dict) else None
    return values if isinstance(values, dict) else {}


def _flight(bag: Bag, hall: Hall) -> _Flight:
    """Return what a bag says about its flight."""
    simulated = _parameters(bag, 'sim_node')
    simulator, plan = simulated.get('simulator'), _parameters(bag, 'reference_node').get('plan')
    seed = simulator.get('seed') if isinstance(simulator, dict) else None
    number = list(hall.places).index(bag.namespace)  # seeds are consecutive
    return _Flight(hall, seed - number if isinstance(seed, int) else None,
                   simulated.get('duration'),
                   plan.get('trajectory') if isinstance(plan, dict) else None)


def _difference(what: str, value: Any, expected: Any) -> str:
    """Return how two flights differ, in a few words."""
    if what != 'hall':
        return f'{what} {value}, not {expected}'
    ours, theirs = (schema.flatten(hall.params) for hall in (value, expected))
    for name in ours:
        if ours[name] != theirs[name]:
            return f'world.{name} = {ours[name]}, not {theirs[name]}'
    return 'other places'


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder of bags, not a bag."""
    return not (path / 'metadata.yaml').exists() and any(path.glob('*/metadata.yaml'))


def _bags(path: Path) -> list[Path]:
    """Return the bags in a folder of bags, or the path itself."""
    if not path.exists():
        raise InputError(f'{path}: no such bag or folder of bags')
    if not is_folder(path):
        return [path]
    return sorted(file.parent for file in path.glob('*/metadata.yaml'))


def report(found: Sequence[Pair], limit: float) -> dict[str, object]:
    """Return the result for JSON."""
    return {'collision_distance': limit, 'pairs': [
        {'drones': list(pair.names), 'least': pair.least[0], 'at': pair.least[1],
         'mean': float(pair.distance.mean()), 'from': float(pair.t[0]) * 1e-9,
         'to': float(pair.t[-1]) * 1e-9, 'lacking': pair.lacking} for pair in found]}


def _shorter(drones: Mapping[str, Seen], hall: Hall, found: Sequence[Pair]) -> str:
    """Return that distances end before the flight, as one line; '' if they do not."""
    planned = _flight(next(iter(drones.values())).bag, hall).duration
    end = max(float(pair.t[-1]) * 1e-9 for pair in found)
    if not planned or end > planned - LEAST_LACK:
        return ''
    return f'distances end at t = {end:.2f} s of {planned:g} s of flight'


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    if options.output and options.output.suffix.lower() not in PICTURES:
        raise InputError(
            f'{options.output}: the name of a picture must end in {", ".join(PICTURES)}')
    drones, hall = read_drones(options.bags)
    found, limit = pairs(tracks_of(drones)), hall.params.collision_distance
    lost, shorter = missing(drones, hall), _shorter(drones, hall, found)
    if options.json:
        write_json(options.json, json.dumps({
            **report(found, limit),
            'missing': [name for name in hall.places if name not in drones]}, indent=2))
    if options.json != '-':
        print(table(found, limit))
        if lost:
            print(f'warning: {lost}: their distances are not in the table')
        if shorter:
            print(f'warning: {shorter}')
    if options.output:
        from .plot_separation import draw
        draw(options.output, found, limit)
        if options.json != '-':
            print(f'picture: {options.output}')
    if found[0].least[0] < limit:
        raise JobError(found[0].collided())
    if lack := incomplete(found) or shorter:
        raise JobError(f'collisions cannot be excluded: {lack}')


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
