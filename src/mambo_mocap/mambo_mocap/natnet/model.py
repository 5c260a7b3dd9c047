"""
Model definitions: names, identifiers and markers of what a server streams.

Marker sets and rigid bodies are read; skeletons, force plates, devices, cameras and trained
markersets are kept as bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from .wire import (
    check, INT, message, MODEL, PacketError, payload, Quat, Reader, section, SIZED, text, Vec3,
    VECTOR, Version)

MARKER_SET, RIGID_BODY, SKELETON, FORCE_PLATE, DEVICE, CAMERA = range(6)
NO_PARENT = -1

_PARENT, _ATTITUDE = struct.Struct('<2i3f'), struct.Struct('<4f')
_PLATE = struct.Struct('<158f')  # width, length, origin, calibration matrix, corners
_CAMERA = struct.Struct('<7f')


class MarkerSetModel(NamedTuple):
    """Names of the markers of an asset."""

    name: str
    markers: tuple[str, ...]


class MarkerModel(NamedTuple):
    """Marker of a rigid body, since version 3.0."""

    position: Vec3  # (3,) m, axes of the body
    label: int = 0  # of an active marker, else 0
    name: str = ''  # since 4.0


class BodyModel(NamedTuple):
    """Definition of a rigid body."""

    name: str
    identifier: int
    markers: tuple[MarkerModel, ...] = ()
    parent: int = NO_PARENT
    offset: Vec3 = (0.0, 0.0, 0.0)  # (3,) m, from the parent
    attitude: Quat = (0.0, 0.0, 0.0, 1.0)  # (4,) x y z w, from the parent, since 4.2


class OtherModel(NamedTuple):
    """Definition of anything else, as it came."""

    kind: int
    data: bytes


Model = tuple[MarkerSetModel | BodyModel | OtherModel, ...]


def _read_set(reader: Reader) -> MarkerSetModel:
    name = reader.string('the name of a marker set')
    n = reader.count(1, f'markers of {name!r}')
    return MarkerSetModel(name, tuple(reader.string('a marker') for _ in range(n)))


def _read_body(reader: Reader, version: Version) -> BodyModel:
    name = reader.string('the name of a rigid body')
    identifier, parent, *offset = reader.take(_PARENT, f'the rigid body {name!r}')
    attitude = (0.0, 0.0, 0.0, 1.0)
    if version >= (4, 2):
        attitude = reader.take(_ATTITUDE, f'the rigid body {name!r}')
    markers: tuple[MarkerModel, ...] = ()
    if version >= (3, 0):
        n = reader.count(VECTOR.size + INT.size, f'markers of {name!r}')
        places = reader.many(VECTOR, n, 'the markers of a rigid body')
        labels = reader.many(INT, n, 'the markers of a rigid body')
        names = [reader.string('a marker') if version >= (4, 0) else '' for _ in range(n)]
        markers = tuple(MarkerModel(at, label[0], one) for at, label, one in zip(
            places, labels, names, strict=True))
    return BodyModel(name, identifier, markers, parent, tuple(offset), attitude)


def _skip(reader: Reader, kind: int, version: Version) -> None:
    """Move on behind a definition that tells no size."""
    if kind == SKELETON:
        reader.string('the name of a skeleton')
        reader.take(INT, 'a skeleton')
        for _ in range(reader.count(_PARENT.size, 'bones')):
            _read_body(reader, version)
    elif kind in (FORCE_PLATE, DEVICE):
        reader.take(INT, 'a device')
        reader.string('a device')
        if kind == FORCE_PLATE:
            reader.take(_PLATE, 'a force plate')
        else:
            reader.string('a device')
        reader.raw(2 * INT.size, 'a device')
        for _ in range(reader.count(1, 'channels')):
            reader.string('a channel')
    elif kind == CAMERA:
        reader.string('a camera')
        reader.take(_CAMERA, 'a camera')
    else:
        raise PacketError(f'definition of unknown kind {kind}')


def _read(reader: Reader, version: Version) -> MarkerSetModel | BodyModel | OtherModel:
    """Return the next definition."""
    kind = reader.take(INT, 'a definition')[0]
    part = reader.section(version >= SIZED, 'a definition')
    model: MarkerSetModel | BodyModel | OtherModel
    if kind == MARKER_SET:
        model = _read_set(part)
    elif kind == RIGID_BODY:
        model = _read_body(part, version)
    else:
        begin = part.at
        if part is reader:
            _skip(part, kind, version)
        else:
            part.at = part.end
        model = OtherModel(kind, part.data[begin:part.at])
    if part is not reader:
        part.close('a definition')
    return model


def decode_model(data: bytes, version: Version) -> Model:
    """
    Return the definitions in a packet, in their order.

    Raises
    ------
    PacketError
        If it is no reply to a request for definitions in this version.

    """
    check(version)
    reader = payload(data, MODEL)
    n = reader.count(2 * INT.size, 'definitions')
    model = tuple(_read(reader, version) for _ in range(n))
    reader.close('the model')
    return model


def bodies(model: Model) -> tuple[tuple[int, str], ...]:
    """Return identifier and name of each rigid body; both may repeat."""
    return tuple((body.identifier, body.name) for body in model if isinstance(body, BodyModel))


def _write_body(body: BodyModel, version: Version) -> bytes:
    out = text(body.name) + _PARENT.pack(body.identifier, body.parent, *body.offset)
    if version >= (4, 2):
        out += _ATTITUDE.pack(*body.attitude)
    if version < (3, 0):
        return out
    out += INT.pack(len(body.markers))
    out += b''.join(VECTOR.pack(*marker.position) for marker in body.markers)
    out += b''.join(INT.pack(marker.label) for marker in body.markers)
    return out + b''.join(
        text(marker.name) for marker in body.markers if version >= (4, 0))


def _write(one: MarkerSetModel | BodyModel | OtherModel, version: Version) -> bytes:
    if isinstance(one, MarkerSetModel):
        kind = MARKER_SET
        body = text(one.name) + INT.pack(len(one.markers)) + b''.join(map(text, one.markers))
    elif isinstance(one, BodyModel):
        kind, body = RIGID_BODY, _write_body(one, version)
    else:
        kind, body = one
    return INT.pack(kind) + section(body, version >= SIZED)


def encode_model(model: Model, version: Version) -> bytes:
    """
    Return the packet that replies to a request for definitions.

    Raises
    ------
    PacketError
        If the version is unknown, or the definitions do not fit into a packet or its fields.

    """
    check(version)
    try:
        return message(MODEL, INT.pack(len(model)) + b''.join(
            _write(one, version) for one in model))
    except (struct.error, OverflowError) as error:
        raise PacketError(f'a number of the model does not fit: {error}') from None
