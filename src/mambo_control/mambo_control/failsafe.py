"""
The failsafe of the controller: if estimate or reference is lost, it holds, lands and stops.

There is one step per control period. For any input, each motor gets 0 or a PWM within its limits.
Missing inputs are NaN. The vehicle is in one of five stages:

================  =============================================  ================================
stage             when                                           what the control law gets
================  =============================================  ================================
FLYING            estimate and reference are good                both of them
HOLDING           either is lost, not longer than ``hold``       the last reference; a prediction
LANDING           lost for longer, attitude and height known,    a descent of its own
                  or the law cannot follow its reference, or a
                  user's controller has failed
DESCENDING_BLIND  attitude or height lost for longer             its own descent, a prediction, a
                                                                 vehicle believed to be lighter
STOPPED           touched down; a limit exceeded; a crash; lost  nothing: the motors stand still
                  for longer before take-off or after landing;
                  not aligned at take-off; at rest on the floor
                  while the reference climbs
================  =============================================  ================================

HOLDING can return to FLYING. A landing is final: a reference that returns is not followed, because
it may lead anywhere by then. If attitude and height return, DESCENDING_BLIND becomes LANDING.
STOPPED lasts until the controller is started again.

**Prediction.** The believed vehicle (3.3) is simulated from the last state with the last PWM.
Attitude, height and horizontal motion are taken from the estimate as long as it knows them. Height
and horizontal motion are known while their published variances are within limits; an estimator
that publishes no variances (zeros) is trusted. An estimate in flight that stays the same to
the bit is old if it turns and moves, and if it turns at all while the reference goes ``AWAY``; so
are position and velocity that stay the same, if it turns and they move, or the reference goes
``FAR``, and a position that does while its velocity adds up to ``FAR``. After ``STUCK`` the
prediction takes the place of what is old; after ``hold`` it is lost.
Position and velocity return to a blind descent when they have been new for ``hold``.

**On the floor.** An estimator that knows that the vehicle is at rest repeats position, velocity 0
and attitude, too, but its variances go on. If the reference goes ``FAR`` from such an estimate
on the floor, the vehicle has not followed it: the motors stop, with a reason of its own. An
estimator that takes a vehicle in the air for one at rest, as with an accelerometer that has been
stuck since before the alignment, looks the same from here.

**Descent.** From the initial position, velocity and yaw, the velocity blends to ``descent_speed``
straight down within ``deceleration``, four times continuously differentiable, and the reference
continues below the floor. The descent ends when the vehicle near the floor has stopped sinking, or
when the reference is ``depth`` below the floor.

**Blind.** Nothing limits the speed of an open-loop descent: (3.13) has no drag along the thrust,
so there is no terminal speed, and an error of 1 % in thrust or mass is 0.1 m/s^2. Two measures
help. First, the mass is estimated in flight as lift over gravity minus vertical acceleration, both
averaged over ``SHOWN_TIME`` above ``near_floor``; until then it is the believed mass. Second, the
vehicle is assumed to be lighter than that by the fraction ``thrust_deficit`` d, so the true one
sinks faster than the prediction by d g t and reaches the floor first. Nothing shows that, so its
motors turn until the prediction is down, too. From rest at height h it touches down at
sqrt(v^2 + 2 d g (h + v T/2)), with v the ``descent_speed`` and T the time to reach it: 0.95 m/s
from 1.5 m. With more than 1 + d times the assumed lift a vehicle would not come down; with less
lift it comes down faster. All that holds if the last attitude was right. After a gyro that was
wild for 0.15 s a Mambo fell with 3.8 m/s, and slid over the floor with its motors on for 3.4 s.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion import trajectory
from mambo_model.motion.flatness import from_flat_output_yaw, Reference
from mambo_model.motion.quaternion import IDENTITY, is_unit, rotate, rotate_inverse, to_euler
from mambo_model.motion.rigid_body import LIFTED, rk4_step, State
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type
from mambo_model.vehicle.motor_mixer import mix, thrust_from_pwm
from mambo_model.vehicle.parameters import VehicleValues

from . import controllers
from .command import Command
from .safety import (
    LARGEST, REASON_ALIGNMENT, REASON_CONTROLLER, REASON_CRASH, REASON_ESTIMATE,
    REASON_GROUNDED, REASON_NONE, REASON_REFERENCE, usable, usable_reference)

FLYING, HOLDING, LANDING, DESCENDING_BLIND, STOPPED = range(5)
STAGES = ('flying', 'holding', 'landing', 'descending blind', 'motors shut down')
REASONS = (
    '', 'tilt limit', 'height limit', 'estimate lost or unusable',
    'reference lost or unusable',
    'crash: attitude, body rate or velocity far from what is asked for',
    'estimator not aligned: let the vehicle rest, start again', 'controller failed',
    'stayed on the floor below its reference, by its estimate: thrust too small; check mass, '
    'motor map and controller')

SHORTEST_BLEND = 0.5  # s, shortest time in which a descent reaches its speed
SETTLING = 0.5  # s after that, before a vehicle that does not sink counts as being on the floor
TOUCHED = 0.1  # s for which it must not sink
STUCK = 0.02  # s for which an estimate that stays the same is used: one of 50 Hz does (judgement)
STANDING = 1e-6  # m/s, beyond which a position changes in a step of 5 ms, despite rounding
TURNING = 1e-3  # rad/s, a body rate that no vehicle has on the floor, where sensors without noise
#                 repeat the same, and an estimate may stand at some cm/s
QUIET = 1e-6  # rad/s, which a gyro with noise exceeds at rest, too; one without reads 0 there,
#               also under a vehicle that is too heavy to follow its reference
AWAY = 1e-4  # m that a reference moves while an estimate beyond QUIET stays the same (judgement)
FAR = 0.3  # m, while its position and velocity do: those of one that rests on the floor do until
#            the vehicle takes off, of 1.3 times the believed mass at 0.22 m at the latest
SHOWN_TIME = 2.0  # s
MOST_WRONG = (0.5, 1.5)  # mass shown over mass believed
LEAST_THRUST = 0.1  # m/s^2 along the attitude of a reference that can be followed
Covariance = tuple[float, ...]
_ZERO: Vec3 = (0.0, 0.0, 0.0)
_NAN3: Vec3 = (math.nan, math.nan, math.nan)
_NAN4 = (math.nan, math.nan, math.nan, math.nan)


class Spread(NamedTuple):
    """Variances of an estimate, 0 where its estimator publishes none."""

    position: float  # m^2, horizontal, the larger one
    height: float  # m^2
    velocity: float  # m^2/s^2, along body x and y, the larger one
    tilt: float = 0.0  # rad^2, about horizontal axes, the larger one
    rate: float = 0.0  # rad^2/s^2, of the body rate, the largest one


@jit
def spread_of(pose: Covariance, twist: Covariance) -> Spread:
    """Return the variances in the (6, 6) covariances, row by row, of an estimate's odometry."""
    return Spread(
        max(pose[0], pose[7]), pose[14], max(twist[0], twist[7]),
        max(pose[21], pose[28]), max(twist[21], twist[28], twist[35]))


