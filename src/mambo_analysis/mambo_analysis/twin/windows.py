r"""
Prediction error of a force model in half-second windows that start at recorded states.

From position and velocity at the beginning of a window,

.. math:: \dot p = v, \quad \dot v = R(q) f - g e_3,

is integrated with the recorded attitude :math:`q`, and :math:`f` from motor commands, battery and
the velocity of the prediction itself (:mod:`mambo_analysis.twin.force`). The error at the end
is compared with that of a constant velocity, the best prediction without a model.

The thrust of a motor falls by some per cent as it warms, and no two flights begin alike. What the
accelerometer showed beyond the model in the second before a window, in the mean, is therefore
added to the force, unless ``past`` is 0: it is known when the window begins.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .force import ForceModel
from .recorded import GRAVITY, Recorded, STEP

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

HORIZON = 0.5     # s
EVERY = 0.1       # s from window to window
PAST = 1.0        # s before a window, in which the accelerometer corrects the model


class Windows(NamedTuple):
    """Errors at the end of each window, (k, 3) m: of the model and of constant velocity."""

    model: Floats
    constant: Floats

    @property
    def mae(self) -> Floats:
        """Return the mean absolute error of the model, (3,) m."""
        return np.abs(self.model).mean(axis=0)

    @property
    def constant_mae(self) -> Floats:
        """Return the mean absolute error of constant velocity, (3,) m."""
        return np.abs(self.constant).mean(axis=0)

    @property
    def ratio(self) -> float:
        """Return the mean distance of the model over that of constant velocity."""
        return float(np.linalg.norm(self.model, axis=1).mean()
                     / np.linalg.norm(self.constant, axis=1).mean())


def starts(flight: Recorded, horizon: float, past: float, every: float = EVERY) -> Ints:
    """Return the rows, (k,), at which windows in the air begin, each with its past, all in s."""
    return np.arange(flight.air.start + round(past / STEP),
                     flight.air.stop - round(horizon / STEP), round(every / STEP))


def past_mean(values: Floats, rows: Ints, past: float) -> Floats:
    """Return the mean of values (n, 3) over ``past`` s before each row; 0 without a past."""
    back = round(past / STEP)
    if not back:
        return np.zeros((len(rows), 3))
    first = int(rows[0]) - back if len(rows) else 0
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(values[first:], axis=0)])
    return (total[rows - first] - total[rows - first - back]) / back


def predict(
    flight: Recorded, model: ForceModel, horizon: float = HORIZON, past: float = PAST,
) -> Windows:
    """
    Predict the translation of a flight in windows.

    Parameters
    ----------
    flight
        Only its rows in the air are used.
    model
        Best identified on other flights.
    horizon : s
    past : s
        Before a window, whose mean error of the force is taken out.

    """
    steps, first = round(horizon / STEP), starts(flight, horizon, past)
    thrust, turn = model.thrust_over_mass(flight), flight.turn
    beyond = past_mean(
        flight.force - model.force(thrust, flight.body_velocity), first, past)
    p, v = flight.position[first].copy(), flight.velocity[first].copy()
    for i in range(steps):
        now = turn[first + i]
        f = model.force(thrust[first + i], now.inv().apply(v)) + beyond
        a = now.apply(f) - [0.0, 0.0, GRAVITY]
        p, v = p + STEP * v + 0.5 * STEP * STEP * a, v + STEP * a
    end = flight.position[first + steps]
    constant = flight.position[first] + steps * STEP * flight.velocity[first]
    return Windows(p - end, constant - end)
