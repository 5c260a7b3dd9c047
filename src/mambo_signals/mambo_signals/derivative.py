r"""
Derivatives of recorded positions and attitudes.

Around each instant a polynomial is fitted by least squares to the samples of a window,

.. math:: y(t_i) = c_0 + c_1 (t_i - t) + c_2 (t_i - t)^2 + \ldots, \qquad \dot y(t) = c_1.

This is the Savitzky-Golay filter (1964) for samples at arbitrary times. It has no time lag. A
window that contains a gap, or lacks samples on one side, gives NaN. A parabola over a window W
smooths as much as a Gaussian with a standard deviation of W / 4.5.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .resample import Floats, gaps

LEAST = 5          # smallest number of samples in a window
REACH = 0.25       # [-] share of the window that must have samples on either side
SPARSE = 6.0       # [-] smallest width of a window in sample periods
POSITION = 0.22    # s, window to get velocities from positions
ATTITUDE = 0.09    # s, window to get body rates from attitudes
_AT_ONCE = 20_000  # instants computed at a time, to limit memory


def local_fit(
    times: Floats, values: Floats, at: Floats, window: float, degree: int = 2,
) -> tuple[Floats, Floats]:
    """
    Return a smoothed signal and its derivative at given instants.

    Parameters
    ----------
    times : (n,) s, ascending
    values : (n, k)
        Finite.
    at : (m,) s
    window : s
        Full width; at least ``SPARSE`` periods are used.
    degree
        Degree of the polynomial, 2 or more.

    Returns
    -------
    Values (m, k) and derivatives (m, k); NaN where the window has a gap or too few samples.

    """
    at = np.asarray(at, float)
    value, slope = (np.full((len(at), values.shape[1]), np.nan) for _ in range(2))
    if len(times) < LEAST:
        return value, slope
    half = 0.5 * max(window, SPARSE * float(np.median(np.diff(times))))
    first = np.searchsorted(times, at - half, side='left')
    last = np.searchsorted(times, at + half, side='right') - 1
    crossed = np.concatenate([[0], np.cumsum(gaps(times))])
    use = np.flatnonzero(last - first + 1 >= max(LEAST, degree + 1))
    near = 2.0 * REACH * half
    use = use[(times[first[use]] <= at[use] - near) & (times[last[use]] >= at[use] + near)
              & (crossed[first[use]] == crossed[last[use]])]
    for some in np.split(use, range(_AT_ONCE, len(use), _AT_ONCE)):
        if len(some):
            index = first[some, None] + np.arange(int((last - first)[some].max()) + 1)
            inside = (index <= last[some, None]).astype(float)
            index = np.minimum(index, len(times) - 1)
            x = (times[index] - at[some, None]) / half
            powers = (x[..., None] ** np.arange(degree + 1)) * inside[..., None]
            turned = powers.transpose(0, 2, 1)
            found = np.linalg.solve(turned @ powers, turned @ values[index])
            value[some], slope[some] = found[:, 0], found[:, 1] / half
    return value, slope


def body_rates(
    times: Floats, orientation: Floats, at: Floats | None = None, window: float = ATTITUDE,
) -> tuple[Floats, Floats]:
    """
    Return the angular velocity of a recorded attitude in body axes.

    The rotation vectors from sample to sample, in body axes, are summed, and the sum is
    differentiated by :func:`local_fit`. The result is exact for a constant body rate.

    Parameters
    ----------
    times : (n,) s, ascending
    orientation : (n, 4)
        Unit quaternions x y z w, body to inertial.
    at : (m,) s
        Instants; default: the times of the samples.
    window : s

    Returns
    -------
    Times (j,) s and body rates (j, 3) rad/s, without instants in gaps.

    """
    at = times if at is None else at
    if len(times) < LEAST:
        return np.empty(0), np.empty((0, 3))
    turns = Rotation.from_quat(orientation)
    steps = (turns[:-1].inv() * turns[1:]).as_rotvec()
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    _, rates = local_fit(times, path, at, window)
    known = np.isfinite(rates).all(axis=1)
    return at[known], rates[known]