EXACT = Spread(0.0, 0.0, 0.0)
NO_STATE = State(_NAN3, _NAN3, _NAN4, _NAN3)  # in place of an estimate that has not come
NO_REFERENCE = Reference(
    _NAN3, _NAN3, _NAN3, _NAN3, _NAN3, _NAN4, _NAN3, _NAN3, math.nan, _NAN3)
_REST = State(_ZERO, _ZERO, IDENTITY, _ZERO)
_POINT = Reference(_ZERO, _ZERO, _ZERO, _ZERO, _ZERO, IDENTITY, _ZERO, _ZERO, 0.0, _ZERO)


@dataclass(frozen=True)
class FailsafeParams(Parameters):
    """Tolerated duration of a loss, the landing after it, and the limits that detect a crash."""

    hold: float = quantity(
        0.1, 's', 0.0, 10.0, 'a loss that is not longer is bridged (judgement)')
    descent_speed: float = quantity(0.5, 'm/s', 0.1, 3.0, 'of a landing (judgement)')
    deceleration: float = quantity(
        2.0, 'm/s^2', 0.1, 5.0, 'largest one on the way to the descent speed (judgement)')
    near_floor: float = quantity(
        0.5, 'm', 0.0, 1000.0, 'below this height a vehicle that does not sink has touched '
        'down; sonar and flow are blind below 0.43 m (judgement)')
    depth: float = quantity(
        0.5, 'm', 0.0, 1000.0, 'under the floor where a landing ends anyway (judgement)')
    thrust_deficit: float = quantity(
        0.02, '-', 0.0, 0.5, 'share of the weight not lifted while descending blind (judgement)')
    position_std: float = quantity(
        1000.0, 'm', 0.001, 1e6, 'horizontal position is lost beyond: odometry always drifts')
    height_std: float = quantity(1.0, 'm', 0.001, 1e6, 'height is lost beyond (judgement)')
    velocity_std: float = quantity(
        1.0, 'm/s', 0.001, 1e6, 'horizontal motion is lost beyond (judgement)')
    tilt_std: float = quantity(
        0.5, 'rad', 0.001, 10.0, 'attitude is lost beyond (judgement)')
    rate_std: float = quantity(
        1.0, 'rad/s', 0.001, 1e6,
        'attitude is lost beyond, as after 50 ms without a gyro (judgement)')
    rate_limit: float = quantity(
        25.0, 'rad/s', 1.0, 1e6, 'crash: tumbling; the gyroscope ends at 35 (judgement)')
    attitude_error_limit: float = quantity(
        1.5, 'rad', 0.1, 4.0, 'crash: not as demanded; above pi: never (judgement)')
    velocity_error_limit: float = quantity(
        6.0, 'm/s', 0.1, 1e6, 'crash: velocity far from what is asked for; the firmware '
        'for minidrones allows as much between estimate and optical flow')
    crash_time: float = quantity(
        0.25, 's', 0.0, 10.0, 'for which any of these limits must be exceeded (judgement)')
    takeoff_tilt_std: float = quantity(
        0.08, 'rad', 0.001, 10.0,
        'no take-off beyond: an alignment at rest leaves 0.07 at most, one that failed 0.1')


