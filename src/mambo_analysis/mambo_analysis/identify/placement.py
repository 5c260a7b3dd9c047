"""
Placement of a motion capture beside a simulated flight: turn about z, lateness, and scale.

The frame of a motion capture is not turned exactly as the drone stood at take-off, and its stamps
are late by what the network takes. Neither is drag, but on a circle both look like it. They are
found by Gauss and Newton for each simulated path, so that what is left depends on the vehicle only
(variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_flight.closed_loop import STEP_NS
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LATEST = 0.5       # s: a capture reports within 0.1 s; what differs by more is another clock
ROUNDS = 8         # of Gauss and Newton: from 0.1 s and 10 deg three are enough
SETTLED = 1e-7     # rad, s and [-]: beyond what moves a path by a micrometre


class Placement(NamedTuple):
    """How a motion capture saw a path."""

    turn: float = 0.0    # rad about z (down)
    late: float = 0.0    # s
    scale: float = 1.0   # [-]


def without(terms: Floats, x: Floats) -> Floats:
    """Return x (m, k) after projecting out the terms (m, q)."""
    return x - terms @ np.linalg.lstsq(terms, x)[0]


def seen(path: Floats, rows: Ints, place: Placement) -> tuple[Floats, Floats]:
    """
    Return positions and velocities of a path (n, k), as a capture placed like this sees them.

    The path has a row each control step. Both results are (m, k), in m and m/s, at the rows
    (m,); without a second axis nothing is turned.
    """
    dt = STEP_NS * 1e-9
    at, steps = rows - place.late / dt, np.arange(len(path))
    both = [np.stack([np.interp(at, steps, column) for column in x.T], axis=1)
            for x in (path, np.gradient(path, dt, axis=0))]
    if path.shape[1] == 2:
        c, s = np.cos(place.turn), np.sin(place.turn)
        both = [x @ np.array([[c, s], [-s, c]]) for x in both]
    return place.scale * both[0], place.scale * both[1]


def effects(position: Floats, velocity: Floats, scaled: bool = False) -> Floats:
    """Return how a path (m, k) changes by turn, lateness and scale, (3, m, k); 0 if not free."""
    turned = np.zeros_like(position)
    if position.shape[1] == 2:
        turned = np.stack([-position[:, 1], position[:, 0]], axis=1)
    return np.stack([turned, -velocity, position if scaled else np.zeros_like(position)])


def place(
    path: Floats, rows: Ints, measured: Floats, terms: Floats, scaled: bool = False,
) -> Placement:
    """
    Return the placement by which a path comes nearest to what was measured.

    Parameters
    ----------
    path : (n, k) m
        Simulated, a row each control step; k is 2 for x and y, 1 for z.
    rows : (m,)
        Control steps that were measured.
    measured : (m, k) m
    terms : (m, q)
        What may be added to each axis besides, an offset say.
    scaled
        Whether the scale is free, too.

    """
    found = Placement()
    wanted = without(terms, measured)
    if path.shape[1] == 2:  # the best turn in closed form, from which the rounds begin
        p = without(terms, seen(path, rows, found)[0])
        found = Placement(float(np.arctan2(
            np.sum(p[:, 0] * wanted[:, 1] - p[:, 1] * wanted[:, 0]), np.sum(p * wanted))))
    for _ in range(ROUNDS):
        position, velocity = seen(path, rows, found)
        columns = np.stack([without(terms, x).ravel()
                            for x in effects(position, velocity, scaled)], axis=1)
        rest = (wanted - without(terms, position)).ravel()
        turn, late, larger = np.linalg.lstsq(columns, rest)[0].tolist()  # of least size: on a
        # circle turn and lateness are one
        found = Placement(
            found.turn + turn, float(np.clip(found.late + late, -LATEST, LATEST)),
            found.scale * max(1.0 + larger, 0.1))
        if max(abs(turn), abs(late), abs(larger)) < SETTLED:
            break
    return found
