"""
What a node changes in the messages that it publishes, on request: dates, frames, hardware ids.

Inside, flight time begins at 0 and frames have their plain names. A node with these parameters
publishes other stamps and names, and takes the offset out of the stamps that it receives; without
them no message is touched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import cached_property
from typing import Any

from mambo_model import schema
from rclpy.serialization import deserialize_message

from .. import cdr, topics
from ..layout import Layout, LayoutError

IMU_LINK, SONAR_LINK = 'imu_link', 'sonar_link'
_SENSORS = {topics.IMU.name: IMU_LINK, topics.SONAR.name: SONAR_LINK}
_LAST = datetime(2038, 1, 1, tzinfo=timezone.utc)  # seconds of a stamp have 32 bits
_LONGEST = 200  # characters of a name
_FIRST = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True)
class WireParams:
    """Parameters that every node has, below ``wire``."""

    start_date: str = schema.text(
        '', 'date at flight time 0, ISO 8601 such as 2026-05-01T12:00:00Z, the same for every '
        'node; empty: stamps begin at 0')
    frame_prefix: str = schema.text('', 'put before the name of every frame, such as mambo1/')
    sensor_frames: bool = schema.flag(
        False, 'frames of sensors are imu_link and sonar_link in place of base_link')
    hardware_id: str = schema.text(
        '', 'of diagnostics, whose names then begin with the namespace; empty: none')

    def __post_init__(self) -> None:
        schema.check(self)
        if not _FIRST <= self._date <= _LAST:
            raise schema.ParameterError(
                f'start_date = {self.start_date} must be from 1970 to 2037')
        if len(self.frame_prefix) > _LONGEST or self.frame_prefix and not all(
                part.isidentifier() and part.isascii()
                for part in self.frame_prefix.removesuffix('/').split('/')):
            raise schema.ParameterError(
                f'frame_prefix = {schema.shown(self.frame_prefix)} must be letters, digits and _, '
                f'such as mambo1/, at most {_LONGEST} characters')
        if len(self.hardware_id) > _LONGEST or not self.hardware_id.isprintable():
            raise schema.ParameterError(
                f'hardware_id = {schema.shown(self.hardware_id)} must be a text without line '
                f'breaks and control characters, at most {_LONGEST} of them')

    @cached_property
    def _date(self) -> datetime:
        """Return the start date; ParameterError if the text is not one."""
        if not self.start_date:
            return _FIRST
        try:
            date = datetime.fromisoformat(self.start_date.replace('Z', '+00:00'))
        except ValueError:
            raise schema.ParameterError(
                f'start_date = {schema.shown(self.start_date)} is not a date such as '
                '2026-05-01T12:00:00Z') from None
        return date if date.tzinfo else date.replace(tzinfo=timezone.utc)

    @property
    def offset(self) -> int:
        """Return the stamp at flight time 0, ns."""
        return round((self._date - _FIRST).total_seconds() * 1e6) * 1000

    def frame(self, topic: topics.Topic, name: str) -> str:
        """Return what a frame is called on a topic; an empty name stays empty."""
        if self.sensor_frames:
            name = _SENSORS.get(topic.name, name)
        return name and self.frame_prefix + name

    def frames(self, *names: str) -> tuple[str, ...]:
        """Return what some frames may be called in messages that come in, likely names first."""
        return (*(self.frame_prefix + name for name in names if self.frame_prefix), *names, '')

    def outgoing(
        self, topic: topics.Topic, namespace: str, name: str,
    ) -> Callable[[bytes], bytes] | None:
        """
        Return what changes the messages of a topic; None if nothing is to be changed.

        On ``/diagnostics`` that all drones share, a node beside the drone ``/mambo`` adds its
        namespace to the names of its statuses, also without a parameter that asks for it.

        Parameters
        ----------
        topic
            What is published.
        namespace
            Of the node.
        name
            Absolute name of the topic, after remapping.

        """
        space = namespace.strip('/')
        if topic is not topics.DIAGNOSTICS or not space or (
                not self.hardware_id
                and (name != topic.name or namespace == topics.NAMESPACE)):
            space = ''  # of statuses without it
        if self == WireParams() and not space:
            return None
        if topic in (topics.TF, topics.TF_STATIC, topics.DIAGNOSTICS):
            return lambda data: self._by_message(topic, space, data)
        if not (self.frame_prefix or self.sensor_frames):
            return lambda data: cdr.restamped(data, cdr.stamp_ns(data) + self.offset)
        return _Relabelled(self, topic)

    def incoming(self, decode: Callable[[bytes], tuple]) -> Callable[[bytes], tuple]:
        """Return a decoder whose values begin with the flight time instead of the stamp."""
        offset = self.offset
        if not offset:
            return decode

        def flight_time(data: bytes) -> tuple:
            t, *values = decode(data)
            return (t - offset, *values)
        return flight_time

    def _by_message(self, topic: topics.Topic, space: str, data: bytes) -> bytes:
        """Change a message that has a sequence; statuses get the name of a space, if any."""
        message = deserialize_message(data, topic.msg_type)
        for one in getattr(message, 'transforms', ()):
            self._stamp(one.header)
            one.header.frame_id = self.frame(topic, one.header.frame_id)
            one.child_frame_id = self.frame(topic, one.child_frame_id)
        if topic is topics.DIAGNOSTICS:
            self._stamp(message.header)
            for status in message.status:
                status.hardware_id = self.hardware_id
                status.name = f'{space}/{status.name}' if space else status.name
        return cdr.serialize(message)

    def _stamp(self, header: Any) -> None:
        stamp = header.stamp
        stamp.sec, stamp.nanosec = divmod(
            stamp.sec * cdr.SECOND + stamp.nanosec + self.offset, cdr.SECOND)


class _Relabelled:
    """Gives the messages of a topic, whose frames are always the same, other frames and stamps."""

    def __init__(self, wire: WireParams, topic: topics.Topic) -> None:
        self._wire, self._topic = wire, topic
        self._layout: Layout | None = None
        self._plain = False  # the messages have no frame

    def __call__(self, data: bytes) -> bytes:
        if self._layout is None and not self._plain:
            self._learn(data)
        if self._layout is not None:
            data = self._layout.pack(*self._layout.unpack(data))
        return cdr.restamped(data, cdr.stamp_ns(data) + self._wire.offset)

    def _learn(self, data: bytes) -> None:
        """Read the frames of the first message."""
        message = deserialize_message(data, self._topic.msg_type)
        texts = {'header__frame_id': getattr(getattr(message, 'header', None), 'frame_id', ''),
                 'child_frame_id': getattr(message, 'child_frame_id', '')}
        texts = {key: self._wire.frame(self._topic, name)
                 for key, name in texts.items() if name}
        try:
            self._layout = Layout(self._topic.msg_type, **texts) if texts else None
        except LayoutError:  # of no fixed size: a command
            self._layout = None
        self._plain = self._layout is None
