"""Flights whose every number is known, without flying: what tests of figures look at."""

from types import SimpleNamespace

from mambo_thesis.figures.flights import Flight, STEP
import numpy as np


def made(truth, estimate=None, reference=None, seconds=30.0, flow=None, imu=None):
    """
    Return a flight.

    Parameters
    ----------
    truth, estimate, reference
        Of t, (n,) s: positions (n, 3) m, inertial NED; the last two default to the truth.
    seconds
        Of the flight, a row each 5 ms.
    flow, imu
        Of t: flow (n, 2) rad/s; gyro and accelerometer (n, 6).

    """
    flight = object.__new__(Flight)
    flight.t = t = np.arange(round(seconds / STEP)) * STEP

    def states(position):
        rows = np.zeros((len(t), 13))
        rows[:, :3], rows[:, 6] = position(t), 1.0
        return rows
    samples = np.full((len(t), 3), np.nan)
    if flow is not None:
        samples[:, :2], samples[:, 2] = flow(t), 200.0
    flight.recording = SimpleNamespace(
        truth=states(truth), estimate=states(estimate or truth),
        reference=states(reference or truth), flow=samples,
        imu=np.zeros((len(t), 6)) if imu is None else imu(t), pwm=np.full((len(t), 4), 250.0))
    flight.scenario = None
    return flight


def path(x=0.0, y=0.0, z=-1.5):
    """Return a position of t; each coordinate is a number or a function of t."""
    def position(t):
        return np.stack([np.broadcast_to(c(t) if callable(c) else c, t.shape)
                         for c in (x, y, z)], axis=1)
    return position