FailsafeValues = values_type(FailsafeParams)


class Descent(NamedTuple):
    """Initial state of a descent, inertial NED, and its progress."""

    rho: Vec3  # m
    v: Vec3  # m/s
    yaw: float  # rad
    time: float  # s since its begin
    still: float  # s for which the vehicle has not sunk


class Shown(NamedTuple):
    """Averages above ``near_floor``, starting from zero, that give the mass of the vehicle."""

    lift: float  # N, vertical part of the commanded thrust
    pull: float  # m/s^2, gravity minus vertical acceleration


class Watch(NamedTuple):
    """How long an estimate in flight has stayed the same to the bit."""

    state: State  # the last one
    held: float  # s for which its position has
    gone: Vec3  # m, what its velocity has added up to in that time, inertial NED
    still: float  # s for which its velocity has, too
    stuck: float  # s for which all of it has
    asked: Vec3  # m, where the reference was when position or velocity last changed, inertial NED
    new: float  # s since it was old
    spread: Spread  # the last variances
    rests: float  # s for which position, velocity 0 and attitude have, but not the variances


class Memory(NamedTuple):
    """Memory of the failsafe from step to step."""

    control: controllers.Memory  # of the control law
    stage: int  # FLYING ... STOPPED
    reason: int  # one of safety.REASON_*: why the stage is not FLYING
    estimate_lost: float  # s
    reference_lost: float  # s
    crash: float  # s for which a limit of a crash has been exceeded
    state: State  # the last one the law got
    ref: Reference  # the last good one
    phase: int  # of the flight plan, the last good one
    shown: Shown  # what the vehicle weighs
    descent: Descent  # the last one
    command: Command  # the last one
    watch: Watch  # whether the estimate is a new one


class Known(NamedTuple):
    """Which parts of an estimate can be used."""

    attitude: bool  # and body rate
    vertical: bool  # height and vertical velocity
    horizontal: bool  # position and velocity


def initial(params: controllers.Params) -> Memory:
    """Return the memory at start of the controller that has such parameters."""
    return begin(params.values())


