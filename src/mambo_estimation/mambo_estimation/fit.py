"""
How well a filter's covariance fits: squared innovations over what the filter expects of them.

The noise parameters hold for the roughest flights that are known, so that the gains are safe
there; a smoother flight has smaller errors than the filter's own covariance says. The variance of
unit weight of least squares tells by how much: 1 where the innovations are as large as expected.
What is published is scaled by it; the gains and the gates do not see it. Holds no equation of the
thesis.
"""

from __future__ import annotations

import math

from mambo_model.compiled import jit

FADE_TIME = 0.5  # s


@jit
def updated(fit: float, squared: float, gate: float, weight: float) -> float:
    """
    Return the fit with one more innovation.

    Parameters
    ----------
    fit : -
        Before; 1 at the start.
    squared : -
        Squared innovation over its expected variance, mean of its components.
    gate : sigma
        A larger innovation counts as just so large.
    weight : -
        Of this innovation.

    """
    return fit + weight * (min(squared, gate * gate) - fit)


@jit
def faded(fit: float, least: float, age: float) -> float:
    """
    Return by how much a published covariance is scaled: without innovations not at all.

    Parameters
    ----------
    fit : -
    least : -
        Smallest one that the model is believed to hold for.
    age : s
        Since the last innovation, infinite before the first.

    """
    return 1.0 + (max(fit, least) - 1.0) * math.exp(-age / FADE_TIME)
