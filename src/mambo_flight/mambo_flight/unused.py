"""Refuse parameters of an estimator that nobody flies: they would change nothing, silently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mambo_estimation.filters import REGISTRY
from mambo_model import schema

NODE = 'estimator_node'


def refuse(flown: Iterable[str], places: Mapping[str, str]) -> None:
    """
    Refuse parameters of an estimator that no flight has.

    Parameters
    ----------
    flown
        The estimators of the flights.
    places
        {'node.parameter': where it is set}, such as file and line, or an option.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the parameter and the estimators that are flown.

    """
    names = set(flown)
    for name, where in places.items():
        node, _, rest = name.partition('.')
        group = rest.partition('.')[0]
        if node == NODE and group in REGISTRY.built_in and group not in names:
            raise schema.ParameterError(
                f'{where}: {name}: has no effect, as the estimator is '
                f'{" or ".join(sorted(names))}: choose estimator: {group}, or leave it out')
