"""Parameters of the cascaded controller: gains of section 3.4, switches, shutdown limits."""

from __future__ import annotations

from dataclasses import dataclass
import math

from mambo_model.arithmetic.trigonometry import sin
from mambo_model.schema import choice, flag, quantity
from mambo_model.values import derived, Parameters, values_type

DERIVATIVES = ('analytic', 'no_acceleration', 'no_rates')
ANALYTIC, NO_ACCELERATION, NO_RATES = range(3)  # as compiled code sees them
_GAINS = 'section 3.4, v.d. Eijnden'


@dataclass(frozen=True)
class CascadedParams(Parameters):
    """
    Gains of (3.18) and (3.29) as scalars, how f_d is differentiated, and limits of a flight.

    The matrices of the thesis are these scalars times the identity (position) and times the
    believed inertia (attitude). ``K_P`` and ``K_p`` shape the integral action (stiffness and
    damping of its filter); ``k_p`` and ``K_nu`` are the feedback of position and velocity.
    """

    K_P: float = quantity(0.4, '1/s^2', 0.0, 10.0, _GAINS + '; 0: no integral action')
    K_p: float = quantity(1.0, '1/s', 0.01, 20.0, _GAINS)
    k_p: float = quantity(2.6, 'm/s^2', 0.01, 9.0, _GAINS + ' (k_rho of (3.18a) is the same)')
    K_nu: float = quantity(2.0, 'm/s^2', 0.01, 9.0, _GAINS)
    k_omega: float = quantity(30.0, '1/s', 0.1, 200.0, _GAINS + ' (K_omega = 30 J)')
    k_R: float = quantity(70.0, '1/s^2', 0.1, 5000.0, _GAINS + ' (K_R = 70 J)')
    k1: float = quantity(0.9, '-', 0.01, 10.0, _GAINS)
    k2: float = quantity(1.0, '-', 0.01, 10.0, _GAINS)
    k3: float = quantity(1.1, '-', 0.01, 10.0, _GAINS)
    derivatives: str = choice(
        'analytic', DERIVATIVES, 'how omega_d and its rate follow from f_d: exact, without '
        'the rate of omega_d, or without both')
    drag_feedforward: bool = flag(False, 'chapter 7: believed drag in the virtual input')
    tilt_limit: float = quantity(
        math.radians(60.0), 'rad', 0.0, math.pi, 'shutdown beyond; pi: never (judgement)')
    height_min: float = quantity(-1.0, 'm', -1000.0, 0.0, 'shutdown below (judgement)')
    height_max: float = quantity(10.0, 'm', 0.1, 1000.0, 'shutdown above (judgement)')

    @derived('-', 'k1', 'k2', 'k3')
    def k(self) -> tuple[float, float, float]:
        """Gains of (3.29) about the three axes."""
        return (float(self.k1), float(self.k2), float(self.k3))

    @derived('-', 'tilt_limit')
    def tilt_sine_squared(self) -> float:
        """Squared sine of half the tilt limit."""
        s = sin(self.tilt_limit / 2)
        return s * s


GainValues = values_type(CascadedParams)
