"""Parameters of the package's nodes, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mambo_model import schema
from mambo_model.components import built_in_groups
from mambo_model.motion import parameter_change
from mambo_model.motion.trajectory import FlightPlanParams, PlanValues
from mambo_model.vehicle.parameters import Vehicle

from .commanded import evaluation, script
from .commanded.command_params import CommandParams
from .commanded.evaluation import CommandedValues
from .controllers import OwnParams, REGISTRY
from .failsafe import FailsafeParams


@dataclass(frozen=True)
class ReferenceNodeParams:
    """Parameters of ``reference_node``; the vehicle is the one the controller believes in."""

    plan: FlightPlanParams = schema.group(FlightPlanParams)
    vehicle: Vehicle = schema.group(Vehicle)
    commands: CommandParams = schema.group(CommandParams)

    def __post_init__(self) -> None:
        if self.commands.enabled:
            script.flown(self.commands, self.vehicle)

    def flown(self) -> PlanValues | CommandedValues:
        """Return what the reference follows, for compiled code: the plan, or the script."""
        if self.commands.enabled:
            return evaluation.values(script.flown(self.commands, self.vehicle))
        return self.plan.values()


@built_in_groups(REGISTRY, before='failsafe')
@dataclass(frozen=True)
class ControllerNodeParams:
    """Parameters of ``controller_node``; the vehicle is the one the controller believes in."""

    controller: str = schema.component('cascaded', REGISTRY, 'which control law')
    estimate: str = schema.choice(
        'odom', ('odom', 'map'), 'frame of the estimate that is answered: odom never jumps, map '
        'is where the motion capture sees the vehicle and needs an estimator that uses it')
    period: float = schema.quantity(0.005, 's', 0.001, 0.1, '200 Hz, section 4.2')
    patience: float = schema.quantity(
        0.1, 's', 0.0, 10.0, 'an estimate or a reference is missing when the other stream is '
        'ahead by so much stamped time (judgement)')
    failsafe: FailsafeParams = schema.group(FailsafeParams)
    vehicle: Vehicle = schema.group(Vehicle)
    changes: str = schema.text(
        '', 'changes of gains and failsafe in flight, a YAML list: see docs/how-to/commands.md')

    def __post_init__(self) -> None:
        schema.check(self)
        parameter_change.check(self)

    def fixed(self, name: str) -> str:
        """Return why a parameter cannot be changed in flight; empty: it can be."""
        chosen, group = REGISTRY.find(self.controller), name.partition('.')[0]
        if chosen.own and group in (chosen.name, 'failsafe'):
            return 'a controller of your own keeps its parameters for a whole flight'
        if group in (chosen.name, 'failsafe'):
            return ''
        if group in REGISTRY.built_in:
            return f'the flight has the controller {chosen.name}'
        return parameter_change.STARTED

    def kept(self) -> dict[str, Any]:
        """Return the parameters that every change sets as well: none."""
        return {}

    def compiled(self) -> tuple[Any, ...]:
        """Return what the compiled step reads: period in s, gains, failsafe, vehicle."""
        return (self.period, self.law.values(), self.failsafe.values(), self.vehicle.values())

    @property
    def law(self) -> Any:
        """Return the parameters of the chosen control law."""
        chosen = REGISTRY.find(self.controller)
        params = getattr(self, chosen.name)
        return OwnParams(chosen, params) if chosen.own else params