def begin(gains: controllers.Gains) -> Memory:
    """Return the memory at start of the controller that has such gains."""
    control = controllers.initial(gains)
    return Memory(
        control, FLYING, REASON_NONE, 0.0, 0.0, 0.0, _REST, _POINT, trajectory.GROUND,
        Shown(0.0, 0.0), Descent(_ZERO, _ZERO, 0.0, 0.0, 0.0),
        controllers.stopped(control, REASON_NONE),
        Watch(_REST, 0.0, _ZERO, 0.0, 0.0, _ZERO, math.inf, EXACT, 0.0))


def describe(stage: int, reason: int) -> str:
    """Return a stage and its reason in words."""
    return f'{STAGES[stage]}: {REASONS[reason]}' if reason else STAGES[stage]


@jit
def known(state: State, spread: Spread, aloft: bool, p: FailsafeValues) -> Known:
    """Tell what of an estimate can be used; variances count in flight only."""
    attitude = is_unit(state.q) and usable(state.omega)
    if aloft:
        attitude = (attitude and spread.tilt <= p.tilt_std * p.tilt_std
                    and spread.rate <= p.rate_std * p.rate_std)
    moving = attitude and usable(state.nu)
    vertical = moving and abs(state.rho[2]) <= LARGEST
    horizontal = moving and abs(state.rho[0]) <= LARGEST and abs(state.rho[1]) <= LARGEST
    if aloft:
        vertical = vertical and spread.height <= p.height_std * p.height_std
        horizontal = (
            horizontal and spread.position <= p.position_std * p.position_std
            and spread.velocity <= p.velocity_std * p.velocity_std)
    return Known(attitude, vertical, horizontal)


@jit
def followable(ref: Reference, phase: int, gravity: float) -> bool:
    """Tell whether a reference of a phase can be followed: numbers, phase, a thrust (3.14b)."""
    if not usable_reference(ref) or phase < trajectory.GROUND or phase > trajectory.LANDED:
        return False
    thrust = sub((0.0, 0.0, gravity), ref.a)  # m/s^2
    return dot(rotate(ref.q, (0.0, 0.0, 1.0)), thrust) > LEAST_THRUST


@jit
def predicted(memory: Memory, dt: float, vv: VehicleValues) -> State:
    """Return the last state dt s later by (3.3); with all motors stopped it stays as it is."""
    x = memory.command.pwm
    f, tau = mix((thrust_from_pwm(x[0], vv), thrust_from_pwm(x[1], vv),
                  thrust_from_pwm(x[2], vv), thrust_from_pwm(x[3], vv)), vv)
    if f == 0.0:
        return memory.state
    return rk4_step(memory.state, f, tau, dt, vv)


@jit
def _observed(memory: Memory, state: State, thrust: float, dt: float, p: FailsafeValues,
              gravity: float) -> Shown:
    """Return what one more step has shown of the weight, with a thrust in N."""
    if -state.rho[2] <= p.near_floor:
        return memory.shown
    lift, pull = memory.shown
    before, now = rotate(memory.state.q, memory.state.nu)[2], rotate(state.q, state.nu)[2]
    share = dt / (SHOWN_TIME + dt)
    upright = rotate(state.q, (0.0, 0.0, 1.0))[2]
    return Shown(
        lift + share * (thrust * upright - lift),
        pull + share * (gravity - (now - before) / dt - pull))


@jit
def lighter(shown: Shown, p: FailsafeValues, vv: VehicleValues) -> VehicleValues:
    """Return the vehicle that descends blind: its mass as shown so far, less the deficit."""
    rest = max(0.0, vv.gravity - shown.pull)  # not shown yet: as believed
    mass = (shown.lift + rest * vv.mass) / (shown.pull + rest)
    mass = min(max(mass, MOST_WRONG[0] * vv.mass), MOST_WRONG[1] * vv.mass)
    return VehicleValues((1.0 - p.thrust_deficit) * mass, *vv[1:])  # mass is its first field


