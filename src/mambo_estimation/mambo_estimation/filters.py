"""The estimators: the type of the parameters says which one answers, compiled code or not."""

from __future__ import annotations

from mambo_model.compiled import by_type

from . import kalman, support_package

Params = kalman.EstimatorParams | support_package.ToolboxEstimatorParams
Values = kalman.EstimatorValues | support_package.ToolboxValues
Memory = kalman.Memory | support_package.Memory

initial = by_type(0, {
    kalman.EstimatorValues: kalman.initial,
    support_package.ToolboxValues: support_package.initial})
step = by_type(8, {
    kalman.EstimatorValues: kalman.step, support_package.ToolboxValues: support_package.step})
