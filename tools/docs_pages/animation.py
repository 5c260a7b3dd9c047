"""The picture of the first page: the default flight, drawn as an SVG that moves by itself."""

from __future__ import annotations

from mambo_bringup.run import CONTROLLER
from mambo_flight.closed_loop import fly
from mambo_flight.scenario import scenario
from mambo_model import palette
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WIDTH, HEIGHT, SECONDS = 860, 380, 10  # pixels; of one round of the picture
SCALE, ORIGIN = 108.0, (255.0, 268.0)  # pixels per metre, where x = y = z = 0 is
AZIMUTH, ELEVATION = np.radians(35.0), np.radians(28.0)  # of the camera
STRIPS = (('x', 70), ('y', 170), ('z', 270))  # axis, top of its plot
LEFT, RIGHT, TALL = 560, 835, 80  # of the plots
FLOWN, PLANNED, SOFT = (palette.COLOURS[role] for role in ('truth', 'reference', 'soft'))
DASHED = 'stroke-width="1.4" stroke-dasharray="5 4"'
INK, LINE, PAPER, NOW = palette.INK, palette.LINE, palette.PAPER, palette.COLOURS['bad']


def project(position: Array) -> Array:
    """Return the pixels (n, 2) of positions (n, 3) m, z up, seen from above at an angle."""
    x, y, z = position.T
    right = x * np.cos(AZIMUTH) - y * np.sin(AZIMUTH)
    depth = x * np.sin(AZIMUTH) + y * np.cos(AZIMUTH)
    up = z * np.cos(ELEVATION) + depth * np.sin(ELEVATION)
    return np.column_stack([ORIGIN[0] + SCALE * right, ORIGIN[1] - SCALE * up])


def _line(points: Array) -> str:
    return 'M' + ' L'.join(f'{x:.1f} {y:.1f}' for x, y in points)


def _moving(points: Array) -> str:
    values = ';'.join(f'{x:.1f} {y:.1f}' for x, y in points)
    return (f'<animateTransform attributeName="transform" type="translate" values="{values}" '
            f'dur="{SECONDS}s" repeatCount="indefinite"/>')


def _trail(points: Array) -> str:
    """Return the flown path, drawn as far as the vehicle has come."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    left = 1.0 - np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    values = ';'.join(f'{value:.4f}' for value in left)
    return (f'<path d="{_line(points)}" pathLength="1" stroke="{FLOWN}" stroke-width="3.4" '
            f'fill="none" stroke-dasharray="1 1"><animate attributeName="stroke-dashoffset" '
            f'values="{values}" dur="{SECONDS}s" repeatCount="indefinite"/></path>')


def _floor() -> str:
    """Return a grid of half metres."""
    lines = []
    for at in np.arange(-1.5, 1.51, 0.5):
        for ends in ([[at, -1.5, 0.0], [at, 1.5, 0.0]], [[-1.5, at, 0.0], [1.5, at, 0.0]]):
            lines.append(_line(project(np.array(ends))))
    return f'<path d="{" ".join(lines)}" stroke="{LINE}" fill="none"/>'


def _vehicle(points: Array, shadow: Array) -> str:
    """Return the vehicle with its four rotors, and its shadow on the floor."""
    arms = [(dx, dy) for dx in (-11, 11) for dy in (-6, 6)]
    rotors = ''.join(
        f'<line x2="{dx}" y2="{dy}" stroke="{INK}" stroke-width="2.5"/>'
        f'<ellipse cx="{dx}" cy="{dy - 2}" rx="8" ry="3.4" fill="{FLOWN}" fill-opacity=".55" '
        f'stroke="{INK}"/>' for dx, dy in arms)
    return (f'<g><ellipse rx="14" ry="6" fill="{INK}" fill-opacity=".18"/>{_moving(shadow)}</g>'
            f'<g>{rotors}<ellipse rx="6" ry="4" fill="{INK}"/>{_moving(points)}</g>')


def _strips(t: Array, flown: Array, planned: Array) -> str:
    """Return the three plots of position over time, and the line that says when it is."""
    out = []
    across = LEFT + (RIGHT - LEFT) * t / t[-1]
    for axis, (name, top) in enumerate(STRIPS):
        low, high = (-1.3, 1.3) if axis < 2 else (-0.1, 1.7)
        out.append(f'<rect x="{LEFT}" y="{top}" width="{RIGHT - LEFT}" height="{TALL}" '
                   f'fill="none" stroke="{LINE}"/>'
                   f'<text x="{LEFT - 44}" y="{top + TALL / 2 + 4}">{name} [m]</text>')
        for values, colour, look in ((flown, FLOWN, 'stroke-width="2.6"'),
                                     (planned, PLANNED, DASHED)):
            down = top + TALL * (high - values[:, axis]) / (high - low)
            out.append(f'<path d="{_line(np.column_stack([across, down]))}" stroke="{colour}" '
                       f'{look} fill="none"/>')
    ends = np.array([[LEFT, 0.0], [RIGHT, 0.0]])
    return (''.join(out) + f'<g><line y1="{STRIPS[0][1]}" y2="{STRIPS[-1][1] + TALL}" '
            f'stroke="{NOW}"/>{_moving(ends)}</g>'
            f'<text x="{LEFT}" y="370">0 s</text>'
            f'<text x="{RIGHT}" y="370" text-anchor="end">{t[-1]:.0f} s</text>')


def svg() -> str:
    """Return the default circle, flown in one process, as a moving picture."""
    flight = fly(scenario(controller=CONTROLLER))
    pick = np.linspace(0, len(flight.t) - 1, 161).astype(int)
    t = flight.t[pick] * 1e-9
    flown, planned = (rows[pick, :3] * [1.0, -1.0, -1.0]
                      for rows in (flight.truth, flight.reference))
    points = project(flown)
    shadow = project(flown * [1.0, 1.0, 0.0])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">'
        '<title>The simulated Mambo takes off, flies a circle and lands</title>'
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" fill="{PAPER}"/>'
        f'{_floor()}{_trail(points)}'
        f'<path d="{_line(project(planned))}" stroke="{PLANNED}" {DASHED} fill="none"/>'
        f'{_vehicle(points, shadow)}'
        f'{_strips(t, flown, planned)}'
        f'<text x="24" y="34"><tspan fill="{PLANNED}" font-weight="700">- - reference</tspan>'
        f'<tspan dx="18" fill="{FLOWN}" font-weight="700">flown</tspan></text>'
        f'<text x="{LEFT}" y="34" fill="{SOFT}">take-off, circle, landing</text></svg>\n')
