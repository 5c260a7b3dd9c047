"""The part of the page that asks for commands: buttons, their values, the answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
import html
import math
import queue
import time
from typing import Any, NamedTuple

from mambo_model import palette

from .drone_state import rgb

ALL = 'all drones'
FLIGHT = ('takeoff', 'land', 'go_to', 'follow', 'stop')
"""Commands of a flight that takes commands."""
TIME = ('pause', 'resume', 'step')
"""Commands of a simulated flight; in a hall they count for all drones."""
_MOST = 20  # clicks that wait for the next frame
_KEPT = 6  # answers on the page
_LONGEST = 240  # characters of an answer
_FAR = 1000.0  # m, as far as a goal can be typed
_STEPS = 1_000_000
_LINE = '<div style="font-size:12px;margin:.2em .9em;color:{}">{}</div>'
_NO_FILE = '(no file)'
_BEFORE_HEALTH = 5e8  # order in the panel: below the choice of curves, above the plot


class Order(NamedTuple):
    """A click: which command, of which drones, with which arguments."""

    name: str
    drones: tuple[str, ...]
    arguments: dict[str, Any]


def _whole(value: float) -> int:
    """Return a typed number as a whole one; -1, which no command takes, if it is none."""
    return int(value) if math.isfinite(value) and value == int(value) else -1


def chosen(dropdown: Any) -> str:
    """Return the choice of a dropdown; its first one in place of what is none of them."""
    if dropdown.value not in dropdown.options:
        dropdown.value = dropdown.options[0]
    return dropdown.value


class Controls:
    """
    The commands of a page; they are off until :meth:`offer` says what the flight takes.

    A click never waits: :meth:`take` returns it to whoever sends commands, and :meth:`answer`
    shows what came of it.

    Parameters
    ----------
    gui : viser.GuiApi
        Of the page.
    drones : sequence of str
        Namespaces.

    """

    def __init__(self, gui: Any, drones: Sequence[str]) -> None:
        self._drones = tuple(drones)
        self._clicks: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self._offered: dict[str, frozenset[str]] = {}
        self._files: tuple[str, ...] = ()
        self._answers: deque[str] = deque(maxlen=_KEPT)
        self._buttons: dict[str, Any] = {}
        with gui.add_folder('commands', order=_BEFORE_HEALTH):
            self._reason = gui.add_html('')
            self._drone = gui.add_dropdown(
                'drone', (ALL, *drones), visible=len(drones) > 1, initial_value=(
                    ALL if len(drones) > 1 else drones[0]))
            self._drone.on_update(lambda _: self._renew())
            self._button(gui, 'stop', 'Stop and hover', lambda: {}, color=rgb('bad'))
            tabs = gui.add_tab_group()
            with tabs.add_tab('fly'):
                self._tab_fly(gui)
            with tabs.add_tab('go to'):
                self._tab_go_to(gui)
            with tabs.add_tab('follow'):
                self._tab_follow(gui)
            with tabs.add_tab('time'):
                self._tab_time(gui)
            with tabs.add_tab('set'):
                self._tab_set(gui)
            self._log = gui.add_html('')
        self.offer({})

    def _tab_fly(self, gui: Any) -> None:
        """Take off and land."""
        height = gui.add_number('height, m', 1.0, min=0.1, max=_FAR, step=0.1)
        self._button(gui, 'takeoff', 'Take off', lambda: {'height': height.value})
        self._button(gui, 'land', 'Land', lambda: {})

    def _tab_go_to(self, gui: Any) -> None:
        """Go to a goal."""
        goal = gui.add_vector3('x, y, z, m', (0.0, 0.0, 1.0), step=0.1,
                               min=(-_FAR,) * 3, max=(_FAR,) * 3)
        self._yaw = gui.add_number('yaw, degrees', 0.0, min=-360.0, max=360.0, step=5.0)
        relative = gui.add_checkbox('from where it is', initial_value=False)
        self._button(gui, 'go_to', 'Go to', lambda: {
            'goal': tuple(goal.value), 'yaw': math.radians(self._yaw.value),
            'relative': relative.value})

    def _tab_follow(self, gui: Any) -> None:
        """Follow a file."""
        self._file = gui.add_dropdown('file', (_NO_FILE,))
        relative = gui.add_checkbox('from where it is ', initial_value=True)
        self._button(gui, 'follow', 'Follow', lambda: {
            'trajectory': chosen(self._file), 'relative': relative.value})

    def _tab_time(self, gui: Any) -> None:
        """Pause, go on, step."""
        self._button(gui, 'pause', 'Pause', lambda: {})
        self._button(gui, 'resume', 'Resume', lambda: {})
        # a float: of a whole number viser would send on one that no other page can read
        self._steps = gui.add_number('steps of 5 ms', 1.0, min=1.0, max=float(_STEPS), step=1.0)
        self._button(gui, 'step', 'Step', lambda: {
            'steps': _whole(self._steps.value)})

    def _tab_set(self, gui: Any) -> None:
        """Set parameters."""
        text = gui.add_text('parameter', 'sim_node.simulator.sonar.noise=0.05')
        self._button(gui, 'set', 'Set', lambda: {'parameters': text.value})

    def _button(self, gui: Any, name: str, label: str, arguments: Any, **look: Any) -> None:
        """Add the button of a command; ``arguments`` returns what is typed beside it."""
        self._buttons[name] = gui.add_button(label, disabled=True, **look)
        self._buttons[name].on_click(lambda _: self._click(name, arguments))

    def _click(self, name: str, arguments: Any) -> None:
        """Keep a click for the next frame; in a thread of viser."""
        reason = self._why_not(name)  # the page of a browser may be older than the flight
        if not reason and self._clicks.qsize() >= _MOST:
            reason = 'too many clicks'
        if reason:
            self.answer(f'{name}: {reason}', False)
            return
        self._clicks.put(Order(name, self._chosen(), arguments()))

    def _chosen(self) -> tuple[str, ...]:
        drone = chosen(self._drone)
        return self._drones if drone == ALL else (drone,)

    def _why_not(self, name: str) -> str:
        """Return why a command is off; empty: it is not."""
        chosen = self._chosen()
        deaf = [drone for drone in chosen if name not in self._offered.get(drone, ())]
        if not deaf:
            return '' if name != 'follow' or self._files else 'there is no file of a trajectory'
        whose = 'this flight' if len(self._drones) == 1 else ', '.join(deaf[:3])
        if not self._offered.get(deaf[0]):
            return f'no flight of {", ".join(deaf[:3])} is found'
        if name in TIME:
            return f'{whose} is not simulated here: no pause, no steps'
        return f'{whose} takes no commands: start it with ./run --commanded'

    def offer(self, commands: Mapping[str, Collection[str]], files: Sequence[str] = ()) -> None:
        """
        Switch on what can be commanded.

        Parameters
        ----------
        commands
            Names of the commands that each drone takes.
        files
            Names of trajectories to follow.

        """
        self._offered = {drone: frozenset(names) for drone, names in commands.items()}
        if tuple(files) != self._files:
            self._files = tuple(files)
            self._file.options = self._files or (_NO_FILE,)
        self._renew()

    def _renew(self) -> None:
        """Let buttons and the line above them be as the offer is."""
        for name, button in self._buttons.items():
            off = bool(self._why_not(name))
            if button.disabled != off:
                button.disabled = off
        text = self._why_not('stop')  # always a line: buttons never move under the mouse
        content = _LINE.format(
            palette.COLOURS['bad' if text else 'good'], html.escape(text or 'takes commands'))
        if content != self._reason.content:
            self._reason.content = content

    def take(self) -> list[Order]:
        """Return the clicks since the last call."""
        out = []
        while not self._clicks.empty():
            out.append(self._clicks.get_nowait())
        return out

    def answer(self, text: str, good: bool) -> None:
        """Show what came of a command, the newest first; the text is escaped."""
        if len(text) > _LONGEST:  # what is wrong is said at the end
            text = f'{text[:_LONGEST // 3]}…{text[-2 * _LONGEST // 3:]}'
        line = f'{time.strftime("%H:%M:%S")} {text}'
        self._answers.appendleft(_LINE.format(
            palette.COLOURS['good' if good else 'bad'], html.escape(line)))
        self._log.content = ''.join(tuple(self._answers))
