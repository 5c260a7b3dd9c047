"""The force model is found again, with intervals that hold, and what is not excited is named."""

from flown import flight, TRUE
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.twin import force
from mambo_analysis.twin.force import fit_force
import numpy as np
import pytest


def of_truth(found):
    """Return the true value of each parameter, at the reference of what was found."""
    # kappa belongs to X_0 and V_0, which are the means of the flight
    share = found.model.command / TRUE.command * found.model.voltage / TRUE.voltage
    return {'drag x': 0.4, 'drag y': 0.35, 'drag z': 0.25, 'tilt x': 0.05, 'tilt y': -0.03,
            'thrust': TRUE.thrust * share ** TRUE.exponent, 'exponent': 1.8, 'motor lag': 0.05}


def test_without_noise_the_model_is_found_exactly():
    found = fit_force(flight(noise=1e-6))
    for name, value in of_truth(found).items():
        assert found.values[name].value == pytest.approx(value, rel=2e-3, abs=1e-4), name
    assert not found.hidden


@pytest.mark.long
def test_intervals_cover_and_are_no_wider_than_the_spread():
    """Of 25 flights 95 % intervals miss a parameter once; 6 misses have a chance of 0.1 %."""
    found = [fit_force(flight(seed)) for seed in range(25)]
    truth = of_truth(found[0])
    for name in force.NAMES:
        inside = [one.values[name].low <= truth[name] <= one.values[name].high for one in found]
        assert sum(inside) >= 20, name
        spread = np.std([one.values[name].value for one in found], ddof=1)
        half = np.mean([one.values[name].high - one.values[name].value for one in found])
        # eight parts are cautious: Student's t of 7 is 1.2 times the normal one, and an estimate
        # without a part misses the part's velocities, too
        assert 0.7 < half / (1.96 * spread) < 2.2, name


@pytest.mark.long
def test_a_drag_that_changes_within_the_flight_widens_its_interval():
    """Of a drag that grows by half in the middle, the interval reaches both values."""
    steady, later = flight(0, 30.0), flight(1, 30.0, TRUE._replace(drag=(0.6, 0.35, 0.25)))
    half = len(steady.t) // 2
    changed = later._replace(**{name: np.concatenate([
        getattr(steady, name)[:half], getattr(later, name)[half:]]) for name in (
            'force', 'attitude', 'command', 'velocity')})
    value = fit_force(changed).values['drag x']
    assert value.low < 0.41 and value.high > 0.59
    assert value.half > 5.0 * fit_force(steady).values['drag x'].half
    assert fit_force(changed).values['drag y'].half < 0.05  # which stayed


def test_the_lag_may_be_shorter_by_a_step_of_the_grid():
    """Commands that act half a step later look like a longer lag; the interval knows."""
    late, on_time = [], []
    for seed in range(6):
        one = flight(seed)
        next_one = np.vstack([one.command[1:], one.command[-1:]])
        delayed = 0.5 * (one.command + next_one)  # what is logged acts half a step later
        late.append(fit_force(one._replace(command=delayed), blocks=0).values['motor lag'])
        on_time.append(fit_force(one, blocks=0).values['motor lag'])
    longer = np.mean([a.value - b.value for a, b in zip(late, on_time, strict=True)])
    assert 0.003 < longer < 0.008
    assert sum(value.low < TRUE.lag < value.high for value in late) >= 5
    assert all(value.low >= 0.0 for value in (*late, *on_time))


def test_a_bias_that_may_be_a_turned_sensor_makes_the_thrust_uncertain():
    one = flight()
    sure, unsure = (fit_force(one._replace(mounting=np.array([angle, 0.0, 0.0]))).values
                    for angle in (0.0, 0.06))
    assert unsure['thrust'].half > 1.5 * sure['thrust'].half
    assert unsure['drag x'] == sure['drag x'] and unsure['thrust'].value == sure['thrust'].value


