"""The reference of a flight at a time: of a flight plan, or of the commands given so far."""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import by_type, jit_inside
from mambo_model.motion import trajectory
from mambo_model.motion.flatness import from_flat_output_yaw, Reference
from mambo_model.motion.polynomial import evaluate, Pieces
from mambo_model.motion.trajectory import PlanValues
from mambo_model.motion.vector import Vec3
import numpy as np
from numpy.typing import NDArray

from .timeline import Timeline


class CommandedValues(NamedTuple):
    """A timeline for compiled code."""

    pieces: Pieces             # of the flight
    phases: NDArray[np.int64]  # (n,) of each piece, GROUND ... LANDED of trajectory


def values(timeline: Timeline) -> CommandedValues:
    """Return a timeline for compiled code."""
    return CommandedValues(
        Pieces(np.array(timeline.begin), np.array(timeline.coefficients)),
        np.array(timeline.phases, dtype=np.int64))


@jit_inside
def _commanded_step(
    t: float, plan: CommandedValues, mass: float, inertia: Vec3, gravity: float,
) -> tuple[Reference, int]:
    """Return the feasible reference (3.14) of a timeline at t in s, and the phase."""
    x, y, z, psi = evaluate(t, plan.pieces)
    i = max(np.searchsorted(plan.pieces.begin, t, side='right') - 1, 0)
    return from_flat_output_yaw(
        (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]), (x[3], y[3], z[3]),
        (x[4], y[4], z[4]), psi[0], psi[1], psi[2], mass, inertia, gravity), plan.phases[i]


reference_step = by_type(1, {
    PlanValues: trajectory.reference_step, CommandedValues: _commanded_step})
"""
Return the feasible reference (3.14) at a time, and the phase.

Arguments as of :func:`mambo_model.motion.trajectory.reference_step`; the type of the second one
selects flight plan or commands.
"""
