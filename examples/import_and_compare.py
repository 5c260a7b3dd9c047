"""
Import a take of Motive and compare it with a flight, each with its own clock and frame.

    python3 examples/import_and_compare.py [TAKE.csv BAG]

Without a take, what the motion capture saw of the repository's circle is written as Motive
exports it, y up and with the clock of a take that began 2.5 s into the flight. Other logs:
import_minidrone, import_crazyflie and import_bag in the place of import_motive.
"""

from __future__ import annotations

from pathlib import Path
import sys

import mambo
from mambo_analysis.compare import tables
from mambo_analysis.compare.compare import compare_bags
from mambo_analysis.importers.motive import import_motive
from mambo_bags.reader import Bag
import numpy as np

HERE = Path(__file__).resolve().parents[1]
BEGAN = 2.5  # s
HEAD = """\
Format Version,1.23,Take Name,circle,Export Frame Rate,120.000000,Rotation Type,Quaternion,\
Length Units,Meters,Coordinate Space,Global

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,Name,Mambo,Mambo,Mambo,Mambo,Mambo,Mambo,Mambo
,ID,1,1,1,1,1,1,1
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z
"""


def export(bag: Bag, path: Path) -> None:
    """Write the motion capture of a bag as a take."""
    poses = bag['optitrack/pose']
    t = poses.t - BEGAN
    (x, y, z), (qx, qy, qz, qw) = poses.position.T, poses.orientation.T
    rows = np.column_stack([np.round(t * 120.0), t, qx, qz, -qy, qw, x, z, -y])[t >= 0.0]
    lines = (f'{int(frame)},' + ','.join(f'{value:.6f}' for value in rest)
             for frame, *rest in rows)
    path.write_text(HEAD + '\n'.join(lines) + '\n', encoding='utf-8')


def main(take: Path | None, flight: Path) -> None:
    """Import the take into the folder ``take`` and print how the flight's estimate differs."""
    bag = mambo.open_bag(flight)
    if take is None:
        take = Path('take.csv')
        export(bag, take)
    counts, _ = import_motive(take, Path('take'))
    print(counts)
    seen = mambo.open_bag('take')
    result, _, alignment = compare_bags(bag, seen, 'estimate/odom', 'optitrack/pose')
    print(tables.table(result))
    print(f'\nthe take began {-alignment.offset * 1e-9:.3f} s into the flight')


if __name__ == '__main__':
    given = [Path(argument) for argument in sys.argv[1:]]
    main(given[0] if given else None, given[1] if len(given) > 1 else HERE / 'bags/circle_short')
