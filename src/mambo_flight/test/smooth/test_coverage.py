"""How often the intervals of the smoother hold: a fast subset of what the command does."""

from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.filter_error import with_unknowns
from mambo_flight.scenario import override
from mambo_flight.smooth import coverage
from mambo_flight.smooth.intervals import Path, QUANTITIES
import pytest

FLIGHTS = 6


@pytest.fixture(scope='module')
def trials():
    """Return short flights with drawn errors of the flow."""
    flight = override(flight_of('vertical_circle'), {'sim_node.duration': 25.0})
    return [coverage.trial(with_unknowns(flight, seed, True)) for seed in range(1, 1 + FLIGHTS)]


@pytest.mark.long
def test_intervals_hold_as_often_as_they_say(trials):
    held = [sum(one.held[i] for one in trials) for i in range(len(QUANTITIES))]
    # an interval of 95 % misses 3 or more of 6 in 1 of 500 cases, of 11 quantities in 1 of 45
    assert min(held) >= FLIGHTS - 2, held
    assert sum(held) >= 0.85 * FLIGHTS * len(QUANTITIES)


@pytest.mark.long
def test_a_smoothed_path_is_nearer_to_the_truth(trials):
    assert sum(one.smoothed.rms for one in trials) < sum(one.filtered.rms for one in trials)


def test_table_counts_and_averages():
    path = Path(0.03, 0.05, 0.04)
    one = coverage.Trial((True,) * len(QUANTITIES), (0.01,) * len(QUANTITIES), path, path)
    two = one._replace(held=(False,) + one.held[1:])
    text = coverage.table([one, two]).splitlines()
    assert text[1].split()[-2:] == ['1', '0.01'] and text[2].split()[-2:] == ['2', '0.01']
    assert text[-1].endswith('rms 0.0300, largest 0.0500, end 0.0400')


def test_no_flight_is_refused(capsys):
    with pytest.raises(SystemExit) as end:
        coverage.main(['circle', '--seeds', '0'])
    assert end.value.code == 2
    assert 'coverage: --seeds: 0 must be within 1 to 10000' in capsys.readouterr().err


def test_an_interrupt_says_how_many_were_flown(monkeypatch):
    def trial(flight):
        if flight.seed == 3:
            raise KeyboardInterrupt
        return of_errors(True)
    monkeypatch.setattr(coverage, 'trial', trial)
    with pytest.raises(KeyboardInterrupt, match='2 of 5 flights were done, none is kept'):
        coverage.main(['circle', '--seeds', '5'])


def test_vehicles_that_never_take_off_are_counted_and_left_out(monkeypatch, capsys):
    monkeypatch.setattr(coverage, 'trial', lambda flight: of_errors(True) if flight.seed % 2
                        else None)
    assert coverage.main(['circle', '--seeds', '5']) == 0
    out = capsys.readouterr().out
    assert out.endswith('2 of 5 vehicles never took off: left out\n') and ' of 3' in out
    monkeypatch.setattr(coverage, 'trial', lambda flight: None)
    assert coverage.main(['circle', '--seeds', '5']) == 1
    assert capsys.readouterr().err.endswith('the vehicle never took off: nothing to compare\n')


@pytest.mark.long
def test_a_vehicle_too_heavy_to_fly_has_no_trial():
    heavy = override(flight_of('circle'), {
        'sim_node.duration': 12.0, 'sim_node.simulator.vehicle.mass': 0.15})
    assert coverage.trial(heavy) is None


def of_errors(held, error=0.01, rms=0.03):
    count = len(QUANTITIES)
    return coverage.Trial((held,) * count, (error,) * count, Path(rms, 2.0 * rms, rms),
                          Path(0.5 * rms, rms, 0.0))


def test_the_table_has_the_rms_error_over_all_flights():
    text = coverage.table([of_errors(True, 0.03), of_errors(False, 0.04)]).splitlines()
    assert text[0].split()[:3] == ['held', 'of', '2']
    for row, quantity in zip(text[1:], QUANTITIES):
        assert row.startswith(f'{quantity.name} [{quantity.unit}]')
        assert row.split()[-2:] == ['1', '0.03536']  # the root of (9 + 16) / 2


def test_both_paths_are_averaged_as_squares():
    *_, filtered, smoothed = coverage.table([
        of_errors(True, rms=0.03), of_errors(True, rms=0.04)]).splitlines()
    assert filtered.endswith('rms 0.0354, largest 0.0707, end 0.0354')
    assert smoothed.endswith('rms 0.0177, largest 0.0354, end 0.0000')
    assert 'filtered [m]' in filtered and 'smoothed [m]' in smoothed
