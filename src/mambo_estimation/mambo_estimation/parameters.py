"""Parameters of the package's node, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model import schema

from .filters import Params
from .joint.joint_parameters import JointParams
from .kalman import EstimatorParams
from .support_package import ToolboxEstimatorParams


@dataclass(frozen=True)
class EstimatorNodeParams:
    """Parameters of ``estimator_node``."""

    estimator: str = schema.choice(
        'kalman', ('kalman', 'joint', 'toolbox', 'ground_truth'),
        'which estimator answers the sensors')
    synchronise: str = schema.choice(
        'watermark', ('watermark', 'arrival'),
        'wait for every sample the watermark announces, or use what has arrived (real hardware)')
    sensor_reliability: str = schema.choice(
        'reliable', ('reliable', 'best_effort'),
        'what the subscriptions of the sensors ask for; best_effort also hears drivers that offer '
        'no more, with synchronise = arrival, as a lost sample is never announced twice')
    map_to_odom: bool = schema.flag(True, 'publish the identity map to odom on /tf')
    kalman: EstimatorParams = schema.group(EstimatorParams)
    joint: JointParams = schema.group(JointParams)
    toolbox: ToolboxEstimatorParams = schema.group(ToolboxEstimatorParams)

    def __post_init__(self) -> None:
        schema.check(self)

    @property
    def filter(self) -> Params:
        """Return the parameters of the chosen filter; with the ground truth, one not used."""
        if self.estimator == 'joint':
            return self.joint
        return self.toolbox if self.estimator == 'toolbox' else self.kalman
