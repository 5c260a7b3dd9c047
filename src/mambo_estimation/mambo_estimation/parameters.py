"""Parameters of the package's node, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mambo_model import schema
from mambo_model.components import built_in_groups

from .filters import OwnParams, REGISTRY


@built_in_groups(REGISTRY)
@dataclass(frozen=True)
class EstimatorNodeParams:
    """Parameters of ``estimator_node``."""

    estimator: str = schema.component(
        'kalman', REGISTRY, 'which estimator answers the sensors')
    synchronise: str = schema.choice(
        'watermark', ('watermark', 'arrival'),
        'wait for every sample the watermark announces, or use what has arrived (real hardware)')
    sensor_reliability: str = schema.choice(
        'reliable', ('reliable', 'best_effort'),
        'what the subscriptions of the sensors ask for; best_effort also hears drivers that offer '
        'no more, with synchronise = arrival, as a lost sample is never announced twice')
    map_to_odom: bool = schema.flag(True, 'publish the identity map to odom on /tf')

    def __post_init__(self) -> None:
        schema.check(self)

    @property
    def filter(self) -> Any:
        """Return the parameters of the chosen filter; with the ground truth, one not used."""
        chosen = REGISTRY.find(self.estimator) or REGISTRY.find('kalman')
        params = getattr(self, chosen.name)
        return OwnParams(chosen, params) if chosen.own else params
