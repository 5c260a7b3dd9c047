r"""
Offset and drift between the clock of a server and that of this host, from delayed messages.

A message that the server sends at s of its clock arrives at l of this host's:

.. math:: l - s = o(s) + d, \quad d \ge 0

with the offset o, nearly a straight line over a minute, and the delay d. All points (s, l - s)
lie above the line, and those that were least delayed come nearest to it. The line is the edge of
the lower convex hull that spans the mean of s: among the lines below all points it is the one
with the least sum of distances (S. B. Moon, P. Skelly, D. Towsley 1999, "Estimation and removal
of clock skew from network delay measurements", INFOCOM).

Echoes give points below the line in the same way: a question sent at l and received at s has
``l - s = o(s) - d``. They are rare, so they share the slope of the other side. The offset is
midway between both lines: a least delay that is the same in both directions leaves no error; one
that is not leaves half of the difference. Without echoes the least delay is unknown, and the
stamps are late by it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

BIN = 250_000_000        # ns of the server's clock, of which only the least delayed point is kept
WINDOW = 240             # bins that are kept: a minute
SHORT = 10.0             # s of points, below which the drift is bounded more tightly
STEEPEST, STEEP = 500e-6, 100e-6  # s/s, largest drift; while there are few points
STEP = 10_000_000        # ns, a point that far beyond the line: one of the clocks was set
BEHIND = 1_000_000_000   # ns, points that far behind the line
PATIENCE = 200           # such points in a row after which the clocks are matched anew


class Line(NamedTuple):
    """Offset of the clocks as a line."""

    origin: int    # ns, server
    offset: float  # ns, at the origin
    drift: float   # s/s, of this host's clock over the server's, less 1


def lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the lower convex hull of points, (n, 2) by increasing x, from left to right."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (a, b), (c, d) = hull[-2], hull[-1]
            if (c - a) * (y - b) > (d - b) * (x - a):
                break
            hull.pop()
        hull.append((x, y))
    return hull


def line_below(points: list[tuple[float, float]]) -> tuple[float, float]:
    """
    Return slope and value at 0 of the line below points with the least sum of distances.

    The slope is bounded; the line then touches the points at one place.
    """
    hull = lower_hull(points)
    mean = math.fsum(x for x, _ in points) / len(points)
    slope = 0.0
    for (a, b), (c, d) in zip(hull, hull[1:]):
        slope = (d - b) / (c - a)
        if c >= mean:
            break
    steepest = STEEPEST if points[-1][0] - points[0][0] >= SHORT * 1e9 else STEEP
    slope = min(max(slope, -steepest), steepest)
    return slope, min(y - slope * x for x, y in hull)


class ClockMatch:
    """
    Converts times of a server to times of this host.

    Attributes
    ----------
    resets : int
        How often the clocks were matched anew, because one of them had been set.

    """

    def __init__(self) -> None:
        self.resets = 0
        self._clear()

    def _clear(self) -> None:
        self._late: dict[int, tuple[int, int]] = {}   # by bin: (server, local - server)
        self._early: dict[int, tuple[int, int]] = {}  # the same of echoes
        self._line: Line | None = None
        self._changed, self._behind = False, 0

    @property
    def line(self) -> Line | None:
        """Return the offset of the clocks; None before the first message."""
        if self._changed:
            self._changed = False
            self._fit()
        return self._line

    @property
    def answered(self) -> bool:
        """Return whether the least delay is known from echoes."""
        return bool(self._early)

    def local(self, server: int) -> int | None:
        """Return the time of this host, ns, for one of the server, ns; None if not matched."""
        line = self.line
        if line is None:
            return None
        return server + round(line.offset + line.drift * (server - line.origin))

    def add_arrival(self, server: int, local: int) -> None:
        """Add a message sent at ``server`` of the server's clock and received at ``local``, ns."""
        excess = self._excess(server, local)
        self._behind = self._behind + 1 if excess > BEHIND else 0
        if excess < -STEP or self._behind >= PATIENCE:
            self.resets += 1
            self._clear()
        self._keep(self._late, server, local - server, 1)

    def add_echo(self, sent: int, server: int, received: int) -> None:
        """
        Add an echo.

        Parameters
        ----------
        sent : ns
            When the question left this host.
        server : ns
            When the server received it.
        received : ns
            When the answer arrived. It may have waited at the server.

        """
        if sent > received:
            return
        self.add_arrival(server, received)
        if self._excess(server, sent) > STEP:
            self.resets += 1
            self._clear()
            self._keep(self._late, server, received - server, 1)
        self._keep(self._early, server, sent - server, -1)

    def _excess(self, server: int, local: int) -> float:
        """Return by how much a pair lies above the line, ns; 0 if there is none."""
        wanted = self.local(server)
        return 0.0 if wanted is None else local - wanted

    def _keep(self, bins: dict[int, tuple[int, int]], server: int, offset: int,
              sign: int) -> None:
        """Keep the point of each bin with the least ``sign`` times offset."""
        number = server // BIN
        before = bins.get(number)
        if before is not None and sign * before[1] <= sign * offset:
            return
        bins[number] = (server, offset)
        self._changed = True
        newest = max(bins) if len(bins) > WINDOW else number
        if len(bins) > WINDOW:
            for old in [one for one in bins if not newest - WINDOW < one]:
                del bins[old]

    def _fit(self) -> None:
        """Find the line of the points that are kept."""
        origin, base = self._late[max(self._late)]
        slope, late = line_below(sorted(
            (float(server - origin), float(offset - base))
            for server, offset in self._late.values()))
        middle = late
        if self._early:
            early = max(offset - base - slope * (server - origin)
                        for server, offset in self._early.values())
            middle = 0.5 * (early + late)
        self._line = Line(origin, base + middle, slope)
