"""Turn, lateness and scale of a motion capture beside a simulated path are found again."""

from mambo_analysis.identify.placement import (
    effects, LATEST, place, Placement, seen, SETTLED, without)
from mambo_flight.closed_loop import STEP_NS
import numpy as np
import pytest

DT = STEP_NS * 1e-9
ROWS = np.arange(400, 3600, 4)
OFFSET = np.ones((len(ROWS), 1))


def figure(n=4000):
    """Return a figure of eight, (n, 2) m, which no turn and no lateness leaves as it is."""
    t = np.arange(n) * DT
    return np.stack([1.2 * np.sin(0.9 * t), 0.7 * np.sin(1.8 * t + 0.3)], axis=1)


def circle(n=4000):
    """Return a circle, (n, 2) m."""
    t = np.arange(n) * DT
    return np.stack([np.cos(t), np.sin(t)], axis=1)


def climb(n=4000):
    """Return a height, (n, 1) m."""
    return -1.0 - 0.3 * np.sin(1.3 * np.arange(n) * DT)[:, None]


@pytest.mark.parametrize('true', [
    Placement(), Placement(turn=0.1), Placement(turn=-2.5, late=0.08), Placement(late=-0.3),
    Placement(turn=3.0, late=0.02)])
def test_turn_and_lateness_are_found(true):
    measured = seen(figure(), ROWS, true)[0] + [0.4, -0.2]
    found = place(figure(), ROWS, measured, OFFSET)
    assert found.turn == pytest.approx(true.turn, abs=1e-5)
    assert found.late == pytest.approx(true.late, abs=1e-5)
    assert found.scale == 1.0


def test_scale_is_found_where_it_is_free():
    measured = seen(figure(), ROWS, Placement(0.2, 0.05, 0.5))[0]
    assert place(figure(), ROWS, measured, OFFSET, scaled=True) == pytest.approx(
        (0.2, 0.05, 0.5), abs=1e-5)
    assert place(figure(), ROWS, measured, OFFSET).scale == 1.0


def test_noise_moves_the_placement_little():
    rng = np.random.default_rng(0)
    true = Placement(0.05, 0.06)
    measured = seen(figure(), ROWS, true)[0] + rng.normal(0.0, 0.01, (len(ROWS), 2))
    found = place(figure(), ROWS, measured, OFFSET)
    assert found == pytest.approx(true, abs=2e-3)


def test_on_a_circle_turn_and_lateness_are_one():
    """Their sum is found, whichever it was, and the path fits."""
    true = Placement(turn=0.15)
    found = place(circle(), ROWS, seen(circle(), ROWS, true)[0], OFFSET)
    assert found.turn - found.late * 1.0 == pytest.approx(0.15, abs=1e-6)  # at 1 rad/s
    there, wanted = (seen(circle(), ROWS, each)[0] for each in (found, true))
    np.testing.assert_allclose(without(OFFSET, there), without(OFFSET, wanted), atol=1e-5)


def test_lateness_beyond_that_of_a_capture_stays_at_its_limit():
    measured = seen(figure(), ROWS, Placement(late=0.9))[0]
    assert abs(place(figure(), ROWS, measured, OFFSET).late) <= LATEST


def test_a_height_is_late_but_not_turned():
    measured = seen(climb(), ROWS, Placement(late=0.07))[0] + 0.05
    found = place(climb(), ROWS, measured, OFFSET)
    assert found.late == pytest.approx(0.07, abs=1e-5) and found.turn == 0.0
    position, velocity = seen(climb(), ROWS, Placement(turn=1.0))
    np.testing.assert_array_equal(position, climb()[ROWS])  # one axis is not turned
    assert not effects(position, velocity)[0].any()


def test_a_turn_keeps_sizes_and_has_the_sign_of_ned():
    """From north (x) to east (y), about z down."""
    path = np.stack([np.arange(4000) * DT, np.zeros(4000)], axis=1)
    position, velocity = seen(path, ROWS, Placement(turn=np.pi / 2))
    np.testing.assert_allclose(position, path[ROWS][:, ::-1], atol=1e-12)
    np.testing.assert_allclose(velocity, np.broadcast_to([0.0, 1.0], velocity.shape), atol=1e-9)


def test_what_is_late_was_there_before():
    position, _ = seen(figure(), ROWS, Placement(late=10 * DT))
    np.testing.assert_allclose(position, figure()[ROWS - 10], atol=1e-12)


@pytest.mark.parametrize('part, change', [
    (0, Placement(turn=1e-5)), (1, Placement(late=1e-5)), (2, Placement(scale=1.0 + 1e-5))])
def test_effects_are_the_derivatives_of_what_is_seen(part, change):
    position, velocity = seen(figure(), ROWS, Placement())
    moved = seen(figure(), ROWS, change)[0]
    np.testing.assert_allclose(
        (moved - position) / 1e-5, effects(position, velocity, scaled=True)[part], atol=2e-2)


def test_terms_are_projected_out():
    terms = np.column_stack([np.ones(50), np.arange(50.0)])
    x = np.random.default_rng(1).normal(size=(50, 2))
    rest = without(terms, x + terms @ [[1.0, 2.0], [0.3, -0.1]])
    np.testing.assert_allclose(rest, without(terms, x), atol=1e-10)
    np.testing.assert_allclose(terms.T @ rest, 0.0, atol=1e-9)
    assert SETTLED < 1e-6  # m: so near the rounds come
