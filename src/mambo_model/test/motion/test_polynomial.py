"""Piecewise polynomials against numpy and scipy."""

from mambo_model.motion import polynomial as poly
import numpy as np
import pytest
from scipy.interpolate import BPoly, PPoly

RNG = np.random.default_rng(3)
COURSE = poly.Course(np.array([0.7, 1.9, 0.4]), RNG.normal(size=(3, 4, 8)))


def as_scipy(course):
    """Return the course as scipy has it: descending powers, (8, n, 4)."""
    breaks = np.concatenate(([0.0], np.cumsum(course.duration)))
    return PPoly(course.coefficients.transpose(2, 0, 1)[::-1], breaks)


@pytest.mark.parametrize('order', range(5))
def test_derivatives_are_those_of_scipy_in_every_piece(order):
    other = as_scipy(COURSE).derivative(order) if order else as_scipy(COURSE)
    for t in np.linspace(0.0, COURSE.total, 61)[:-1].tolist():
        np.testing.assert_allclose(
            poly.state_at(COURSE, t)[:, order], other(t), rtol=1e-12, atol=1e-10)


def test_compiled_code_evaluates_the_piece_of_the_time():
    pieces = poly.Pieces(COURSE.begin + 2.0, COURSE.coefficients)
    for t in (2.0, 2.3, 2.7, 3.0, 4.6, 4.9, 5.0, 7.0):  # 7: the last piece goes on
        i = sum(t >= pieces.begin) - 1
        for axis, found in enumerate(poly.evaluate(t, pieces)):
            one = np.polynomial.Polynomial(COURSE.coefficients[i, axis])
            assert found == pytest.approx(
                [one.deriv(k)(t - pieces.begin[i]) for k in range(5)], rel=1e-12)
    before = poly.evaluate(-1.0, pieces)
    assert before == poly.evaluate(2.0, pieces)


def test_connecting_polynomials_are_those_of_scipy():
    start, end, T = RNG.normal(size=(4, 5)), RNG.normal(size=(4, 5)), 1.7
    found = poly.connect(start, end, T)
    for axis in range(4):
        other = BPoly.from_derivatives([0.0, T], [start[axis], end[axis]])
        x = np.linspace(0.0, T, 21)
        np.testing.assert_allclose(
            np.polynomial.polynomial.polyval(x, found[axis]), other(x), rtol=0.0, atol=1e-11)


def test_a_stretched_course_takes_the_same_path_in_another_time():
    slow = poly.stretched(COURSE, 2.5)
    assert slow.total == pytest.approx(2.5 * COURSE.total, rel=1e-15)
    for t in np.linspace(0.0, COURSE.total, 17).tolist():
        np.testing.assert_allclose(
            poly.state_at(slow, 2.5 * t), poly.state_at(COURSE, t) / 2.5 ** np.arange(5),
            rtol=1e-10, atol=1e-10)


def test_a_course_is_resized_about_its_first_point_and_raised_to_a_height():
    large, high = poly.resized(COURSE, 3.0), poly.raised(COURSE, 1.4)
    first = poly.state_at(COURSE, 0.0)[:, 0]
    assert poly.state_at(high, 0.0)[2, 0] == pytest.approx(-1.4, abs=1e-15)
    for t in np.linspace(0.0, COURSE.total, 17).tolist():
        at = poly.state_at(COURSE, t)
        wanted = at.copy()
        wanted[:3] = 3.0 * at[:3]
        wanted[:3, 0] -= 2.0 * first[:3]
        np.testing.assert_allclose(poly.state_at(large, t), wanted, rtol=1e-11, atol=1e-11)
        moved = poly.state_at(high, t) - at
        np.testing.assert_allclose(moved[2, 0], -1.4 - first[2], rtol=0.0, atol=1e-12)
        moved[2, 0] = 0.0
        assert not moved.any()


@pytest.mark.parametrize('order', range(5))
def test_the_largest_value_is_found_between_samples(order):
    for c, T in ((COURSE.coefficients[i, j], COURSE.duration[i])
                 for i in range(3) for j in range(4)):
        value, when = poly.largest(c, T, order)
        p = np.polynomial.Polynomial(c).deriv(order)
        sampled = p(np.linspace(0.0, T, 20001)).max()
        assert sampled - 1e-9 <= value <= sampled + 1e-4 * abs(sampled)
        assert 0.0 <= when <= T and p(when) == pytest.approx(value, rel=1e-12)


def test_the_largest_value_of_what_is_constant_is_its_value():
    assert poly.largest(np.array([2.0, 0.0, 0.0]), 3.0, 0) == (2.0, 0.0)
    assert poly.largest(np.array([2.0]), 0.0, 2) == (0.0, 0.0)
