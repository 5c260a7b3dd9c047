"""
Parameters that change in flight: in a scenario file, and in one process.

In a scenario file::

    changes:
      - {time: 5.0, set: {controller_node.cascaded.k_p: 3.5}}
      - {time: 9.0, set: {sim_node.simulator.wind.velocity: [1.0, 0.0, 0.0]}}
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from mambo_estimation.parameters import EstimatorNodeParams
from mambo_model import schema
from mambo_model.motion import parameter_change
from mambo_model.motion.parameter_change import Change, Changes, NEVER
from mambo_sim.parameters import STEP_NS
import yaml

from .scenario import LEAVES, ParameterReader, Place, Scenario

NODES = ('sim_node', 'estimator_node', 'controller_node')
"""Nodes whose parameters can change in flight."""


class Taken(NamedTuple):
    """A change of a node at the control step at which it takes effect."""

    k: int                  # number of the step
    node: str
    values: dict[str, Any]  # by name within the node
    params: Any             # of the node from then on


def taken(flight: Scenario, rows: int = NEVER) -> list[Taken]:
    """
    Return the scripted changes of a flight, in the order of time.

    Parameters
    ----------
    flight
        Scenario.
    rows
        Number of control steps of the flight; later changes are left out.

    """
    out = []
    for node in NODES:
        changes = Changes(getattr(flight, node))
        while (k := -(-changes.due // STEP_NS)) < min(rows, NEVER // STEP_NS):
            out.append(Taken(k, node, changes.take(k * STEP_NS), changes.params))
    return sorted(out, key=lambda one: (one.k, one.node))


def changes_at_all(flight: Scenario) -> bool:
    """Return whether a flight has scripted changes."""
    return any(getattr(flight, node).changes for node in NODES)


def late(flight: Scenario) -> Iterator[str]:
    """Yield a line for each node with changes that come after the end of a flight."""
    end = flight.sim_node.duration
    for node in NODES:
        after = [one.t * 1e-9 for one in parameter_change.parse(getattr(flight, node).changes)
                 if end and one.t >= end * 1e9]
        if after:
            yield (f'changes of {node} at t = {after[0]:g} s or later have no effect: the flight '
                   f'ends at {end:g} s')


def idle_faults(flight: Scenario) -> Iterator[str]:
    """Yield a line for each fault that never happens: after the end of a flight, or of nothing."""
    faults, end = flight.sim_node.simulator.faults, flight.sim_node.duration
    for name in faults.present():
        fault = getattr(faults, name)
        reason = (
            f'it begins at {fault.start:g} s, and the flight ends at {end:g} s'
            if end and fault.start >= end else
            f'its {"duration" if not fault.duration else "share"} is 0'
            if not (fault.duration and fault.share) else '')
        if reason:
            yield f'the fault of sim_node.simulator.faults.{name} never happens: {reason}'


def settings_later(flight: Scenario, p: Any, rows: int) -> list[tuple[int, Any]]:
    """
    Return the constants of a flight that change, each with the number of its control step.

    Parameters
    ----------
    flight
        Scenario.
    p
        ``closed_loop.Settings`` at the start.
    rows
        Number of control steps.

    """
    out: dict[int, Any] = {}
    for one in taken(flight, rows):
        values = one.params.compiled()
        if one.node == 'controller_node':
            _, gains, failsafe, _ = values
            p = p._replace(gains=gains, failsafe=failsafe)
        elif one.node == 'estimator_node':
            p = p._replace(estimator=values)
        else:
            p = p._replace(simulator=values)
        out[one.k] = p
    return list(out.items())


def values_later(node: EstimatorNodeParams) -> list[tuple[int, Any]]:
    """Return the values of an estimator that change, each with its time in ns."""
    changes, out = Changes(node), []
    while (t := changes.due) < NEVER:
        changes.take(t)
        out.append((t, changes.params.compiled()))
    return out


def by_node(found: list[Change], where: str) -> dict[str, list[Change]]:
    """Return changes of ``node.parameter`` by node; ParameterError for one that has none."""
    out: dict[str, list[Change]] = {}
    for change in found:
        own: dict[str, dict[str, Any]] = {}
        for full, value in change.values.items():
            node, _, name = full.partition('.')
            if node not in NODES:
                raise schema.ParameterError(f'{where}: ' + (
                    f'{full}: cannot be changed in flight: {parameter_change.STARTED}'
                    if full in LEAVES else schema.unknown(full, LEAVES)))
            own.setdefault(node, {})[name] = value
        for node, values in own.items():
            out.setdefault(node, []).append(Change(change.t, values))
    return out


def _refuse_two_values(changes: list[Change], where: str) -> None:
    """Raise ParameterError for a parameter that gets two values in one control step."""
    step, values = -1, {}
    for change in changes:
        k = -(-change.t // STEP_NS)
        step, values = (k, values) if k == step else (k, {})
        for name, value in change.values.items():
            if values.setdefault(name, value) != value:
                raise schema.ParameterError(
                    f'{where}: {name}: is set to {schema.shown(values[name])} and '
                    f'{schema.shown(value)} at t = {change.t * 1e-9:g} s: leave one out')


def parameters(reader: ParameterReader, node: yaml.Node) -> dict[str, Place]:
    """
    Return the parameters of the nodes for the key ``changes`` of a scenario file.

    Raises
    ------
    ParameterError
        Naming file, line and what is wrong.

    """
    entries = reader.plain(node, 'changes')
    where = f'{reader.where(node)}: changes'
    changes = parameter_change.read(entries, where)
    _refuse_two_values(changes, where)
    found = by_node(changes, where)
    return {f'{name}.changes': Place(parameter_change.to_text(own), reader.where(node))
            for name, own in found.items()}
