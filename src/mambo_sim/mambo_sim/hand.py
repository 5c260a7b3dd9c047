"""
A vehicle that is not flown but carried by hand along a trajectory, level, its motors stopped.

The thesis measured errors of the optical flow in this way, without tilt and rotation, Fig. C.1.
"""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model.compiled import jit
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import flat_output, FlightPlanParams, PlanValues
from mambo_model.motion.vector import Vec3
from mambo_model.schema import flag, group


@dataclass(frozen=True)
class HandParams:
    """Whether a hand carries the vehicle, and along which trajectory."""

    enabled: bool = flag(False, 'design choice: true moves the vehicle by hand, thesis app. C')
    plan: FlightPlanParams = group(FlightPlanParams)

    def values(self) -> PlanValues | None:
        """Return the values for compiled code; None, a separate type, for a flying vehicle."""
        return self.plan.values() if self.enabled else None


@jit
def carry(t: float, plan: PlanValues, gravity: float) -> tuple[State, Vec3]:
    """
    Return the state at t s, and the specific force, (3,) m/s^2, body FRD: a - g e3.

    Parameters
    ----------
    t : s
    plan
        Path of the hand.
    gravity : m/s^2

    """
    rho, v, a, _, _, _ = flat_output(t, plan)
    body = State(rho, v, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return body, (a[0], a[1], a[2] - gravity)
