"""The numbers are those of numpy, but for the last bit of a few."""

from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import jit
import numpy as np


@jit
def many(rng, count):
    """Return an array of draws."""
    out = np.empty(count)
    for i in range(count):
        out[i] = standard_normal(rng)
    return out


def test_a_million_draws_are_those_of_numpy():
    ours, theirs = (np.random.Generator(np.random.PCG64(5)) for _ in range(2))
    a, b = many(ours, 1_000_000), theirs.standard_normal(1_000_000)
    different = np.flatnonzero(a != b)
    assert different.size < 20                    # 31 of 20 million were
    assert (abs(b[different]) > 3.65).all()       # in the tail alone
    np.testing.assert_allclose(a, b, rtol=0.0, atol=2e-15)
    assert ours.random() == theirs.random()       # and both go on from the same place


def test_the_python_function_draws_the_same():
    ours, theirs = (np.random.Generator(np.random.PCG64(6)) for _ in range(2))
    plain = getattr(standard_normal, 'py_func', standard_normal)
    assert [plain(ours) for _ in range(50)] == many(theirs, 50).tolist()
