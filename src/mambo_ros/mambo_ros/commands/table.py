"""Table of the command services: relative name and type."""

from __future__ import annotations

from dataclasses import dataclass

from mambo_interfaces.srv import GoTo, Land, StartTrajectory, Step, Takeoff
from std_srvs.srv import SetBool, Trigger


@dataclass(frozen=True)
class Service:
    """
    One service.

    Attributes
    ----------
    name : str
        Relative to the node's namespace.
    srv_type : type
        Service class; its response has ``success`` and ``message``.

    """

    name: str
    srv_type: type

    @property
    def type_name(self) -> str:
        """Return the type as ``package/srv/Name``."""
        package = self.srv_type.__module__.split('.')[0]
        return f'{package}/srv/{self.srv_type.__name__}'


TAKEOFF = Service('takeoff', Takeoff)
LAND = Service('land', Land)
GO_TO = Service('go_to', GoTo)
START_TRAJECTORY = Service('start_trajectory', StartTrajectory)
STOP = Service('stop', Trigger)
PAUSE = Service('pause', SetBool)
STEP = Service('step', Step)

REFERENCE = (TAKEOFF, LAND, GO_TO, START_TRAJECTORY, STOP)
"""Of the node that makes the reference of a commanded flight."""