def test_thrust_follows_commands_voltage_and_lag():
    one = flight(noise=0.0)
    thrust = one.force[:, 2] + 0.25 * one.body_velocity[:, 2]
    assert np.allclose(TRUE.thrust_over_mass(one), thrust, atol=2e-3)
    assert TRUE.motor_thrust(one).shape == (len(one.t), 4)
    assert np.allclose(TRUE.motor_thrust(one).sum(axis=1), TRUE.thrust_over_mass(one))
    doubled = one._replace(command=2.0 * one.command)
    assert np.allclose(TRUE.thrust_over_mass(doubled), 2.0 ** 1.8 * TRUE.thrust_over_mass(one))
    dead = one._replace(voltage=np.full(len(one.t), np.nan))
    assert np.isfinite(TRUE.thrust_over_mass(dead)).all()


def test_a_hover_shows_no_drag():
    one = flight()
    still = one._replace(velocity=0.01 * one.velocity)
    hidden = fit_force(still).hidden
    assert [line.split(':')[0] for line in hidden][:3] == ['drag x', 'drag y', 'drag z']


def test_constant_thrust_shows_neither_exponent_nor_lag():
    one = flight()
    mean = np.full_like(one.command, one.command.mean())
    rng = np.random.default_rng(1)
    force_z = TRUE.thrust_over_mass(one).mean() + rng.normal(0.0, 0.05, len(one.t))
    flat = one._replace(command=mean + rng.normal(0.0, 10.0, mean.shape),
                        voltage=np.full(len(one.t), 3.6),
                        force=np.column_stack([one.force[:, :2], force_z]))
    assert {line.split(':')[0] for line in fit_force(flat).hidden} >= {'exponent', 'motor lag'}


def test_flights_that_determine_nothing_are_named():
    dead = flight()
    dead = dead._replace(command=np.zeros_like(dead.command))
    with np.errstate(all='ignore'), pytest.raises(
            IdentifyError, match=f'^{dead.name}: the numbers are too extreme to fit'):
        fit_force(dead)


@pytest.mark.parametrize('axis, i', [('x', 0), ('y', 1)])
def test_a_drag_that_drives_is_refused(axis, i):
    one = flight()
    force = one.force * np.where(np.arange(3) == i, -1.0, 1.0)
    with pytest.raises(IdentifyError, match=f'drag {axis} is -0.* drives the vehicle: check the '
                                            f'sign of the accelerometer along {axis}'):
        fit_force(one._replace(force=force), blocks=0)


def test_a_thrust_that_falls_less_than_without_drag_shows_none():
    """Of other causes, wash say: a drag along z below 0 is none, but no sign of wrong axes."""
    model = TRUE._replace(drag=(0.4, 0.35, -0.25))
    found = fit_force(flight(model=model), blocks=0)
    assert 'drag z' not in found.shown and 'drag x' in found.shown
    assert any('would drive the vehicle' in line for line in found.hidden)


def test_swapped_axes_of_the_accelerometer_are_refused():
    one = flight()
    with pytest.raises(IdentifyError, match='across the velocity: its x and y are not those'):
        fit_force(one._replace(force=one.force[:, [1, 0, 2]]), blocks=0)


def test_an_estimate_at_the_bound_of_its_range_is_not_shown():
    found = fit_force(flight(model=TRUE._replace(exponent=4.6)), blocks=0)
    assert 'exponent: the fit ends at the bound of its range, 4' in found.hidden
    assert 'exponent' not in found.shown


def test_commands_that_are_stamped_late_are_refused():
    """A vehicle without a lag is none of them."""
    one = flight()
    late = one._replace(command=np.concatenate([one.command[:10], one.command[:-10]]))
    with pytest.raises(IdentifyError, match='the stamps of motor_pwm are late against those of'):
        fit_force(late, blocks=0)
    quick = fit_force(flight(model=TRUE._replace(lag=1e-3)), blocks=0)
    assert quick.values['motor lag'].value < 0.01