@jit
def completed(state: State, have: Known, ahead: State) -> State:
    """Return the estimate with what is not known of it taken from a prediction."""
    if not have.attitude:
        return ahead
    rho, v = ahead.rho, rotate(ahead.q, ahead.nu)
    seen = rotate(state.q, state.nu)
    if have.horizontal:
        rho, v = (state.rho[0], state.rho[1], rho[2]), (seen[0], seen[1], v[2])
    if have.vertical:
        rho, v = (rho[0], rho[1], state.rho[2]), (v[0], v[1], seen[2])
    return State(rho, rotate_inverse(state.q, v), state.q, state.omega)


@jit
def blend_duration(d: Descent, p: FailsafeValues) -> float:
    """Return the time in s in which a descent takes up its speed."""
    change = norm(sub((0.0, 0.0, p.descent_speed), d.v))
    return max(SHORTEST_BLEND, trajectory.BLEND_SPEED * change / p.deceleration)


@jit
def descent_reference(d: Descent, p: FailsafeValues, vv: VehicleValues) -> Reference:
    """Return the feasible reference (3.14) of a descent at its time, yaw kept."""
    T = blend_duration(d, p)
    x, h = d.time / T, 1.0 / T
    b = trajectory.blend(x)
    change = sub((0.0, 0.0, p.descent_speed), d.v)
    return from_flat_output_yaw(
        add(d.rho, add(scale(d.time, d.v), scale(T * trajectory.blend_integral(x), change))),
        add(d.v, scale(b[0], change)), scale(h * b[1], change), scale(h * h * b[2], change),
        scale(h * h * h * b[3], change), d.yaw, 0.0, 0.0, vv.mass, vv.inertia, vv.gravity)


@jit
def _begin(state: State) -> Descent:
    """Return a descent that begins at a state."""
    return Descent(state.rho, rotate(state.q, state.nu), to_euler(state.q)[2], 0.0, 0.0)


@jit
def _touched(state: State, d: Descent, ref: Reference, blind: bool, dt: float,
             p: FailsafeValues) -> tuple[bool, float]:
    """Return whether a descent is over, and for how long in s the vehicle has not sunk."""
    if blind:
        return state.rho[2] >= 0.0, 0.0
    sinking = rotate(state.q, state.nu)[2] >= 0.5 * p.descent_speed
    still = 0.0
    if (not sinking and -state.rho[2] <= p.near_floor
            and d.time >= blend_duration(d, p) + SETTLING):
        still = d.still + dt
    return still > TOUCHED or ref.rho[2] > p.depth, still


@jit
def _crashing(state: State, command: Command, p: FailsafeValues) -> bool:
    """Tell whether a limit of a crash is exceeded; the NaN of a law that rests exceeds none."""
    return (norm(state.omega) > p.rate_limit or command.attitude_error > p.attitude_error_limit
            or norm(command.velocity_error) > p.velocity_error_limit)


@jit
def _next_stage(
    memory: Memory, have: Known, estimate_lost: float, reference_lost: float, aloft: bool,
    hold: float,
) -> tuple[int, int]:
    """Return the stage and its reason by what is lost, for how long in s, borne for hold s."""
    landable = have.attitude and have.vertical
    if memory.stage == LANDING or memory.stage == DESCENDING_BLIND:
        if landable:
            return LANDING, memory.reason
        if estimate_lost > hold:
            return DESCENDING_BLIND, REASON_ESTIMATE
        return memory.stage, memory.reason
    if estimate_lost > hold or reference_lost > hold:
        reason = REASON_ESTIMATE if estimate_lost > hold else REASON_REFERENCE
        if not aloft:
            return STOPPED, reason
        return LANDING if landable or reason == REASON_REFERENCE else DESCENDING_BLIND, reason
    if estimate_lost > 0.0:
        return HOLDING, REASON_ESTIMATE
    if reference_lost > 0.0:
        return HOLDING, REASON_REFERENCE
    return FLYING, REASON_NONE


@jit
def _with_reason(c: Command, reason: int) -> Command:
    """Return a command that tells why the vehicle does not follow its plan."""
    return Command(
        c.pwm, c.shutdown, reason, c.motor_thrust, c.saturated, c.thrust, c.torque,
        c.position_error, c.velocity_error, c.integral, c.integral_rate, c.virtual_input,
        c.attitude_desired, c.attitude_error, c.angular_velocity_error)


