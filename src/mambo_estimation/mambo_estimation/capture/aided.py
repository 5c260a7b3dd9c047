"""
The joint filter with motion capture: poses correct it while the cameras see the vehicle.

A pose is used at the time of its exposure (:mod:`.pose`). What it changes of position and yaw is
where ``odom`` stands in ``map`` (:mod:`.frames`): the pose in ``odom`` goes on without a jump.

A pose that does not fit (a flip of the body, another body) is refused by its statistics. Refused
poses, and the first ones, are only believed where they all say the same for a time: that
``map`` is turned and shifted by one yaw and one shift against what the filter believes. Then the
filter takes these, at first any, later only what is within `recovery_distance` and
`recovery_turn`; what is further off is refused for ever, and said so.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import normalise, Quat
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import hypot, norm, sub, Vec3
import numpy as np

from . import pose
from ..blocks import Vec2
from ..estimate import Estimate
from ..joint import filter as joint
from ..joint.answer import pose_covariance, state_of, twist_covariance
from ..joint.flow import Past
from ..joint.state import Array, ATTITUDE, forget, inject, Nominal, POSITION, SIZE
from ..joint.vibration import left
from .frames import (
    about_z, Anchor, composed, in_odom, moved, SAME, take_up, turn_covariance, wrapped)
from .pose_parameters import AidedValues, PoseValues

GOOD, NEVER, MISSING, POSITION_OFF, ATTITUDE_OFF, TOO_OLD, NOT_FINITE = range(7)


class Sight(NamedTuple):
    """A pose that the next step uses."""

    age: float  # s, since its stamp, at the time of that step; NaN: none
    rho: Vec3   # (3,) m, map, axes as of NED
    q: Quat     # (4,) w x y z, body to map


class Candidate(NamedTuple):
    """What refused poses agree on."""

    time: float    # s, for how long they have; negative: there is none
    anchor: Anchor  # by which map is turned and shifted against the filter's belief
    first: Anchor   # the same by the first of them


class Capture(NamedTuple):
    """What is remembered of the motion capture."""

    located: bool     # some poses have been used
    anchor: Anchor    # odom in map
    age: float        # s, since a pose was used
    silence: float    # s, since a pose came
    used: int         # [-] poses since start
    refused: int      # [-] likewise
    trouble: int      # why the last pose was not used, GOOD: it was
    off: float        # m, distance of the last pose from the position believed in
    delay: float      # s, age of the last pose that was used, since its exposure
    candidate: Candidate
    sight: Sight


class AidedMemory(NamedTuple):
    """What the filter remembers between steps."""

    joint: joint.Memory  # its state is in map
    capture: Capture


class Located(NamedTuple):
    """The estimate in ``map``, and what there is to say of the motion capture."""

    state: State                        # in map, axes as of NED and FRD
    pose_covariance: tuple[float, ...]  # (36,) m, rad, axes of map
    twist_covariance: tuple[float, ...]  # (36,) m/s, rad/s, body axes
    capture: Capture


NOTHING_SEEN = Sight(math.nan, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
NO_CANDIDATE = Candidate(-1.0, SAME, SAME)
START = Capture(
    False, SAME, 0.0, 0.0, 0, 0, NEVER, math.nan, math.nan, NO_CANDIDATE, NOTHING_SEEN)


@jit
def initial(v: AidedValues) -> AidedMemory:
    """Return the memory of a filter that has seen nothing."""
    return AidedMemory(joint.initial(v.joint), START)


@jit
def offer(memory: AidedMemory, age: float, rho: Vec3, q: Quat) -> AidedMemory:
    """
    Return the memory with a pose that the next step uses.

    Parameters
    ----------
    memory
        Before the step.
    age : s
        Of the stamp of the pose, at the time of the next step.
    rho : (3,) m, map, axes as of NED
    q : (4,) w x y z, body to map

    """
    c = memory.capture
    return AidedMemory(memory.joint, Capture(
        c.located, c.anchor, c.age, c.silence, c.used, c.refused, c.trouble, c.off, c.delay,
        c.candidate, Sight(age, rho, q)))


@jit
def _later(c: Capture, dt: float, v: PoseValues) -> Capture:
    """Return the capture after a step of dt, s, without a pose."""
    step = dt if dt > 0.0 else 0.0
    candidate = c.candidate
    if candidate.time >= 0.0:
        candidate = Candidate(candidate.time + step, candidate.anchor, candidate.first)
    if c.silence + step > v.max_age:
        candidate = NO_CANDIDATE
    return Capture(
        c.located, c.anchor, c.age + step, c.silence + step, c.used, c.refused, c.trouble, c.off,
        c.delay, candidate, NOTHING_SEEN)


@jit
def _refused(c: Capture, trouble: int, off: float, candidate: Candidate) -> Capture:
    """Return the capture after a pose that was not used."""
    return Capture(
        c.located, c.anchor, c.age, 0.0, c.used, c.refused + 1, trouble, off, c.delay, candidate,
        NOTHING_SEEN)


@jit
def _used(c: Capture, anchor: Anchor, off: float, delay: float) -> Capture:
    """Return the capture after a pose that was used."""
    return Capture(
        True, anchor, 0.0, 0.0, c.used + 1, c.refused, GOOD, off, delay, NO_CANDIDATE,
        NOTHING_SEEN)


@jit
def _agreed(
    old: Candidate, past: Past, rho: Vec3, turn: Vec3, v: PoseValues,
) -> Candidate:
    """
    Return what refused poses agree on, with one more; it begins anew where this one differs.

    It is compared with the first of them: another drone goes by in steps of some millimetres from
    pose to pose, all of which would agree with the one before.
    """
    if hypot(turn[0], turn[1]) > v.tilt_gate:
        return NO_CANDIDATE
    new = Anchor(turn[2], sub(rho, about_z(turn[2], past.x.p)))
    if old.time < 0.0:
        return Candidate(0.0, new, new)
    a = old.first
    expected = about_z(a.yaw, past.x.p)
    apart = norm(sub(sub(rho, expected), a.shift))
    same = apart <= v.agreement and abs(wrapped(turn[2] - a.yaw)) <= v.agreement_turn
    return Candidate(old.time, new, a) if same else Candidate(0.0, new, new)


@jit
def _is_believed(found: Candidate, located: bool, off: float, v: PoseValues) -> bool:
    """Tell whether what poses agree on may move the filter, which was off by so many m."""
    if not located:
        return found.time >= v.acquire_time
    return (found.time >= v.recovery_time and off <= v.recovery_distance
            and abs(found.anchor.yaw) <= v.recovery_turn)


@jit
def _located_covariance(P: Array, yaw: float, v: PoseValues) -> Array:
    """Return the covariance of a filter that is turned, position and yaw known as by a pose."""
    P = P.copy()
    turn_covariance(P, yaw)
    for i in range(3):
        forget(P, POSITION + i, v.position_noise * v.position_noise)
    forget(P, ATTITUDE + 2, v.attitude_noise * v.attitude_noise)
    return P


@jit
def _use(
    x: Nominal, P: Array, ring: Array, at: int, resting: bool, c: Capture, sight: Sight,
    values: AidedValues,
) -> tuple[Nominal, Array, Capture]:
    """
    Correct with a pose at the time of its exposure, or refuse it.

    Parameters
    ----------
    x, P, ring, at, resting
        Of the joint filter.
    c
        Before the pose.
    sight
        The pose.
    values
        Parameters.

    """
    v, gravity = values.pose, values.joint.gravity
    age, q = sight.age + v.latency, normalise(sight.q)
    total = age + sight.rho[0] + sight.rho[1] + sight.rho[2] + q[0] + q[1] + q[2] + q[3]
    if not math.isfinite(total):
        return x, P, _refused(c, NOT_FINITE, math.nan, c.candidate)
    # a vehicle at rest has been where it is
    past = pose.state_at(x, ring, at, 0.0 if resting else age, gravity)
    if age < 0.0 or not resting and past.age < 0.999 * age:
        return x, P, _refused(c, TOO_OLD, math.nan, NO_CANDIDATE)
    errors = pose.innovation(past, sight.rho, q)
    off, trouble = norm(errors[0]), NEVER
    if c.located:
        H, d, after = np.empty((pose.ROWS, SIZE)), np.zeros(SIZE), P.copy()
        pose.jacobian(past, x.p, gravity, H)
        fit = pose.compare(
            after, H, errors, pose.noise_of(past, values.joint.motion.accel_noise, v), d)
        if fit.position + fit.attitude <= v.gate * v.gate:
            y = inject(x, d)
            anchor = take_up(c.anchor, x.p, y.p, d[ATTITUDE + 2])
            return y, after, _used(c, anchor, off, age)
        trouble = POSITION_OFF if fit.position > fit.attitude else ATTITUDE_OFF
    found = _agreed(c.candidate, past, sight.rho, errors[1], v)
    if _is_believed(found, c.located, off, v):
        by = found.anchor
        return (moved(x, by), _located_covariance(P, by.yaw, v),
                _used(c, composed(by, c.anchor), off, age))
    return x, P, _refused(c, trouble, off, found)


@jit
def step(
    memory: AidedMemory, dt: float, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    flow_quality: int, pressure: float, values: AidedValues,
) -> tuple[AidedMemory, Estimate]:
    """
    Advance the filter by one inertial sample; the estimate is in ``odom``.

    Arguments and result as of :func:`mambo_estimation.kalman.step`, the pose as of
    :func:`offer`; ``memory`` is not changed.
    """
    sight = memory.capture.sight
    m, e = joint.step(
        memory.joint, dt, gyro, accel, sonar, flow, flow_quality, pressure, values.joint)
    c = _later(memory.capture, 0.0 if m.aligning else dt, values.pose)
    x, P = m.x, m.P
    if not math.isnan(sight.age) and not m.aligning:
        x, P, c = _use(x, P, m.ring, m.at, m.resting, c, sight, values)
    turned = P.copy()
    turn_covariance(turned, -c.anchor.yaw)
    there = in_odom(state_of(x, m.gyro, m.shake.velocity, m.aligning), c.anchor)
    after = joint.Memory(
        m.aligning, m.resting, m.alignment, m.landing, x, P, m.ring, m.at, m.has_pressure,
        m.window, m.shake, m.noise, m.gates, m.counts, m.gyro, m.accel, m.sensors)
    return AidedMemory(after, c), Estimate(
        there, pose_covariance(turned),
        twist_covariance(P, x, m.sensors, left(m.shake, m.sensors.accel, dt),
                         values.joint.motion), e.status, -there.rho[2],
        -x.v[2], x.gyro_bias, x.accel_bias, e.barometer_offset, e.sonar_innovation,
        e.sonar_test_ratio, e.flow_innovation, e.flow_test_ratio, e.barometer_innovation,
        e.barometer_test_ratio, e.sonar_refused, e.flow_refused, e.barometer_refused,
        e.invalid_samples, e.health)


@jit
def located(memory: AidedMemory, e: Estimate) -> Located:
    """Return the estimate of a step in ``map``."""
    m = memory.joint
    return Located(
        state_of(m.x, m.gyro, m.shake.velocity, m.aligning), pose_covariance(m.P),
        e.twist_covariance, memory.capture)
