"""
Minimum-snap polynomials within corridors and limits, by a quadratic program with cones.

A polynomial stays inside the convex hull of its control points (Bernstein form). A cone for each
control point therefore keeps the whole course inside a tube, a box or a limit; the optimum is
slightly conservative. More pieces per leg make the hull tighter and give more freedom. Solved by
Clarabel (P. J. Goulart, Y. Chen, 2024), an optional dependency.
"""

from __future__ import annotations

from math import comb, factorial
from typing import Any, NamedTuple

from mambo_model.errors import InputError, JobError
from mambo_model.motion.polynomial import AXES, Course
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .minimum_snap import end_scale, hermite, leg_energy, ORDERS, to_course, Waypoints

Array = NDArray[np.float64]

DERIVATIVES = ('speed', 'acceleration', 'jerk', 'snap')  # derivatives whose length can be limited


class Bounds(NamedTuple):
    """Constraints of a course besides its waypoints; inf and NaN: no bound."""

    limits: Array    # (4,) m/s ... m/s^4, largest length of velocity to snap
    yaw_rate: float  # rad/s
    tube: Array      # (n - 1,) m, radius of the tube around each straight leg
    box: Array       # (n - 1, 3, 2) m, inertial NED, lowest and highest x, y and z of each leg

    @property
    def binding(self) -> bool:
        """Return whether there is any bound."""
        return bool(np.isfinite(self.limits).any() or np.isfinite(self.yaw_rate)
                    or np.isfinite(self.tube).any() or np.isfinite(self.box).any())


def unbounded(legs: int) -> Bounds:
    """Return no bounds, for a number of legs."""
    return Bounds(np.full(4, np.inf), np.inf, np.full(legs, np.nan),
                  np.tile([-np.inf, np.inf], (legs, 3, 1)))


def control_points(order: int, derivative: int, duration: float) -> Array:
    """
    Return the matrix from 2 r end values to the control points of a time derivative.

    Parameters
    ----------
    order
        r: the polynomial has degree 2 r - 1.
    derivative
        Order of the derivative; 0: the polynomial itself.
    duration : s
        Duration of the piece.

    Returns
    -------
    (2 r - derivative, 2 r)

    """
    count = 2 * order - derivative
    powers = np.zeros((count, 2 * order))  # ascending powers of the derivative by u
    for i in range(count):
        powers[i, i + derivative] = factorial(i + derivative) / factorial(i)
    bernstein = np.array([[
        comb(i, j) / comb(count - 1, j) if j <= i else 0.0 for j in range(count)]
        for i in range(count)])
    return (bernstein @ powers @ hermite(order)) * end_scale(
        duration, order) / duration**derivative


class _Program:
    """Cone program with rows b - A x; x: derivatives at knots (knots, axes, r), then slacks."""

    def __init__(self, knots: int, axes: int, order: int) -> None:
        self.shape = (knots, axes, order)
        self.blocks: dict[str, list[tuple[Array, Array, Array]]] = {
            'zero': [], 'linear': [], 'cone': []}
        self.sizes: list[int] = []  # rows of each cone
        self.count = knots * axes * order  # variables

    def add_variable(self) -> int:
        """Add a variable; return its index."""
        self.count += 1
        return self.count - 1

    def columns(self, piece: int, axis: int) -> Array:
        """Return the indices of the 2 r end values of a piece."""
        _, axes, order = self.shape
        return np.concatenate([
            (knot * axes + axis) * order + np.arange(order) for knot in (piece, piece + 1)])

    def add(self, kind: str, columns: Array, rows: Array, right: Array) -> None:
        """Constrain right - rows x[columns] to zero, to >= 0, or to a second-order cone."""
        self.blocks[kind].append((columns, rows, right))
        if kind == 'cone':
            self.sizes.append(len(right))

    def matrices(self) -> tuple[sparse.csc_matrix, Array, dict[str, int]]:
        """Return A, b and the number of rows of each kind, in their order."""
        i, j, values, b, counts, row = [], [], [], [], {}, 0
        for kind, blocks in self.blocks.items():
            first = row
            for columns, rows, right in blocks:
                at = np.arange(row, row + len(right))
                i.append(np.repeat(at, len(columns)))
                j.append(np.tile(columns, len(right)))
                values.append(rows.ravel())
                b.append(right)
                row += len(right)
            counts[kind] = row - first
        A = sparse.csc_matrix(
            (np.concatenate(values), (np.concatenate(i), np.concatenate(j))),
            shape=(row, self.count))
        A.eliminate_zeros()
        return A, np.concatenate(b), counts


def split(waypoints: Waypoints, pieces: int) -> Waypoints:
    """Return the waypoints with free ones in between, ``pieces`` pieces for each leg."""
    n = len(waypoints.t)
    t = np.interp(np.arange((n - 1) * pieces + 1) / pieces, np.arange(n), waypoints.t)
    t[::pieces] = waypoints.t
    fixed = np.full((len(t), *waypoints.fixed.shape[1:]), np.nan)
    fixed[::pieces] = waypoints.fixed
    return Waypoints(t, fixed)