@jit
def _stop(memory: Memory, reason: int) -> tuple[Memory, Command]:
    """Stop the motors for good."""
    command = controllers.stopped(memory.control, reason)
    return Memory(
        memory.control, STOPPED, reason, memory.estimate_lost, memory.reference_lost,
        memory.crash, memory.state, memory.ref, memory.phase, memory.shown, memory.descent,
        command, memory.watch), command


@jit
def _descend(
    memory: Memory, stage: int, reason: int, state: State, dt: float,
    gains: controllers.Gains, p: FailsafeValues, vv: VehicleValues,
) -> tuple[Memory, Command]:
    """Answer in LANDING or DESCENDING_BLIND, with a state that is complete."""
    d = memory.descent if stage == memory.stage else _begin(state)
    blind = stage == DESCENDING_BLIND
    vehicle = lighter(memory.shown, p, vv) if blind else vv
    ref = descent_reference(d, p, vehicle)
    over, still = _touched(state, d, ref, blind, dt, p)
    if over:
        return _stop(memory, reason)
    control, command = controllers.answer(
        memory.control, state, ref, trajectory.LANDING, dt, gains, vehicle)
    if command.reason != REASON_NONE:
        return _stop(memory, command.reason)
    crash = memory.crash + dt if not blind and _crashing(state, command, p) else 0.0
    if crash > p.crash_time:
        return _stop(memory, REASON_CRASH)
    command = _with_reason(command, reason)
    return Memory(
        control, stage, reason, memory.estimate_lost, memory.reference_lost, crash, state,
        memory.ref, memory.phase, memory.shown, Descent(d.rho, d.v, d.yaw, d.time + dt, still),
        command, memory.watch), command


@jit
def _with_control(m: Memory, control: controllers.Memory) -> Memory:
    """Return the memory with another one of the control law."""
    return Memory(
        control, m.stage, m.reason, m.estimate_lost, m.reference_lost, m.crash, m.state, m.ref,
        m.phase, m.shown, m.descent, m.command, m.watch)


@jit_inside
def _follow(
    memory: Memory, stage: int, reason: int, state: State, dt: float,
    gains: controllers.Gains, p: FailsafeValues, vv: VehicleValues,
) -> tuple[Memory, Command]:
    """Answer in FLYING or HOLDING, with a state that is complete and the last reference."""
    control, command = controllers.answer(
        memory.control, state, memory.ref, memory.phase, dt, gains, vv)
    if controllers.is_faulty(control):
        return _descend(
            _with_control(memory, control), LANDING, REASON_CONTROLLER, state, dt, gains, p, vv)
    if command.reason == REASON_REFERENCE:
        return _descend(memory, LANDING, REASON_REFERENCE, state, dt, gains, p, vv)
    if command.reason != REASON_NONE:
        return _stop(memory, command.reason)
    crash = memory.crash + dt if _crashing(state, command, p) else 0.0
    if crash > p.crash_time:
        return _stop(memory, REASON_CRASH)
    shown = memory.shown
    if stage == FLYING:
        shown = _observed(memory, state, command.thrust, dt, p, vv.gravity)
    command = _with_reason(command, reason)
    return Memory(
        control, stage, reason, memory.estimate_lost, memory.reference_lost, crash, state,
        memory.ref, memory.phase, shown, memory.descent, command, memory.watch), command


@jit
def _watched(
    w: Watch, state: State, spread: Spread, rho: Vec3, aloft: bool, dt: float,
) -> tuple[Watch, float, float]:
    """
    Return the watch after one more estimate, whose reference is at rho, and how old it is.

    That is for how long attitude, and position and velocity, have been old, s; 0: they are not.
    """
    same = aloft and w.state.rho == state.rho
    held = w.held + dt if same else 0.0
    gone = add(w.gone, scale(dt, rotate(state.q, state.nu))) if same else _ZERO
    same = same and w.state.nu == state.nu
    still = w.still + dt if same else 0.0
    asked = w.asked if same else rho
    same = same and w.state.q == state.q
    at_rest = same and w.spread != spread and norm(state.nu) <= STANDING
    rests = w.rests + dt if at_rest else 0.0
    stuck = w.stuck + dt if same and w.state.omega == state.omega else 0.0
    rate, away, limit = norm(state.omega), norm(sub(rho, asked)), STUCK + 0.5 * dt
    moves = rate > TURNING and norm(state.nu) > STANDING
    attitude = stuck if stuck > limit and (moves or rate > QUIET and away > AWAY) else 0.0
    motion = still if still > limit and (moves or rate > QUIET and away > FAR) else 0.0
    old = max(attitude, motion, 0.0 if norm(gone) <= FAR else held)
    new = 0.0 if old > 0.0 else w.new + dt
    return Watch(state, held, gone, still, stuck, asked, new, spread, rests), attitude, old


