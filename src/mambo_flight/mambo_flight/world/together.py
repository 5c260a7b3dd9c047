"""
Several drones flown in one hall, in one process, on one clock.

Each step the hall looks at all vehicles, then every drone reads its sensors, commands and moves,
with the compiled step of :mod:`mambo_flight.closed_loop`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mambo_model.compiled import hold, jit, set_values
from mambo_model.motion.vector import Vec3
from mambo_model.schema import ParameterError
from mambo_sim import pushed, simulator
from mambo_sim.sensors import hall_capture
from mambo_sim.sensors.hall_capture import Exchange
from mambo_sim.world import Collision, World, WorldParams

from .. import changes, closed_loop
from ..closed_loop import fly_on, Recording
from ..scenario import Scenario


class Together(NamedTuple):
    """Result of a flight of several drones."""

    recordings: list[Recording]  # of each drone, in its own frame
    collisions: list[Collision]
    exchanges: list[Exchange]  # of names in the motion capture


@jit
def _observe(held, row):
    """Store what the hall sees of a drone."""
    pushed.observe(held.memory.state.plant, row)


@jit
def _body(held, k):
    """Return the true state of a drone's body at step k."""
    p = held.values[0].simulator
    return simulator.body_at(held.memory.state.plant.body, k, p.hand, p.vehicle.gravity)


@jit
def _step(held, k, push, stop, view, row, estimating):
    """Sense, command and move on at step k; store what is seen of the drone then."""
    rngs, mocap_rng = held.rng
    p, out = held.values
    fly_on(held.memory, k, k + 1, rngs, mocap_rng, p, out, push, stop, view, held, estimating)
    pushed.observe(held.memory.state.plant, row)


def fly(
    flights: Sequence[Scenario], params: WorldParams, places: Sequence[Vec3],
    recordings: Sequence[Recording] | None = None,
) -> Together:
    """
    Fly several drones in one hall.

    Parameters
    ----------
    flights
        One scenario each, all of the same duration.
    params
        Of the hall.
    places
        Where each drone starts, (3,) m, inertial NED of the hall.
    recordings
        To be filled, of :func:`closed_loop.blank` with the columns of a bag; None: new ones.

    Returns
    -------
    together
        The same recordings as of drones that fly alone, with the columns of a bag, unless there is
        downwash, a collision stops them, or the motion capture sees what drones do to each other's
        markers.

    Raises
    ------
    ParameterError
        If the durations differ, or the drones cannot share a motion capture.

    """
    if len({closed_loop.step_count(flight) for flight in flights}) != 1:
        raise ParameterError('drones of one world need the same sim_node.duration')
    world = World(params, places, [flight.sim_node.simulator.vehicle for flight in flights])
    capture = hall_capture.of_hall(
        params.capture, places, [flight.optitrack_node.optitrack for flight in flights])
    if recordings is None:
        recordings = [closed_loop.blank(flight, inner=True) for flight in flights]
    held, later, estimating = [], [], []
    for flight, out, row in zip(flights, recordings, world.seen, strict=True):
        p = closed_loop.settings(flight)
        carry, rngs, mocap_rng = closed_loop.begin(flight, p)
        held.append(hold(carry, (rngs, mocap_rng), (p, out)))
        later.append(dict(changes.settings_later(flight, p, len(out.t))))
        _observe(held[-1], row)
        estimating.append(closed_loop.estimates(p))
    times = recordings[0].t.tolist()
    for k, t in enumerate(times):
        for one, out, new in zip(held, recordings, later, strict=True):
            if k in new:
                set_values(one, (new[k], out))
        pushes = world.look(t)
        views = [None] * len(held) if capture is None else list(
            capture.step(t, [_body(one, k) for one in held]))
        for one, push, stop, view, row, own in zip(
                held, pushes, world.stopped, views, world.seen, estimating, strict=True):
            _step(one, k, push, stop, view, row, own)
    return Together(list(recordings), world.collisions, capture.exchanges if capture else [])
