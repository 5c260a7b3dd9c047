"""What to say of a node that had to be killed while compiled code of the user ran in it."""

from __future__ import annotations

from collections.abc import Iterable

from mambo_flight.scenario import Scenario
from mambo_model.components import own_components, where


def stuck(flight: Scenario, killed: Iterable[str]) -> str:
    """
    Return which step of a user's component may never end, '' if it cannot be that.

    Parameters
    ----------
    flight
        What was flown.
    killed
        Names of the nodes that were ended by SIGKILL, as neither SIGINT nor SIGTERM ended them.

    """
    said = []
    for name in killed:
        params = getattr(flight, name, None)
        for component in own_components(params) if params is not None else ():
            if component.compiled:
                said.append(f'{name} had to be killed: the compiled step of '
                            f'{where(component.path, component.step)} may never end')
    return '; '.join(said)
