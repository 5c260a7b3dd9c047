"""The motion of a vehicle as arrays, read from any topic that holds one; z up, as in messages."""

from __future__ import annotations

import dataclasses

from mambo_bags.reader import Bag, BagError, Messages
import numpy as np
from scipy.spatial.transform import Rotation

from . import resample
from .poses import outliers
from .resample import Bools, Floats, Ints

TRUTH = ('ground_truth/odom', 'optitrack/pose')
MOTIONS = (*TRUTH, 'estimate/odom', 'estimate/map', 'onboard/odom')
"""Topics with the motion of the vehicle, the most accurate first."""
REFERENCE = 'mambo_interfaces/msg/Reference'
KINDS = ('nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped',
         'geometry_msgs/msg/PoseWithCovarianceStamped', REFERENCE)
"""Message types that hold a motion."""
POSES = KINDS[1:3]
"""Message types of a motion capture system."""
ROUNDING = 1e-6  # [-] of the components of a quaternion whose axes were turned


@dataclasses.dataclass(frozen=True)
class Motion:
    """
    A motion over time, in an inertial frame with z up; the body is FLU.

    Attributes
    ----------
    name
        Name of the topic, relative to the namespace of the drone.
    stamps : (n,) ns, ascending
    position : (n, 3) m
    quaternion : (n, 4)
        x y z w, body to inertial, without jumps of sign; NaN where the message holds none.
    velocity : (n, 3) m/s, inertial
        None if the topic does not hold it.
    impossible
        Number of impossible poses that were rejected, see :mod:`mambo_signals.poses.outliers`.
    frame
        Name of the frame of the poses in the messages, of the first one.
    frames
        Names of all of them, if there are several.

    """

    name: str
    stamps: Ints
    position: Floats
    quaternion: Floats
    velocity: Floats | None = None
    impossible: int = 0
    frame: str = ''
    frames: tuple[str, ...] = ()

    @property
    def t(self) -> Floats:
        """Return the stamps, (n,) s."""
        return self.stamps * 1e-9

    @property
    def orientation(self) -> Floats:
        """Return the quaternions under their name in messages."""
        return self.quaternion

    @property
    def gap(self) -> int:
        """Return the largest time between two samples that are connected, ns."""
        return resample.longest_step(self.stamps)

    def moved(self, offset: int, turn: float, shift: Floats) -> Motion:
        """Shift the clock by ``offset`` [ns], rotate by ``turn`` [rad] and translate [m]."""
        rotation = Rotation.from_euler('z', turn)
        half = Rotation.from_euler('z', turn).as_quat()
        return dataclasses.replace(
            self, stamps=self.stamps + offset, position=rotation.apply(self.position) + shift,
            quaternion=product(half, self.quaternion),
            velocity=None if self.velocity is None else rotation.apply(self.velocity))

    def values(self, stamps: Ints, column: Floats) -> Floats:
        """Return a column, (n, k), interpolated at other stamps; NaN in gaps and outside."""
        return resample.interpolate(stamps, self.stamps, column, self.gap)

    def at(self, stamps: Ints) -> Motion:
        """Return the motion interpolated at other stamps; NaN in gaps and outside."""
        q = self.values(stamps, self.quaternion)  # linear: error 1e-5 rad at 0.1 rad per sample
        return dataclasses.replace(
            self, stamps=stamps, position=self.values(stamps, self.position),
            quaternion=q / np.linalg.norm(q, axis=1, keepdims=True),
            velocity=None if self.velocity is None else self.values(stamps, self.velocity))


def product(p: Floats, q: Floats) -> Floats:
    """Return the products (2.10) of quaternions x y z w, (n, 4); one factor may be (4,)."""
    pv, pw, qv, qw = p[..., :3], p[..., 3:], q[..., :3], q[..., 3:]
    vector = pw * qv + qw * pv + np.cross(pv, qv)
    return np.concatenate(
        [vector, pw * qw - (pv * qv).sum(axis=-1, keepdims=True)], axis=-1)


def has_attitude(m: Motion) -> bool:
    """Return whether attitudes were measured: trackers of points alone publish the identity."""
    q = m.quaternion[np.isfinite(m.quaternion).all(axis=1)]
    return bool((np.abs(q[:, :3]) > ROUNDING).any())


def rotation_vectors(q: Floats) -> Floats:
    """Return quaternions x y z w as rotation vectors, (n, 3) rad, of at most pi; NaN stays NaN."""
    q = q * np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[:, 3:])
    return q[:, :3] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine != 0.0)


