"""
Shutdown that stays: once the motors are stopped for a reason, they stay stopped.

The same for every controller: the types of its memory and its gains say which one answers.
"""

from __future__ import annotations

from mambo_model.compiled import by_type, jit
from mambo_model.flatness import Reference
from mambo_model.rigid_body import State
from mambo_model.vehicle import VehicleValues

from . import cascaded, toolbox
from .cascaded import Command
from .gains import CascadedParams, GainValues
from .safety import REASON_NONE
from .toolbox import ToolboxControllerParams, ToolboxGainValues

Memory = cascaded.Memory | toolbox.Memory
Gains = GainValues | ToolboxGainValues
Params = CascadedParams | ToolboxControllerParams

_answer = by_type(5, {GainValues: cascaded.step, ToolboxGainValues: toolbox.step})
_stopped = by_type(0, {cascaded.Memory: cascaded.stopped, toolbox.Memory: toolbox.stopped})


def initial(params: Params) -> Memory:
    """Return the memory at start of the controller that has such parameters."""
    return (toolbox if isinstance(params, ToolboxControllerParams) else cascaded).initial()


@jit
def step(
    memory: Memory, reason: int, state: State, ref: Reference, phase: int, dt: float,
    gains: Gains, vv: VehicleValues,
) -> tuple[Memory, int, Command]:
    """
    Answer one estimate as the controller's step, unless an earlier answer was a shutdown.

    Parameters
    ----------
    reason
        Result of the previous call; ``safety.REASON_NONE`` at start. The other parameters are
        those of :func:`cascaded.step` or :func:`toolbox.step`, both of one of them.

    Returns
    -------
    memory, reason
        To be passed to the next call.
    command
        Valid for one period.

    """
    if reason != REASON_NONE:
        return memory, reason, _stopped(memory, reason)
    memory, command = _answer(memory, state, ref, phase, dt, gains, vv)
    return memory, command.reason, command
