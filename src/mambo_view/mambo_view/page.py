"""
The page in the browser: drones in 3-D, curves, health.

On viser, an optional package. It serves one page on this machine alone (127.0.0.1), and to pages
of its own alone.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import html
import io
import logging
import math
import socket
from typing import Any

from mambo_model import palette
from mambo_model.errors import InputError, JobError
import numpy as np

from . import same_origin
from .controls import chosen, Controls
from .drone_state import (
    DroneState, ESTIMATE, History, MEASURED, REFERENCE, rgb, ROLES, SIGNALS, TRUTH)

HOST = '127.0.0.1'
PORT = 8080
_ARM, _ROTOR, _BODY = 0.05, 0.033, (0.06, 0.045, 0.025)  # m, about the size of a Mambo
_OPACITY = {TRUTH: None, ESTIMATE: 0.45, REFERENCE: 0.25}
_LEVELS = (('good', 'OK'), ('half', 'WARN'), ('bad', 'ERROR'))
_LONGEST = 160  # characters of a message on the page
_PLOT_HEIGHT = 240  # pixels
_LAST = 1e9  # order of the health in the panel, below what a caller adds
_SILENT = 5.0  # s of wall time, after which the health of a node is not known any more
_STATUS = '<p style="margin:.4em .7em"><b>{}</b></p>'


def _viser() -> Any:
    """Return the package viser, or say how to get it."""
    try:
        import viser
    except ImportError:
        raise InputError('the view needs viser: pip install -r requirements/view.txt') from None
    return viser


def check(port: int) -> None:
    """
    Refuse to start a page that cannot be served.

    Raises
    ------
    mambo_model.errors.InputError
        If viser is not installed, or another program uses the port.

    """
    _viser()
    if not 1 <= port <= 65535:
        raise InputError(f'port {port} must be from 1 to 65535')
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
    except OSError as error:
        raise InputError(f'port {port}: {error.strerror}; give another') from None


def address(port: int) -> str:
    """Return where the page on a port is."""
    return f'http://{HOST}:{port}'


def _scales(low: float, high: float, now: dict[str, Any] | None = None) -> dict[str, Any]:
    """
    Return the axes of a plot whose curves, from low to high, may be unknown (NaN) for a while.

    The browser makes a plot anew for other axes, and draws no curve if that is often: those of now
    are kept while the curves fit, and others have room to grow.
    """
    if now is not None:
        bottom, top = now['y']['min'], now['y']['max']
        if bottom <= low and high <= top and high - low > 0.3 * (top - bottom):
            return now
    if high > low:
        step = 2.0 ** math.ceil(math.log2(high - low)) / 4.0
        margin = 0.1 * step
        low, high = step * math.floor(low / step), step * math.ceil(high / step)
    else:
        margin = 0.5
    return {'x': {'time': False, 'auto': True},
            'y': {'auto': False, 'min': float(low - margin), 'max': float(high + margin)}}


class _Drone:
    """The parts of one drone in the scene."""

    def __init__(self, scene: Any, name: str, label: bool) -> None:
        self._frames = {role: self._model(scene, f'{name}/{role}', role)
                        for role in (TRUTH, ESTIMATE, REFERENCE)}
        self._frames[MEASURED] = scene.add_icosphere(
            f'{name}/{MEASURED}', radius=0.015, color=rgb(MEASURED), visible=False)
        if label:
            scene.add_label(f'{name}/{TRUTH}/label', name.strip('/'), position=(0.0, 0.0, 0.1))
        self._paths = {role: scene.add_line_segments(
            f'{name}/paths/{role}', np.zeros((1, 2, 3), np.float32), rgb(role), thickness=2.0,
            thickness_units='screen', visible=False) for role in ROLES}

    @staticmethod
    def _model(scene: Any, name: str, role: str) -> Any:
        """Add a quadrotor: a body, two arms, four rotors; the front ones are lighter."""
        colour, look = rgb(role), {'opacity': _OPACITY[role]}
        root = scene.add_frame(name, show_axes=False, visible=False)
        scene.add_box(f'{name}/body', color=colour, dimensions=_BODY, **look)
        for number, (x, y) in enumerate(((1, -1), (1, 1), (-1, 1), (-1, -1))):
            place = (_ARM * x, _ARM * y, 0.012)
            rotor = tuple((one + 255) // 2 for one in colour) if x > 0 else colour
            scene.add_cylinder(f'{name}/rotor{number + 1}', radius=_ROTOR, height=0.004,
                               color=rotor, position=place, **look)
            scene.add_box(f'{name}/arm{number + 1}', color=colour, position=(
                place[0] / 2, place[1] / 2, 0.0), dimensions=(0.07, 0.008, 0.006),
                wxyz=(0.9239, 0.0, 0.0, 0.3827 * x * y), **look)
        return root

    def show(self, state: DroneState, shown: set[str]) -> None:
        """Move the parts to the poses of now."""
        for role, frame in self._frames.items():
            pose = state.poses.get(role)
            visible = role in shown and pose is not None
            if frame.visible != visible:
                frame.visible = visible
            if visible:
                frame.position, frame.wxyz = pose.position, pose.attitude

    def draw(self, history: History, shown: set[str]) -> None:
        """Draw the paths."""
        for role, line in self._paths.items():
            segments = history.segments(role) if role in shown else ()
            if len(segments):
                line.points = segments
            if line.visible != bool(len(segments)):
                line.visible = bool(len(segments))


def _health(state: DroneState, now: float = math.nan) -> str:
    """
    Return the health of every node as a table; every text in it is escaped.

    A node that has been silent for long at ``now``, monotonic s, has none any more.
    """
    rows = []
    for node, (level, message) in sorted(state.health.items()):
        role, word = _LEVELS[min(max(level, 0), 2)]
        silent = now - state.heard.get(node, math.nan)
        if silent > _SILENT:
            role, word, message = 'half', '?', f'no report for {silent:.0f} s'
        name, text = html.escape(node[:_LONGEST]), html.escape(message[:_LONGEST])
        style = f'color:{palette.COLOURS[role]};padding:0 .6em'
        rows.append(f'<tr><td>{name}</td><td style="{style}"><b>{word}</b></td>'
                    f'<td>{text}</td></tr>')
    return f'<table style="font-size:12px;margin:.4em .7em">{"".join(rows)}</table>' if rows else (
        '<p style="font-size:12px;margin:.4em .7em">no report yet</p>')


class Page:
    """
    The page of some drones.

    Parameters
    ----------
    names : sequence of str
        Of the drones, such as ``/mambo``.
    port : int
        To serve it on.
    length : int
        Samples of the curves that are kept.
    commanded
        Whether the page has commands, as that of a running flight.

    Attributes
    ----------
    controls : Controls or None
        The commands of the page.
    server : viser.ViserServer
        For controls of the caller's own.
    histories : list[History]
        One for each drone; the caller adds to them.

    Raises
    ------
    mambo_model.errors.InputError
        If viser is not installed, or the port is used.
    mambo_model.errors.JobError
        If the page could not be served on that port.

    """

    def __init__(self, names: Sequence[str], port: int = PORT, length: int = 600,
                 commanded: bool = False) -> None:
        check(port)
        viser = _viser()
        # what a stranger sends to the port ends the connection and is no error of the view
        for logger in ('websockets.server', 'asyncio'):
            logging.getLogger(logger).setLevel(logging.CRITICAL)
        self.server = None
        try:
            with contextlib.redirect_stdout(io.StringIO()), same_origin.enforced():  # its banner
                self.server = viser.ViserServer(
                    host=HOST, port=port, label='Mambo', verbose=False)
        except JobError:
            if self.server is not None:
                self.close()
            raise
        if self.server.get_port() != port:
            self.close()
            raise JobError(f'port {port} was taken while the page started; start it again')
        self.histories = [History(length) for _ in names]
        scene, gui = self.server.scene, self.server.gui
        scene.set_up_direction('+z')
        scene.add_grid('/floor', width=10.0, height=10.0, cell_size=0.5, section_size=1.0)
        scene.add_frame('/map', axes_length=0.3, axes_radius=0.005)
        self.server.initial_camera.position = (-1.6, -1.6, 2.2)
        self.server.initial_camera.look_at = (0.0, 0.0, 0.9)
        self._drones = [_Drone(scene, name, len(names) > 1) for name in names]
        self._names = list(names)
        # a shared page would be one on the Internet
        gui.configure_theme(dark_mode=False, control_width='large', show_share_button=False)
        self._status = gui.add_html(_STATUS.format('waiting for a flight'))
        self._roles = {role: gui.add_checkbox(label, initial_value=True)
                       for role, label in ROLES.items()}
        self._chooser = gui.add_dropdown('curves of', tuple(names), visible=len(names) > 1)
        self._signal = gui.add_dropdown('curves', tuple(SIGNALS))
        self._plotted, self._plot = '', None
        self._drawn: tuple[Any, ...] = ()
        self._health = gui.add_html(_health(DroneState()), order=_LAST)
        self.controls = Controls(gui, names) if commanded else None

    @property
    def address(self) -> str:
        """Return where the page is."""
        return address(self.server.get_port())

    @property
    def _chosen(self) -> int:
        """Return the number of the drone whose curves and health are shown."""
        return self._names.index(chosen(self._chooser))

    def _new_plot(self, name: str) -> None:
        """Put a plot of other signals into the place of the last one."""
        if self._plot is not None:
            self._plot.remove()
        curves = SIGNALS[name]
        self._plot = self.server.gui.add_uplot(
            tuple(np.zeros(1) for _ in range(len(curves) + 1)),
            ({'label': 't, s'}, *({'label': curve.label, 'width': 2,
                                   'stroke': palette.COLOURS[curve.role]} for curve in curves)),
            scales=_scales(0.0, 1.0),
            height=_PLOT_HEIGHT, order=_LAST - 1.0)
        self._plotted = name

    def _shown(self) -> set[str]:
        return {role for role, box in self._roles.items() if box.value}

    def show(self, states: Sequence[DroneState]) -> None:
        """Move every drone to its poses of now; cheap, for every frame."""
        shown = self._shown()
        for drone, state in zip(self._drones, states, strict=True):
            drone.show(state, shown)
        self.server.flush()

    def draw(self) -> None:
        """Draw curves and paths anew; dearer, for some times a second."""
        shown, name = self._shown(), chosen(self._signal)
        wanted = (name, self._chosen, shown, *(one.version for one in self.histories))
        if wanted == self._drawn:
            return
        self._drawn = wanted
        for drone, history in zip(self._drones, self.histories, strict=True):
            drone.draw(history, shown)
        if name != self._plotted:
            self._new_plot(name)
        columns = self.histories[self._chosen].columns(name)
        known = np.concatenate(columns[1:])
        known = known[np.isfinite(known)]
        if len(known):
            scales = _scales(known.min(), known.max(), self._plot.scales)
            if scales != self._plot.scales:
                self._plot.scales = scales
            self._plot.data = columns

    def report(
        self, states: Sequence[DroneState], text: str, now: float = math.nan,
    ) -> None:
        """
        Write a line of status, which is escaped, and the health of the chosen drone.

        ``now`` is the monotonic wall time, s; NaN for a recording.
        """
        self._status.content = _STATUS.format(html.escape(text))
        content = _health(states[self._chosen], now)
        if content != self._health.content:
            self._health.content = content

    def close(self) -> None:
        """End the server."""
        with contextlib.redirect_stdout(io.StringIO()):  # says that it has stopped
            self.server.stop()
