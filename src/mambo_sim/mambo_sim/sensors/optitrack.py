"""
Mock of an Optitrack system: the true pose seen by cameras of their own rate, noise and latency.

Frames are exposed at whole multiples of the period, whatever the ticks of the simulation; the
truth in between is interpolated between two stamped samples of it. What comes out is a function
of these stamps, never of when they arrive, so a node fed by messages and a closed loop in one
process give the same poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.quaternion import exp_map, multiply, normalise, Quat
from mambo_model.rigid_body import State
from mambo_model.schema import check, choice, flag, quantity
from mambo_model.vector import add, scale, sub, Vec3
from numpy.random import Generator

from .sampling import period_ns

QUEUE = 11  # poses under way at most: 50 ms of latency at 200 Hz, and one

STAMPS = ('exposure', 'arrival')
STAMP_EXPOSURE, STAMP_ARRIVAL = range(len(STAMPS))


class OptitrackValues(NamedTuple):
    """An :class:`OptitrackParams` as compiled code reads it."""

    period: int   # ns
    latency: int  # ns
    stamp: int
    position_noise: float
    attitude_noise: float
    noise: bool


class Pose(NamedTuple):
    """A pose as the cameras see it."""

    exposure: int  # ns, when the frame was exposed
    rho: Vec3      # (3,) m, inertial NED
    q: Quat        # (4,) w x y z, body to inertial, unit


class OptitrackMemory(NamedTuple):
    """Poses under way: the last ``pending`` of the queue, oldest first."""

    pending: int
    queue: tuple[Pose, ...]


class OptitrackSample(NamedTuple):
    """What a step brings."""

    new: bool
    stamp: int  # ns, to be published with the pose
    pose: Pose


_NOWHERE = Pose(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
START = OptitrackMemory(0, (_NOWHERE,) * QUEUE)


@dataclass(frozen=True)
class OptitrackParams:
    """Rate, latency and noise of the motion capture."""

    rate: float = quantity(120.0, 'Hz', 1.0, 200.0, 'usual camera rate; at most one pose a step')
    latency: float = quantity(0.01, 's', 0.0, 0.05, 'assumed: exposure to delivery')
    stamp: str = choice('exposure', STAMPS, 'design choice: what the stamp of a pose tells')
    position_noise: float = quantity(
        0.0003, 'm', 0.0, 0.1, 'each axis; error up to 1 mm, thesis sec. 5.2')
    attitude_noise: float = quantity(
        0.001, 'rad', 0.0, 0.5,
        'each axis; second differences over sqrt(6) of Crazyflie flights under Optitrack')
    noise: bool = flag(True, 'design choice: false switches every random part off')

    def __post_init__(self) -> None:
        check(self)

    def values(self) -> OptitrackValues:
        """Return what compiled code reads: whole ns for rate and latency, index for stamp."""
        return OptitrackValues(
            period_ns(self.rate), round(self.latency * 1e9), STAMPS.index(self.stamp),
            self.position_noise, self.attitude_noise, self.noise)


@jit
def interpolate(before: State, after: State, share: float) -> tuple[Vec3, Quat]:
    """
    Return position and attitude between two states, share 0 at the first, 1 at the second.

    Position linearly, attitude linearly and normalised, along the shorter way. Over a step of h
    seconds the errors are at most ``a h^2 / 8`` and ``alpha h^2 / 8`` for an acceleration a in
    m/s^2 and an angular one alpha in rad/s^2.
    """
    rho = add(before.rho, scale(share, sub(after.rho, before.rho)))
    a, b = before.q, after.q
    same = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] >= 0.0
    u, w = 1.0 - share, share if same else -share
    return rho, normalise((
        u * a[0] + w * b[0], u * a[1] + w * b[1], u * a[2] + w * b[2], u * a[3] + w * b[3]))


@jit
def _see(
    exposure: int, rho: Vec3, q: Quat, rng: Generator, p: OptitrackValues,
) -> Pose:
    """Return the pose with noise: position in inertial axes, rotation in body axes."""
    if not p.noise:
        return Pose(exposure, rho, q)
    s, r = p.position_noise, p.attitude_noise
    shift = (s * rng.standard_normal(), s * rng.standard_normal(), s * rng.standard_normal())
    turn = (r * rng.standard_normal(), r * rng.standard_normal(), r * rng.standard_normal())
    return Pose(exposure, add(rho, shift), normalise(multiply(q, exp_map(turn))))


@jit
def step(
    memory: OptitrackMemory, before_ns: int, before: State, now_ns: int, now: State,
    rng: Generator, p: OptitrackValues,
) -> tuple[OptitrackMemory, OptitrackSample]:
    """
    Expose the frame that falls between two samples of the truth, deliver the one that is due.

    Frames fall into the interval after ``before_ns`` up to ``now_ns``. For the first sample of
    the truth give it twice, then the sample before and the one now. Samples should be at most one
    period apart: of several frames in an interval only the last is seen, as when a camera drops
    frames.

    Parameters
    ----------
    memory
        Result of the previous call; ``START`` at first.
    before_ns, now_ns : ns
        Stamps of the two samples, not decreasing.
    before, now
        The true states at these stamps.
    rng
        The generator of this sensor.
    p
        From :meth:`OptitrackParams.values`.

    Returns
    -------
    memory
        To be passed to the next call.
    sample
        At most one pose: exposed at least the latency ago.

    """
    pending, queue = memory.pending, memory.queue
    exposure = now_ns // p.period * p.period
    first = before_ns == now_ns
    if exposure > before_ns or (first and exposure == now_ns):
        share = 1.0 if first else (exposure - before_ns) / (now_ns - before_ns)
        rho, q = interpolate(before, now, share)
        queue = queue[1:] + (_see(exposure, rho, q, rng, p),)
        pending = min(pending + 1, QUEUE)
    if pending > 0:
        oldest = queue[QUEUE - pending]
        arrival = oldest.exposure + p.latency
        if arrival <= now_ns:
            stamp = arrival if p.stamp == STAMP_ARRIVAL else oldest.exposure
            return OptitrackMemory(pending - 1, queue), OptitrackSample(True, stamp, oldest)
    return OptitrackMemory(pending, queue), OptitrackSample(False, 0, queue[QUEUE - 1])
