"""The lag of the motors from commands and an accelerometer, made here and flown."""

from pathlib import Path
import re

from interval_checks import assert_covers
from mambo_analysis.identify import motor
from mambo_analysis.identify.motor import fit_flight, fit_motor, from_recording, in_flight, main
from mambo_analysis.identify.regression import IdentifyError
from mambo_flight import closed_loop
from mambo_flight.scenario import scenario
from mambo_model.vehicle import parameters
from mambo_model.vehicle.parameters import preset
import numpy as np
import pytest
from scipy import signal

BAG = Path(__file__).parents[4] / 'bags/circle_short'
MAMBO = preset('identified')
DT, N = 0.005, 3000
T = DT * np.arange(N)


def sensed(pwm, lag, noise=0.1, vibration=0.0, offset=0.3, seed=0):
    """Return the accelerometer along b3: map (4.5), lag by a filter, noise."""
    target = np.sum(MAMBO.power_a * pwm ** MAMBO.power_b, axis=1)
    left = np.exp(-DT / lag) if lag else 0.0
    start = [left * target[0]]
    late = signal.lfilter([1.0 - left], [1.0, -left], target, zi=start)[0]
    thrust = np.concatenate(([target[0]], late[:-1]))  # a command acts from its instant on
    rng = np.random.default_rng((seed, 7))
    shaken = vibration * np.diff(rng.standard_normal(len(pwm) + 1))
    return -thrust / MAMBO.mass + offset + shaken + noise * rng.standard_normal(len(pwm))


def commands(seed=0):
    """Return commands around hover that change at all rates below some 10 Hz."""
    rng = np.random.default_rng((seed, 3))
    smooth = signal.lfilter([0.2], [1.0, -0.8], rng.standard_normal((N, 1)), axis=0)
    return 277.0 + 40.0 * smooth + rng.standard_normal((N, 4))


@pytest.mark.parametrize('lag', [0.0, 0.005, 0.02, 0.05, 0.1])
def test_the_lag_comes_back(lag):
    pwm = commands()
    found = fit_motor(T, pwm, sensed(pwm, lag), MAMBO)
    # 5 % asked, and of no lag at all less than half a step of 5 ms
    assert found.time_constant.value == pytest.approx(lag, rel=0.05, abs=0.0 if lag else 0.0025)
    assert found.time_constant.low <= lag <= found.time_constant.high
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    assert found.offset == pytest.approx(0.3, abs=0.1)
    if lag > 0.01:
        assert found.without > 1.5 * found.fit.rms


def test_a_heavier_vehicle_has_less_acceleration_but_the_same_lag():
    pwm = commands()
    found = fit_motor(T, pwm, 0.9 * sensed(pwm, 0.03, offset=0.0), MAMBO)
    assert found.gain.value == pytest.approx(0.9, abs=0.01)
    assert found.time_constant.value == pytest.approx(0.03, rel=0.05)


@pytest.mark.long
def test_intervals_cover_over_60_seeds():
    found = []
    for seed in range(60):
        pwm = commands(seed)
        found.append(fit_motor(T, pwm, sensed(pwm, 0.03, seed=seed), MAMBO))
    assert_covers(0.03, [one.time_constant for one in found])


@pytest.mark.long
def test_shaking_propellers_make_intervals_cautious_but_true():
    found = []
    for seed in range(60):
        pwm = commands(seed)
        acceleration = sensed(pwm, 0.03, 0.02, 0.9, seed=seed)  # 1.3 m/s^2, as in flight
        found.append(fit_motor(T, pwm, acceleration, MAMBO))
    assert max(abs(one.time_constant.value / 0.03 - 1.0) for one in found) < 0.05
    # no autoregressive model knows a noise that has nothing at low frequencies
    assert_covers(0.03, [one.time_constant for one in found], wide=3.0)


def test_steps_of_uneven_length_are_taken_as_they_are():
    steps = np.random.default_rng(1).uniform(0.003, 0.007, N)
    t, pwm, lag = np.cumsum(steps), commands(), 0.04
    target = np.sum(MAMBO.power_a * pwm ** MAMBO.power_b, axis=1)
    thrust = [target[0]]
    for step, goal in zip(steps[1:], target):
        thrust.append(goal + np.exp(-step / lag) * (thrust[-1] - goal))
    found = fit_motor(t, pwm, -np.array(thrust) / MAMBO.mass, MAMBO)
    assert found.time_constant.value == pytest.approx(lag, rel=1e-3)  # without noise


@pytest.mark.parametrize('lag', [0.0, 0.03])
def test_a_flight_with_lagging_motors_shows_them(lag):
    flown = closed_loop.fly(scenario(
        'z_sine', duration=20.0, land=False, seed=4,
        overrides={'sim_node.simulator.vehicle.motor_time_constant': lag}))
    t, pwm, acceleration = from_recording(flown, MAMBO)
    assert 1.0 < t[0] < 3.0 and t[-1] > 19.0
    found = fit_motor(t, pwm, acceleration, MAMBO)
    assert found.time_constant.value == pytest.approx(lag, rel=0.05, abs=0.0 if lag else 0.0025)
    assert found.time_constant.low <= lag <= found.time_constant.high


