"""
Mock of an Optitrack system: the true pose with the rate, noise and latency of cameras.

The pose of a frame is computed in one of two ways: from five markers that are seen, labelled and
fitted (:mod:`.marker_occlusion`, :mod:`.tracker`, :mod:`.rigid_fit`), or the true pose with white
noise. A
body that is not found has no pose; like ROS drivers of Optitrack (mocap_optitrack,
vrpn_client_ros) this mock then publishes nothing.

Frames are exposed at whole multiples of the period, whatever the ticks of the simulation; the
truth in between is interpolated between two stamped samples of it. What comes out is a function
of these stamps, never of when they arrive, so a node fed by messages and a closed loop in one
process give the same poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.quaternion import exp_map, multiply, normalise, Quat
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, scale, sub, Vec3
from mambo_model.schema import choice, flag, group, ParameterError, quantity
from mambo_model.values import derived, Parameters, values, values_type
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from . import marker_occlusion, tracker
from .sampling import period_ns

QUEUE = 11  # poses under way at most: 50 ms of latency at 200 Hz, and one

MODELS = ('markers', 'pose')
MODEL_MARKERS, MODEL_POSE = range(len(MODELS))

FAULTS = ('none', 'lost', 'flip', 'swap')
FAULT_NONE, FAULT_LOST, FAULT_FLIP, FAULT_SWAP = range(len(FAULTS))

STAMPS = ('exposure', 'arrival')
STAMP_EXPOSURE, STAMP_ARRIVAL = range(len(STAMPS))


class Pose(NamedTuple):
    """A pose as the cameras see it."""

    exposure: int  # ns, when the frame was exposed
    rho: Vec3      # (3,) m, inertial NED
    q: Quat        # (4,) w x y z, body to inertial, unit


class Counts(NamedTuple):
    """Counts of the frames so far."""

    frames: int   # exposed
    lost: int     # the body was not found
    dropped: int  # the body was found, its pose did not arrive


class OptitrackMemory(NamedTuple):
    """Queue of poses not yet delivered (the last ``pending``, oldest first), and the counts."""

    pending: int          # poses in the queue
    queue: tuple[Pose, ...]  # (QUEUE,) not yet delivered, oldest first
    counts: Counts        # of the frames
    seen: marker_occlusion.Seen    # which markers the last frame showed
    unhidden: marker_occlusion.Seen  # the same without what other drones hid
    dropping: bool        # the last frame did not arrive
    track: tracker.Track  # of the body


class OptitrackSample(NamedTuple):
    """Output of the motion capture at one step."""

    new: bool   # a pose is delivered
    stamp: int  # ns, to be published with the pose
    pose: Pose  # as seen at the exposure


_NOWHERE = Pose(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
START = OptitrackMemory(
    0, (_NOWHERE,) * QUEUE, Counts(0, 0, 0), marker_occlusion.ALL, marker_occlusion.ALL, False,
    tracker.Track(False, 0, _NOWHERE.rho, _NOWHERE.q, (0.0, 0.0, 0.0)))


def check_fault(fault: str, begin: float, end: float) -> None:
    """Raise ParameterError for a fault of the cameras that is over, in s, when it begins."""
    if fault != 'none' and not begin < end:
        raise ParameterError(
            f'fault = {fault} lasts from fault_begin = {begin:g} s to fault_end = {end:g} s: '
            'give a later fault_end')


@dataclass(frozen=True)
class OptitrackParams(Parameters):
    """
    Rate, latency, losses on the way and noise of the motion capture.

    Position and attitude noise are those of the model ``pose``; with ``markers`` they follow from
    the noise of the markers.
    """

    rate: float = quantity(120.0, 'Hz', 1.0, 200.0, 'usual camera rate; at most one pose a step')
    latency: float = quantity(
        0.01, 's', 0.0, 0.05,
        'assumed: exposure to delivery; 5.4 ms of it in the cameras of a recorded Motive 2.1')
    stamp: str = choice('exposure', STAMPS, 'design choice: meaning of the stamp of a pose')
    model: str = choice('markers', MODELS, 'design choice: how a pose is computed')
    position_noise: float = quantity(
        0.0003, 'm', 0.0, 0.1, 'each axis; error up to 1 mm, thesis sec. 5.2')
    attitude_noise: float = quantity(
        0.001, 'rad', 0.0, 0.5,
        'each axis; second differences over sqrt(6) of Crazyflie flights under Optitrack')
    frame_loss: float = quantity(
        0.0, '1', 0.0, 0.5,
        'design choice: share of poses that do not arrive; 0.005 in 198 s of a recorded hall')
    loss_length: float = quantity(
        2.0, '1', 1.0, 1000.0, 'mean number of poses lost in a row, 2.06 in that recording')
    fault: str = choice(
        'none', FAULTS, 'what the cameras say from fault_begin to fault_end: nothing, the body '
        'turned by half a turn of yaw, or another body that moves alike fault_distance away')
    fault_begin: float = quantity(0.0, 's', 0.0, 86400.0, 'design choice')
    fault_end: float = quantity(0.0, 's', 0.0, 86400.0, 'design choice')
    fault_distance: float = quantity(
        1.0, 'm', 0.0, 100.0, 'to the other body, northwards: room for two drones')
    noise: bool = flag(True, 'design choice: false switches every random part off')
    markers: marker_occlusion.MarkerParams = group(marker_occlusion.MarkerParams)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fault(self.fault, self.fault_begin, self.fault_end)

    @derived('ns', 'rate')
    def period(self) -> int:
        """Time from frame to frame."""
        return period_ns(self.rate)

    @derived('ns', 'latency')
    def latency_ns(self) -> int:
        """Exposure to delivery."""
        return round(self.latency * 1e9)

    @derived('-', 'frame_loss')
    def lose(self) -> float:
        """Probability that a frame is lost after one that arrived."""
        return self.frame_loss / ((1.0 - self.frame_loss) * self.loss_length)

    @derived('-', 'loss_length')
    def recover(self) -> float:
        """Probability that a frame arrives after one that was lost."""
        return 1.0 / self.loss_length

    def values(self) -> OptitrackValues:
        """Return the values for compiled code."""
        return values(self, markers=self.markers.values(self.period()))


OptitrackValues = values_type(OptitrackParams)


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
def _noisy(rho: Vec3, q: Quat, rng: Generator, p: OptitrackValues) -> tuple[Vec3, Quat]:
    """Return the pose with noise: position in inertial axes, rotation in body axes."""
    if not p.noise:
        return rho, q
    s, r = p.position_noise, p.attitude_noise
    shift = (s * standard_normal(rng), s * standard_normal(rng), s * standard_normal(rng))
    turn = (r * standard_normal(rng), r * standard_normal(rng), r * standard_normal(rng))
    return add(rho, shift), normalise(multiply(q, exp_map(turn)))


@jit
def _is_at_fault(exposure: int, fault: int, p: OptitrackValues) -> bool:
    """Tell whether a frame, exposed at so many ns, has a fault."""
    return p.fault == fault and p.fault_begin <= exposure * 1e-9 < p.fault_end


@jit
def _shown(pose: Pose, p: OptitrackValues) -> Pose:
    """Return a pose as it is delivered, turned or of another body where there is such a fault."""
    if _is_at_fault(pose.exposure, FAULT_FLIP, p):
        return Pose(pose.exposure, pose.rho, multiply(pose.q, (0.0, 0.0, 0.0, 1.0)))
    if _is_at_fault(pose.exposure, FAULT_SWAP, p):
        return Pose(pose.exposure, add(pose.rho, (p.fault_distance, 0.0, 0.0)), pose.q)
    return pose


@jit
def _expose(
    memory: OptitrackMemory, exposure: int, rho: Vec3, q: Quat, rng: Generator,
    p: OptitrackValues, view: NDArray[np.float64] | None,
) -> OptitrackMemory:
    """Expose a frame of a true pose and queue the pose found in it."""
    pending, queue, counts, seen, unhidden, dropping, track = memory
    if p.model == MODEL_POSE:
        place, attitude = _noisy(rho, q, rng, p)
        track = tracker.define(exposure, place, attitude)
    else:
        if counts.frames == 0:
            track = tracker.define(exposure, rho, q)
        shown = marker_occlusion.ALL
        if view is not None:
            rho, q, shown = marker_occlusion.view_of(view)
        points, unhidden = marker_occlusion.reconstruct(
            unhidden, rho, q, rng, p.noise, p.markers)
        seen = unhidden if view is None else marker_occlusion.both(unhidden, shown)
        track = tracker.step(track, exposure, points, seen, p.markers)
    if p.noise:
        chance = rng.random()
        dropping = chance >= p.recover if dropping else chance < p.lose
    shown = _shown(Pose(exposure, track.rho, track.q), p)
    if track.tracked and not dropping and not _is_at_fault(exposure, FAULT_LOST, p):
        queue = queue[1:] + (shown,)
        pending = min(pending + 1, QUEUE)
    counts = Counts(
        counts.frames + 1, counts.lost + (not track.tracked),
        counts.dropped + (track.tracked and dropping))
    return OptitrackMemory(pending, queue, counts, seen, unhidden, dropping, track)


@jit_inside
def step(
    memory: OptitrackMemory, before_ns: int, before: State, now_ns: int, now: State,
    rng: Generator, p: OptitrackValues, view: NDArray[np.float64] | None,
) -> tuple[OptitrackMemory, OptitrackSample]:
    """
    Expose the frame that falls between two samples of the truth, deliver the one that is due.

    Frames fall into the interval after ``before_ns`` up to ``now_ns``. For the first sample of
    the truth give it twice, then the sample before and the one now. Samples should be at most one
    period apart: of several frames in an interval only the last is seen, as when a camera drops
    frames. Each frame draws the same number of random numbers, whatever it shows.

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
    view : (12,)
        What the markers show in the frame of this step where several drones share a hall, from
        ``HallCapture.step``; None: the drone is seen as if alone.

    Returns
    -------
    memory
        To be passed to the next call.
    sample
        At most one pose: exposed at least the latency ago.

    """
    exposure = now_ns // p.period * p.period
    first = before_ns == now_ns
    if exposure > before_ns or (first and exposure == now_ns):
        share = 1.0 if first else (exposure - before_ns) / (now_ns - before_ns)
        rho, q = interpolate(before, now, share)
        memory = _expose(memory, exposure, rho, q, rng, p, view)
    pending, queue, counts, seen, unhidden, dropping, track = memory
    if pending > 0:
        oldest = queue[QUEUE - pending]
        arrival = oldest.exposure + p.latency_ns
        if arrival <= now_ns:
            stamp = arrival if p.stamp == STAMP_ARRIVAL else oldest.exposure
            memory = OptitrackMemory(
                pending - 1, queue, counts, seen, unhidden, dropping, track)
            return memory, OptitrackSample(True, stamp, oldest)
    return memory, OptitrackSample(False, 0, queue[QUEUE - 1])
