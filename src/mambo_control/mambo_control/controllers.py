"""
The registry of all controllers, and the guard around each of them.

A controller is a dataclass of parameters with ``initial`` and ``step``. A built-in controller is
one line of ``REGISTRY``; a user's controller is a file or an installed package. A user's
controller that raises an error, returns NaN or takes too long is not called again: the cascaded
controller replaces it, and the failsafe lands the vehicle.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from mambo_model import slots
from mambo_model.compiled import by_type, jit, jit_inside, objmode, typeof
from mambo_model.components import Component, Registry
from mambo_model.motion.flatness import from_flat_output, Reference
from mambo_model.motion.quaternion import IDENTITY
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import GROUND, LANDED
from mambo_model.slots import PlainMemory, PlainValues, UnusableError
from mambo_model.values import values
from mambo_model.vehicle.motor_mixer import limit_pwm
from mambo_model.vehicle.parameters import Vehicle, VehicleValues

from . import cascaded, support_package
from .command import Command, no_thrust
from .gains import CascadedParams, GainValues
from .literature import extended, flatness_drag, geometric, indi
from .literature.extended import ExtendedParams
from .literature.flatness_drag import FlatnessDragParams
from .literature.geometric import GeometricParams
from .literature.indi import IndiParams
from .safety import (
    LARGEST, REASON_CONTROLLER, REASON_NONE, REASON_REFERENCE, stop_reason, usable)
from .support_package import ToolboxControllerParams

REGISTRY = Registry(
    'controller', ('memory', 'state', 'reference', 'dt', 'gains', 'vehicle'), {
        'cascaded': (CascadedParams, cascaded),
        'toolbox': (ToolboxControllerParams, support_package),
        'extended': (ExtendedParams, extended),
        'flatness_drag': (FlatnessDragParams, flatness_drag),
        'geometric': (GeometricParams, geometric), 'indi': (IndiParams, indi)})

Memory = Any  # of any of them
Gains = Any   # the values of its parameters
Params = Any  # a dataclass with such values

_NAN3 = (math.nan, math.nan, math.nan)
_NOTHING = no_thrust(REASON_NONE, _NAN3, _NAN3)
_COMMAND = typeof(_NOTHING)


class OwnValues(NamedTuple):
    """Parameters of a user's controller, and what the guard and the failsafe need."""

    values: Any                # its own, or the slot of a plain one
    slot: int                  # that keeps its fault
    tilt_sine_squared: float   # -, limits of a flight, as of the cascaded controller
    height_min: float          # m
    height_max: float          # m
    backup: GainValues         # of the cascaded controller, which lands the vehicle


class OwnMemory(NamedTuple):
    """What such a controller remembers."""

    memory: Any                # its own, or the slot of a plain one
    fault: bool                # it has failed
    backup: cascaded.Memory    # of the controller in its place


@dataclasses.dataclass(frozen=True)
class OwnParams:
    """Parameters of a user's controller, used as those of a built-in one."""

    component: Component
    params: Any

    def values(self) -> OwnValues:
        """Return what compiled code takes, for one flight; limits are the user's if there are."""
        own, backup = values(self.params), CascadedParams()
        slot = slots.open_slot(self.component, own)
        limits = dataclasses.replace(backup, **{
            name: getattr(self.params, name) for name in ('tilt_limit', 'height_min', 'height_max')
            if hasattr(self.params, name)})
        return OwnValues(
            own if self.component.compiled else PlainValues(slot), slot,
            limits.tilt_sine_squared(), float(limits.height_min), float(limits.height_max),
            backup.values())


def read(answer: Any) -> Command:
    """
    Check the command of a user's controller and convert its numbers for compiled code.

    Raises
    ------
    UnusableError
        If it is not a command, or if its numbers are unusable.

    """
    if not isinstance(answer, Command):
        raise UnusableError(
            f'step answers {type(answer).__name__} where a Command belongs: make it by '
            'mambo_control.command.thrust_and_torque')
    out = slots.typed(answer, _NOTHING)
    if not 0 <= out.reason <= REASON_CONTROLLER:
        raise UnusableError(f'step answers reason = {out.reason}: wanted 0 to {REASON_CONTROLLER}')
    for name, numbers in (('thrust', (out.thrust,)), ('torque', out.torque), ('pwm', out.pwm)):
        if not all(abs(x) <= LARGEST for x in numbers):
            raise UnusableError(f'step answers {name} = {getattr(out, name)}')
    return out


def _try(component: Component) -> None:
    """Run one step at hover; raise ParameterError if the controller fails it."""
    vv, zero = Vehicle().values(), (0.0, 0.0, 0.0)
    at = (0.0, 0.0, -1.0)
    ref = from_flat_output(at, zero, zero, zero, zero, vv.mass, vv.inertia, vv.gravity)
    slots.tried(component, (State(at, zero, IDENTITY, zero), ref, 0.005, None, vv), read)
    if component.compiled:
        _STEPS[component.params.Values] = component.step
        _INITIALS[component.params.Values] = component.initial


REGISTRY.trial = _try


def _call(memory, own, state, ref, dt, vv):
    """Take a step of a plain controller; return whether it failed, and the command."""
    out = slots.call(memory, own, (state, ref, dt, None, vv), read)
    return (True, _NOTHING) if out is None else (False, out)


def _report(slot, memory, state, ref, dt, vv):
    """Keep the fault of a compiled controller."""
    slots.report(slot, memory, (state, ref, dt, None, vv), read)


