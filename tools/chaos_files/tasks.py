"""The commands that are given too little, and what each makes when it has enough."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile
from typing import NamedTuple

from mambo_bags.cli.digest import digest
from mambo_bags.reader import BagError, read_bag
from mambo_bringup.stuck import is_closed
from mambo_ros import topics

from . import ROOT

START = (sys.executable, str(ROOT / 'tools/start.py'))
_FLIGHT = 'run --no-landing --duration 3 --output {out}/bag'
_TIMED = 0.9  # least share of the messages that a recording in wall time must hold
_SWEEP = """title: Two seeds
vary:
  seed: [1, 2]
  sim_node.duration: [2.0]
"""


class Task(NamedTuple):
    """
    A command.

    Attributes
    ----------
    words
        Command line; ``{out}`` is the folder of what it makes, ``{good}`` a bag, ``{sweep}`` a
        sweep file.
    exact
        Whether every message of its bags is the same each time.
    ends
        Whether it ends by itself; otherwise it is interrupted.

    """

    words: str
    exact: bool = True
    ends: bool = True

    @property
    def writes(self) -> bool:
        """Return whether the command makes files."""
        return '{out}' in self.words


TASKS = {
    'composed': Task(f'{_FLIGHT} --composed --no-report'),
    'composed, report': Task(f'{_FLIGHT} --composed'),
    'processes': Task(f'{_FLIGHT} --processes --no-report'),
    'processes, report': Task(f'{_FLIGHT} --processes'),
    'real time': Task(f'{_FLIGHT} --mode realtime --no-report', exact=False),
    'real time, report': Task(f'{_FLIGHT} --mode realtime', exact=False),
    'drones': Task(f'{_FLIGHT} --drones 2 --processes --no-report'),
    'drones, report': Task(f'{_FLIGHT} --drones 2 --processes'),
    'replay': Task('mambo replay {good} -o {out}/bag', exact=False),
    'fly': Task('mambo fly --duration 4 -o {out}/bag'),
    'compare': Task('mambo compare {good} {good} --html {out}/page.html --csv {out}/table.csv'),
    'estimate': Task('mambo estimate {good} -o {out}/bag'),
    'recover': Task('mambo recover {good} {out}/bag'),
    'import': Task('mambo import bag {good} -o {out}/bag --map '
                   '/mambo/ground_truth/odom:=ground_truth/odom --map '
                   '/mambo/imu/data_raw:=imu/data_raw'),
    'sweep': Task('mambo sweep {sweep} --workers 2 -o {out}/table.parquet'),
    'check': Task('mambo trajectory check {gate}'),
    'digest': Task('mambo digest {good}'),
    'urdf': Task('mambo urdf'),
    'view': Task('mambo view {good} --port {port}', ends=False)}
"""By the name in the output."""


class Made(NamedTuple):
    """What a command has made and printed."""

    bags: dict[str, tuple[str, int]]  # digest, and messages of the IMU and the estimate, by path
    files: dict[str, int]  # bytes, by path
    lines: int             # of stdout


def words_of(task: Task, out: Path, base: Path, port: int) -> list[str]:
    """Return the words of a command line."""
    places = {'out': out, 'good': ROOT / 'bags/circle_short', 'sweep': base / 'sweep.yaml',
              'gate': ROOT / 'examples/gate.yaml', 'port': port}
    return [word.format(**places) for word in task.words.split()]


def made(out: Path, printed: str) -> Made:
    """
    Read what a command has made, beside what it has printed.

    Raises
    ------
    mambo_bags.reader.BagError
        If a bag is not closed or cannot be read.

    """
    bags, files = {}, {}
    for path in sorted(out.rglob('*')):
        name = str(path.relative_to(out))
        if path.name == 'metadata.yaml':
            if not is_closed(path.parent):
                raise BagError(f'{name}: the bag is not closed')
            bag = read_bag(path.parent)
            bags[name] = digest(bag), sum(
                len(bag[each]) for each in bag.topics
                if each.endswith((topics.IMU.name, topics.ESTIMATE.name)))
        elif path.is_file() and path.suffix != '.mcap':
            files[name] = path.stat().st_size
    lines = [line for line in printed.splitlines() if 'compil' not in line]  # said only once
    return Made(bags, files, len(lines))


def missing(task: Task, found: Made, whole: Made) -> str:
    """Return what a command did not make that it makes when it has enough; '' if nothing."""
    for name, (text, count) in whole.bags.items():
        there = found.bags.get(name, ('', 0))
        if there[0] != text and (task.exact or there[1] < _TIMED * count):
            return f'{name} has {there[1]} of {count} messages'
    for name, size in whole.files.items():
        if found.files.get(name, 0) < _TIMED * size:
            return f'{name} has {found.files.get(name, 0)} of {size} bytes'
    return '' if found.lines >= whole.lines else f'{found.lines} of {whole.lines} lines printed'


def enough(task: Task, base: Path) -> Made:
    """Run a command that has enough; return what it makes. SystemExit if it fails."""
    (base / 'sweep.yaml').write_text(_SWEEP)
    if not task.ends:
        return Made({}, {}, 0)
    with tempfile.TemporaryDirectory(dir=base) as folder:
        out = Path(folder, 'out')
        out.mkdir()
        done = subprocess.run([*START, *words_of(task, out, base, 0)], text=True,
                              capture_output=True, cwd=folder, stdin=subprocess.DEVNULL)
        if done.returncode:
            sys.exit(f'chaos: {task.words} fails with enough of everything: {done.stderr}')
        return made(out, done.stdout)
