"""
The simulated cameras of a NatNet server: true states in, frames out, at any rate.

One server sees all drones of a hall: the rigid body of each, and all markers.

Markers, occlusion, tracker and noise are those of ``mambo_sim.sensors``, and the random numbers
are drawn in the order of ``optitrack.step``, whose rate is limited to one pose a step.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from mambo_model.motion.quaternion import multiply, Quat, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, Vec3
from mambo_sim import simulator
from mambo_sim.sensors import hall_capture, marker_occlusion, optitrack, tracker
from mambo_sim.sensors.rigid_fit import COUNT
import numpy as np
from numpy.typing import NDArray

from .axes import attitude_to_stream, to_stream
from .natnet import frame as frames, model as models
from .parameters import NatNetServerNodeParams, places

MOST = 64  # frames of one step at most: a longer one was not simulated in real time
ALL = 'all'  # Motive's set of every marker
UNLABELLED = 50_001  # first identifier of a marker without a body, as Motive numbers them
_LABELLED = frames.SEEN | frames.HAS_BODY
Array = NDArray[np.float64]
Point = tuple[int, Vec3]
Pose = tuple[Vec3, Quat]


class View(NamedTuple):
    """What the cameras saw of one body at one exposure, in the frame of its drone."""

    number: int            # of the frame, from 1
    exposure: int          # ns of the flight
    points: tuple[Vec3, ...]  # (n, 3) m, inertial NED, markers that were seen
    track: tracker.Track   # of the body


class _Body:
    """Cameras as they look at one body, as those of ``optitrack.step``."""

    def __init__(self, params: NatNetServerNodeParams, number: int) -> None:
        self._params = params
        self._values = params.markers.values(params.period)
        self._rng = simulator.generators(params.seed + number)[4]
        self._seen, self._track = marker_occlusion.ALL, optitrack.START.track
        self._defined = False

    def expose(self, number: int, exposure: int, pose: Pose | None, view: Array | None) -> View:
        """Return what frame `number` shows; view: as in ``optitrack.step``."""
        if pose is None:
            return View(number, exposure, (), self._track._replace(tracked=False))
        p, (rho, q) = self._params, pose
        if not self._defined:
            self._track, self._defined = tracker.define(exposure, rho, q), True
        shown = marker_occlusion.ALL
        if view is not None:
            rho, q, shown = marker_occlusion.view_of(view)
        points, self._seen = marker_occlusion.reconstruct(
            self._seen, rho, q, self._rng, p.noise, self._values)
        seen = marker_occlusion.both(self._seen, shown)
        self._track = tracker.step(self._track, exposure, points, seen, self._values)
        if p.noise:
            self._rng.random()  # that of a lost frame in optitrack.step
        kept = tuple(at for at, visible in zip(points, seen, strict=True) if visible)
        return self._faulty(View(number, exposure, kept, self._track))

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


class Hall:
    """
    Cameras of the simulated hall, which see all bodies in each frame.

    Parameters
    ----------
    params
        Bodies, rate, markers, noise and faults.

    """

    def __init__(self, params: NatNetServerNodeParams) -> None:
        self._params, n = params, len(params.topics)
        self._bodies = [_Body(params, number) for number in range(n)]
        self._capture = hall_capture.HallCapture(
            params.capture, places(params.places, n), [params.markers.five()] * n, params.period
        ) if params.capture.acts else None
        self._before: list[tuple[int, State] | None] = [None] * n
        self._looked = -1  # ns, stamp of the newest samples
        self._number = 0

    def look(self, t: int, states: Sequence[State | None]) -> list[tuple[View, ...]]:
        """
        Expose every frame after the previous samples of the truth up to these.

        Parameters
        ----------
        t : ns
            Stamp of the samples, later than that of those before.
        states
            True state of each body in the frame of its drone; None where it is missing.

        Returns
        -------
        frames
            View of each body.

        """
        period, first = self._params.period, self._looked < 0
        since = t - 1 if first else self._looked
        exposures = [k * period for k in range(since // period + 1, t // period + 1)]
        frames = [self._frame(at, t, states) for at in exposures[-MOST:]]
        self._looked = t
        for number, state in enumerate(states):
            if state is not None:
                self._before[number] = (t, state)
        return frames

    def _frame(self, exposure: int, t: int, states: Sequence[State | None]) -> tuple[View, ...]:
        self._number += 1
        poses: list[Pose | None] = []
        for state, last in zip(states, self._before, strict=True):
            before_t, before = last or (t - 1, state)
            poses.append(None if state is None else optitrack.interpolate(
                before, state, (exposure - before_t) / (t - before_t)))
        views: Sequence[Array | None] = [None] * len(poses)
        if self._capture is not None:
            here = np.array([pose is not None for pose in poses])
            views = self._capture.frame(exposure, np.array([
                (*pose[0], *pose[1]) if pose else (0.0,) * 7 for pose in poses]), here)
        return tuple(body.expose(self._number, exposure, pose, view)
                     for body, pose, view in zip(self._bodies, poses, views, strict=True))


def model(params: NatNetServerNodeParams) -> models.Model:
    """Return the definitions that a server streams: each body, its markers, and all markers."""
    five, bodies = params.markers.five(), list(params.topics)
    names = [f'Marker{k + 1}' for k in range(COUNT)]
    return (
        *(models.MarkerSetModel(body, tuple(names)) for body in bodies),
        models.MarkerSetModel(ALL, tuple(
            f'{body}_{k + 1}' for body in bodies for k in range(COUNT))),
        *(models.BodyModel(body, params.body_id + number, tuple(
            models.MarkerModel(to_stream(at, params.up), 0, name)
            for at, name in zip(five, names, strict=True)))
          for number, body in enumerate(bodies)))


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


class _Streamed(NamedTuple):
    """One body in a frame."""

    markers: tuple[Vec3, ...]  # (5, 3) m, axes of the stream
    body: frames.RigidBody
    labelled: list[frames.LabelledMarker]
    free: list[Vec3]           # (n, 3) m, likewise, markers without a label


def _streamed(view: View, number: int, place: Vec3, p: NatNetServerNodeParams) -> _Streamed:
    """Return the body of a number, from 0, whose drone starts at a place in the hall."""
    track, identifier = view.track, p.body_id + number
    expected = [add(track.rho, rotate(track.q, at)) for at in p.markers.five()]
    known = label(view.points, expected, p.markers.gate()) if track.tracked else {}
    taken = {index for index, _ in known.values()}
    free = [to_stream(add(at, place), p.up)
            for index, at in enumerate(view.points) if index not in taken]
    markers, labelled, error = [], [], 0.0
    for k, there in enumerate(expected):
        at = known[k][1] if k in known else there
        markers.append(to_stream(add(at, place), p.up))
        residual = math.dist(at, there)
        error += residual / max(len(known), 1)
        if track.tracked:
            labelled.append(frames.LabelledMarker(
                identifier << 16 | k + 1, markers[k], p.marker_size,
                _LABELLED if k in known else _LABELLED | frames.OCCLUDED, residual))
    body_markers = tuple(frames.BodyMarker(at, k + 1, p.marker_size)
                         for k, at in enumerate(markers))
    body = frames.RigidBody(
        identifier, to_stream(add(track.rho, place), p.up), attitude_to_stream(track.q, p.up),
        error, frames.TRACKED if track.tracked else 0, body_markers)
    return _Streamed(tuple(markers), body, labelled, free)


def content(
    views: Sequence[View], params: NatNetServerNodeParams, times: frames.Times,
) -> frames.Frame:
    """
    Return the frame that a server streams of the views of all bodies.

    Positions are those in the hall. A marker that is not seen has the place that the pose gives
    it, and the flag of an occluded one. A body that is not found has its last pose, and the flag
    says so; its markers are then without a label.
    """
    p = params
    found = [_streamed(view, number, place, p) for number, (view, place) in enumerate(zip(
        views, places(p.places, len(views)), strict=True))]
    free = [at for one in found for at in one.free]
    labelled = [marker for one in found for marker in one.labelled]
    labelled += [frames.LabelledMarker(
        UNLABELLED + k, at, p.marker_size, frames.SEEN | frames.NO_LABEL)
        for k, at in enumerate(free)]
    sets = [frames.MarkerSet(name, one.markers)
            for name, one in zip(p.topics, found, strict=True)]
    every = frames.MarkerSet(ALL, tuple(at for one in found for at in one.markers))
    return frames.Frame(
        views[0].number, times, (*sets, every), tuple(free), tuple(one.body for one in found),
        labelled=tuple(labelled))


def fullest(params: NatNetServerNodeParams) -> frames.Frame:
    """Return a frame as long as any: bodies tracked, and no marker that is seen near its place."""
    far = (1e3, 0.0, 0.0)
    track = tracker.define(0, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0))
    view = View(1, 0, tuple(add(at, far) for at in params.markers.five()), track)
    return content([view] * len(params.topics), params, frames.Times(0.0))
