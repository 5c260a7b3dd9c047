"""Chapter 6 on made flights: distances between flights, overshoot, and what drag changes."""

from made_flights import made, path
from mambo_thesis.figures import chapter_6
from mambo_thesis.figures.flights import X, Y, Z
import numpy as np
import pytest


def by_what(result):
    return {m.what: m for m in result.measured}


def circle(radius=1.0, height=-2.0):
    return path(lambda t: radius * np.cos(t), lambda t: radius * np.sin(t), height)


def test_a_distance_is_on_the_axes_asked_for_and_in_the_time_asked_for():
    a = made(path(lambda t: np.where(t < 12.0, 9.0, 0.3), 0.4, -1.0), seconds=20.0)
    b = made(path(), seconds=20.0)
    assert chapter_6._distance(a, b, [X, Y]) == pytest.approx(0.5)
    assert chapter_6._distance(a, b, [Z]) == pytest.approx(0.5)
    assert chapter_6._distance(a, b, [X], 0.0, 12.0) == pytest.approx(9.0)


def test_an_overshoot_is_above_the_hover_point_during_take_off():
    def z(t):
        return np.where(t < 5.0, np.where((t > 3.0) & (t < 3.5), -1.95, -1.5), -9.0)
    assert chapter_6._overshoot(made(path(z=z), None, path(), seconds=10.0)) == pytest.approx(0.45)
    assert chapter_6._overshoot(made(path(), None, path(), seconds=10.0)) == pytest.approx(0.0)


def flights_by(monkeypatch, **flights):
    """Let the chapter have these flights by the last part of their names."""
    def find(name, seed=None, changes=()):
        model = flights[name.rpartition('/')[2]]
        return model if callable(getattr(model, 'after', None)) else model(dict(changes))
    monkeypatch.setattr(chapter_6, 'fly', find)
    monkeypatch.setattr(chapter_6, 'seeds', lambda name: [find(name)])


def test_a_better_map_is_nearer_where_the_reference_turns_round(monkeypatch):
    wanted = path(z=lambda t: -2.0 - np.sin(t))
    old, new = (made(path(z=lambda t, s=s: -2.0 - (1.0 - s) * np.sin(t)), None, wanted,
                     seconds=40.0) for s in (0.3, 0.01))
    flights_by(monkeypatch, experiment_old_map=old, experiment_new_map=new, simulation=new)
    found = by_what(chapter_6.figure_6_2())
    assert found['error in height, old map, RMS'].low == pytest.approx(0.3 / np.sqrt(2), rel=0.01)
    assert found['error in height, new map, RMS'].holds
    assert found['error at the highest and lowest points, old over new map'].low == (
        pytest.approx(30.0, rel=1e-6))
    assert found['new map against simulation, RMS'].high == 0.0


def test_inertias_are_apart_by_the_largest_distance_in_mm(monkeypatch):
    base = made(path(), seconds=20.0)
    flights_by(monkeypatch, new_inertia=base, old_inertia=made(path(0.0008), seconds=20.0),
               new_inertia_fast=base, old_inertia_fast=made(path(0.0, 0.006), seconds=20.0))
    found = by_what(chapter_6.figure_6_3())
    assert found['largest distance'].low == pytest.approx(0.8)
    assert found['the same at twice the speed, over that'].low == pytest.approx(7.5)
    assert all(m.holds for m in found.values())


def shrinking(height=-2.0):
    """Return circles that drag makes smaller: 1.05 m with 0.22 s/m, 1 m with 0.24 s/m."""
    return lambda changes: made(
        circle(1.05 - 2.5 * (changes.get(chapter_6.MODEL, 0.22) - 0.22), height), seconds=30.0)


@pytest.mark.parametrize(('radius', 'k'), [(1.0, 0.24), (1.05, 0.22), (0.5, 0.44)])
def test_the_best_drag_is_that_whose_simulation_is_nearest(monkeypatch, radius, k):
    flights_by(monkeypatch, simulation_with_drag=shrinking())
    real = [made(circle(radius), seconds=30.0)]
    assert chapter_6.best_drag('fig_6_4', real, 12.0, 30.0) == pytest.approx(k, abs=0.001)


def test_an_excitation_without_the_integral_and_an_error_that_recurs(monkeypatch):
    def climb(peak, wave=0.0):
        return made(path(z=lambda t: np.where((t > 3.0) & (t < 4.0), -1.5 - peak, -1.5)
                         + wave * np.sin(t)), None, path(), seconds=40.0)
    flights_by(monkeypatch, experiment=climb(0.45, 0.02),
               simulation_with_drag=lambda changes: climb(0.1 if changes else 0.46))
    assert all(m.holds for m in chapter_6.section_6_3().measured)
    assert all(m.holds for m in chapter_6.section_6_4().measured)
    flights_by(monkeypatch, experiment=climb(0.45),
               simulation_with_drag=lambda changes: climb(0.46))
    assert [m.holds for m in chapter_6.section_6_3().measured] == [True, False, False]
    assert [m.holds for m in chapter_6.section_6_4().measured] == [True, True, False]


@pytest.mark.parametrize('figure', [chapter_6.figure_6_4, chapter_6.figure_6_6])
def test_drag_brings_the_simulation_nearer_in_x_and_y_alone(monkeypatch, figure):
    flights_by(monkeypatch, experiment=made(circle(1.0), seconds=30.0),
               simulation_without_drag=made(circle(1.4), seconds=30.0),
               simulation_with_drag=shrinking())
    found = by_what(figure())
    ratio = found['x and y: distance to the experiment without drag over that with']
    assert ratio.low == pytest.approx(8.0)
    assert found['x and y, experiment against simulation with drag, RMS'].high == (
        pytest.approx(0.05))
    assert all(m.holds for m in found.values())
    flights_by(monkeypatch, experiment=made(circle(1.0), seconds=30.0),
               simulation_without_drag=made(circle(1.4), seconds=30.0),
               simulation_with_drag=shrinking(-2.1))
    height = by_what(figure())['z, change of the distance by the drag']
    assert height.low == pytest.approx(0.1) and not height.holds


def test_a_step_is_compared_before_it_has_settled(monkeypatch):
    def step(size):  # differs between 5 and 12 s alone
        return path(lambda t: np.where((t > 5.0) & (t < 12.0), size, 0.0))
    flights_by(monkeypatch, experiment=made(step(0.0), seconds=20.0),
               simulation_without_drag=made(step(0.2), seconds=20.0),
               simulation_with_drag=lambda changes: made(step(
                   0.05 + changes.get(chapter_6.MODEL, 0.22) - 0.22), seconds=20.0))
    ratio = by_what(chapter_6.figure_6_5())[
        'x and y: distance to the experiment without drag over that with']
    assert ratio.low == pytest.approx(4.0) and ratio.holds


def test_both_maps_beside_the_simulation(monkeypatch):
    def climb(peak, radius):
        return path(lambda t: radius * np.cos(t), lambda t: radius * np.sin(t),
                    lambda t: np.where((t > 3.0) & (t < 4.0), -1.5 - peak, -1.5))
    flights_by(monkeypatch, experiment_old_map=made(climb(0.09, 1.0), None, path(), seconds=20.0),
               experiment_new_map=made(climb(0.45, 1.05), None, path(), seconds=20.0),
               simulation=made(climb(0.45, 1.34), None, path(), seconds=20.0))
    found = by_what(chapter_6.figure_6_1())
    assert all(m.holds for m in found.values()), [str(m) for m in found.values()]
    assert found['x and y, old against new map, RMS'].low == pytest.approx(0.05)
