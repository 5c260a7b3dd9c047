"""
Wind: a constant velocity of the air and gusts on top of it.

Gusts are those of Dryden's longitudinal spectrum, on each world axis on its own: a first-order
Gauss-Markov process (MIL-F-8785C, sec. 3.7), whose correlation time is the length of an eddy over
the speed at which it passes. They are drawn once per control step and held over it. Drag takes
the velocity relative to the air; the thesis flies in still air.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp
from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import by_type, jit
from mambo_model.motion.vector import add, Vec3
from mambo_model.schema import flag, quantity
from mambo_model.values import Parameters, values_type
from numpy.random import Generator

from .sensors.sampling import STEP


class WindMemory(NamedTuple):
    """The air during a control step."""

    velocity: Vec3  # (3,) m/s, inertial NED, of the air
    gust: Vec3      # (3,) m/s, inertial NED, gust part


@dataclass(frozen=True)
class WindParams(Parameters):
    """How the air moves; still by default."""

    velocity: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'm/s', -30.0, 30.0, 'inertial NED, where the air goes to; still: thesis')
    gust: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'm/s', 0.0, 10.0, 'standard deviation of gusts, inertial NED axes')
    gust_time: float = quantity(
        1.0, 's', 0.01, 600.0, 'correlation time of gusts: eddies of 2 m that pass at 2 m/s')
    changeable: bool = flag(
        False, 'whether the compiled step has wind even if the air is still, so that it can rise '
        'in flight')

    def values(self) -> WindValues | None:
        """Return the values for compiled code; None, a separate type, for still air."""
        if not (any(self.velocity) or any(self.gust) or self.changeable):
            return None
        return super().values()


WindValues = values_type(WindParams, without=('changeable',))


def initial(params: WindParams) -> WindMemory | None:
    """Return the memory before the first step, None for still air."""
    still = (0.0, 0.0, 0.0)
    return None if params.values() is None else WindMemory(still, still)


@jit
def blow(
    memory: WindMemory, tick: int, rng: Generator, noise: bool, p: WindValues,
) -> WindMemory:
    """
    Return the air during a control step.

    A gust keeps exp(-dt/T) of itself from step to step, so that its standard deviation is
    ``gust`` at any time, from the first one.

    Parameters
    ----------
    memory
        Of the step before.
    tick : 5 ms
        Number of the control step.
    rng
        Three numbers of it are used.
    noise
        False: no gusts, and nothing drawn.
    p
        From :meth:`WindParams.values`.

    """
    if not noise:
        return WindMemory(p.velocity, (0.0, 0.0, 0.0))
    keep = exp(-STEP / p.gust_time) if tick else 0.0
    new = math.sqrt(1.0 - keep * keep)
    old, sigma = memory.gust, p.gust
    gust = (
        keep * old[0] + new * sigma[0] * standard_normal(rng),
        keep * old[1] + new * sigma[1] * standard_normal(rng),
        keep * old[2] + new * sigma[2] * standard_normal(rng))
    return WindMemory(add(p.velocity, gust), gust)


@jit
def _velocity(memory: WindMemory) -> Vec3:
    return memory.velocity


@jit
def _rest(memory: None, tick: int, rng: Generator, noise: bool, p: None) -> None:
    return None


@jit
def _still(memory: None) -> None:
    return None


# With None for still air; chosen by type, as a function cannot return both None and a tuple.
step = by_type(4, {WindValues: blow, type(None): _rest})
air_velocity = by_type(0, {WindMemory: _velocity, type(None): _still})
