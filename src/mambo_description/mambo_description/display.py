"""
Messages for viewers: static transforms, paths and markers.

Poses come as the page in the browser has them, z up (REP-103).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
import math
from typing import Any

from geometry_msgs.msg import Point, PoseStamped, Quaternion, TransformStamped
from mambo_model import schema
from mambo_model.motion.vector import Vec3
from mambo_view.drone_state import DroneState, Pose, REFERENCE
from nav_msgs.msg import Path
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from .static_frames import BASE, Frame

HALL, MAP, ODOM = 'hall', 'map', 'odom'
_MOST = 100  # transforms of a message that are passed on
_FULL = 0.1  # m, length of the arrow of a motor at the largest command
_FAR = 1e6   # m, the farthest place of a drone
_GREEN, _BLUE, _WHITE = (0.1, 0.7, 0.3, 1.0), (0.1, 0.3, 0.9, 0.8), (1.0, 1.0, 1.0, 1.0)


def stamp(message: Any, t: float) -> None:
    """Set the stamp of a header to a flight time in s."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        round(t * 1e9), 1_000_000_000)


def places(text: str, drones: int) -> list[Vec3]:
    """
    Return the place of each drone in the hall, m, z up.

    Parameters
    ----------
    text
        Three numbers a drone, drones separated by semicolons; empty: all at the origin.
    drones
        Their number.

    Raises
    ------
    mambo_model.schema.ParameterError
        If the text is not so many places.

    """
    if not text.strip():
        return [(0.0, 0.0, 0.0)] * drones
    try:
        out = [tuple(map(float, place.split())) for place in text.split(';')]
    except ValueError:
        out = []
    if len(out) != drones or not all(
            len(place) == 3 and all(abs(x) <= _FAR for x in place) for place in out):
        raise schema.ParameterError(
            f'places = {schema.shown(text)} must be {drones} times x y z in m, separated by ;')
    return out  # type: ignore[return-value]  # three numbers each


def static_transforms(frames: Iterable[Frame], prefix: str = '') -> list[TransformStamped]:
    """Return fixed frames as transforms at stamp 0, which hold for all times."""
    out = []
    for frame in frames:
        one = TransformStamped(child_frame_id=prefix + frame.name)
        one.header.frame_id = prefix + frame.parent
        move, turn = one.transform.translation, one.transform.rotation
        move.x, move.y, move.z = frame.position
        turn.x, turn.y, turn.z, turn.w = frame.quaternion
        out.append(one)
    return out


def place_in_hall(prefix: str, place: Vec3) -> TransformStamped:
    """Return the transform from the hall to the ``map`` of a drone."""
    [out] = static_transforms([Frame(MAP, '', place, (0.0, 0.0, 0.0))], prefix)
    out.header.frame_id = HALL
    return out


def prefixed(message: TFMessage, prefix: str) -> TFMessage:
    """Put a prefix before the frames of transforms that do not have it yet."""
    def name(frame: str) -> str:
        frame = frame.lstrip('/')
        return frame if frame.startswith(prefix) else prefix + frame
    kept = message.transforms[:_MOST]
    for one in kept:
        one.header.frame_id, one.child_frame_id = (
            name(one.header.frame_id), name(one.child_frame_id))
    return TFMessage(transforms=kept)


class Trail:
    """
    The way of a drone as a path that grows.

    Parameters
    ----------
    frame : str
        Frame of the poses.
    step : m
        Least distance between two poses of it.
    most : int
        Most poses; older ones are dropped.

    """

    def __init__(self, frame: str, step: float, most: int) -> None:
        self._frame, self._step = frame, step
        self._poses: deque[PoseStamped] = deque(maxlen=most)
        self._last: Vec3 | None = None
        self._t = -math.inf

    def add(self, t: float, pose: Pose) -> bool:
        """Add the pose of a flight time in s if it is a step away; return whether it was."""
        if t < self._t:  # another flight
            self._poses.clear()
            self._last = None
        self._t = t
        if self._last is not None and math.dist(self._last, pose.position) < self._step:
            return False
        self._last = pose.position
        one = PoseStamped()
        stamp(one, t)
        one.header.frame_id = self._frame
        at, turn = one.pose.position, one.pose.orientation
        at.x, at.y, at.z = pose.position
        turn.w, turn.x, turn.y, turn.z = pose.attitude
        self._poses.append(one)
        return True

    def message(self) -> Path:
        """Return the path so far, stamped as its last pose."""
        out = Path(poses=list(self._poses))
        out.header.frame_id = self._frame
        if self._poses:
            out.header.stamp = self._poses[-1].header.stamp
        return out


def _marker(kind: int, frame: str, space: str, number: int, t: float,
            scale: Sequence[float], colour: Sequence[float]) -> Marker:
    out = Marker(type=kind, ns=space, id=number, frame_locked=True)
    out.header.frame_id = frame
    stamp(out, t)
    out.scale.x, out.scale.y, out.scale.z = scale
    out.color.r, out.color.g, out.color.b, out.color.a = colour
    out.pose.orientation = Quaternion(w=1.0)
    return out


def markers(name: str, state: DroneState, rotors: Sequence[Vec3], largest: float,
            prefix: str = '') -> MarkerArray:
    """
    Return name, motor commands and reference of a drone as markers.

    Parameters
    ----------
    name
        Text above the drone.
    state
        Its newest values.
    rotors : (4, 3) m
        Place of each rotor in ``base_link``.
    largest : PWM
        Command for which the arrow of a motor is 0.1 m long.
    prefix
        Of its frames.

    """
    label = _marker(
        Marker.TEXT_VIEW_FACING, prefix + BASE, 'name', 0, state.t, (0.0, 0.0, 0.06), _WHITE)
    label.text, label.pose.position.z = name, 0.12
    out = [label]
    for number, (place, pwm) in enumerate(zip(rotors, state.pwm, strict=True), 1):
        if not math.isfinite(pwm):
            continue
        arrow = _marker(Marker.ARROW, prefix + BASE, 'motors', number, state.t,
                        (0.006, 0.012, 0.0), _GREEN)
        x, y, z = place
        length = max(0.0, min(1.0, pwm / largest)) * _FULL
        arrow.points = [Point(x=x, y=y, z=z), Point(x=x, y=y, z=z + length)]
        out.append(arrow)
    reference = state.poses.get(REFERENCE)
    if reference is not None:
        ball = _marker(Marker.SPHERE, prefix + ODOM, 'reference', 0, state.t,
                       (0.04, 0.04, 0.04), _BLUE)
        at = ball.pose.position
        at.x, at.y, at.z = reference.position
        out.append(ball)
    return MarkerArray(markers=out)