def minimum(
    waypoints: Waypoints, bounds: Bounds, minimise: str = 'snap', pieces: int = 3,
) -> Course:
    """
    Return the course of minimum snap or jerk within bounds.

    Parameters
    ----------
    waypoints
        Both ends of a leg with a tube must be given.
    bounds
        Constraints of each leg.
    minimise
        ``snap`` or ``jerk``.
    pieces
        Polynomials for each leg. Derivatives up to snap, or up to jerk if that is minimised,
        are continuous.

    Raises
    ------
    mambo_model.errors.InputError
        If Clarabel is not installed.
    mambo_model.errors.JobError
        If no course satisfies the bounds.

    """
    order, knots = ORDERS[minimise], split(waypoints, pieces)
    scale = float(np.diff(knots.t).mean())  # unit of time, for numbers of similar size
    duration, powers = np.diff(knots.t) / scale, scale ** np.arange(order)
    out = np.empty((len(knots.t), len(AXES), order))
    for axes, names in (((0, 1, 2), 'path'), ((3,), 'yaw')):
        given = knots.fixed[:, axes, :order] * powers
        if names == 'yaw' and np.isnan(given[:, 0, 0]).all():
            out[:, 3] = 0.0
            continue
        program = _Program(len(knots.t), len(axes), order)
        _join(program, given, duration)
        if names == 'path':
            for piece, T in enumerate(duration):
                _limit(program, piece, T, bounds.limits * scale ** np.arange(1, 5))
                leg = piece // pieces
                _corridor(program, piece, T, waypoints.fixed[leg:leg + 2, :3, 0],
                          bounds.tube[leg], bounds.box[leg])
        else:
            for piece, T in enumerate(duration):
                _limit(program, piece, T, np.array([bounds.yaw_rate * scale]))
        out[:, axes] = _solve(program, duration, names).reshape(given.shape) / powers
    return to_course(knots.t, out)


def _join(program: _Program, given: Array, duration: Array) -> None:
    """Fix the given values at the knots and make the r-th derivative continuous."""
    for number, value in enumerate(given.ravel()):
        if not np.isnan(value):
            program.add('zero', np.array([number]), np.ones((1, 1)), np.array([value]))
    _, axes, order = program.shape
    for piece in range(len(duration) - 1):
        last = control_points(order, order, duration[piece])[-1:]
        first = control_points(order, order, duration[piece + 1])[:1]
        for axis in range(axes):
            columns = np.concatenate((
                program.columns(piece, axis), program.columns(piece + 1, axis)))
            program.add('zero', columns, np.hstack((last, -first)), np.zeros(1))


def _limit(program: _Program, piece: int, duration: float, limits: Array) -> None:
    """Limit the length of the derivatives of a piece, from the first derivative on."""
    _, axes, order = program.shape
    columns = np.concatenate([program.columns(piece, axis) for axis in range(axes)])
    for derivative, most in enumerate(limits, 1):
        if np.isfinite(most):
            for point in control_points(order, derivative, duration):
                rows = np.vstack((np.zeros(len(columns)), -np.kron(np.eye(axes), point) / most))
                program.add('cone', columns, rows, np.eye(1, axes + 1)[0])


def _corridor(
    program: _Program, piece: int, duration: float, ends: Array, tube: float, box: Array,
) -> None:
    """Keep the control points of a piece inside a tube around a straight line and in a box."""
    _, axes, order = program.shape
    columns = np.concatenate([program.columns(piece, axis) for axis in range(axes)])
    for point in control_points(order, 0, duration):
        if np.isfinite(tube):
            along = ends[1] - ends[0]
            share = program.add_variable()  # of the leg, position of the nearest point on its line
            program.add('linear', np.array([share]), np.array([[1.0], [-1.0]]),
                        np.array([1.0, 0.0]))
            rows = np.zeros((4, len(columns) + 1))
            rows[1:, :-1] = -np.kron(np.eye(3), point) / tube
            rows[1:, -1] = along / tube
            program.add('cone', np.append(columns, share), rows,
                        np.concatenate(([1.0], -ends[0] / tube)))
        for axis, (low, high) in enumerate(box):
            for sign, edge in ((1.0, high), (-1.0, -low)):
                if np.isfinite(edge):
                    program.add('linear', program.columns(piece, axis), sign * point[None],
                                np.array([edge]))


def _clarabel() -> Any:
    """Return the solver; InputError if it is not installed."""
    try:
        import clarabel
    except ImportError:
        raise InputError(
            'corridors and limits need Clarabel: pip install -r requirements/courses.txt'
        ) from None
    return clarabel


def _solve(program: _Program, duration: Array, what: str) -> Array:
    """Solve for the derivatives at all knots; JobError if there is no solution."""
    clarabel = _clarabel()
    _, axes, order = program.shape
    P = sparse.lil_matrix((program.count, program.count))
    for piece, T in enumerate(duration):
        H = leg_energy(T, order)
        for axis in range(axes):
            at = program.columns(piece, axis)
            P[np.ix_(at, at)] += 2.0 * H
    A, b, counts = program.matrices()
    cones = [clarabel.ZeroConeT(counts['zero'])]
    if counts['linear']:
        cones.append(clarabel.NonnegativeConeT(counts['linear']))
    cones += [clarabel.SecondOrderConeT(size) for size in program.sizes]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1  # the same course on every machine
    found = clarabel.DefaultSolver(
        sparse.triu(P.tocsc(), format='csc'), np.zeros(P.shape[0]), A, b, cones, settings).solve()
    if str(found.status) not in ('Solved', 'AlmostSolved'):
        raise JobError(
            f'no {what} satisfies its corridor and limits ({found.status}): lengthen the times, '
            'widen them, or use more pieces per leg')
    return np.array(found.x[:int(np.prod(program.shape))])
