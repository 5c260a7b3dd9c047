"""One name for every controller: the types of its memory and its gains say which one answers."""

from __future__ import annotations

from mambo_model.compiled import by_type

from . import cascaded, toolbox
from .gains import CascadedParams, GainValues
from .toolbox import ToolboxControllerParams, ToolboxGainValues

Memory = cascaded.Memory | toolbox.Memory
Gains = GainValues | ToolboxGainValues
Params = CascadedParams | ToolboxControllerParams

answer = by_type(5, {GainValues: cascaded.step, ToolboxGainValues: toolbox.step})
stopped = by_type(0, {cascaded.Memory: cascaded.stopped, toolbox.Memory: toolbox.stopped})


def initial(params: Params) -> Memory:
    """Return the memory at start of the controller that has such parameters."""
    return (toolbox if isinstance(params, ToolboxControllerParams) else cascaded).initial()
