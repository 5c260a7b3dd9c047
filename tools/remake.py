#!/usr/bin/env python3
"""
Make the committed flights and figures again, after any change of what they show.

usage: tools/remake.py [NAME ...]

NAME: bags/circle_short, docs/images/circle.png or docs/evidence/drift.png; without one: all of
them. Begin with ``source env.bash``. tests/workspace/test_committed.py fails when one of them is
stale.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import shutil
import sys
import tempfile

from mambo_analysis.compare import figures
from mambo_bags.reader import Bag, read_bag
from mambo_bringup.run import CONTROLLER
from mambo_flight import closed_loop, recording_to_bag
from mambo_flight.scenario import scenario, Scenario
from mambo_thesis.drift import experiments
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
TITLE = 'circle_kalman_seed1'  # the name that ./run gives its default flight


def fly(flight: Scenario, path: Path) -> Path:
    """Fly in one process, write the bag that the graph would write, return its path."""
    recording_to_bag.write(path, flight, closed_loop.fly(flight, inner=True))
    return path


def circle_short(folder: Path) -> Path:
    """Return the bag of ``./run --duration 8 --no-landing --controller cascaded``."""
    return fly(scenario(duration=8.0, land=False), folder / 'circle_short')


def circle(folder: Path) -> Bag:
    """Return the default flight of ``./run``, flown into a folder."""
    return read_bag(fly(scenario(controller=CONTROLLER), folder / TITLE))


def circle_figure(folder: Path) -> Figure:
    """Return the figure of the README, whose flight goes into a folder."""
    return figures.overview(circle(folder), TITLE)


def _bag(folder: Path) -> None:
    made, old = circle_short(folder), ROOT / 'bags/circle_short'
    shutil.rmtree(old, ignore_errors=True)
    shutil.copytree(made, old)


def _circle(folder: Path) -> None:
    figures.write_overview(circle(folder), ROOT / 'docs/images/circle.png', TITLE)


def _drift(folder: Path) -> None:
    if code := experiments.main(
            ['--output', str(folder), '--write', str(ROOT / 'docs/evidence/drift.md')]):
        raise SystemExit(code)
    shutil.copyfile(folder / 'drift.png', ROOT / 'docs/evidence/drift.png')


MADE: dict[str, Callable[[Path], None]] = {
    'bags/circle_short': _bag, 'docs/images/circle.png': _circle,
    'docs/evidence/drift.png': _drift}


def main(names: list[str]) -> int:
    """Make what is named, or all; return the exit code."""
    unknown = [name for name in names if name not in MADE]
    if unknown:
        print(f'remake: {unknown[0]} is none of {", ".join(MADE)}', file=sys.stderr)
        return 2
    for name in names or MADE:
        with tempfile.TemporaryDirectory() as folder:
            MADE[name](Path(folder))
        print(f'made {name}', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
