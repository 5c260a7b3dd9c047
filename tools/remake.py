#!/usr/bin/env python3
"""
Make the committed flights and figures again, after any change of what they show.

usage: tools/remake.py [NAME ...]

NAME: bags/circle_short, docs/images/circle.png, docs/images/view.png or docs/evidence/drift.png;
without one: all of them. Begin with ``source env.bash``. tests/workspace/test_committed.py fails
when one of them is stale, except for view.png: Chromium takes that screenshot, and every version
draws a little differently.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
import threading

from mambo_analysis.compare import figures
from mambo_bags.reader import Bag, read_bag
from mambo_bringup.run import CONTROLLER
from mambo_flight import closed_loop, recording_to_bag
from mambo_flight.scenario import scenario, Scenario
from mambo_thesis.drift import experiments
from mambo_view.page import PORT
from mambo_view.view import Player
from matplotlib.figure import Figure
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
_SHOWN = (320, 0, 1400, 760)  # pixels of the view, without Chromium's note on software rendering
TITLE = 'circle_joint_seed1'  # the name that ./run gives its default flight


def fly(flight: Scenario, path: Path) -> Path:
    """Fly in one process, write the bag that the graph would write, return its path."""
    recording_to_bag.write(path, flight, closed_loop.fly(flight, inner=True))
    return path


def circle_short(folder: Path) -> Path:
    """Return the first 8 s of the circle (5.3), flown as the thesis flies it."""
    return fly(scenario(estimator='kalman', duration=8.0, land=False), folder / 'circle_short')


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


def _view(folder: Path) -> None:
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if chromium is None:
        raise SystemExit('remake: docs/images/view.png needs Chromium')
    player = Player([circle_short(folder)], PORT)
    player._play.value, player._slider.value = False, 6.9
    taken = threading.Thread(target=subprocess.run, args=([
        chromium, '--headless', '--no-sandbox', '--use-angle=swiftshader', '--hide-scrollbars',
        '--enable-unsafe-swiftshader', '--window-size=1400,760', '--virtual-time-budget=9000',
        f'--screenshot={folder}/view.png', player.page.address],), kwargs={
            'timeout': 120, 'stderr': subprocess.DEVNULL})
    taken.start()
    player.play(taken.is_alive)
    player.page.close()
    with Image.open(folder / 'view.png') as image:
        image.convert('RGB').crop(_SHOWN).quantize(256).save(
            ROOT / 'docs/images/view.png', optimize=True)


MADE: dict[str, Callable[[Path], None]] = {
    'bags/circle_short': _bag, 'docs/images/circle.png': _circle,
    'docs/images/view.png': _view, 'docs/evidence/drift.png': _drift}


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
