"""Refuse parameters of an estimator or controller that nobody flies: they would do nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_model import schema

_KINDS = {'estimator_node': ESTIMATORS, 'controller_node': CONTROLLERS}
_BACKUP = 'cascaded'  # lands a vehicle whose own controller has failed, and has its limits


def refuse(flown: Iterable[tuple[str, str]], places: Mapping[str, str]) -> None:
    """
    Refuse parameters of an estimator or a controller that no flight has.

    Parameters
    ----------
    flown
        The estimator and the controller of each flight.
    places
        {'node.parameter': where it is set}, such as file and line, or an option.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the parameter and the components that are flown.

    """
    names = dict(zip(_KINDS, map(set, zip(*flown, strict=True)), strict=True))
    for name, where in places.items():
        node, _, rest = name.partition('.')
        group = rest.partition('.')[0]
        if node not in _KINDS or group not in _KINDS[node].built_in or group in names[node]:
            continue
        if group == _BACKUP and names[node] - set(_KINDS[node].names):
            continue
        kind = node.removesuffix('_node')
        raise schema.ParameterError(
            f'{where}: {name}: has no effect, as the {kind} is '
            f'{" or ".join(sorted(names[node]))}: choose {kind}: {group}, or leave it out')
