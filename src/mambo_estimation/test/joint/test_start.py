"""State and covariance that the joint filter starts with after a rest."""

import math

from mambo_estimation import alignment
from mambo_estimation.alignment import EMPTY, Noise
from mambo_estimation.estimate import NOT_ALIGNED
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.start import aligned
from mambo_estimation.joint.state import ACCEL_BIAS, ATTITUDE
from mambo_model.motion.quaternion import conjugate, multiply
import numpy as np
import pytest

V = JointParams().values()
G = V.gravity
READING = alignment.reading_std(G, V.alignment)  # m/s^2


def started(force):
    """Return state and covariance after a rest with this mean specific force, m/s^2."""
    return aligned(EMPTY._replace(
        count=100, accel=tuple(force), noise=Noise(1e-6, 1e-6), first_gyro=(0.0, 0.0, 0.0)), V)


def at_rest(deviations):
    """Return the force of a reading so many deviations from level, along body x."""
    x = deviations * READING
    return (x, 0.0, -math.sqrt(G * G - x * x))


def tilt(x):
    return math.degrees(2.0 * math.hypot(x.q[1], x.q[2]))


def test_a_level_start_and_a_tilted_one_are_told_apart():
    level, _ = started(at_rest(2.0))
    tilted, _ = started(at_rest(6.0))
    assert tilt(level) < 0.1 and level.accel_bias[0] == pytest.approx(2.0 * READING, rel=0.02)
    assert tilt(tilted) == pytest.approx(math.degrees(6.0 * READING / G), rel=0.01)
    assert abs(tilted.accel_bias[0]) < 0.01


@pytest.mark.parametrize('deviations', np.arange(0.0, 8.0, 0.25))
def test_both_explanations_of_a_reading_are_within_the_stated_deviation(deviations):
    """At 4.3 deviations the tilt is 0 or 7.6 degrees, with the same probability."""
    force = at_rest(deviations)
    x, P = started(force)
    p = alignment.tilted_probability(force, G, V.alignment)
    for share, probability in ((0.99, 1.0 - p), (0.0, p)):
        q, bias = alignment.split(force, G, share)
        off = 2.0 * multiply(q, conjugate(x.q))[2]
        assert off ** 2 * probability <= P[ATTITUDE + 1, ATTITUDE + 1]
        assert (bias[0] - x.accel_bias[0]) ** 2 * probability <= P[ACCEL_BIAS, ACCEL_BIAS]
    # such a vehicle takes off: flow tells tilt from bias in the first second
    assert math.sqrt(np.linalg.eigvalsh(P[6:8, 6:8]).max()) < NOT_ALIGNED
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P[:15, :15]).min() > 0.0


def test_stated_deviation_of_tilt_and_bias_is_that_of_many_starts():
    """Starts drawn from the prior whose reading is near the border of both explanations."""
    rng, count = np.random.default_rng(4), 1_000_000
    a = V.alignment
    wide = rng.random(count) < alignment.TILTED
    slope = rng.standard_normal(count) * np.where(
        wide, alignment.STEEPER * READING / G, a.floor_slope_std)
    other = rng.standard_normal(count) * np.where(
        wide, alignment.STEEPER * READING / G, a.floor_slope_std)
    bias = a.accel_bias_std * rng.standard_normal((2, count))
    force = np.array([G * np.sin(slope) + bias[0], -G * np.sin(other) + bias[1]])
    distance = np.hypot(*force) / READING
    near = np.flatnonzero((distance > 4.0) & (distance < 4.7))
    assert len(near) > 80
    squares = []
    for k in near:
        x, y = force[:, k]
        found, P = started((x, y, -math.sqrt(G * G - x * x - y * y)))
        off = np.array([other[k] - 2.0 * found.q[1], slope[k] - 2.0 * found.q[2]])
        squares.append(off @ np.linalg.solve(P[6:8, 6:8], off))
    # two numbers a start, of two kinds: their mean square has the deviation of a Bernoulli
    # distribution, at most 1, over the root of 80
    assert np.mean(squares) == pytest.approx(2.0, abs=0.5)


def test_probability_is_a_half_at_the_border_and_never_overflows():
    border = alignment.tilted_probability(at_rest(alignment.NOT_LEVEL), G, V.alignment)
    assert border == pytest.approx(0.5, abs=0.02)
    certain = V.alignment._replace(accel_bias_std=1e-6, floor_slope_std=0.0)
    assert alignment.tilted_probability((9.81, 0.0, 0.0), G, certain) == 1.0
    assert alignment.tilted_probability((0.0, 0.0, -9.81), G, V.alignment) < 2e-4
