"""Random numbers of the standard normal distribution."""

from __future__ import annotations

from numba.np.random._constants import (  # the tables of numpy's generator
    fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r)
from numba.np.random.generator_core import next_uint64
import numpy as np
from numpy.random import BitGenerator, Generator

from ..compiled import jit, jit_apart, jit_inside, overload
from .exponential import exp, log1p


def _raw(source: BitGenerator) -> int:
    """Return 64 random bits."""
    return np.uint64(source.random_raw())


@overload(_raw)
def _raw_compiled(source):
    """Return the same in compiled code."""
    return lambda source: next_uint64(source)


@jit
def _uniform(source: BitGenerator) -> float:
    """Return a number in [0, 1), as ``Generator.random`` does."""
    return (_raw(source) >> np.uint64(11)) * 2.0 ** -53


@jit_apart
def _at_edge(
    source: BitGenerator, cell: int, whole: int, x: float,
) -> tuple[bool, float]:
    """Return whether x is kept, at the edge of its layer, and a number of the tail in layer 0."""
    if cell != 0:
        below, above = fi_double[cell - np.uint64(1)], fi_double[cell]
        return (below - above) * _uniform(source) + above < exp(-0.5 * x * x), x
    while True:
        beyond = -ziggurat_nor_inv_r * log1p(-_uniform(source))
        other = -log1p(-_uniform(source))
        if other + other > beyond * beyond:
            x = ziggurat_nor_r + beyond
            return True, -x if (whole >> np.uint64(8)) & np.uint64(1) else x


@jit
def _draw(source: BitGenerator) -> float:
    """Return a number of the standard normal distribution: 99 % at the first attempt."""
    while True:
        raw = _raw(source)
        cell = raw & np.uint64(0xff)
        whole = (raw >> np.uint64(9)) & np.uint64(0xfffffffffffff)
        x = whole * wi_double[cell]
        if raw & np.uint64(0x100):
            x = -x
        if whole < ki_double[cell]:
            return x
        kept, x = _at_edge(source, cell, whole, x)
        if kept:
            return x


@jit_inside
def standard_normal(rng: Generator) -> float:
    """
    Return a number of the standard normal distribution.

    It is what ``rng.standard_normal()`` returns, and leaves the generator as that does, but for
    the last bit of 1 number in 600000: numpy takes the logarithm and the exponential function of
    the C library in the tail and at the edges of the layers.

    Parameters
    ----------
    rng
        Generator of 64-bit numbers (PCG64).

    References
    ----------
    G. Marsaglia, W. W. Tsang, The ziggurat method for generating random variables, J. Stat.
    Software 5(8), 2000.

    """
    return _draw(rng.bit_generator)
