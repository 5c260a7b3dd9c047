"""Parameters of the recorder."""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model import schema


@dataclass(frozen=True)
class RecorderNodeParams:
    """Parameters of ``recorder_node``."""

    bag: str = schema.text('', 'directory of the bag; must not exist')
    topics: str = schema.text('', 'names separated by commas, default: every topic of the flight')
    scenario: str = schema.text('', 'file kept inside the bag: scenario and parameters')
    whole: bool = schema.flag(
        True, 'whether it is a fault if the bag lacks samples that sensor_tick counts, or the end '
        'of a topic that the simulator publishes at every step; a replay lacks what its bag lacks')
    world: str = schema.text('', 'file kept inside the bag: the hall that several drones share')

    def __post_init__(self) -> None:
        schema.check(self)
        if not self.bag:
            raise schema.ParameterError('bag: give the directory of the bag')
