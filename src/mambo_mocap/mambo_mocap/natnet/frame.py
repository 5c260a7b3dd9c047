"""
Frames of data: what the cameras saw at one exposure.

A packet holds these sections in this order. Numbers in brackets: the first version that has them.

1. marker sets; 2. markers without a label; 3. rigid bodies; 4. skeletons; 5. assets [4.1];
6. labelled markers; 7. force plates [2.9]; 8. devices [2.11]; 9. times and flags.

Positions are in metres, attitudes x y z w, both in the axes that the server streams.
"""

from __future__ import annotations

from collections.abc import Callable
import struct
from typing import NamedTuple

from .wire import (
    check, FRAME, INT, message, PacketError, payload, Quat, Reader, section, SIZED, text, Vec3,
    VECTOR, Version)

TRACKED = 0x01  # flag of a rigid body
OCCLUDED, SEEN, FILLED_IN, HAS_BODY, NO_LABEL = 0x01, 0x02, 0x04, 0x08, 0x10  # of a marker
RECORDING, MODELS_CHANGED = 0x01, 0x02  # of a frame

_BODY = struct.Struct('<i7f')
_FLOAT, _DOUBLE, _SHORT = struct.Struct('<f'), struct.Struct('<d'), struct.Struct('<h')
_STAMPS, _PAIR = struct.Struct('<3Q'), struct.Struct('<2I')
_LABELLED = (  # first version, layout of a labelled marker and how many values that are
    ((3, 0), struct.Struct('<i4fhf'), 7), ((2, 6), struct.Struct('<i4fh'), 6),
    ((0, 0), struct.Struct('<i4f'), 5))


class MarkerSet(NamedTuple):
    """Markers of an asset by its name."""

    name: str
    positions: tuple[Vec3, ...]  # (n, 3) m


class BodyMarker(NamedTuple):
    """Marker of a rigid body, before version 3.0."""

    position: Vec3  # (3,) m
    label: int
    size: float     # m, diameter


class RigidBody(NamedTuple):
    """Pose of a rigid body."""

    identifier: int
    position: Vec3     # (3,) m; zeros or the last one if it is not tracked
    attitude: Quat     # (4,) x y z w
    error: float       # m, mean distance of the markers from where they should be
    flags: int = TRACKED  # since 2.6
    markers: tuple[BodyMarker, ...] = ()  # before 3.0

    @property
    def tracked(self) -> bool:
        """Return whether the body was found in this frame."""
        return bool(self.flags & TRACKED)


class LabelledMarker(NamedTuple):
    """A marker with its label: body in the upper, marker in the lower 16 bits."""

    identifier: int
    position: Vec3   # (3,) m
    size: float      # m, diameter
    flags: int = 0   # since 2.6
    residual: float = 0.0  # m, since 3.0


class Skeleton(NamedTuple):
    """Bones of a skeleton."""

    identifier: int
    bones: tuple[RigidBody, ...]


class Channels(NamedTuple):
    """Samples of a force plate or another device."""

    identifier: int
    channels: tuple[tuple[float, ...], ...]


class Assets(NamedTuple):
    """Trained markersets, since 4.1; kept as they came."""

    count: int = 0
    data: bytes = b''


class Times(NamedTuple):
    """Times of a frame; ticks are those of the server's clock."""

    timestamp: float       # s since the server began to stream, at the exposure
    exposure: int = 0      # ticks, middle of the exposure, since 3.0
    received: int = 0      # ticks, camera data at the server, since 3.0
    transmitted: int = 0   # ticks, since 3.0
    latency: float = 0.0   # s, software latency, before 3.0
    timecode: tuple[int, int] = (0, 0)   # SMPTE, with subframe
    precision: tuple[int, int] = (0, 0)  # s and fraction of the precision clock, since 4.1


class Frame(NamedTuple):
    """One frame of data."""

    number: int
    times: Times
    marker_sets: tuple[MarkerSet, ...] = ()
    others: tuple[Vec3, ...] = ()  # (n, 3) m, markers without a label
    bodies: tuple[RigidBody, ...] = ()
    skeletons: tuple[Skeleton, ...] = ()
    assets: Assets = Assets()
    labelled: tuple[LabelledMarker, ...] = ()
    plates: tuple[Channels, ...] = ()
    devices: tuple[Channels, ...] = ()
    flags: int = 0


