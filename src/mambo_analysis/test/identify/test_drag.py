"""Drag from simulated flights whose truth is known, sensors with their noise."""

from pathlib import Path

from interval_checks import assert_covers
from mambo_analysis.identify.drag import fit_drag, from_recording, main, Track, VEHICLE
from mambo_analysis.identify.regression import IdentifyError
from mambo_flight import closed_loop
from mambo_flight.scenario import scenario
from mambo_model.vehicle import parameters
import numpy as np
import pytest

BAG = Path(__file__).parents[4] / 'bags/circle_short'
K_C, K_Z = 0.22, 0.15


def flight(trajectory='circle', seed=1, duration=15.0, **overrides):
    return scenario(trajectory, duration=duration, land=False, seed=seed, overrides=overrides)


def flown(scenario):
    """Return what the command gets: a track, and a scenario that does not know the drag."""
    return from_recording(closed_loop.fly(scenario))


def blind(**options):
    """Return the scenario of a flight with a wrong coefficient in it."""
    return flight(**options, **{f'{VEHICLE}.drag_coefficient': 0.6})


@pytest.mark.parametrize('truth', [0.0, 0.1, K_C, 0.5])
def test_k_c_comes_back_whatever_the_scenario_believes(truth):
    track = flown(flight(**{f'{VEHICLE}.drag_coefficient': truth}))
    found = fit_drag(track, blind())
    # 5 % asked; three times the spread of 0.003 over seeds
    assert found.coefficient.value == pytest.approx(truth, abs=max(0.05 * truth, 0.009))
    assert found.coefficient.low <= truth <= found.coefficient.high
    assert found.fit.rms < 0.015  # m, what the estimator lets the vehicle stray
    if truth:
        assert found.without > 5.0 * found.fit.rms


def test_without_noise_it_is_exact():
    quiet = scenario('circle', duration=15.0, land=False, noise=False)
    found = fit_drag(flown(quiet), blind(seed=5))
    assert found.coefficient.value == pytest.approx(K_C, rel=1e-3)  # interpolation of 120 Hz


def test_offset_and_drift_of_the_axes_do_not_matter():
    track = flown(flight())
    moved = track._replace(position=track.position + [0.3, -0.2, 0.1]
                           + np.outer(track.t * 1e-9, [0.01, 0.02, 0.0]))
    ours, theirs = fit_drag(track, blind()), fit_drag(moved, blind())
    # a sixth of the interval: gates of the filters leave steps in what a coefficient flies
    assert theirs.coefficient.value == pytest.approx(ours.coefficient.value, abs=1e-3)


def test_a_sine_in_height_shows_the_vertical_drag():
    truth = flight('z_sine', duration=20.0, **{f'{VEHICLE}.vertical_drag_coefficient': K_Z})
    found = fit_drag(flown(truth), flight('z_sine', duration=20.0), 'vertical')
    assert found.coefficient.value == pytest.approx(K_Z, rel=0.05)
    assert found.coefficient.low <= K_Z <= found.coefficient.high


@pytest.mark.slow
def test_intervals_cover_over_20_seeds():
    # a fit flies 15 s many times over: 20 still tell intervals that are half or twice as wide
    found = [fit_drag(flown(flight(seed=seed)), blind(seed=seed)) for seed in range(1, 21)]
    assert max(abs(one.coefficient.value / K_C - 1.0) for one in found) < 0.06
    assert_covers(K_C, [one.coefficient for one in found])


@pytest.mark.parametrize('change, message', [
    (lambda t: t._replace(position=t.position[:, :] * np.nan), 'position is not finite'),
    (lambda t: Track(t.t[:600], t.position[:600]), 'positions to compare, at least 100'),
    (lambda t: t._replace(position=np.zeros_like(t.position)), 'stays where it is'),
    (lambda t: t._replace(t=t.t[::-1]), 'time does not rise')])
def test_what_is_no_flight_is_refused(change, message):
    with pytest.raises(IdentifyError, match=message):
        fit_drag(change(flown(flight())), blind())


def test_a_hover_is_refused():
    with pytest.raises(IdentifyError, match='a hover shows no drag'):
        fit_drag(flown(flight()), flight('hover'))
    with pytest.raises(IdentifyError, match='nothing to compare between 9 and 8 s'):
        fit_drag(flown(flight()), blind(), start=9.0, end=8.0)


def test_the_command_reads_a_bag_and_writes_a_vehicle(tmp_path, capsys):
    assert main([str(BAG), '--out', str(tmp_path)]) == 0
    assert 'k_c' in capsys.readouterr().out
    got = parameters.load(tmp_path / 'identify_drag.yaml')
    assert got.drag_coefficient == pytest.approx(K_C, rel=0.25)  # 8 s, of which 3 on the circle
    assert got.drag_reading == 'per_rotor_thrust'
    assert (tmp_path / 'identify_drag.png').stat().st_size > 10000
    assert main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.count('\n') == 1
