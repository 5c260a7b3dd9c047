"""
Consistency of a filter's covariance: squared innovations over their expected variances.

The noise parameters hold for the roughest known flights, so that the gains are safe there. In a
smoother flight the errors are smaller than the filter's covariance. The ratio, the variance of
unit weight of least squares, is 1 if the innovations are as large as expected. Published
covariances are scaled by it; gains and gates are not. Holds no equation of the thesis.
"""

from __future__ import annotations

from mambo_model.arithmetic.exponential import exp
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
    Return the scale factor of a published covariance; 1 without innovations.

    Parameters
    ----------
    fit : -
    least : -
        Smallest one that the model is believed to hold for.
    age : s
        Since the last innovation, infinite before the first.

    """
    return 1.0 + (max(fit, least) - 1.0) * exp(-age / FADE_TIME)
