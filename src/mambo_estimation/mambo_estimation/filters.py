"""The estimators: the type of the parameters says which one answers, compiled code or not."""

from __future__ import annotations

from mambo_model.compiled import by_type

from . import kalman, toolbox

Params = kalman.EstimatorParams | toolbox.ToolboxEstimatorParams
Values = kalman.EstimatorValues | toolbox.ToolboxValues
Memory = kalman.Memory | toolbox.Memory

initial = by_type(0, {
    kalman.EstimatorParams: kalman.initial, toolbox.ToolboxEstimatorParams: toolbox.initial})
step = by_type(8, {kalman.EstimatorValues: kalman.step, toolbox.ToolboxValues: toolbox.step})