@jit
def _plain_initial(own: PlainValues) -> PlainMemory:
    """Start a plain controller."""
    with objmode():
        slots.begin(own.slot)
    return PlainMemory(own.slot)


@jit
def _plain_step(memory, state, ref, dt, own, slot, vv):
    """Take a step of a plain controller; return whether it failed, memory and command."""
    with objmode(failed='boolean', command=_COMMAND):
        failed, command = _call(memory.slot, own.slot, state, ref, dt, vv)
    return failed, memory, command


@jit
def _sound(c: Command) -> bool:
    """Tell whether the numbers of a command can be used."""
    x = c.pwm
    known = 0 <= c.reason <= REASON_CONTROLLER
    return known and usable(c.torque) and abs(c.thrust) <= LARGEST and (
        abs(x[0]) <= LARGEST and abs(x[1]) <= LARGEST and abs(x[2]) <= LARGEST
        and abs(x[3]) <= LARGEST)


_STEPS: dict[type, Any] = {}  # of compiled ones from outside, by the type of their values
_INITIALS: dict[type, Any] = {}
_compiled = by_type(4, _STEPS)


@jit
def _compiled_step(memory, state, ref, dt, own, slot, vv):
    """Take a step of a compiled controller; return whether it failed, memory and command."""
    failed, after, command = False, memory, no_thrust(REASON_NONE, _NAN3, _NAN3)
    try:
        after, command = _compiled(memory, state, ref, dt, own, vv)
    except Exception:
        failed = True
    if failed or not _sound(command):
        failed = True
        with objmode():
            _report(slot, memory, state, ref, dt, vv)
    return failed, after, command


_begin = by_type(0, {PlainValues: _plain_initial}, by_type(0, _INITIALS))
_take = by_type(4, {PlainValues: _plain_step}, _compiled_step)


@jit
def _own_initial(gains: OwnValues) -> OwnMemory:
    """Return the memory of a user's controller at start."""
    return OwnMemory(_begin(gains.values), False, cascaded.initial(gains.backup))


@jit
def _own_step(
    memory: OwnMemory, state: State, ref: Reference, dt: float, gains: OwnValues,
    vv: VehicleValues,
) -> tuple[OwnMemory, Command]:
    """Take a step of a user's controller, or of the one in its place."""
    if not memory.fault:
        failed, after, c = _take(memory.memory, state, ref, dt, gains.values, gains.slot, vv)
        if not failed:
            x = c.pwm
            pwm = (limit_pwm(x[0], vv), limit_pwm(x[1], vv), limit_pwm(x[2], vv),
                   limit_pwm(x[3], vv))
            return OwnMemory(after, False, memory.backup), Command(pwm, *c[1:])
    backup, c = cascaded.step(memory.backup, state, ref, dt, gains.backup, vv)
    return OwnMemory(memory.memory, True, backup), c


@jit
def _own_stopped(memory: OwnMemory, reason: int) -> Command:
    """Return the command that stops the motors."""
    return no_thrust(reason, _NAN3, _NAN3)


@jit
def _own_is_faulty(memory: OwnMemory) -> bool:
    """Tell whether a user's controller has failed."""
    return memory.fault


@jit
def _is_sound(memory: Memory) -> bool:
    """Return False: a built-in controller does not fail."""
    return False


_ALL = tuple(REGISTRY.built_in.values())
initial = by_type(
    0, {OwnValues: _own_initial} | {c.params.Values: c.initial for c in _ALL})
stopped = by_type(0, {OwnMemory: _own_stopped} | {c.more.Memory: c.more.stopped for c in _ALL})
_step = by_type(4, {OwnValues: _own_step} | {c.params.Values: c.step for c in _ALL})
is_faulty = by_type(0, {OwnMemory: _own_is_faulty}, _is_sound)


@jit_inside
def answer(
    memory: Memory, state: State, ref: Reference, phase: int, dt: float, gains: Gains,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate with motor commands: the guard of every controller.

    On the ground before take-off and after landing the motors stand still and the controller
    starts anew. Inputs that cannot be used (not finite, absurdly large, no unit quaternion,
    an unknown phase, a reference without a thrust direction) and, in flight, tilt or height
    beyond the limits stop the motors with ``shutdown``; the memory stays as it is. A shutdown
    is not remembered here but by :mod:`failsafe`.

    Parameters
    ----------
    memory
        Result of the previous call; :func:`initial` at start.
    state
        Estimate, inertial NED and body FRD.
    ref
        Reference for the time of the estimate.
    phase
        Of the flight, 0 GROUND to 4 LANDED of mambo_model.motion.trajectory.
    dt : s
        Time to the next call, the control period.
    gains
        Of the controller; their type says which one it is.
    vv
        Believed vehicle.

    Returns
    -------
    memory
        To be passed to the next call.
    command
        Valid for one period.

    Raises
    ------
    ValueError
        If ``dt`` is not positive and finite.

    """
    if not 0.0 < dt < math.inf:
        raise ValueError('dt of the controller must be positive and finite, in seconds')
    reason = stop_reason(state, ref, phase, gains)
    if reason != REASON_NONE:
        return memory, stopped(memory, reason)
    if phase == GROUND or phase == LANDED:
        memory = initial(gains)
        return memory, stopped(memory, REASON_NONE)
    after, command = _step(memory, state, ref, dt, gains, vv)
    if not (usable(command.torque) and math.isfinite(command.thrust)):
        return memory, stopped(memory, REASON_REFERENCE)
    return after, command
