"""Conditions that stop the motors: unusable inputs, and limits of tilt and height."""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import is_unit, Quat
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import GROUND, LANDED
from mambo_model.motion.vector import Vec3

from .gains import GainValues

# MotorPwm.msg
REASON_NONE = 0
REASON_ATTITUDE = 1
REASON_ALTITUDE = 2
REASON_ESTIMATE = 3
REASON_REFERENCE = 4
REASON_CRASH = 5
REASON_ALIGNMENT = 6
REASON_CONTROLLER = 7
REASON_GROUNDED = 8

LARGEST = 1e6  # of any component in SI units; keeps every product of the controller finite


@jit
def usable(v: Vec3) -> bool:
    """Tell whether every component of a (3,) is a number of sensible size; NaN is not."""
    return abs(v[0]) <= LARGEST and abs(v[1]) <= LARGEST and abs(v[2]) <= LARGEST


@jit
def usable_state(state: State) -> bool:
    """Tell whether a rigid_body.State can be controlled."""
    return (usable(state.rho) and usable(state.nu) and is_unit(state.q)
            and usable(state.omega))


@jit
def usable_reference(ref: Reference) -> bool:
    """Tell whether every field of a flatness.Reference is a number of sensible size."""
    return (usable(ref.rho) and usable(ref.v) and usable(ref.a) and usable(ref.j)
            and usable(ref.s) and is_unit(ref.q) and usable(ref.omega)
            and usable(ref.omega_dot) and abs(ref.f) <= LARGEST and usable(ref.tau))


@jit
def beyond_tilt(q: Quat, tilt_sine_squared: float) -> bool:
    """
    Tell whether the body z axis is tilted by more than the limit.

    Parameters
    ----------
    q : (4,)
        Body to inertial.
    tilt_sine_squared : -
        sin^2 of half the limit: 1 (180 deg) is never exceeded, in rounded arithmetic either.

    """
    horizontal = q[1] * q[1] + q[2] * q[2]
    return horizontal > tilt_sine_squared * (horizontal + (q[0] * q[0] + q[3] * q[3]))


@jit
def stop_reason(state: State, ref: Reference, phase: int, gains: GainValues) -> int:
    """
    Return why the motors must be shut down, or REASON_NONE.

    Unusable inputs count in every phase, the limits of tilt and height in flight only.

    Parameters
    ----------
    state, ref
        Estimate and reference.
    phase
        Of the flight; one that is not known makes the reference unusable.
    gains
        Limits of tilt and height.

    """
    if not usable_state(state):
        return REASON_ESTIMATE
    if not usable_reference(ref) or phase < GROUND or phase > LANDED:
        return REASON_REFERENCE
    if phase == GROUND or phase == LANDED:
        return REASON_NONE
    if beyond_tilt(state.q, gains.tilt_sine_squared):
        return REASON_ATTITUDE
    height = -state.rho[2]
    if height < gains.height_min or height > gains.height_max:
        return REASON_ALTITUDE
    return REASON_NONE
