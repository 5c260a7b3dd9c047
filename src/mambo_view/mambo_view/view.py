"""
Watch a flight in the browser: drones in 3-D, curves, health.

Without a bag, shows the running flight of this ROS domain, which can begin later, and commands it
if it was started with ./run --commanded. With a bag, or
with one for each drone, plays the recording. The page is at http://127.0.0.1:8080, for this
machine alone; Ctrl-C ends it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import json
from pathlib import Path
import time

from mambo_bags.cli.option_types import whole
from mambo_bags.command import guard, Parser, refuse_unused
from mambo_model.errors import InputError
import numpy as np

from .controls import chosen
from .dispatcher import FOLDERS
from .page import check, Page, PORT
from .recording import Recording

_FRAMES = 25.0  # Hz
_SAMPLES = 1500  # of the curves
_SPEEDS = ('0.25', '0.5', '1', '2', '5')
_DRAW_EVERY = 0.3  # s
_LONGEST_STEP = 0.2  # s of wall time of one frame: after a pause of the machine nothing jumps


class Player:
    """
    Plays recordings on a page, with a slider, a button and a choice of speed.

    Parameters
    ----------
    paths : sequence of Path
        Bags, one for each drone.
    port : int
        Of the page.
    namespace : str, optional
        Of the drone to show of each bag, if it has several.

    """

    def __init__(self, paths: Sequence[Path], port: int, namespace: str | None = None) -> None:
        check(port)
        self._recordings = [Recording(path, namespace) for path in paths]
        self.start = min(one.start for one in self._recordings)
        self.end = max(one.end for one in self._recordings)
        names = [f'/{number + 1} {path.stem}' if len(paths) > 1 else '/drone'
                 for number, path in enumerate(paths)]
        self.page = Page(names, port, _SAMPLES)
        for recording, history in zip(self._recordings, self.page.histories, strict=True):
            for t in np.linspace(self.start, self.end, _SAMPLES).tolist():
                history.add(recording.state(t))
        gui = self.page.server.gui
        self._slider = gui.add_slider(
            't, s', 0.0, max(self.end - self.start, 0.01), 0.01, 0.0)
        self._play = gui.add_checkbox('play', initial_value=True)
        self._speed = gui.add_dropdown('speed', _SPEEDS, initial_value='1')
        self._drawn, self._next = -1.0, 0.0

    def step(self, seconds: float) -> None:
        """Advance by a wall time, s, and show the drones."""
        t = min(max(self._slider.value, 0.0), self._slider.max)
        if time.monotonic() >= self._next:  # somebody may have chosen other curves
            self._next = time.monotonic() + _DRAW_EVERY
            self.page.draw()
        if self._play.value:
            t += min(seconds, _LONGEST_STEP) * float(chosen(self._speed))
            self._slider.value = t = 0.0 if t > self._slider.max else t
        if t == self._drawn:
            return
        self._drawn = t
        states = [one.state(self.start + t) for one in self._recordings]
        self.page.show(states)
        self.page.report(states, f't = {self.start + t:.2f} s of {self.end:.2f} s')

    def play(self, going: Callable[[], bool] = lambda: True) -> None:
        """Play, over and over, as long as ``going`` says."""
        last = time.monotonic()
        while going():
            time.sleep(1.0 / _FRAMES)
            now = time.monotonic()
            self.step(now - last)
            last = now


def _run(command: Parser, options: argparse.Namespace) -> None:
    if not options.bags:
        if options.namespace is not None:
            raise InputError('--namespace is for a BAG; a running flight has --drones')
        check(options.port)
        from . import view_node
        view_node.main(['--ros-args', '-p', f'port:={options.port}', '-p',
                        f'drones:={options.drones}', '-p',
                        f'commands:={str(not options.no_commands).lower()}', '-p',
                        f'trajectories:={json.dumps(options.trajectories)}'])
        return
    refuse_unused(command, options, ('drones', 'no_commands', 'trajectories'),
                  'it is for a running flight and a BAG is given')
    player = Player(options.bags, options.port, options.namespace)
    print(f'{player.page.address} (Ctrl-C ends it)', flush=True)
    try:
        player.play()
    except KeyboardInterrupt:
        player.page.close()


def parser() -> Parser:
    """Return the command line."""
    out = Parser('view', __doc__)
    out.add_argument('bags', nargs='*', type=Path, metavar='BAG',
                     help='recording to play; several: one for each drone')
    out.add_argument('--namespace', help='of the drone, if a BAG has several')
    out.add_argument('--drones', default='/mambo', metavar='NAMESPACES',
                     help='of a running flight, separated by commas (default: /mambo)')
    out.add_argument('--no-commands', action='store_true',
                     help='only show a running flight: no buttons that command it')
    out.add_argument('--trajectories', default=FOLDERS, metavar='FOLDERS',
                     help='folders whose trajectories the page can let a drone follow, separated '
                     f'by commas (default: {FOLDERS})')
    out.add_argument('--port', type=whole(1, 65535), default=PORT, metavar='N',
                     help=f'of the page (default: {PORT})')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo view``; return the exit code."""
    command = parser()
    options = command.parse_args(arguments)
    return guard('view', lambda: _run(command, options))
