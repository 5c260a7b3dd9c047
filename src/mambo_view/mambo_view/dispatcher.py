"""From a click to the answer of the flight, without a wait: what is sent, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
import math
from pathlib import Path
import threading
import time
from typing import Any, Protocol

from mambo_model.errors import MamboError

from .controls import Controls, FLIGHT, Order, TIME

FOLDERS = '.,examples'
"""Folders whose trajectories are offered, unless others are given."""
READ = 20.0  # s of wall time, to read the file of a trajectory
_MOST = 64  # commands on their way
_FILES = 100  # trajectories of a folder that are offered
_SUFFIXES = ('.csv', '.yaml', '.yml')
_HEAD = 65_536  # characters in which a file says that it is a trajectory
_WORDS = {'takeoff': 'take off', 'go_to': 'go to'}


class Call(Protocol):
    """A command that was sent; see ``mambo_ros.commands.client.Call``."""

    sent: bool

    def poll(self, now: float) -> str | None:
        """Return what the flight answered; None: nothing yet."""

    def close(self) -> None:
        """Forget it."""


def trajectories(folders: Sequence[Path]) -> list[str]:
    """Return the files of trajectories in some folders, as they would be named to open them."""
    found = []
    for folder in folders:
        try:
            inside = sorted(folder.iterdir())
        except OSError:
            continue
        found += [str(file) for file in inside if _is_trajectory(file)]
    return found[:_FILES]


def _is_trajectory(file: Path) -> bool:
    """Return whether a file may be one of a trajectory; those in YAML say so by a key."""
    if file.suffix.lower() not in _SUFFIXES or file.name.startswith('.') or not file.is_file():
        return False
    if file.suffix.lower() == '.csv':
        return True
    try:
        with file.open(encoding='utf-8') as text:
            return any(line.startswith('waypoints:') for line in text.read(_HEAD).splitlines())
    except (OSError, UnicodeDecodeError):
        return False


class _Course:
    """Reads a file of a trajectory in a thread of its own; planning one may take seconds."""

    sent = False

    def __init__(self, read: Callable[[Path], str], path: Path) -> None:
        self._limit = time.monotonic() + READ
        self.text, self._error = '', ''
        self._path = path
        self._thread = threading.Thread(target=self._run, args=(read,), daemon=True)
        self._thread.start()

    def _run(self, read: Callable[[Path], str]) -> None:
        try:
            self.text = read(self._path)
        except (MamboError, OSError) as error:
            self._error = str(error)
        except Exception as error:  # whatever the file holds, the page says it
            self._error = f'{self._path}: cannot be read: {error!r}'

    def done(self, now: float) -> bool:
        """Return whether it has been read; ValueError with the reason if it cannot be."""
        if self._thread.is_alive():
            if now > self._limit:
                raise ValueError(f'{self._path}: not read within {READ:g} s')
            return False
        if self._error:
            raise ValueError(self._error)
        return True


class _Pending:
    """A command of one drone on its way."""

    def __init__(self, order: Order, drone: str, course: _Course | None) -> None:
        self.order, self.drone, self.course = order, drone, course
        self.call: Call | None = None

    @property
    def waits(self) -> bool:
        """Return whether the drone cannot have got it yet."""
        return self.call is None or not self.call.sent


class Dispatcher:
    """
    Sends the commands of a page and shows the answers.

    Every wait has a limit and none stops a frame. A command that moves a drone takes the place of
    one that has not been sent yet: nothing that was clicked before a stop is flown after it.

    Parameters
    ----------
    controls : Controls
        Of the page.
    drones : sequence of str
        Namespaces.
    call
        Sends a command: ``call(name, drone, **arguments)`` returns a :class:`Call`.
    read_course
        Returns the text of a trajectory for ``follow`` of its file.
    setting
        Returns name and value of ``NODE.PARAMETER=VALUE``.
    folders
        Whose trajectories are offered; no other file is read.

    """

    def __init__(
        self, controls: Controls, drones: Sequence[str], call: Callable[..., Call],
        read_course: Callable[[Path], str], setting: Callable[[str], tuple[str, Any]],
        folders: Sequence[Path],
    ) -> None:
        self._controls, self._drones, self._folders = controls, tuple(drones), tuple(folders)
        self._call, self._read, self._setting = call, read_course, setting
        self._pending: list[_Pending] = []
        self._files: list[str] = []
        self._many = len(drones) > 1

    def offer(self, has: Callable[[str, str], bool]) -> None:
        """
        Show which commands there are.

        Parameters
        ----------
        has
            Whether a drone has a service: ``has(drone, name)``.

        """
        self._files = trajectories(self._folders)
        offered: dict[str, Collection[str]] = {}
        for drone in self._drones:
            flown, simulated = has(drone, 'takeoff'), has(drone, 'pause')
            offered[drone] = (*(FLIGHT if flown else ()), *(TIME if simulated else ()),
                              *(('set',) if flown or simulated else ()))
        self._controls.offer(offered, self._files)

    def step(self, now: float) -> None:
        """Send what was clicked, show what was answered; ``now`` is a wall time, s."""
        for order in self._controls.take():
            self._accept(order)
        for one in tuple(self._pending):
            try:
                message = self._advance(one, now)
            except (MamboError, ValueError) as error:
                self._finish(one, str(error), False)
            else:
                if message is not None:
                    self._finish(one, message, True)

    def _accept(self, order: Order) -> None:
        """Begin with a click."""
        # a pause of a hall is one of all its drones, and so is a step
        drones = order.drones[:1] if order.name == 'step' else order.drones
        if len(self._pending) + len(drones) > _MOST:
            self._show(order, '', 'too many commands wait for their answers', False)
            return
        course = None
        try:
            if order.name == 'set':
                order.arguments['parameters'] = self._settings(order.arguments['parameters'])
            if order.name == 'follow':
                course = self._course(order.arguments['trajectory'])
        except (MamboError, ValueError) as error:
            self._show(order, '', str(error), False)
            return
        if order.name in FLIGHT:
            for one in tuple(self._pending):
                if one.waits and one.drone in drones and one.order.name in FLIGHT:
                    self._finish(one, f'not sent: {_words(order.name)} came after it', False)
        self._pending += [_Pending(order, drone, course) for drone in drones]

    def _settings(self, text: str) -> dict[str, Any]:
        """Return {name: value} of what was typed; ValueError for a name given twice."""
        given = [self._setting(one) for one in text.split()]
        names = [name for name, _ in given]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f'{twice[0]}: given twice')
        return dict(given)

    def _course(self, name: str) -> _Course:
        """Begin to read a trajectory, one of those that are offered."""
        if name not in self._files:
            raise ValueError(f'{name}: choose one of the files')
        if any(one.course is not None and one.call is None for one in self._pending):
            raise ValueError('another file is being read')
        return _Course(self._read, Path(name))

    def _advance(self, one: _Pending, now: float) -> str | None:
        """Do what can be done now; return the answer, None: there is none yet."""
        if one.call is None:
            arguments = one.order.arguments
            if one.course is not None:
                if not one.course.done(now):
                    return None
                arguments = {**arguments, 'trajectory': one.course.text}
            one.call = self._call(one.order.name, one.drone, **arguments)
        return one.call.poll(now)

    def _finish(self, one: _Pending, text: str, good: bool) -> None:
        """Show what came of a command and forget it."""
        self._pending.remove(one)
        if one.call is not None:
            one.call.close()
        self._show(one.order, one.drone if self._many else '', text, good)

    def _show(self, order: Order, drone: str, text: str, good: bool) -> None:
        """Show what came of an order, with what was asked for."""
        self._controls.answer(
            f'{drone} {_words(order.name)}{_said(order)}: {text}'.strip(), good)


def _words(name: str) -> str:
    """Return a command as the page calls it."""
    return _WORDS.get(name, name)


def _said(order: Order) -> str:
    """Return the values of an order that were sent, for its answer."""
    given = order.arguments
    if order.name == 'takeoff':
        return f' to {given["height"]:g} m'
    if order.name == 'go_to':
        goal = ', '.join(f'{one:g}' for one in given['goal'])
        yaw = f', yaw {math.degrees(given["yaw"]):g} degrees' if given['yaw'] else ''
        return f' {goal} m{yaw}{" from where it is" if given["relative"] else ""}'
    if order.name == 'follow':
        return f' {given["trajectory"]}'
    return f' {given["steps"]}' if order.name == 'step' else ''
