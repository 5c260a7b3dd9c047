"""One name for every controller: the types of its memory and its gains say which one answers."""

from __future__ import annotations

import math

from mambo_model.compiled import by_type, jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import GROUND, LANDED
from mambo_model.vehicle.parameters import VehicleValues

from . import cascaded, support_package
from .command import Command
from .gains import CascadedParams, GainValues
from .literature import extended, flatness_drag, geometric, indi
from .safety import REASON_NONE, REASON_REFERENCE, stop_reason, usable
from .support_package import ToolboxControllerParams, ToolboxGainValues

# Values, memory and functions of each controller, built in or from the literature.
_LAWS = (
    (GainValues, cascaded), (ToolboxGainValues, support_package),
    (extended.ExtendedValues, extended), (flatness_drag.FlatnessDragValues, flatness_drag),
    (geometric.GeometricValues, geometric), (indi.IndiValues, indi))

Memory = (cascaded.Memory | support_package.Memory | extended.Memory | flatness_drag.Memory
          | geometric.Memory | indi.Memory)
Gains = (GainValues | ToolboxGainValues | extended.ExtendedValues
         | flatness_drag.FlatnessDragValues | geometric.GeometricValues | indi.IndiValues)
Params = (CascadedParams | ToolboxControllerParams | extended.ExtendedParams
          | flatness_drag.FlatnessDragParams | geometric.GeometricParams | indi.IndiParams)

initial = by_type(0, {values: law.initial for values, law in _LAWS})
stopped = by_type(0, {law.Memory: law.stopped for _, law in _LAWS})
_step = by_type(4, {values: law.step for values, law in _LAWS})


@jit
def answer(
    memory: Memory, state: State, ref: Reference, phase: int, dt: float, gains: Gains,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate with motor commands: the guard of every controller.

    On the ground before take-off and after landing the motors stand still and the controller
    starts anew. Inputs that cannot be used (not finite, absurdly large, no unit quaternion,
    an unknown phase, a reference without a thrust direction) and, in flight, tilt or height
    beyond the limits stop the motors with ``shutdown``; the memory stays as it is. A shutdown
    is not remembered here but by :mod:`failsafe`.

    Parameters
    ----------
    memory
        Result of the previous call; :func:`initial` at start.
    state
        Estimate, inertial NED and body FRD.
    ref
        Reference for the time of the estimate.
    phase
        Of the flight, 0 GROUND to 4 LANDED of mambo_model.motion.trajectory.
    dt : s
        Time to the next call, the control period.
    gains
        Of the controller; their type says which one it is.
    vv
        Believed vehicle.

    Returns
    -------
    memory
        To be passed to the next call.
    command
        Valid for one period.

    Raises
    ------
    ValueError
        If ``dt`` is not positive and finite.

    """
    if not 0.0 < dt < math.inf:
        raise ValueError('dt of the controller must be positive and finite, in seconds')
    reason = stop_reason(state, ref, phase, gains)
    if reason != REASON_NONE:
        return memory, stopped(memory, reason)
    if phase == GROUND or phase == LANDED:
        memory = initial(gains)
        return memory, stopped(memory, REASON_NONE)
    after, command = _step(memory, state, ref, dt, gains, vv)
    if not (usable(command.torque) and math.isfinite(command.thrust)):
        return memory, stopped(memory, REASON_REFERENCE)
    return after, command
