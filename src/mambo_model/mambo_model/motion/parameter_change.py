"""
Changes of the parameters of a node while it flies, as data.

A change is a flight time and values by name; it counts from the first control step at or after
that time. As text, a YAML list::

    - {time: 5.0, set: {cascaded.k_p: 3.0, cascaded.K_nu: 2.5}}
    - {time: 9.0, set: {failsafe.hold: 0.5}}

The dataclass of a node whose parameters can change has the parameter ``changes``, this text, and
three methods: ``fixed``, why a parameter cannot change; ``compiled``, what its compiled step
reads; ``kept``, what every change sets as well, so that the step stays the same. A change that
would need another compiled step is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import json
from typing import Any, NamedTuple

import yaml

from ..schema import build, flatten, ParameterError, shown, unknown
from ..yaml_nodes import load, reason

NEVER = 2**63 - 1  # ns, later than any flight
MOST = 20_000  # changes of a node
LATEST = 86400.0  # s
STARTED = 'it is fixed when the node starts'
"""Reason for most parameters."""


class Change(NamedTuple):
    """New values of some parameters of a node."""

    t: int                  # ns of flight time
    values: dict[str, Any]  # by name within the node


def _change(entry: Any, where: str) -> Change:
    """Return the change of one entry."""
    if not isinstance(entry, Mapping) or set(entry) != {'time', 'set'} or (
            not isinstance(entry['set'], Mapping) or not entry['set']):
        raise ParameterError(f'{where}: must hold a time and what to set, such as '
                             '{time: 5.0, set: {NAME: VALUE}}')
    time = entry['time']
    if isinstance(time, bool) or not isinstance(time, (int, float)) or time != time:
        raise ParameterError(f'{where}: time = {shown(time)} must be a number')
    if not 0.0 <= time <= LATEST:
        raise ParameterError(f'{where}: time = {shown(time)} s is outside [0, {LATEST:g}] s')
    for name, value in entry['set'].items():
        if not all(isinstance(one, (bool, int, float, str))
                   for one in (value if isinstance(value, (list, tuple)) else [value])):
            raise ParameterError(f'{where}: {shown(name)} = {shown(value)} must be a number, '
                                 'true or false, a text, or a list of these')
    return Change(round(time * 1e9), {str(name): value for name, value in entry['set'].items()})


def read(entries: Any, where: str = 'changes') -> list[Change]:
    """
    Return the changes of a list of entries, such as YAML gives it.

    Raises
    ------
    ParameterError
        Naming the entry that is wrong, or for entries out of order.

    """
    if not isinstance(entries, list) or len(entries) > MOST:
        raise ParameterError(f'{where}: must be a list of at most {MOST} changes')
    out = [_change(entry, f'{where}: change {number}') for number, entry in enumerate(entries, 1)]
    for number, (before, after) in enumerate(zip(out, out[1:]), 2):
        if after.t < before.t:
            raise ParameterError(f'{where}: change {number}: is earlier than the one before it')
    return out


def parse(text: str) -> list[Change]:
    """Return the changes of a text; errors as of :func:`read`."""
    if not text.strip():
        return []
    try:
        return read(load(text))
    except yaml.YAMLError as error:
        raise ParameterError(f'changes: {reason(error)}') from None


def to_text(changes: Iterable[Change]) -> str:
    """Return changes as text, whose numbers read back exactly."""
    return ''.join(
        '- ' + json.dumps({'time': change.t / 1e9, 'set': change.values}) + '\n'
        for change in changes)


def _shape(values: Any) -> Any:
    """Return the types of values for compiled code: equal ones need no other compiled step."""
    return (type(values), tuple(map(_shape, values))) if isinstance(values, tuple) else (
        type(values))


def changed(params: Any, values: Mapping[str, Any]) -> Any:
    """
    Return the parameters of a node with new values.

    Parameters
    ----------
    params
        Of a node, with ``fixed``, ``kept`` and ``compiled``.
    values
        By name within the node; lists stand for tuples.

    Raises
    ------
    ParameterError
        For an unknown name (with the nearest), a wrong value, or a parameter that cannot change
        in flight, with the reason.

    """
    flat = flatten(params)
    for name in values:
        if name not in flat:
            raise ParameterError(unknown(name, flat))
        if why := params.fixed(name):
            raise ParameterError(f'{name}: cannot be changed in flight: {why}')
    after = build(type(params), {**flat, **values, **params.kept(), 'changes': ''})
    if _shape(after.compiled()) != _shape(params.compiled()):
        raise ParameterError(f'{", ".join(values)}: cannot be changed in flight: the flight would '
                             'need another compiled step; start it with this value')
    return after


def check(params: Any) -> None:
    """Raise ParameterError if a change of a node's own ``changes`` is refused."""
    if params.changes:
        changes = Changes(params)
        while changes.due < NEVER:
            t = changes.due
            try:
                changes.take(t)
            except ParameterError as error:
                raise ParameterError(f'changes: at t = {t * 1e-9:g} s: {error}') from None


class Changes:
    """
    The parameters of one node as the flight goes on.

    Parameters
    ----------
    params
        At its start.

    Attributes
    ----------
    params
        Now.
    due : int
        Time of the next change, ns; :data:`NEVER`: there is none.

    """

    def __init__(self, params: Any) -> None:
        self.params = params
        self._pending = parse(params.changes)
        self._look()

    def _look(self) -> None:
        self.due = self._pending[0].t if self._pending else NEVER

    def _until(self, t: int) -> dict[str, Any]:
        """Return the values that are pending up to a time in ns, the latest of each name."""
        return {name: value for change in self._pending if change.t <= t
                for name, value in change.values.items()}

    def offer(self, values: Mapping[str, Any], t: int) -> dict[str, Any]:
        """
        Add a change at a time in ns; return its values with their declared types.

        Raises
        ------
        ParameterError
            As :func:`changed`.

        """
        before = self._until(t)
        wanted = dict(values)
        flat = flatten(changed(changed(self.params, before) if before else self.params, wanted))
        typed = {name: flat[name] for name in wanted}
        later = [change for change in self._pending if change.t > t]
        self._pending = [Change(t, {**before, **typed}), *later]
        self._look()
        return typed

    def take(self, t: int) -> dict[str, Any]:
        """
        Let the changes up to a time in ns take effect; return their values.

        Raises
        ------
        ParameterError
            As :func:`changed`; the changes up to this time then have no effect.

        """
        values = self._until(t)
        self._pending = [change for change in self._pending if change.t > t]
        self._look()
        self.params = changed(self.params, values)
        flat = flatten(self.params)
        return {name: flat[name] for name in values}
