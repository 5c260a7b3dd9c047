"""
Parameters that change while a node flies: ``ros2 param set``, and the script of the flight.

A change takes effect at one control step of its node, and is recorded on ``/diagnostics`` with the
time of that step. Flown again, the script has it at that time.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
import time
from types import MappingProxyType
from typing import Any

from mambo_model import schema
from mambo_model.compiled import set_values
from mambo_model.motion import parameter_change
from mambo_model.motion.parameter_change import Changes
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from .. import topics
from .change_message import encode

MOST = 50
"""Requests within a second; each takes a millisecond of a node that has steps to take."""


class Live:
    """
    The part of a node that answers requests to set its parameters.

    Attributes
    ----------
    changes : Changes
        Of a node that called :meth:`allow_changes`; None: its parameters are fixed.
    held : mambo_model.compiled.Held
        What the compiled step of such a node reads.
    decided : Mapping[str, str]
        Parameters that another node decides on, and the reason: no request sets them here.

    """

    changes: Changes | None = None
    decided: Mapping[str, str] = MappingProxyType({})
    held: Any
    _second: int = 0  # of the machine's clock, in which there were ...
    _requests: int = 0  # ... so many requests

    def allow_changes(self: Any, next_step: Callable[[], int]) -> None:
        """
        Let the parameters of this node change while it flies.

        The node calls :meth:`change` at a step whose time has reached ``changes.due``.

        Parameters
        ----------
        next_step
            Returns the time of the next control step, ns.

        """
        self.changes, self._next_step = Changes(self.params), next_step
        self._changed = self.advertise(topics.DIAGNOSTICS)
        self.renew()

    def renew(self) -> None:
        """Take what the node itself needs of its parameters; called after each change."""

    def set_parameters_atomically(
        self: Any, parameter_list: Sequence[Parameter],
    ) -> SetParametersResult:
        """Answer a request: set all parameters from the next control step on, or none of them."""
        second = int(time.monotonic())
        self._requests = self._requests + 1 if second == self._second else 1
        self._second = second
        if self._requests > MOST:  # one request of ``set_parameters`` may hold thousands
            return SetParametersResult(successful=False, reason=(
                f'more than {MOST} changes within a second: set the parameters together, by '
                'set_parameters_atomically'))
        if not parameter_list:
            return SetParametersResult(successful=True, reason='nothing to set')
        names = [one.name for one in parameter_list]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            return SetParametersResult(successful=False, reason=f'{twice}: given twice')
        known = schema.flatten(self.params)
        if all(p.name not in known and self.has_parameter(p.name)
               for p in parameter_list):  # ROS's own, such as use_sim_time
            return super().set_parameters_atomically(parameter_list)
        values = {p.name: list(p.value) if isinstance(p.value, (array, list)) else p.value
                  for p in parameter_list}
        try:
            t = self._offer(values, known)
        except schema.ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True, reason=f'from t = {t * 1e-9:.3f} s')

    def _offer(self: Any, values: dict[str, Any], known: dict[str, Any]) -> int:
        """Let values be set at the next control step; return its time in ns."""
        for name in values:
            if name not in known:
                raise schema.ParameterError(schema.unknown(name, known))
            why = parameter_change.STARTED if self.changes is None else self.decided.get(name)
            if why:
                raise schema.ParameterError(f'{name}: cannot be changed in flight: {why}')
        t = self._next_step()
        self._show(self.changes.offer(values, t))
        return t

    def _show(self: Any, values: dict[str, Any]) -> None:
        """Let ROS show new values of parameters."""
        super().set_parameters_atomically([
            Parameter(name, value=list(value) if isinstance(value, tuple) else value)
            for name, value in values.items()])

    def change(self: Any, t: int) -> None:
        """Let the changes up to a control step, in ns, take effect, and record them."""
        try:
            values = self.changes.take(t)
        except schema.ParameterError as error:  # of the script, after others that came in between
            self.get_logger().warning(f't = {t * 1e-9:.3f} s: parameters not changed: {error}')
            return
        self.params = self.changes.params
        set_values(self.held, self.params.compiled())
        self.renew()
        self._show(values)
        self._changed(encode(t, self.get_name(), values))