def _layout(version: Version) -> tuple[struct.Struct, int]:
    """Return the layout of a labelled marker and the number of its values."""
    return next((layout, n) for first, layout, n in _LABELLED if version >= first)


def _read_set(reader: Reader, version: Version) -> MarkerSet:
    name = reader.string('the name of a marker set')
    n = reader.count(VECTOR.size, f'markers of {name!r}')
    return MarkerSet(name, tuple(reader.many(VECTOR, n, 'a marker set')))


def _read_other(reader: Reader, version: Version) -> Vec3:
    return reader.take(VECTOR, 'a marker')


def _read_body(reader: Reader, version: Version) -> RigidBody:
    identifier, x, y, z, *attitude = reader.take(_BODY, 'a rigid body')
    markers: tuple[BodyMarker, ...] = ()
    if version < (3, 0):
        n = reader.count(20, 'markers of a rigid body')
        places = reader.many(VECTOR, n, 'a rigid body')
        labels = reader.many(INT, n, 'a rigid body')
        sizes = reader.many(_FLOAT, n, 'a rigid body')
        markers = tuple(BodyMarker(at, label[0], size[0]) for at, label, size in zip(
            places, labels, sizes, strict=True))
    error = reader.take(_FLOAT, 'a rigid body')[0]
    flags = reader.take(_SHORT, 'a rigid body')[0] if version >= (2, 6) else TRACKED
    return RigidBody(identifier, (x, y, z), tuple(attitude), error, flags, markers)


def _read_skeleton(reader: Reader, version: Version) -> Skeleton:
    identifier = reader.take(INT, 'a skeleton')[0]
    n = reader.count(_BODY.size, 'bones')
    return Skeleton(identifier, tuple(_read_body(reader, version) for _ in range(n)))


def _read_labelled(reader: Reader, version: Version) -> LabelledMarker:
    identifier, x, y, z, *rest = reader.take(_layout(version)[0], 'a labelled marker')
    return LabelledMarker(identifier, (x, y, z), *rest)


def _read_channels(reader: Reader, version: Version) -> Channels:
    identifier = reader.take(INT, 'a device')[0]
    channels = []
    for _ in range(reader.count(INT.size, 'channels')):
        n = reader.count(_FLOAT.size, 'samples of a channel')
        channels.append(tuple(value for value, in reader.many(_FLOAT, n, 'a channel')))
    return Channels(identifier, tuple(channels))


def _read_times(reader: Reader, version: Version) -> tuple[Times, int]:
    """Return the times and the flags of a frame."""
    latency = reader.take(_FLOAT, 'the latency')[0] if version < (3, 0) else 0.0
    timecode = reader.take(_PAIR, 'the timecode')
    if version < (2, 6):  # Motive 1.5 streams its time as the latency, and no flags
        return Times(latency, latency=latency, timecode=timecode), 0
    timestamp = reader.take(_DOUBLE if version >= (2, 7) else _FLOAT, 'the timestamp')[0]
    stamps = reader.take(_STAMPS, 'the stamps') if version >= (3, 0) else (0, 0, 0)
    precision = reader.take(_PAIR, 'the precision timestamp') if version >= SIZED else (0, 0)
    flags = reader.take(_SHORT, 'the flags')[0]
    return Times(timestamp, *stamps, latency, timecode, precision), flags


def _read_all(reader: Reader, version: Version, read: Callable, least: int, what: str) -> tuple:
    """Return the elements of a section."""
    n = reader.count(least, what)
    part = reader.section(version >= SIZED, what)
    if n * least > part.end - part.at:
        raise PacketError(f'{n} {what} do not fit into {part.end - part.at} bytes')
    found = tuple(read(part, version) for _ in range(n))
    if part is not reader:
        part.close(what)
    return found