def test_only_the_air_counts():
    pwm = np.zeros((N, 4))
    pwm[300:320] = 300.0   # a hop
    pwm[600:2800] = 277.0  # the flight
    air = in_flight(T, pwm, MAMBO)
    assert T[air][0] == pytest.approx(600 * DT + 0.5, abs=0.02)
    assert T[air][-1] == pytest.approx(2800 * DT - 0.5, abs=0.02)
    assert not in_flight(T, 0.0 * pwm, MAMBO).any()


@pytest.mark.parametrize('change, message', [
    (lambda t, p, a: (t[:500], p[:500], a[:500]), '500 samples, at least 800'),
    (lambda t, p, a: (t, p, np.where(t == t[9], np.nan, a)), 'acceleration is not finite in 1'),
    (lambda t, p, a: (t, 277.0 + 0.0 * p, a), 'constant commands show no lag'),
    (lambda t, p, a: (t, p, -a), 'must be in m/s'),
    (lambda t, p, a: (t, p, a / 9.81), 'must be in m/s'),
    (lambda t, p, a: (t, p, 2.0 * a), 'must be in m/s'),
    (lambda t, p, a: (t, p, -9.8 + 0.0 * a), '-9.8 m/s.2 throughout: that axis is dead'),
    (lambda t, p, a: (t, p, -9.8 + 0.01 * (a + 9.8)), 'is at the end of its range'),
    (lambda t, p, a: (0.0 * t, p, a), 'time does not rise')])
def test_what_shows_no_lag_is_refused(change, message):
    pwm = commands()
    with pytest.raises(IdentifyError, match=message):
        fit_motor(*change(T, pwm, sensed(pwm, 0.03)), MAMBO)


def test_the_command_reads_a_bag_and_writes_a_vehicle(tmp_path, capsys, monkeypatch):
    kept, fit = [], motor.fit_flight
    monkeypatch.setattr(motor, 'fit_flight', lambda *a: kept.append(fit(*a)) or kept[-1])
    assert main([str(BAG), '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert 'time constant' in output and 'thrust over that of the map' in output
    # the fit is along b3, which points down
    assert re.search(r'accelerometer offset z, body FLU \[m/s\^2\] +' + re.escape(
        f'{-kept[0].offset:.6g}'), output)
    got = parameters.load(tmp_path / 'identify_motor.yaml')
    assert got.motor_time_constant < 0.02  # the bag's vehicle has none, its commands hardly change
    assert (tmp_path / 'identify_motor.png').stat().st_size > 10000
    assert main([str(BAG), '--namespace', 'x']) == 2
    assert capsys.readouterr().err.startswith('identify_motor: ')


@pytest.mark.parametrize('battery', [False, True])
def test_a_battery_that_may_have_sagged_is_told(monkeypatch, capsys, battery):
    whole = motor.of_bag
    monkeypatch.setattr(motor, 'of_bag', lambda *arguments: whole(*arguments)._replace(
        battery=battery))
    assert main([str(BAG)]) == 0
    assert ('lag and thrust over that of the map hold only if the battery did not sag; record '
            'voltage and motion, and give --map flight' in capsys.readouterr().out) == battery


def test_residuals_with_and_without_lag_are_about_their_means_under_drift():
    pwm = commands()
    falling = sensed(pwm, 0.03, noise=0.02) + 0.5 * T / T[-1]
    found = fit_motor(T, pwm, falling, MAMBO)
    assert found.rms < found.without  # beside the mean of a drift the rms would be larger
    assert found.offset == pytest.approx(0.3 + 0.25, abs=0.1)  # and the mean of the drift


def test_commands_that_are_not_those_of_the_base_say_so(tmp_path, capsys):
    weak = tmp_path / 'weak.yaml'
    weak.write_text('description: weak\nbase: identified\n'
                    'pwm_max: {value: 200, unit: PWM, source: made up}\n')
    for base, line in ((weak, 'beyond the range of the base, 10 to 200'),
                       ('crazyflie', 'with the motor map of the base, commands up to')):
        assert main([str(BAG), '--base', str(base)]) == 2
        error = capsys.readouterr().err
        assert line in error and 'give the vehicle by --base' in error and error.count('\n') == 1


@pytest.mark.parametrize('lag', [0.03, 0.06])
def test_the_floor_under_a_landing_vehicle_counts_as_no_thrust(lag):
    """It is carried by the floor while its motors still run, in a flight with gentle commands."""
    flown = closed_loop.fly(scenario(
        'circle', duration=20.0, land=True, seed=4,
        overrides={'sim_node.simulator.vehicle.motor_time_constant': lag}))
    found = fit_flight(*from_recording(flown, MAMBO), MAMBO)
    assert found.time_constant.low <= lag <= found.time_constant.high
    assert found.time_constant.value == pytest.approx(lag, rel=0.05)
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    with_floor = fit_motor(*from_recording(flown, MAMBO), MAMBO)
    assert with_floor.time_constant.value > 1.1 * lag
