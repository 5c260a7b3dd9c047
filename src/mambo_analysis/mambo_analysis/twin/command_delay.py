r"""
Delay of the stamps of motor commands against those of the gyro, from a flight in closed loop.

A controller answers the part of a body rate that could not be foreseen against it and never before
the gyro shows it. A command turns the vehicle in its own sense and never before it is given. With
the innovations e of the body rate and w of the difference of commands about the same axis, each
the rest of an autoregressive model of its own past, the correlations

.. math:: c_k = \overline{e_i w_{i+k}}

are therefore at most 0 for :math:`k \ge 0` and at least 0 for :math:`k < 0`, if the stamps are
right. Stamps of commands that are late by d steps move all of them by d. (Prewhitening: Box,
Jenkins, Reinsel and Ljung, Time Series Analysis, 2015, ch. 12.) Independent innovations give each
:math:`c_k` the variance 1/n.

A slow motor, or a controller that answers late, leaves a gap between both parts and moves neither
to the other side. So only a turn before its command shows late stamps, and only an answer before
its cause shows early ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from ..identify.regression import autoregression
from .recorded import MIX, Recorded, STEP

Floats = NDArray[np.float64]

ORDER = 20     # of the autoregressive models, at most: 0.2 s
LARGEST = 15   # steps of delay that are tried, either way
WIDTH = 3      # steps on either side in which command and answer are compared
USUAL = 1      # step that interpolation between samples can make; of 100 Hz, longer if slower
CLEARLY = 5.0  # standard errors; of 31 trial delays by chance in 2e-5


def _innovations(x: Floats) -> Floats:
    """Return what a signal (n,) has beyond its own past, (n - ORDER,), of unit variance or 0."""
    x = x - x.mean()
    rest = signal.lfilter(np.append(1.0, -autoregression(x, ORDER)), 1.0, x)[ORDER:]
    size = float(rest.std())
    return rest / size if size > 0.0 else rest


def correlations(u: Floats, rate: Floats) -> tuple[Floats, float]:
    """
    Return the correlations of innovations of rates with those of commands.

    Parameters
    ----------
    u, rate : (n, m), (n, m) rad/s
        Differences of commands about each axis, in any unit, and body rates, every ``STEP`` s.

    Returns
    -------
    c : (2 K + 1,)
        Sum over the axes, of commands k = -K..K steps after the rate, K = LARGEST + WIDTH.
    error
        Standard error of each.

    """
    reach = LARGEST + WIDTH
    inner = [_innovations(x)[reach:-reach] for x in rate.T]
    c = [np.correlate(_innovations(x), e, 'valid') / len(e) for x, e in zip(u.T, inner)]
    return np.sum(c, axis=0), (len(c) / len(inner[0])) ** 0.5


def delay(c: Floats, error: float, usual: int = USUAL) -> int:
    """
    Return how many steps commands are stamped late (above 0) or early; 0: neither is clear.

    Parameters
    ----------
    c : (2 K + 1,)
    error
        As of :func:`correlations`.
    usual
        Steps up to which a delay is none.

    """
    middle = LARGEST + WIDTH
    trials = np.arange(-LARGEST, LARGEST + 1)
    before, after = np.array([(c[middle + d - WIDTH:middle + d].sum(),
                               -c[middle + d:middle + d + WIDTH].sum()) for d in trials]).T
    best = int((before + after).argmax())
    late, clear = int(trials[best]), CLEARLY * error * WIDTH ** 0.5
    # with motors in another order, or no controller, one of both parts is missing
    if abs(late) <= usual or min(before[best], after[best]) < clear:
        return 0
    # what right stamps cannot show: turns at k >= usual, answers at k < -usual
    wrong = c[middle + usual:middle + late] if late > 0 else -c[middle + late:middle - usual]
    return late if wrong.sum() > CLEARLY * error * len(wrong) ** 0.5 else 0


def command_notes(flight: Recorded) -> list[str]:
    """Return a note if the commands of a flight are stamped late or early against its gyro."""
    usual = USUAL
    if np.isfinite(flight.pace):
        usual = max(usual, int(np.ceil(flight.pace / STEP - 0.5)))
    late = delay(*correlations(flight.command[flight.air] @ MIX.T, flight.gyro[flight.air]), usual)
    if not late:
        return []
    how = ('late against those of the gyro: the vehicle turns before the command'
           if late > 0 else
           'early against those of the gyro: commands answer a turn before it happens')
    return [f'{flight.name}: the stamps of motor_pwm are about {abs(late) * STEP:.2f} s {how}; '
            'correct them, as drag z, exponent, motor lag and inertia have their error']
