"""
Description of the drones for RViz and other viewers: model, static frames, paths, markers.

The node only watches: it subscribes with best effort, no flight waits for it, and no bag records
what it publishes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
import math

from mambo_model import schema
from mambo_model.vehicle import parameters
from mambo_ros import node, process, topics
from mambo_ros.endpoints import Input, RawPublisher
from mambo_ros.layout import Layout, LayoutError
from mambo_view.drone_state import ESTIMATE, MEASURED, REFERENCE, TRUTH
from mambo_view.live import Mailbox
from mambo_view.view_node import watch
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from . import display
from .static_frames import rotor_places, SONAR, static_frames
from .urdf import marker_places, urdf

_WATCHED = (topics.GROUND_TRUTH, topics.ESTIMATE, topics.OPTITRACK, topics.REFERENCE,
            topics.MOTOR_PWM)
_PATHS = {TRUTH: (topics.TRUE_PATH, display.MAP), ESTIMATE: (topics.ESTIMATED_PATH, display.ODOM),
          MEASURED: (topics.MEASURED_PATH, display.MAP),
          REFERENCE: (topics.REFERENCE_PATH, display.ODOM)}
_LARGEST = 65_536  # bytes of a message that is passed on


@dataclass(frozen=True)
class DescriptionNodeParams:
    """Parameters of ``description_node``."""

    drones: str = schema.text('/mambo', 'namespaces of the drones, separated by commas')
    vehicle: str = schema.text('identified', 'of the model: a known vehicle, or a vehicle file')
    prefixed: bool = schema.flag(
        False, 'begin the names of frames with the name of their drone, as in mambo1/base_link, '
        'and publish the frames of all drones on /tf')
    places: str = schema.text(
        '', 'x y z of each drone in the frame hall, m, z up, drones separated by semicolons; '
        'empty: all at its origin (prefixed)')
    paths: bool = schema.flag(False, 'publish path/true, estimated, measured and reference')
    markers: bool = schema.flag(
        False, 'publish markers (name, motors, reference) and sonar/beam')
    rate: float = schema.quantity(
        10.0, 'Hz', 0.1, 60.0, 'design choice: of paths and markers, over wall time')
    path_step: float = schema.quantity(
        0.02, 'm', 0.0, 10.0, 'design choice: least distance of two poses of a path')
    path_length: int = schema.quantity(
        1000, '1', 2, 100_000, 'design choice: most poses of a path')

    def __post_init__(self) -> None:
        schema.check(self)
        if not self.spaces or not all(name.startswith('/') for name in self.spaces):
            raise schema.ParameterError(
                f'drones = {self.drones!r} must be namespaces such as /mambo1,/mambo2')
        if self.prefixed and topics.NAMESPACE in self.spaces:
            raise schema.ParameterError(
                f'prefixed = True is for drones that have a /tf of their own, as /mambo1 has: '
                f'leave {topics.NAMESPACE} out of drones')

    @property
    def spaces(self) -> list[str]:
        """Return the namespaces."""
        return [name.strip() for name in self.drones.split(',') if name.strip()]


class _Drone:
    """What is known and published of one drone."""

    def __init__(self, owner: DescriptionNode, space: str) -> None:
        p = owner.params
        self.name, self.box = space.strip('/'), Mailbox(lambda _: [])
        self.prefix = f'{self.name}/' if p.prefixed else ''
        self.trails = {role: (owner.output(topic, space), display.Trail(
            self.prefix + frame, p.path_step, p.path_length))
            for role, (topic, frame) in _PATHS.items()} if p.paths else {}
        self.markers: RawPublisher | None = None
        if p.markers:
            self.markers = owner.output(topics.MARKERS, space)
            beam = Layout(topics.BEAM.msg_type, header__frame_id=self.prefix + SONAR)
            owner.watch(topics.SONAR, space, partial(
                _pass_beam, owner.output(topics.BEAM, space), beam))
        if p.paths or p.markers:
            for topic in _WATCHED:
                owner.watch(topic, space, partial(self.box.put, topic))


def _pass_beam(publish: RawPublisher, layout: Layout, data: bytes) -> None:
    """Publish a reading of the sonar in the frame of its beam; ignore one that is unreadable."""
    if len(data) <= _LARGEST:
        try:
            publish(layout.pack(*layout.unpack(data)))
        except LayoutError:
            return


class DescriptionNode(node.MamboNode[DescriptionNodeParams]):
    """
    Description of one or several drones: robot_description, /tf_static, paths, markers.

    For several drones with ``prefixed``, their transforms are on ``/tf`` below one frame, hall.
    """

    publishes = (topics.ROBOT_DESCRIPTION, topics.TF_STATIC, *(topic for topic, _ in
                 _PATHS.values()), topics.MARKERS, topics.BEAM)
    subscribes = (*_WATCHED, topics.SONAR)
    example = '--ros-args -p paths:=true -p markers:=true'

    def __init__(self, **kwargs) -> None:
        super().__init__('description_node', DescriptionNodeParams, **kwargs)
        p = self.params
        self._vehicle = parameters.find(p.vehicle)
        self._rotors = rotor_places(self._vehicle)
        self._drones = [_Drone(self, space) for space in p.spaces]
        places = display.places(p.places, len(self._drones))
        if p.prefixed:
            tf = self.advertise(topics.TF)
            for space, drone in zip(p.spaces, self._drones, strict=True):
                self.watch(topics.TF, space, partial(self._relay, tf, drone.prefix))
        self._describe(places)

    def output(self, topic: topics.Topic, space: str) -> RawPublisher:
        """Advertise a topic of a drone."""
        return self.advertise(replace(topic, name=topics.full_name(topic, space)))

    def watch(self, topic: topics.Topic, space: str, take: object) -> None:
        """Subscribe to a topic of a drone with best effort."""
        full = replace(topic, name=topics.full_name(topic, space))
        self.inputs.append(Input(full, full.name, take, False, reliable=False))

    def _describe(self, places: list) -> None:
        """Publish model and static frames, which late viewers get too."""
        frames = static_frames(self._vehicle, marker_places())
        static = []
        for space, drone, place in zip(self.params.spaces, self._drones, places, strict=True):
            self.output(topics.ROBOT_DESCRIPTION, space)(serialize_message(String(
                data=urdf(self._vehicle, marker_places(), drone.prefix))))
            own = display.static_transforms(frames, drone.prefix)
            if self.params.prefixed:
                static += [display.place_in_hall(drone.prefix, place), *own]
            else:
                self._static(self.output(topics.TF_STATIC, space), own)
        if static:
            self._static(self.advertise(topics.TF_STATIC), static)

    @staticmethod
    def _static(publish: RawPublisher, transforms: list) -> None:
        publish(serialize_message(topics.TF_STATIC.msg_type(transforms=transforms)))

    @staticmethod
    def _relay(publish: RawPublisher, prefix: str, data: bytes) -> None:
        """Publish the transforms of a drone with its prefix; ignore those that are unreadable."""
        if len(data) > _LARGEST:
            return
        try:
            message = deserialize_message(bytes(data), topics.TF.msg_type)
        except Exception:  # the middleware's own, of hostile bytes
            return
        publish(serialize_message(display.prefixed(message, prefix)))

    def frame(self, now: float) -> None:
        """Publish paths and markers as of now; ``now`` is not used: stamps are of the flight."""
        for drone in self._drones:
            if not drone.box.read() or not math.isfinite(drone.box.state.t):
                continue
            state = drone.box.state
            for role, (publish, trail) in drone.trails.items():
                pose = state.poses.get(role)
                if pose is not None and trail.add(state.t, pose):
                    publish(serialize_message(trail.message()))
            if drone.markers is not None:
                drone.markers(serialize_message(display.markers(
                    drone.name, state, self._rotors, self._vehicle.pwm_max, drone.prefix)))


def main(args=None) -> None:
    """Entry point ``description_node``."""
    process.main(DescriptionNode, args, watch)
