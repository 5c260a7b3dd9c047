"""Columns of a flight with motion capture: the estimate in ``map``, a row for each step."""

from __future__ import annotations

from typing import NamedTuple

from mambo_estimation.capture.aided import Capture, NO_CANDIDATE, NOTHING_SEEN
from mambo_estimation.capture.frames import Anchor
from mambo_estimation.capture.report import complaint, longest
from mambo_model.compiled import jit
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Columns(NamedTuple):
    """First column of each part of a row; inertial NED and body FRD."""

    state: int = 0        # (13,) in map, as in closed_loop.Recording
    covariance: int = 13  # (36,) of the pose, axes of map
    anchor: int = 49      # yaw rad, shift (3,) m of odom in map
    capture: int = 53     # located, age, silence, used, refused, trouble, off, delay


COLUMNS = Columns()
WIDTH = 61


@jit
def store_located(rows, k, where):
    """Store the estimate in ``map`` in row k; do nothing without one."""
    if where is None:
        return
    row, s, a, c = rows[k], where.state, where.capture.anchor, where.capture
    for i in range(3):
        row[i], row[3 + i], row[10 + i] = s.rho[i], s.nu[i], s.omega[i]
        row[50 + i] = a.shift[i]
    for i in range(4):
        row[6 + i] = s.q[i]
    for i in range(36):
        row[13 + i] = where.pose_covariance[i]
    row[49] = a.yaw
    row[53], row[54], row[55], row[56], row[57], row[58], row[59], row[60] = (
        c.located, c.age, c.silence, c.used, c.refused, c.trouble, c.off, c.delay)


def anchor_of(row: Array) -> Anchor:
    """Return the pose of ``odom`` in ``map`` that a row holds."""
    yaw, *shift = row[COLUMNS.anchor:COLUMNS.capture].tolist()
    return Anchor(yaw, tuple(shift))


def unused(t: Array, rows: Array, max_age: float) -> str:
    """
    Return for how long, at most, no pose of the motion capture was used, or an empty string.

    Parameters
    ----------
    t : (n,) s
        Of each step.
    rows : (n, 61)
        One for each step.
    max_age : s
        As of :func:`mambo_estimation.capture.report.complaint`.

    """
    if not len(rows):
        return ''
    age, silence = rows[:, COLUMNS.capture + 1], rows[:, COLUMNS.capture + 2]
    # poses that are refused as they come again end a loss
    k = int((silence if silence.max() > 0.5 * age.max() else age).argmax())
    seen = capture_of(rows[k])
    return longest(float(t[k]), seen.age, complaint(seen, max_age))


def capture_of(row: Array) -> Capture:
    """Return the state of the motion capture that a row holds, for a report."""
    seen, age, silence, used, refused, trouble, off, delay = row[COLUMNS.capture:].tolist()
    return Capture(
        bool(seen), anchor_of(row), age, silence, int(used), int(refused), int(trouble), off,
        delay, NO_CANDIDATE, NOTHING_SEEN)