@jit_inside
def step(
    memory: Memory, state: State, spread: Spread, ref: Reference, phase: int, dt: float,
    gains: controllers.Gains, p: FailsafeValues, vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate and one reference, any of which may be missing or unusable.

    Parameters
    ----------
    memory
        Result of the previous call; :func:`initial` at start.
    state
        Estimate; ``NO_STATE`` where it is missing.
    spread
        Its variances.
    ref
        Reference for the time of the estimate; ``NO_REFERENCE`` where it is missing.
    phase
        Of the flight, 0 GROUND to 4 LANDED of mambo_model.motion.trajectory.
    dt : s
        Time to the next call, the control period.
    gains
        Of the control law; their type says which one it is.
    p
        From :meth:`FailsafeParams.values`.
    vv
        Believed vehicle.

    Returns
    -------
    memory
        To be passed to the next call; ``stage`` and ``reason`` say how it flies.
    command
        Valid for one period. Its reason without a shutdown says why the vehicle holds or lands.

    Raises
    ------
    ValueError
        If ``dt`` is not positive and finite.

    """
    if not 0.0 < dt < math.inf:
        raise ValueError('dt of the controller must be positive and finite, in seconds')
    if memory.stage == STOPPED:
        return _stop(memory, memory.reason)
    followed = followable(ref, phase, vv.gravity)
    if not followed:
        ref, phase = memory.ref, memory.phase
    if (phase == trajectory.TAKEOFF and memory.phase == trajectory.GROUND
            and spread.tilt > p.takeoff_tilt_std * p.takeoff_tilt_std):
        return _stop(memory, REASON_ALIGNMENT)
    aloft = trajectory.in_flight(phase) or memory.stage > HOLDING
    have = known(state, spread, aloft, p)
    hold = p.hold + 0.5 * dt  # whole steps, whatever their sum is rounded to
    complete = have.attitude and have.vertical and have.horizontal
    estimate_lost = 0.0 if complete else memory.estimate_lost + dt
    watch, old_attitude, old = _watched(memory.watch, state, spread, ref.rho, aloft, dt)
    if (memory.stage <= HOLDING and old > hold and watch.rests > hold
            and -state.rho[2] < LIFTED and ref.rho[2] < state.rho[2]):
        return _stop(memory, REASON_GROUNDED)
    if old > 0.0 or memory.stage == DESCENDING_BLIND and watch.new <= hold:
        have, complete = Known(have.attitude and old_attitude == 0.0, False, False), False
        estimate_lost = max(estimate_lost, old if old > hold else 0.0)
    reference_lost = 0.0 if followed else memory.reference_lost + dt
    stage, reason = _next_stage(memory, have, estimate_lost, reference_lost, aloft, hold)
    if not complete:
        blind = memory.stage == DESCENDING_BLIND
        vehicle = lighter(memory.shown, p, vv) if blind else vv
        state = completed(state, have, predicted(memory, dt, vehicle))
    memory = Memory(
        memory.control, memory.stage, memory.reason, estimate_lost, reference_lost, memory.crash,
        memory.state, ref, phase, memory.shown, memory.descent, memory.command, watch)
    if stage == STOPPED:
        return _stop(memory, reason)
    if stage == LANDING or stage == DESCENDING_BLIND:
        return _descend(memory, stage, reason, state, dt, gains, p, vv)
    return _follow(memory, stage, reason, state, dt, gains, p, vv)
