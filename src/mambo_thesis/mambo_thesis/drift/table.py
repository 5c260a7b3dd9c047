"""
The table of mechanisms: drift per turn of each path, with the simulated sensor and no noise.

Sensor errors are parameters of :mod:`mambo_sim.sensors.optical_flow`. Estimator errors are wrong
ways to compute a velocity from the flow, written out here. ``Row.audit`` holds the values of an
independent derivation, rounded to 1 mm, or to 1 cm for G.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
from typing import Any, NamedTuple

from mambo_model.motion.rigid_body import State
from mambo_sim.sensors.optical_flow import deliver, OpticalFlowParams
import numpy as np
from scipy.spatial.transform import Rotation

from .mechanisms import dead_reckoned
from .paths import Array, DRAG_RATE, one_turn, PATHS, Track

EXACT = {'factor_offset': 1.0, 'factor_slope': 0.0}
Estimator = Callable[[Track, Array], Array]


def exact_velocity(track: Track, flow: Array) -> Array:
    """Return the horizontal velocity (5.2), (n, 2) m/s, for flow times factor, (n, 2) rad/s."""
    return dead_reckoned(track, flow)


def without_tilt(track: Track, flow: Array) -> Array:
    """Return (5.2) with the height in place of the depth Z (C1)."""
    return dead_reckoned(track, flow * track.R[:, 2, 2][:, None])


def without_rotation(track: Track, flow: Array) -> Array:
    """Return the body velocity without rotation to inertial axes (C2)."""
    return track.depth[:, None] * flow


def without_coriolis(track: Track, flow: Array) -> Array:
    """Return (5.2) with the error omega x nu / L of a filter with gain L = 1/s (G)."""
    missing = np.cross(track.omega, track.nu)[:, :2]
    return dead_reckoned(track, flow + missing / track.depth[:, None])


class Row(NamedTuple):
    """
    A row of the table: a mechanism, its audited drift and how to simulate it.

    Attributes
    ----------
    description
    audit
        Drift (x, y) on each of ``PATHS``, m; NaN: not given.
    sensor
        Parameters of the simulated sensor.
    scale
        Factor Q0 of the estimator.
    estimator
        Computes the velocity from the flow.
    drag_rate : 1/s
        Rotor drag that tilts the vehicle.

    """

    description: str
    audit: tuple[tuple[float, float], ...]
    sensor: Mapping[str, Any] = EXACT
    scale: float = 1.0
    estimator: Estimator = exact_velocity
    drag_rate: float = 0.0


def _audit(x53: float, y54: float, x56: float, c4: float, hand: float, x54: float = 0.0,
        x55: float = 0.0, x41: float | None = None) -> tuple[tuple[float, float], ...]:
    """Return the drift on all PATHS from the independent values of a row."""
    return ((x53, 0.0), (x54, y54), (y54, x54), (x55, 0.0), (x56, 0.0), (c4, 0.0),
            (x55 if x41 is None else x41, x56), (hand, 0.0))


UNKNOWN = float('nan')
ROWS = {
    'A': Row('Q = 0.92 + 0.07 h, estimator 1.06', _audit(0, .233, .058, .233, .223), {}, 1.06),
    'A2': Row('slope 0.10, estimator Q(1.5 m)', _audit(0, .295, .073, .295, .296),
              {'factor_slope': 0.1}, 1.07),
    'A3': Row('Q = 0.95 + 0.011 exp(h)', _audit(0, .167, .039, .166, .169),
              {'factor_law': 'exponential', 'factor_offset': 0.95, 'factor_slope': 0.011}),
    'H': Row('height offset 0.14 m', _audit(0, .278, .049, .278, .275),
             {**EXACT, 'height_offset': 0.14}, 1.5 / 1.64),
    'B': Row('height lags 0.1 s', _audit(0, .016, .003, .016, .016, -.237, -.054),
             {**EXACT, 'height_delay': 0.1}),
    'C1': Row('tilt ignored in Z', _audit(0, .002, 0, 0, 0), estimator=without_tilt),
    'C2': Row('not rotated to inertial axes', _audit(0, .319, .080, .321, 0),
              estimator=without_rotation),
    'C2 drag': Row('as C2, tilted by drag', _audit(0, .320, .080, .321, 0, -.170, -.043),
                   estimator=without_rotation, drag_rate=DRAG_RATE),
    'D1': Row('rotational flow left in', _audit(0, -.322, -.080, -.320, 0),
              {**EXACT, 'leakage': 1.0}),
    'D2': Row('rotational flow removed twice', _audit(0, .322, .080, .320, 0),
              {**EXACT, 'leakage': -1.0}),
    'D2 drag': Row('as D2, tilted by drag', _audit(0, .322, .080, .320, 0, -.174, -.043),
                   {**EXACT, 'leakage': -1.0}, drag_rate=DRAG_RATE),
    'E': Row('vertical coupling 0.05', _audit(0, 0, 0, 0, 0),
             {**EXACT, 'vertical_coupling': (0.05, 0.05)}),
    'F': Row('flow (1 + 0.1 flow^2)', _audit(0, .387, .011, .389, .368),
             {**EXACT, 'nonlinearity': 0.1}),
    'G': Row('Coriolis term missing, filter gain 1/s, tilted by drag',
             ((0, 0), (-.32, -.17), (-.17, -.32), (-.08, 0), (-.04, 0), (-.17, 0),
              (UNKNOWN, UNKNOWN), (0, 0)), estimator=without_coriolis, drag_rate=DRAG_RATE),
    'I': Row('scale error 3 %', _audit(0, .010, .002, .010, 0), {'factor_offset': 1 / 1.03,
                                                              'factor_slope': 0.0}),
}


def sensed(track: Track, sensor: Mapping[str, Any], earlier: Track) -> Array:
    """Return the output of the simulated sensor, (n, 2) rad/s, with heights from ``earlier``."""
    p = OpticalFlowParams(**sensor)
    v, q = p.values(), Rotation.from_matrix(track.R).as_quat()
    out = np.empty((len(track.t), 2))
    for k, (rho, nu, (x, y, z, w), omega, height) in enumerate(zip(
            track.position.tolist(), track.nu.tolist(), q.tolist(), track.omega.tolist(),
            earlier.height.tolist(), strict=True)):
        body = State(tuple(rho), tuple(nu), (w, x, y, z), tuple(omega))
        out[k] = deliver(body, height + p.height_offset, v)
    return out


def estimated(row: Row, turn: Track, scale: float | Array) -> Array:
    """
    Return the horizontal velocity, (n, 2) m/s, that an estimator computes over a whole turn.

    Parameters
    ----------
    row
        The mechanism.
    turn
        True motion.
    scale
        Factor of the estimator, one number, or (n,) one for each instant.

    """
    T = (turn.t[1] - turn.t[0]) * len(turn.t)
    delay = dataclasses.asdict(OpticalFlowParams(**row.sensor))['height_delay']
    earlier = turn
    if delay:
        before = np.interp((turn.t - delay) % T, np.append(turn.t, T),
                           np.append(turn.height, turn.height[0]))
        earlier = turn._replace(position=np.column_stack([turn.position[:, :2], -before]))
    factors = np.broadcast_to(scale, (len(turn.t),))[:, None]
    return row.estimator(turn, factors * sensed(turn, row.sensor, earlier))


def drift(row: Row, path: str, speed: float = 1.0, size: float = 1.0) -> Array:
    """Return the drift in x and y over one turn of a path, (2,) m."""
    turn = one_turn(path, speed, size, row.drag_rate)
    return moved(turn, estimated(row, turn, row.scale))


def moved(turn: Track, velocity: Array) -> Array:
    """Return how far an estimated velocity, (n, 2) m/s, goes astray in a turn, (2,) m."""
    T = (turn.t[1] - turn.t[0]) * len(turn.t)
    return (velocity - turn.velocity[:, :2]).mean(axis=0) * T


def table() -> dict[str, Array]:
    """Return the whole table as {row: drift (paths, 2) m}."""
    return {name: np.array([drift(row, path) for path in PATHS]) for name, row in ROWS.items()}
