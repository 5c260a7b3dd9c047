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
    assert found['height error, old map, RMS'].low == pytest.approx(0.3 / np.sqrt(2), rel=0.01)
    assert found['height error, new map, RMS'].holds
    assert found['height error at the highest and lowest points, old over new map'].low == (
        pytest.approx(30.0, rel=1e-6))
    assert found['new map against simulation, RMS'].high == 0.0


def test_inertias_are_apart_by_the_largest_distance_in_mm(monkeypatch):
    base = made(path(), seconds=20.0)
    flights_by(monkeypatch, new_inertia=base, old_inertia=made(path(0.0008), seconds=20.0),
               new_inertia_fast=base, old_inertia_fast=made(path(0.0, 0.006), seconds=20.0))
    found = by_what(chapter_6.figure_6_3())
    assert found['largest distance between the flights'].low == pytest.approx(0.8)
    ratio = found['that distance at twice the speed over that at normal speed']
    assert ratio.low == pytest.approx(7.5)
    assert all(m.holds for m in found.values())


def shrinking(height=-2.0, radius=1.05):
    """Return circles of a radius with 0.22 s/m that drag makes smaller by 2.5 m per s/m."""
    return lambda changes: made(
        circle(radius - 2.5 * (changes.get(chapter_6.MODEL, 0.22) - 0.22), height), seconds=30.0)


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
    ratio = found['x and y, distance to the experiment, without drag over with drag']
    assert ratio.low == pytest.approx(8.0)
    assert found['x and y, experiment against simulation with drag, RMS'].high == (
        pytest.approx(0.05))
    assert all(m.holds for m in found.values())
    flights_by(monkeypatch, experiment=made(circle(1.0), seconds=30.0),
               simulation_without_drag=made(circle(1.4), seconds=30.0),
               simulation_with_drag=shrinking(-2.1))
    height = by_what(figure())['z, change of that distance by the drag']
    assert height.low == pytest.approx(0.1) and not height.holds


def test_a_step_is_compared_before_it_has_settled(monkeypatch):
    def step(size):  # differs between 5 and 12 s alone
        return path(lambda t: np.where((t > 5.0) & (t < 12.0), size, 0.0))
    flights_by(monkeypatch, experiment=made(step(0.0), seconds=20.0),
               simulation_without_drag=made(step(0.2), seconds=20.0),
               simulation_with_drag=lambda changes: made(step(
                   0.05 + changes.get(chapter_6.MODEL, 0.22) - 0.22), seconds=20.0))
    ratio = by_what(chapter_6.figure_6_5())[
        'x and y, distance to the experiment, without drag over with drag']
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
    assert found['x and y, old map against new map, RMS'].low == pytest.approx(0.05)


def holds(result):
    return [m.holds for m in result.measured]


def climbing(peak, radius=1.0):
    """Return a circle after a take-off that overshoots by a peak, about a hover point of 1.5 m."""
    return made(
        path(lambda t: radius * np.cos(t), lambda t: radius * np.sin(t),
             lambda t: np.where((t > 3.0) & (t < 4.0), -1.5 - peak, -1.5)), None, path(),
        seconds=20.0)


@pytest.mark.parametrize(('old', 'new', 'simulation', 'expected'), [
    (climbing(0.09), climbing(0.45, 1.05), climbing(0.45, 1.34), [True] * 6),
    (climbing(0.09), climbing(0.45, 1.2), climbing(0.45, 1.5), [False, *[True] * 5]),
    (climbing(0.09), climbing(0.45), climbing(0.45), [True, False, False, True, True, True]),
    (climbing(0.09), climbing(0.45), climbing(0.45, 1.4), [True, True, False, True, True, True]),
    (climbing(0.45), climbing(0.09), climbing(0.1, 1.29), [True, True, True, *[False] * 3])])
def test_each_part_of_the_claim_on_the_motor_maps_can_fail(
        monkeypatch, old, new, simulation, expected):
    flights_by(monkeypatch, experiment_old_map=old, experiment_new_map=new, simulation=simulation)
    assert holds(chapter_6.figure_6_1()) == expected


def bobbing(shrink, offset=0.0):
    """Return a vertical sine whose amplitude is too small by a share, with an offset."""
    return made(path(z=lambda t: -2.0 + offset - (1.0 - shrink) * np.sin(t)), None,
                path(z=lambda t: -2.0 - np.sin(t)), seconds=40.0)


@pytest.mark.parametrize(('old', 'new', 'simulation', 'expected'), [
    (bobbing(0.3), bobbing(0.01), bobbing(0.0), [True, True, True, True]),
    (bobbing(0.1), bobbing(0.01), bobbing(0.0), [False, True, True, True]),
    (bobbing(0.3), bobbing(0.1), bobbing(0.0), [True, False, False, False]),
    (bobbing(0.3), bobbing(0.01), bobbing(0.0, 0.03), [True, True, False, True]),
    (bobbing(0.3), bobbing(0.01, 0.1), bobbing(0.01, 0.1), [True, False, True, False])])
def test_each_part_of_the_claim_on_the_vertical_sine_can_fail(
        monkeypatch, old, new, simulation, expected):
    flights_by(monkeypatch, experiment_old_map=old, experiment_new_map=new, simulation=simulation)
    assert holds(chapter_6.figure_6_2()) == expected


@pytest.mark.parametrize(('slow', 'fast', 'expected'), [
    (0.0008, 0.006, [True, True, True]), (0.0012, 0.006, [False, True, True]),
    (0.003, 0.009, [False, False, True]), (0.0008, 0.0012, [True, True, False])])
def test_inertias_that_matter_or_do_not_depend_on_the_speed_fail(
        monkeypatch, slow, fast, expected):
    base = made(path(), seconds=20.0)
    flights_by(monkeypatch, new_inertia=base, old_inertia=made(path(slow), seconds=20.0),
               new_inertia_fast=base, old_inertia_fast=made(path(fast), seconds=20.0))
    assert holds(chapter_6.figure_6_3()) == expected


@pytest.mark.parametrize(('figure', 'without', 'with_drag', 'expected'), [
    (chapter_6.figure_6_4, 1.4, 1.05, [True, True, True, True]),
    (chapter_6.figure_6_4, 1.1, 1.05, [True, False, True, True]),   # drag hardly matters
    (chapter_6.figure_6_4, 1.9, 1.2, [False, True, False, True]),   # nearer, but not close
    (chapter_6.figure_6_4, 1.05, 1.4, [False, False, False, True]),  # drag makes it worse
    (chapter_6.figure_6_6, 1.14, 1.05, [True, False, True, True])])
def test_a_simulation_that_drag_does_not_bring_close_fails(
        monkeypatch, figure, without, with_drag, expected):
    flights_by(monkeypatch, experiment=made(circle(1.0), seconds=30.0),
               simulation_without_drag=made(circle(without), seconds=30.0),
               simulation_with_drag=shrinking(radius=with_drag))
    assert holds(figure()) == expected


def test_the_figures_overlay_every_flight_on_its_reference(monkeypatch):
    flights_by(monkeypatch, experiment=made(circle(1.0), seconds=30.0),
               simulation_without_drag=made(circle(1.4), seconds=30.0),
               simulation_with_drag=shrinking())
    figure = chapter_6.figure_6_4().figure
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert labels == ['reference', 'experiment', 'without drag', 'with drag']
    assert [line.get_ydata().max() for line in figure.axes[0].lines[1:]] == pytest.approx(
        [1.0, 1.4, 1.05], abs=1e-4)