def angles(q: Floats) -> Floats:
    """Return quaternions x y z w as roll, pitch and yaw, (n, 3) deg, unwrapped."""
    x, y, z, w = q.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    out = np.stack([roll, pitch, yaw], axis=1)
    good = np.isfinite(out).all(axis=1)
    out[good] = np.unwrap(out[good], axis=0)
    return np.degrees(out)


def _possible(stamps: Ints, position: Floats, q: Floats) -> Bools:
    """Return which poses of a motion capture are possible, (n,); any without attitude is."""
    out = np.ones(len(stamps), bool)
    posed = np.flatnonzero(np.isfinite(q).all(axis=1))
    out[posed] = ~outliers.impossible(1e-9 * stamps[posed], position[posed], q[posed])
    return out


def read(bag: Bag, topic: str) -> Motion:
    """
    Return the motion that a topic holds.

    Samples without a finite position are left out. Of samples with equal stamps only the first
    is used. Impossible poses of a motion capture are rejected
    (:mod:`mambo_signals.poses.outliers`).

    Raises
    ------
    BagError
        If the bag lacks the topic, if its type holds no motion, or if fewer than two samples
        remain.

    """
    messages = bag[topic]
    name = bag.name(topic)
    if messages.type_name not in KINDS:
        raise BagError(
            f'{bag.path}: {name} has the type {messages.type_name}, which holds no motion; '
            f'choose a topic of type {", ".join(kind.split("/")[-1] for kind in KINDS)}')
    stamps, position, q = messages.stamp, messages.position, messages.orientation
    velocity: Floats | None = None
    if messages.type_name == REFERENCE:
        velocity = messages.velocity
    elif messages.type_name == KINDS[0]:
        q = resample.continuous_quaternions(q)
        velocity = np.full(position.shape, np.nan)
        good = np.isfinite(q).all(axis=1)
        if good.any():  # the twist is in the axes of the body
            velocity[good] = Rotation.from_quat(q[good]).apply(messages.velocity[good])
    good = np.flatnonzero(np.isfinite(position).all(axis=1))
    _, first = np.unique(stamps[good], return_index=True)
    kept = good[first]
    q = resample.continuous_quaternions(q[kept])
    impossible = 0
    if messages.type_name in POSES:
        possible = _possible(stamps[kept], position[kept], q)
        impossible = int((~possible).sum())
        kept, q = kept[possible], resample.continuous_quaternions(q[possible])
    if len(kept) < 2:
        raise BagError(
            f'{bag.path}: {name} has {len(kept)} usable sample{"s" * (len(kept) != 1)} of '
            f'{len(messages)}; two are needed for a comparison')
    prefix, frames = f'{bag.namespace}/', messages['header.frame_id']
    found = set(frames.tolist()) - {''}  # some publishers leave it out at times
    several = tuple(sorted(found)) if len(found) > 1 else ()
    return Motion(
        name[len(prefix):] if bag.namespace and name.startswith(prefix) else name, stamps[kept],
        position[kept], q, None if velocity is None else velocity[kept], impossible,
        str(frames[0]), several)


def candidates(bag: Bag) -> list[str]:
    """Return the topics of a bag that hold a motion, the most accurate first."""
    known = [name for name in MOTIONS if name in bag]
    absolute = {bag.name(name) for name in known}
    return known + [
        topic for kind in KINDS[:3] for topic, found in sorted(bag.topics.items())
        if found == kind and topic in bag and topic not in absolute]


def choose(bag: Bag, topic: str | None, other: Bag, other_topic: str | None) -> str:
    """
    Return the topic of a bag to compare: ``topic`` if given, or else the best in both bags.

    If ``other`` is the same bag, the topic differs from ``other_topic``.

    Raises
    ------
    BagError
        If the bag holds no motion.

    """
    if topic is not None:
        return topic
    here = [name for name in candidates(bag) if other is not bag or name != other_topic]
    if not here:
        raise BagError(
            f'{bag.path}: no topic with a motion (Odometry or PoseStamped); it has '
            f'{", ".join(sorted(bag.topics)) or "none"}')
    if other_topic is None and other is not bag:
        both = [name for name in here if name in other]
        return both[0] if both else here[0]
    return other_topic if other_topic in here else here[0]


def position_errors(signal: Messages, truth: Messages) -> tuple[Ints, Floats]:
    """
    Return stamps (n,) ns and position errors (n, 3) m of a signal at its own stamps.

    The truth is interpolated. Errors in its gaps (:func:`mambo_signals.resample.longest_step`)
    and beyond its ends are NaN.
    """
    there = resample.interpolate(
        signal.stamp, truth.stamp, truth.position, resample.longest_step(truth.stamp))
    return signal.stamp, signal.position - there
