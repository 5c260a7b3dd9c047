"""One name for every controller: the types of its memory and its gains say which one answers."""

from __future__ import annotations

from mambo_model.compiled import by_type

from . import cascaded, support_package
from .gains import CascadedParams, GainValues
from .support_package import ToolboxControllerParams, ToolboxGainValues

Memory = cascaded.Memory | support_package.Memory
Gains = GainValues | ToolboxGainValues
Params = CascadedParams | ToolboxControllerParams

answer = by_type(5, {GainValues: cascaded.step, ToolboxGainValues: support_package.step})
stopped = by_type(0, {
    cascaded.Memory: cascaded.stopped, support_package.Memory: support_package.stopped})


def initial(params: Params) -> Memory:
    """Return the memory at start of the controller that has such parameters."""
    return (support_package if isinstance(params, ToolboxControllerParams) else cascaded).initial()
