"""Parameters of the package's nodes, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model import schema
from mambo_model.motion.trajectory import FlightPlanParams
from mambo_model.vehicle.parameters import Vehicle

from .controllers import Params
from .failsafe import FailsafeParams
from .gains import CascadedParams
from .literature.extended import ExtendedParams
from .literature.flatness_drag import FlatnessDragParams
from .literature.geometric import GeometricParams
from .literature.indi import IndiParams
from .support_package import ToolboxControllerParams


@dataclass(frozen=True)
class ReferenceNodeParams:
    """Parameters of ``reference_node``; the vehicle is the one the controller believes in."""

    plan: FlightPlanParams = schema.group(FlightPlanParams)
    vehicle: Vehicle = schema.group(Vehicle)


@dataclass(frozen=True)
class ControllerNodeParams:
    """Parameters of ``controller_node``; the vehicle is the one the controller believes in."""

    controller: str = schema.choice(
        'cascaded',
        ('cascaded', 'toolbox', 'extended', 'flatness_drag', 'geometric', 'indi'),
        'which control law')
    period: float = schema.quantity(0.005, 's', 0.001, 0.1, '200 Hz, section 4.2')
    patience: float = schema.quantity(
        0.1, 's', 0.0, 10.0, 'an estimate or a reference is missing when the other stream is '
        'ahead by so much stamped time (judgement)')
    cascaded: CascadedParams = schema.group(CascadedParams)
    toolbox: ToolboxControllerParams = schema.group(ToolboxControllerParams)
    extended: ExtendedParams = schema.group(ExtendedParams)
    flatness_drag: FlatnessDragParams = schema.group(FlatnessDragParams)
    geometric: GeometricParams = schema.group(GeometricParams)
    indi: IndiParams = schema.group(IndiParams)
    failsafe: FailsafeParams = schema.group(FailsafeParams)
    vehicle: Vehicle = schema.group(Vehicle)

    def __post_init__(self) -> None:
        schema.check(self)

    @property
    def law(self) -> Params:
        """Return the parameters of the chosen control law."""
        return getattr(self, self.controller)