def decode_frame(data: bytes, version: Version) -> Frame:
    """
    Return the frame in a packet.

    Parameters
    ----------
    data
        The packet.
    version
        Of the server that sent it.

    Raises
    ------
    PacketError
        If it is not a frame of this version.

    """
    check(version)
    reader = payload(data, FRAME)
    number = reader.take(INT, 'the frame number')[0]
    assets = Assets()
    sets = _read_all(reader, version, _read_set, 5, 'marker sets')
    others = _read_all(reader, version, _read_other, VECTOR.size, 'markers')
    bodies = _read_all(reader, version, _read_body, _BODY.size, 'rigid bodies')
    skeletons = _read_all(reader, version, _read_skeleton, 8, 'skeletons')
    if version >= SIZED:
        n = reader.count(0, 'assets')
        part = reader.section(True, 'assets')
        assets = Assets(n, part.raw(part.end - part.at, 'assets'))
    labelled = _read_all(
        reader, version, _read_labelled, _layout(version)[0].size, 'labelled markers')
    plates = _read_all(
        reader, version, _read_channels, 8, 'force plates') if version >= (2, 9) else ()
    devices = _read_all(
        reader, version, _read_channels, 8, 'devices') if version >= (2, 11) else ()
    times, flags = _read_times(reader, version)
    if reader.take(INT, 'the end of the frame')[0]:
        raise PacketError('the frame does not end with zeros')
    reader.close('the frame')
    return Frame(number, times, sets, others, bodies, skeletons, assets, labelled, plates,
                 devices, flags)


def _positions(positions: tuple[Vec3, ...]) -> bytes:
    return INT.pack(len(positions)) + b''.join(VECTOR.pack(*at) for at in positions)


def _write_body(body: RigidBody, version: Version) -> bytes:
    out = _BODY.pack(body.identifier, *body.position, *body.attitude)
    if version < (3, 0):
        out += _positions(tuple(marker.position for marker in body.markers))
        out += b''.join(INT.pack(marker.label) for marker in body.markers)
        out += b''.join(_FLOAT.pack(marker.size) for marker in body.markers)
    out += _FLOAT.pack(body.error)
    return out + (_SHORT.pack(body.flags) if version >= (2, 6) else b'')


def _write_skeleton(skeleton: Skeleton, version: Version) -> bytes:
    return INT.pack(skeleton.identifier) + INT.pack(len(skeleton.bones)) + b''.join(
        _write_body(bone, version) for bone in skeleton.bones)


def _write_labelled(marker: LabelledMarker, version: Version) -> bytes:
    values = (marker.identifier, *marker.position, marker.size, marker.flags, marker.residual)
    layout, n = _layout(version)
    return layout.pack(*values[:n])


def _write_channels(device: Channels, version: Version) -> bytes:
    return INT.pack(device.identifier) + INT.pack(len(device.channels)) + b''.join(
        INT.pack(len(samples)) + struct.pack(f'<{len(samples)}f', *samples)
        for samples in device.channels)


def _write_times(times: Times, flags: int, version: Version) -> bytes:
    if version < (2, 6):
        return _FLOAT.pack(times.timestamp) + _PAIR.pack(*times.timecode) + INT.pack(0)
    return b''.join((
        _FLOAT.pack(times.latency) if version < (3, 0) else b'', _PAIR.pack(*times.timecode),
        (_DOUBLE if version >= (2, 7) else _FLOAT).pack(times.timestamp),
        _STAMPS.pack(times.exposure, times.received, times.transmitted)
        if version >= (3, 0) else b'',
        _PAIR.pack(*times.precision) if version >= SIZED else b'', _SHORT.pack(flags),
        INT.pack(0)))


def encode_frame(frame: Frame, version: Version) -> bytes:
    """
    Return the packet of a frame; what a version does not have is left out.

    Raises
    ------
    PacketError
        If the version is unknown, or the frame does not fit into a packet or its fields.

    """
    check(version)

    def all_of(parts: list[bytes], count: int) -> bytes:
        return INT.pack(count) + section(b''.join(parts), version >= SIZED)

    def each(write: Callable, items: tuple) -> bytes:
        return all_of([write(item, version) for item in items], len(items))

    try:
        return message(FRAME, b''.join((
            INT.pack(frame.number),
            all_of([text(one.name) + _positions(one.positions) for one in frame.marker_sets],
                   len(frame.marker_sets)),
            all_of([VECTOR.pack(*at) for at in frame.others], len(frame.others)),
            each(_write_body, frame.bodies), each(_write_skeleton, frame.skeletons),
            all_of([frame.assets.data], frame.assets.count) if version >= SIZED else b'',
            each(_write_labelled, frame.labelled),
            each(_write_channels, frame.plates) if version >= (2, 9) else b'',
            each(_write_channels, frame.devices) if version >= (2, 11) else b'',
            _write_times(frame.times, frame.flags, version))))
    except (struct.error, OverflowError) as error:
        raise PacketError(f'frame {frame.number}: a number does not fit: {error}') from None
