"""Refuse parameters of an estimator or controller that nobody flies: they would do nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_model import schema

_KINDS = {'estimator_node': ESTIMATORS, 'controller_node': CONTROLLERS}
_BACKUP = 'cascaded'  # lands a vehicle whose own controller has failed, and has its limits


def refuse(
        places: Mapping[str, str], *, estimators: Iterable[str],
        controllers: Iterable[str] = ()) -> None:
    """
    Refuse parameters of an estimator or a controller that no flight has.

    Parameters
    ----------
    places
        {'node.parameter': where it is set}, such as file and line, or an option.
    estimators, controllers
        Names of all that are flown; none if nothing of the kind flies, as in an estimate of a bag.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the parameter and the components that are flown.

    """
    names = {'estimator_node': set(estimators), 'controller_node': set(controllers)}
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
            f'{" or ".join(sorted(names[node])) or "not flown"}: '
            f'choose {kind}: {group}, or leave it out')
