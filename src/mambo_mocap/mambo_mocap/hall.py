"""
The simulated cameras of a NatNet server: true states in, frames out, at any rate.

Markers, occlusion, tracker and noise are those of ``mambo_sim.sensors``, and the random numbers
are drawn in the order of ``optitrack.step``, whose rate is limited to one pose a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.motion.quaternion import multiply, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, Vec3
from mambo_sim import simulator
from mambo_sim.sensors import marker_occlusion, optitrack, tracker
from mambo_sim.sensors.rigid_fit import COUNT

from .axes import attitude_to_stream, to_stream
from .natnet import frame as frames, model as models
from .parameters import NatNetServerNodeParams

MOST = 64  # frames of one step at most: a longer one was not simulated in real time
ALL = 'all'  # Motive's set of every marker
UNLABELLED = 50_001  # first identifier of a marker without a body, as Motive numbers them
_LABELLED = frames.SEEN | frames.HAS_BODY
Point = tuple[int, Vec3]


class View(NamedTuple):
    """What the cameras saw at one exposure."""

    number: int            # of the frame, from 1
    exposure: int          # ns of the flight
    points: tuple[Vec3, ...]  # (n, 3) m, inertial NED, markers that were seen
    track: tracker.Track   # of the body


class Hall:
    """
    Cameras of the simulated hall.

    Parameters
    ----------
    params
        Rate, markers, noise and faults.

    """

    def __init__(self, params: NatNetServerNodeParams) -> None:
        self._params = params
        self._values = params.markers.values(params.period)
        self._rng = simulator.generators(params.seed)[4]
        self._seen, self._track = marker_occlusion.ALL, optitrack.START.track
        self._before: tuple[int, State] | None = None
        self._number = 0

    def look(self, t: int, state: State) -> list[View]:
        """
        Expose every frame after the previous sample of the truth up to this one.

        Parameters
        ----------
        t : ns
            Stamp of the sample, later than that of the one before.
        state
            The true state.

        """
        period = self._params.period
        before_t, before = (t - 1, state) if self._before is None else self._before
        self._before = (t, state)
        first = before_t // period + 1
        exposures = [k * period for k in range(first, t // period + 1)]
        return [self._expose(at, optitrack.interpolate(
            before, state, (at - before_t) / (t - before_t))) for at in exposures[-MOST:]]

    def _expose(self, exposure: int, pose: tuple) -> View:
        p, (rho, q) = self._params, pose
        if not self._number:
            self._track = tracker.define(exposure, rho, q)
        points, self._seen = marker_occlusion.reconstruct(
            self._seen, rho, q, self._rng, p.noise, self._values)
        self._track = tracker.step(self._track, exposure, points, self._seen, self._values)
        if p.noise:
            self._rng.random()  # that of a lost frame in optitrack.step
        self._number += 1
        seen = tuple(at for at, visible in zip(points, self._seen, strict=True) if visible)
        return self._faulty(View(self._number, exposure, seen, self._track))

    def _faulty(self, view: View) -> View:
        """Return what the cameras say where they have a fault."""
        p, track = self._params, view.track
        if p.fault == 'none' or not p.fault_begin <= view.exposure * 1e-9 < p.fault_end:
            return view
        if p.fault == 'lost':
            return view._replace(points=(), track=track._replace(tracked=False))
        if p.fault == 'flip':
            return view._replace(track=track._replace(q=multiply(track.q, (0.0, 0.0, 0.0, 1.0))))
        shift = (p.fault_distance, 0.0, 0.0)
        return view._replace(points=tuple(add(at, shift) for at in view.points),
                             track=track._replace(rho=add(track.rho, shift)))


def model(params: NatNetServerNodeParams) -> models.Model:
    """Return the definitions that a server streams: the body, its markers, and all markers."""
    five = params.markers.five()
    names = [f'Marker{k + 1}' for k in range(COUNT)]
    return (
        models.MarkerSetModel(params.body, tuple(names)),
        models.MarkerSetModel(ALL, tuple(f'{params.body}_{k + 1}' for k in range(COUNT))),
        models.BodyModel(params.body, params.body_id, tuple(
            models.MarkerModel(to_stream(at, params.up), 0, name)
            for at, name in zip(five, names, strict=True))))


def label(points: tuple[Vec3, ...], places: list[Vec3], gate: float) -> dict[int, Point]:
    """
    Return {marker: (index, position) of the point nearest to its place}.

    Parameters
    ----------
    points : (n, 3) m
        Markers that were seen.
    places : (5, 3) m
        Where they are expected.
    gate : m
        Farther points are not that marker.

    """
    found: dict[int, Point] = {}
    for index, at in enumerate(points):
        apart = [math.dist(at, place) for place in places]
        nearest = min(range(COUNT), key=apart.__getitem__)
        if apart[nearest] < gate and nearest not in found:
            found[nearest] = (index, at)
    return found


def content(view: View, params: NatNetServerNodeParams, times: frames.Times) -> frames.Frame:
    """
    Return the frame that a server streams of a view.

    A marker that is not seen has the place that the pose gives it, and the flag of an occluded
    one. A body that is not found has its last pose, and the flag says so; its markers are then
    without a label.
    """
    p, track = params, view.track
    places = [add(track.rho, rotate(track.q, at)) for at in p.markers.five()]
    known = label(view.points, places, p.markers.gate()) if track.tracked else {}
    taken = {index for index, _ in known.values()}
    free = [to_stream(at, p.up) for index, at in enumerate(view.points) if index not in taken]
    streamed, labelled, error = [], [], 0.0
    for k, place in enumerate(places):
        at = known[k][1] if k in known else place
        streamed.append(to_stream(at, p.up))
        residual = math.dist(at, place)
        error += residual / max(len(known), 1)
        if track.tracked:
            labelled.append(frames.LabelledMarker(
                p.body_id << 16 | k + 1, streamed[k], p.marker_size,
                _LABELLED if k in known else _LABELLED | frames.OCCLUDED, residual))
    labelled += [frames.LabelledMarker(
        UNLABELLED + k, at, p.marker_size, frames.SEEN | frames.NO_LABEL)
        for k, at in enumerate(free)]
    body_markers = tuple(frames.BodyMarker(at, k + 1, p.marker_size)
                         for k, at in enumerate(streamed))
    body = frames.RigidBody(
        p.body_id, to_stream(track.rho, p.up), attitude_to_stream(track.q, p.up), error,
        frames.TRACKED if track.tracked else 0, body_markers)
    return frames.Frame(
        view.number, times,
        (frames.MarkerSet(p.body, tuple(streamed)), frames.MarkerSet(ALL, tuple(streamed))),
        tuple(free), (body,), labelled=tuple(labelled))
