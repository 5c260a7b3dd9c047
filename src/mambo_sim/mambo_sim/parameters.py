"""Parameters of the package's flight nodes, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mambo_model import schema
from mambo_model.motion import parameter_change

from .sensors.optitrack import OptitrackParams
from .simulator import SimulatorParams

STEP_NS = 5_000_000
"""Control step of the toolbox: 200 Hz, section 4.2."""
_SENSORS = ('imu', 'sonar', 'optical_flow', 'barometer')
_NOISE = frozenset((
    'gyro_noise', 'accel_noise', 'gyro_vibration', 'accel_vibration', 'noise',
    'outlier_probability', 'multipath_probability', 'multipath_excess', 'dropout_probability',
    'texture', 'dropout', 'texture_dropout'))
"""Parameters of the sensors that can change in flight."""


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
        'firmware does it; at a speed below 1, flight time; 0: never (realtime)')
    simulator: SimulatorParams = schema.group(SimulatorParams)
    changes: str = schema.text(
        '', 'changes of noise, wind, faults and speed in flight, a YAML list: see '
        'docs/how-to/commands.md')

    def __post_init__(self) -> None:
        schema.check(self)
        parameter_change.check(self)

    def fixed(self, name: str) -> str:
        """Return why a parameter cannot be changed in flight; empty: it can be."""
        if name == 'speed':
            return '' if self.mode == 'realtime' else 'lockstep flies as fast as the machine can'
        _, group, leaf = (*name.split('.'), '', '')[:3]
        if group in ('wind', 'faults') and leaf != 'changeable':
            if getattr(self.simulator, group).values() is None:
                return f'start the flight with sim_node.simulator.{group}.changeable=true'
            return ''
        if group in _SENSORS and leaf in _NOISE:
            return ''
        return parameter_change.STARTED

    def kept(self) -> dict[str, Any]:
        """Return the parameters that keep wind and faults in the step when they are set to 0."""
        return {f'simulator.{group}.changeable': True for group in ('wind', 'faults')
                if getattr(self.simulator, group).values() is not None}

    def compiled(self) -> Any:
        """Return what the compiled step reads."""
        return self.simulator.values()


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
