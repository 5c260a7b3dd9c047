"""Parameters of the package's flight nodes, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model import schema

from .sensors.optitrack import OptitrackParams
from .simulator import SimulatorParams

STEP_NS = 5_000_000
"""Control step of the toolbox: 200 Hz, section 4.2."""


@dataclass(frozen=True)
class SimNodeParams:
    """Parameters of ``sim_node``."""

    mode: str = schema.choice('realtime', ('realtime', 'lockstep'), 'how time advances')
    speed: float = schema.quantity(1.0, '-', 0.01, 100.0, 'simulated over wall time (realtime)')
    duration: float = schema.quantity(0.0, 's', 0.0, 86400.0, 'flight time, 0: until stopped')
    paused: bool = schema.flag(False, 'begin paused, before the first step')
    wait_for: str = schema.text('', 'names of nodes to wait for, separated by commas')
    wait_for_publishers: str = schema.text(
        '', 'topics, separated by commas, that a node of another origin publishes: wait for it '
        'and for every subscription that it has')
    start_patience: float = schema.quantity(
        300.0, 's', 1.0, 3600.0,
        'wall time to wait for nodes and links: the first start compiles the numerics')
    patience: float = schema.quantity(
        30.0, 's', 1.0, 3600.0, 'wall time without an answer after which to give up (lockstep)')
    motor_timeout: float = schema.quantity(
        0.5, 's', 0.0, 3600.0,
        'wall time without a motor command after which turning motors stop, as a watchdog in the '
        'firmware does it; 0: never (realtime)')
    simulator: SimulatorParams = schema.group(SimulatorParams)

    def __post_init__(self) -> None:
        schema.check(self)


@dataclass(frozen=True)
class OptitrackNodeParams:
    """Parameters of ``optitrack_node``."""

    seed: int = schema.quantity(
        1, '-', 0, 2**31 - 1, 'of the simulator, whose noise streams it shares')
    watermark: bool = schema.flag(
        False, 'publish optitrack/tick, which an estimator that uses the poses waits for; a run '
        'sets it where it is needed')
    optitrack: OptitrackParams = schema.group(OptitrackParams)

    def __post_init__(self) -> None:
        schema.check(self)
