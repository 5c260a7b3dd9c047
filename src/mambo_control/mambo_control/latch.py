"""Shutdown that stays: once the motors are stopped for a reason, they stay stopped."""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.flatness import Reference
from mambo_model.rigid_body import State
from mambo_model.vehicle import VehicleValues

from .cascaded import Command, Memory, step as cascaded_step, stopped
from .gains import GainValues
from .safety import REASON_NONE


@jit
def step(
    memory: Memory, reason: int, state: State, ref: Reference, phase: int, dt: float,
    gains: GainValues, vv: VehicleValues,
) -> tuple[Memory, int, Command]:
    """
    Answer one estimate as :func:`cascaded.step`, unless an earlier answer was a shutdown.

    Parameters
    ----------
    reason
        Result of the previous call; ``safety.REASON_NONE`` at start. The other parameters are
        those of :func:`cascaded.step`.

    Returns
    -------
    memory, reason
        To be passed to the next call.
    command
        Valid for one period.

    """
    if reason != REASON_NONE:
        return memory, reason, stopped(memory, reason)
    memory, command = cascaded_step(memory, state, ref, phase, dt, gains, vv)
    return memory, command.reason, command
