"""A smoothed flight of known numbers, for tests of what is said of it."""

from mambo_estimation.joint.state import SIZE
from mambo_flight.offline_replay import Steps
from mambo_flight.smooth.forward_pass import Forward
from mambo_flight.smooth.smoother import Smoothed
import numpy as np

N = 11


def made_up():
    """Return 11 steps, the first 3 at rest: north 1 m by the filter, 0.5 m by the smoother."""
    x, P = np.zeros((N, 24)), np.tile(np.diag(np.arange(1.0, SIZE + 1.0)), (N, 1, 1))
    x[:, 6], x[:, 3], x[:, 16] = 1.0, 2.0, 1.06
    filtered = x.copy()
    filtered[:, 0], x[:, 0] = 1.0, 0.5
    moving = np.arange(N) >= 3
    t = np.arange(N, dtype=np.int64) * 5_000_000
    return Smoothed(t, x, P, Forward(np.full(N, 0.005), filtered, P, filtered, P, moving))


def moving_in(s, moving):
    """Return a smoothed flight with other steps of motion, (N,)."""
    return s._replace(filtered=s.filtered._replace(moving=moving))


def steps():
    """Return the steps of the same flight, which turns by 0.1 rad/s."""
    s, none = made_up(), np.full(N, np.nan)
    return Steps(
        s.t, np.full(N, 0.005), np.full((N, 3), 0.1), np.zeros((N, 3)), none,
        np.full((N, 2), np.nan), np.zeros(N, np.int64), none, np.ones(N, np.bool_),
        np.zeros((N, 4), np.int64))
