"""Parallel-axis theorem against bodies made of point masses."""

from mambo_model.vehicle.mass_properties import with_points
import numpy as np
import pytest

POINTS = [(0.002, (0.05, -0.03, 0.01)), (0.001, (-0.02, 0.06, -0.02)), (0.004, (0.0, 0.01, 0.03))]


def dumbbells():
    """Return six masses on the axes, whose centre is the origin and whose axes are principal."""
    masses, places = [], []
    for axis, (mass, distance) in enumerate(((0.01, 0.03), (0.015, 0.02), (0.005, 0.05))):
        for sign in (1.0, -1.0):
            masses.append(mass)
            places.append(np.eye(3)[axis] * sign * distance)
    return np.array(masses), np.array(places)


def inertia_about_centre(masses, places):
    """Return centre and inertia as the sum over points of m S(r)^T S(r)."""
    centre = masses @ places / masses.sum()
    J = np.zeros((3, 3))
    for m, (x, y, z) in zip(masses, places - centre):
        S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        J += m * S.T @ S
    return centre, J


def test_points_on_a_body_are_as_a_body_of_all_points():
    masses, places = dumbbells()
    _, J = inertia_about_centre(masses, places)
    assert np.abs(J - np.diag(np.diag(J))).max() < 1e-19  # rounding of terms of 1e-5
    all_masses = np.append(masses, [m for m, _ in POINTS])
    all_places = np.vstack([places, [r for _, r in POINTS]])
    centre, expected = inertia_about_centre(all_masses, all_places)
    mass, c, got = with_points(float(masses.sum()), tuple(np.diag(J).tolist()), POINTS)
    assert mass == pytest.approx(all_masses.sum(), rel=1e-15)
    np.testing.assert_allclose(c, centre, rtol=1e-13)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-20)


def test_nothing_added_changes_nothing():
    inertia = (1e-4, 2e-4, 3e-4)
    mass, centre, J = with_points(0.07, inertia, [])
    assert (mass, centre) == (0.07, (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(J, np.diag(inertia))


def test_two_halves_are_a_rod_about_its_own_centre():
    # a point of 1 kg and one of 3 kg, 2 m apart: reduced mass 0.75 kg
    mass, centre, J = with_points(1.0, (0.0, 0.0, 0.0), [(3.0, (2.0, 0.0, 0.0))])
    assert (mass, centre) == (4.0, (1.5, 0.0, 0.0))
    np.testing.assert_allclose(np.diag(J), [0.0, 3.0, 3.0], atol=1e-15)
