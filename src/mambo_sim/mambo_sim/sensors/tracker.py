"""
Labelling of marker points and the resulting pose: the tracking software of the motion capture.

A body that was found in the previous frame is tracked: each point gets the label of the marker
nearest to it at the predicted pose. Otherwise, or if the points do not fit, the body is searched:
among all labellings the one with the least residual is used, whatever pose results. Points of a
symmetric layout fit several labellings equally well except for noise, so a body that is found
again may be off by half a turn, and is then tracked in that pose.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import Quat, rotate
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
import numpy as np

from .marker_occlusion import MarkerValues, Seen
from .rigid_fit import COUNT, fit, Fit, Five, Labels, NO_FIT, UNLABELLED

_ORDERS = np.array(list(itertools.permutations(range(COUNT))))  # (120, 5)
_HIDDEN: Labels = (UNLABELLED,) * COUNT


class Track(NamedTuple):
    """Memory of the tracker."""

    tracked: bool   # in the frame before
    exposure: int   # ns, of the frame that it was last found in
    rho: Vec3       # (3,) m, inertial NED, its pose there
    q: Quat         # (4,) w x y z, body to inertial, unit
    velocity: Vec3  # (3,) m/s, inertial NED, between the last two frames; 0 if just found


@jit
def define(exposure: int, rho: Vec3, q: Quat) -> Track:
    """Return the track of a body that is defined at its present pose, as before a flight."""
    return Track(True, exposure, rho, q, (0.0, 0.0, 0.0))


@jit
def _nearest(point: Vec3, visible: bool, places: Five, gate: float) -> int:
    """Return the marker that a point is nearest to, if any is nearer than the gate."""
    label, least = UNLABELLED, gate * gate
    if visible:
        for j in range(COUNT):
            miss = sub(point, places[j])
            square = dot(miss, miss)
            if square < least:
                label, least = j, square
    return label


@jit
def _follow(points: Five, seen: Seen, rho: Vec3, q: Quat, p: MarkerValues) -> Labels:
    """Return the labels of points by where the body is expected; none if two points claim one."""
    a, b, c, d, e = p.five
    places = (add(rho, rotate(q, a)), add(rho, rotate(q, b)), add(rho, rotate(q, c)),
              add(rho, rotate(q, d)), add(rho, rotate(q, e)))
    labels = (
        _nearest(points[0], seen[0], places, p.gate), _nearest(points[1], seen[1], places, p.gate),
        _nearest(points[2], seen[2], places, p.gate), _nearest(points[3], seen[3], places, p.gate),
        _nearest(points[4], seen[4], places, p.gate))
    for i in range(COUNT):
        for j in range(i):
            if labels[i] >= 0 and labels[i] == labels[j]:
                return _HIDDEN
    return labels


@jit
def _possible(order: np.ndarray, points: Five, seen: Seen, p: MarkerValues) -> bool:
    """
    Return whether points may be the markers of an order by the distances between them.

    Points within the deflection of their markers are as far apart as these, to twice that. Orders
    that differ only in what is hidden are one: the ascending one is looked at.
    """
    last = UNLABELLED
    for i in range(COUNT):
        if not seen[i]:
            if order[i] < last:
                return False
            last = order[i]
            continue
        for j in range(i):
            if seen[j]:
                apart = norm(sub(points[i], points[j]))
                wanted = norm(sub(p.five[order[i]], p.five[order[j]]))
                if abs(apart - wanted) > 2.0 * p.deflection:
                    return False
    return True


@jit
def search(points: Five, seen: Seen, p: MarkerValues) -> Fit:
    """
    Return the fit of least residual over all ways to call points markers.

    Parameters
    ----------
    points : (5, 3) m, inertial NED
        In any order.
    seen : (5,)
        Which of them there are.
    p
        From ``MarkerParams.values``.

    """
    best = NO_FIT
    for k in range(len(_ORDERS)):
        order = _ORDERS[k]
        if _possible(order, points, seen, p):
            found = fit(p.five, points, (
                order[0] if seen[0] else UNLABELLED, order[1] if seen[1] else UNLABELLED,
                order[2] if seen[2] else UNLABELLED, order[3] if seen[3] else UNLABELLED,
                order[4] if seen[4] else UNLABELLED))
            if found.found and found.deviation <= p.deflection and found.square < best.square:
                best = found
    return best


@jit
def _count(labels: Labels) -> int:
    """Return the number of labelled points."""
    n = 0
    for i in range(COUNT):
        n += labels[i] >= 0
    return n


@jit
def step(track: Track, exposure: int, points: Five, seen: Seen, p: MarkerValues) -> Track:
    """
    Find the body in a frame.

    Parameters
    ----------
    track
        Result of the frame before, of :func:`define` at first.
    exposure : ns
        Later than that of the frame before.
    points : (5, 3) m, inertial NED
        From ``marker_occlusion.reconstruct``. Their order is not made use of.
    seen : (5,)
        Which of them there are.
    p
        From ``MarkerParams.values``.

    Returns
    -------
    track
        Not tracked: there is no pose, and the last one is kept.

    """
    lost = Track(False, track.exposure, track.rho, track.q, (0.0, 0.0, 0.0))
    visible = seen[0] + seen[1] + seen[2] + seen[3] + seen[4]
    if visible < p.min_markers:
        return lost
    followed = track.tracked
    passed = (exposure - track.exposure) * 1e-9
    best = NO_FIT
    if followed:
        place = add(track.rho, scale(passed, track.velocity))
        labels = _follow(points, seen, place, track.q, p)
        if _count(labels) >= p.min_markers:
            best = fit(p.five, points, labels)
        followed = best.found and best.deviation <= p.deflection
    if not followed:
        best = search(points, seen, p)
    if not best.found:
        return lost
    q, old = best.q, track.q
    if q[0] * old[0] + q[1] * old[1] + q[2] * old[2] + q[3] * old[3] < 0.0:
        q = (-q[0], -q[1], -q[2], -q[3])
    velocity = (0.0, 0.0, 0.0)
    if track.tracked and passed > 0.0:
        velocity = scale(1.0 / passed, sub(best.rho, track.rho))
    return Track(True, exposure, best.rho, q, velocity)
