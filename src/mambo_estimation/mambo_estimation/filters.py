"""The estimators: the type of the parameters says which one answers, compiled code or not."""

from __future__ import annotations

from mambo_model.compiled import by_type

from . import kalman, support_package
from .joint import filter as joint
from .joint.joint_parameters import JointParams, JointValues

Params = kalman.EstimatorParams | support_package.ToolboxEstimatorParams | JointParams
Values = kalman.EstimatorValues | support_package.ToolboxValues | JointValues
Memory = kalman.Memory | support_package.Memory | joint.Memory

initial = by_type(0, {
    kalman.EstimatorValues: kalman.initial,
    support_package.ToolboxValues: support_package.initial, JointValues: joint.initial})
step = by_type(8, {
    kalman.EstimatorValues: kalman.step, support_package.ToolboxValues: support_package.step,
    JointValues: joint.step})
