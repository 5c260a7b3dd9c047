"""Distance of results from the true value, in units in the last place."""

import numpy as np

RNG = np.random.default_rng(20261122)


def spread(low, high, count=2000):
    """Return numbers between two positive ones, evenly over the exponents, of both signs."""
    return np.exp(RNG.uniform(np.log(low), np.log(high), count)) * RNG.choice([-1.0, 1.0], count)


def ulps(function, reference, *columns):
    """
    Return the largest error.

    The reference is the C library's function of 64 bits of mantissa: 11 bits more than a double.
    """
    assert np.finfo(np.longdouble).nmant >= 63, 'this machine has no longer floats'
    worst = 0.0
    for row in zip(*(column.tolist() for column in columns), strict=True):
        true = reference(*(np.longdouble(x) for x in row))
        unit = np.longdouble(np.spacing(max(abs(float(true)), 5e-324)))
        worst = max(worst, float(abs(np.longdouble(function(*row)) - true) / unit))
    return worst
