"""
Registry of estimators by name; the types of memory and values select the implementation.

An estimator is a dataclass of parameters, ``initial`` and ``step``: one line of ``REGISTRY`` for a
built-in one, a file or an installed package for one from outside. A custom one that raises an
error, returns values that are not finite or takes too long is not called again. Its estimate is
then lost, and the failsafe of the controller lands the vehicle.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from mambo_model import slots
from mambo_model.compiled import by_type, jit, jit_inside, objmode, typeof
from mambo_model.components import Component, Registry
from mambo_model.motion.rigid_body import State
from mambo_model.slots import PlainMemory, PlainValues, UnusableError
from mambo_model.values import values

from . import kalman, support_package
from .capture import aided
from .capture.pose_parameters import AidedValues
from .estimate import complaint, Estimate, is_sound, of_state, STATUS_DEAD_RECKONING
from .joint import filter as joint
from .joint.joint_parameters import JointParams
from .kalman import EstimatorParams
from .support_package import ToolboxEstimatorParams

REGISTRY = Registry(
    'estimator', (
        'memory', 'dt', 'gyro', 'accel', 'sonar', 'flow', 'flow_quality', 'pressure', 'values'), {
        'kalman': (EstimatorParams, kalman),
        'toolbox': (ToolboxEstimatorParams, support_package),
        'joint': (JointParams, joint)}, others=('ground_truth',))
DEFAULT = 'joint'
"""The estimator of a flight that names none: docs/evidence/estimators.md says why."""

Memory = Any  # of any of them
Values = Any  # of its parameters
Params = Any  # a dataclass with such values

_NAN3, _NAN4 = (math.nan, math.nan, math.nan), (math.nan, math.nan, math.nan, math.nan)
_LOST = of_state(
    State(_NAN3, _NAN3, _NAN4, _NAN3), STATUS_DEAD_RECKONING, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_ESTIMATE = typeof(_LOST)
_HOVER = (0.005, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), math.nan, (math.nan, math.nan), 0, math.nan)


class OwnValues(NamedTuple):
    """Parameters of a user's estimator."""

    values: Any  # its own, or the slot of a plain one
    slot: int    # that keeps its fault


class OwnMemory(NamedTuple):
    """Memory of such an estimator."""

    memory: Any  # its own, or the slot of a plain one
    fault: bool  # it has failed


@dataclasses.dataclass(frozen=True)
class OwnParams:
    """Parameters of a user's estimator, used as those of a built-in one."""

    component: Component
    params: Any

    def values(self) -> OwnValues:
        """Return what compiled code takes, for one flight."""
        own = values(self.params)
        slot = slots.open_slot(self.component, own)
        return OwnValues(own if self.component.compiled else PlainValues(slot), slot)


def read(answer: Any) -> Estimate:
    """
    Return the estimate of a custom estimator, converted to the types of compiled code.

    Raises
    ------
    UnusableError
        If it is not an estimate, or a field of it has another type, shape or range.

    """
    if not isinstance(answer, Estimate):
        raise UnusableError(
            f'step returned {type(answer).__name__} instead of an Estimate: create it with '
            'mambo_estimation.estimate.of_state')
    out = slots.typed(answer, _LOST)
    if wrong := complaint(out):
        raise UnusableError(f'step answers {wrong}')
    return out


def _try(component: Component) -> None:
    """Refuse an estimator whose result for a vehicle at rest is unusable."""
    slots.tried(component, (*_HOVER, None), read)
    if component.compiled:
        _STEPS[component.params.Values] = component.step
        _INITIALS[component.params.Values] = component.initial


REGISTRY.trial = _try


def _call(memory, own, dt, gyro, accel, sonar, flow, quality, pressure):
    """Take a step of a plain estimator; return whether it failed, and the estimate."""
    out = slots.call(memory, own, (dt, gyro, accel, sonar, flow, quality, pressure, None), read)
    return (True, _LOST) if out is None else (False, out)


def _report(slot, memory, dt, gyro, accel, sonar, flow, quality, pressure):
    """Store the error of a compiled estimator."""
    slots.report(slot, memory, (dt, gyro, accel, sonar, flow, quality, pressure, None), read)


@jit
def _plain_initial(own: PlainValues) -> PlainMemory:
    """Start a plain estimator."""
    with objmode():
        slots.begin(own.slot)
    return PlainMemory(own.slot)


@jit
def _plain_step(memory, dt, gyro, accel, sonar, flow, quality, pressure, own, slot):
    """Take a step of a plain estimator; return whether it failed, memory and estimate."""
    with objmode(failed='boolean', estimate=_ESTIMATE):
        failed, estimate = _call(
            memory.slot, own.slot, dt, gyro, accel, sonar, flow, quality, pressure)
    return failed, memory, estimate


_STEPS: dict[type, Any] = {}  # of compiled ones from outside, by the type of their values
_INITIALS: dict[type, Any] = {}
_compiled = by_type(8, _STEPS)


@jit
def _compiled_step(memory, dt, gyro, accel, sonar, flow, quality, pressure, own, slot):
    """Take a step of a compiled estimator; return whether it failed, memory and estimate."""
    failed, after, estimate = False, memory, _LOST
    try:
        after, estimate = _compiled(
            memory, dt, gyro, accel, sonar, flow, quality, pressure, own)
    except Exception:
        failed = True
    if failed or not is_sound(estimate):
        failed = True
        with objmode():
            _report(slot, memory, dt, gyro, accel, sonar, flow, quality, pressure)
    return failed, after, estimate


_begin = by_type(0, {PlainValues: _plain_initial}, by_type(0, _INITIALS))
_take = by_type(8, {PlainValues: _plain_step}, _compiled_step)


@jit
def _own_initial(own: OwnValues) -> OwnMemory:
    """Return the memory of a user's estimator at start."""
    return OwnMemory(_begin(own.values), False)


@jit
def _own_step(memory, dt, gyro, accel, sonar, flow, quality, pressure, own):
    """Take a step of a custom estimator; after a fault the estimate is lost."""
    if memory.fault:
        return memory, _LOST
    failed, after, estimate = _take(
        memory.memory, dt, gyro, accel, sonar, flow, quality, pressure, own.values, own.slot)
    if failed:
        return OwnMemory(memory.memory, True), _LOST
    return OwnMemory(after, False), estimate


@jit_inside
def _ignore(memory, age, rho, q):
    """Return the memory of an estimator that uses no motion capture."""
    return memory


@jit_inside
def _nowhere(memory, estimate):
    """Return that an estimator knows no place in ``map``."""
    return None


@jit
def _no_memory(values):
    """Return no memory, where the true state takes the place of an estimate."""
    return None


_ALL = tuple(REGISTRY.built_in.values())
initial = by_type(0, {
    type(None): _no_memory, OwnValues: _own_initial, AidedValues: aided.initial} | {
    c.params.Values: c.initial for c in _ALL})
step = by_type(8, {OwnValues: _own_step, AidedValues: aided.step} | {
    c.params.Values: c.step for c in _ALL})
offer = by_type(0, {aided.AidedMemory: aided.offer}, _ignore)
located = by_type(0, {aided.AidedMemory: aided.located}, _nowhere)
