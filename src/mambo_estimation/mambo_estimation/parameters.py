"""Parameters of the package's node, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mambo_model import schema
from mambo_model.components import built_in_groups
from mambo_model.motion import parameter_change

from .filters import DEFAULT, OwnParams, REGISTRY


@built_in_groups(REGISTRY)
@dataclass(frozen=True)
class EstimatorNodeParams:
    """Parameters of ``estimator_node``."""

    estimator: str = schema.component(
        DEFAULT, REGISTRY, 'which estimator is used')
    synchronise: str = schema.choice(
        'watermark', ('watermark', 'arrival'),
        'wait for every sample the watermark announces, or use what has arrived (real hardware)')
    sensor_reliability: str = schema.choice(
        'reliable', ('reliable', 'best_effort'),
        'reliability that the sensor subscriptions request; best_effort also matches drivers that '
        'offer no more; use it with synchronise = arrival, as lost samples are not resent')
    map_to_odom: bool = schema.flag(True, 'publish the identity map to odom on /tf')
    changes: str = schema.text(
        '', 'changes of noise and gates in flight, a YAML list: see docs/how-to/commands.md')

    def __post_init__(self) -> None:
        schema.check(self)
        parameter_change.check(self)

    def fixed(self, name: str) -> str:
        """Return why a parameter cannot be changed in flight; empty: it can be."""
        chosen, (group, _, rest) = REGISTRY.find(self.estimator), name.partition('.')
        if chosen is None:
            return 'the true state is the estimate'
        if chosen.own and group == chosen.name:
            return 'an estimator of your own keeps its parameters for a whole flight'
        if group in REGISTRY.built_in and group != chosen.name:
            return f'the flight has the estimator {chosen.name}'
        leaf = rest.rpartition('.')[2]
        if rest and not leaf.startswith('initial_') and leaf.endswith(('noise', 'gate')):
            return ''
        return 'noises and gates of the filter alone can be changed' if rest else (
            parameter_change.STARTED)

    def kept(self) -> dict[str, Any]:
        """Return the parameters that every change sets as well: none."""
        return {}

    def compiled(self) -> Any:
        """Return what the compiled step reads."""
        return self.filter.values()

    @property
    def filter(self) -> Any:
        """Return the parameters of the chosen filter; with the ground truth, one not used."""
        chosen = REGISTRY.find(self.estimator) or REGISTRY.find(DEFAULT)
        params = getattr(self, chosen.name)
        return OwnParams(chosen, params) if chosen.own else params

    @property
    def aided(self) -> bool:
        """Return whether poses of the motion capture correct the estimate."""
        return self.estimator == 'joint' and self.joint.pose.enabled

    @property
    def waits_for_capture(self) -> bool:
        """Return whether a step waits for the watermark of the motion capture."""
        return self.aided and self.synchronise == 'watermark'
