"""Flights reduced to a few numbers: the same flights, and the right numbers."""

import dataclasses
import math

from hypothesis import given, settings, strategies as st
from mambo_control import failsafe
from mambo_control.safety import REASON_ESTIMATE, REASON_GROUNDED
from mambo_flight import closed_loop
from mambo_flight.scenario import replaced, scenario
from mambo_flight.sweep import monte_carlo
from mambo_model.motion.height_check import distance_fault, height_fault, landing_fault
from mambo_model.motion.trajectory import GROUND, LANDED, TRACK
from mambo_model.vehicle.battery import electric_power, supply
from mambo_model.vehicle.parameters import Vehicle
from mambo_model.vehicle.vehicle_options import BatteryParams
from mambo_sim import plant
import numpy as np
import pytest

TRUTH = scenario(estimator='ground_truth', duration=8.0, land=False)
SENSORS = scenario(duration=8.0, land=False, overrides={
    'controller_node.vehicle.pwm_max': 330.0})  # take-off needs more


def recorded(flight):
    r = closed_loop.fly(flight)
    return r, (r.phase > GROUND) & (r.phase < LANDED)


def test_a_flight_without_sensors_is_the_closed_loop_on_the_true_state_to_the_bit():
    (row,) = monte_carlo.fly_many([TRUTH])
    assert repr(row) == repr(monte_carlo.fly_with_sensors(TRUTH))  # NaN equals NaN here
    assert row['tracking_max'] > 0.1 and row['estimation_max'] == 0.0


def test_metrics_are_those_of_the_arrays():
    r, flown = recorded(SENSORS)
    row = monte_carlo.fly_with_sensors(SENSORS)
    for name, error in (('tracking', r.truth - r.reference), ('estimation', r.estimate - r.truth)):
        rho = error[:, :3]
        length = np.linalg.norm(rho, axis=1)
        # sums of 1400 squares in another order: 1400 roundings of 1e-16 at most
        assert row[f'{name}_rms'] == pytest.approx(
            math.sqrt((rho[flown] ** 2).sum(axis=1).mean()), rel=1e-12)
        for i, axis in enumerate('xyz'):
            assert row[f'{name}_rms_{axis}'] == pytest.approx(
                math.sqrt((rho[flown, i] ** 2).mean()), rel=1e-12)
        assert row[f'{name}_max'] == pytest.approx(length[flown].max(), rel=1e-12)
        assert row[f'{name}_final'] == pytest.approx(length[-1], rel=1e-12)
    running = r.pwm.max(axis=1) > 0.0
    limited = (r.pwm >= 330.0).any(axis=1) | (r.pwm <= 10.0).any(axis=1)
    assert 0.0 < row['saturated_share'] == (limited & running).sum() / running.sum() < 0.5
    assert row['pwm_max'] == 330.0
    options = Vehicle(battery=BatteryParams(enabled=True)).options()
    power = [electric_power(tuple(4.29e-5 * x ** 1.47 for x in pwm), options)
             for pwm in r.pwm[:-1]]
    assert row['energy'] == pytest.approx(0.005 * sum(power), rel=1e-12)
    assert not row['shutdown'] and math.isnan(row['shutdown_time'])
    assert row['shutdown_reason'] == ''


@pytest.mark.parametrize('overrides', [
    {}, {'sim_node.simulator.vehicle.motor_time_constant': 0.02},
    {'sim_node.simulator.vehicle.battery.enabled': True},
    {'sim_node.simulator.vehicle.fade.enabled': True, 'sim_node.simulator.vehicle.mass': 0.09},
    {'controller_node.vehicle.thrust_map': 'linear'}])
def test_the_energy_is_that_of_the_true_rotors(overrides):
    """Whatever the controller believes; the charge drawn from the battery says the same."""
    flight = replaced(TRUTH, overrides)
    sim = flight.sim_node.simulator
    (row,) = monte_carlo.fly_many([flight])
    assert repr(row) == repr(monte_carlo.fly_with_sensors(flight))
    r, state, options = closed_loop.fly(flight), plant.initial(sim.plant), (
        dataclasses.replace(sim.vehicle, battery=dataclasses.replace(
            sim.vehicle.battery, enabled=True)).options())
    power, work = 0.0, 0.0
    for pwm in r.pwm[:-1].tolist():
        before = state
        state = plant.advance(
            state, tuple(pwm), monte_carlo.STEP, sim.plant.substeps(), sim.vehicle.values(), True,
            sim.vehicle.options())
        power += electric_power(state.thrust, options)
        if sim.vehicle.battery.enabled:
            voltage, _ = supply(before.charge, before.thrust, options)
            work += voltage * (state.charge - before.charge)
    assert row['energy'] == pytest.approx(0.005 * power, rel=1e-9)
    if sim.vehicle.battery.enabled:
        assert row['energy'] == pytest.approx(work, rel=1e-3)


def count(tally, t, off, stopped=False, reason=0, pwm=(100.0,) * 4, phase=2):
    return monte_carlo.count(
        tally, t, (off, 0.0, 0.0), (off, 0.0, 2.0), (0.0, 0.0, 0.0), phase, pwm, stopped, reason,
        (10.0, 500.0), (0.2,) * 4)


def test_a_shutdown_is_told_with_its_first_instant_and_its_reason():
    tally = count(monte_carlo.START, 0.5, 1.0)
    for t in (1.0, 1.5):
        tally = count(tally, t, 3.0, True, 5, (0.0,) * 4)
    row = monte_carlo.metrics(tally, Vehicle())
    assert (row['shutdown'], row['shutdown_time']) == (True, 1.0)
    assert row['shutdown_reason'].startswith('crash: ')
    assert row['tracking_rms'] == pytest.approx(math.sqrt(19.0 / 3.0), rel=1e-15)
    assert row['estimation_rms_z'] == 2.0 and row['estimation_rms_x'] == 0.0
    assert row['saturated_share'] == 0.0


@pytest.mark.parametrize(('phase', 'told'), [(2, True), (3, True), (4, False)])
def test_what_happens_after_the_landing_is_no_failure(phase, told):
    tally = monte_carlo.START
    for reason in (0, 3, 3):
        tally = count(tally, 0.5, 0.0, reason == 3, reason, (0.0,) * 4, phase)
    row = monte_carlo.metrics(tally, Vehicle())
    assert row['shutdown'] == told and bool(row['failsafe']) == told


def test_a_flight_on_the_floor_below_its_reference_has_fallen():
    heavy = scenario(estimator='ground_truth', land=False, duration=6.0, overrides={
        'sim_node.simulator.vehicle.mass': 0.2})
    (row,) = monte_carlo.fly_many([heavy])
    assert row['fallen'] and not row['shutdown']
    assert monte_carlo.fly_with_sensors(heavy)['fallen']
    assert not monte_carlo.fly_with_sensors(TRUTH)['fallen']


def test_a_vehicle_that_cannot_leave_the_floor_is_told_and_its_estimate_is_not_lost():
    heavy = scenario('hover', 'joint', land=False, duration=4.0, overrides={
        'sim_node.simulator.vehicle.mass': 0.2})
    row = monte_carlo.fly_with_sensors(heavy)
    assert row['shutdown_reason'] == failsafe.REASONS[REASON_GROUNDED]
    assert row['shutdown_time'] < 2.35 and monte_carlo.never_took_off(row)


@pytest.mark.parametrize(('height', 'reason'), [(0.005, REASON_GROUNDED), (0.4, REASON_ESTIMATE)])
def test_a_vehicle_in_the_air_that_is_on_the_floor_by_its_estimate_has_lost_it(height, reason):
    tally = monte_carlo.START
    for k, high in enumerate((height, height, 0.0)):  # it falls
        tally = monte_carlo.count(
            tally, 0.005 * k, (0.0, 0.0, -high), (0.0,) * 3, (0.0, 0.0, -0.3), 2, (0.0,) * 4,
            k > 0, REASON_GROUNDED if k else 0, (10.0, 500.0), (0.0,) * 4)
    row = monte_carlo.metrics(tally, Vehicle())
    assert row['shutdown_reason'] == row['failsafe'] == failsafe.REASONS[reason]


def test_a_flight_that_ends_in_the_hands_of_the_failsafe_is_told():
    over = count(count(monte_carlo.START, 0.5, 1.0, reason=3), 1.0, 1.0)
    assert monte_carlo.metrics(over, Vehicle())['failsafe'] == ''
    late = monte_carlo.metrics(count(over, 1.5, 1.0, reason=3), Vehicle())
    assert late['failsafe'] == failsafe.REASONS[3] and not late['shutdown']
    assert late['shutdown_reason'] == ''
    flight = scenario('hover', duration=10.0, land=False, overrides={
        'controller_node.changes': '- {time: 8.0, set: {failsafe.height_std: 0.001}}'})
    row = monte_carlo.fly_with_sensors(flight)
    assert row['failsafe'].startswith('estimate lost') and not row['shutdown']


def test_what_is_not_in_flight_counts_for_the_end_alone():
    tally = count(count(monte_carlo.START, 0.0, 1.0), 0.5, 9.0, phase=4)
    row = monte_carlo.metrics(tally, Vehicle())
    assert row['tracking_rms'] == row['tracking_max'] == 1.0 and row['tracking_final'] == 9.0
    idle = count(monte_carlo.START, 0.0, 0.0, pwm=(0.0,) * 4, phase=0)
    nothing = monte_carlo.metrics(idle, Vehicle())
    assert math.isnan(nothing['tracking_rms']) and math.isnan(nothing['saturated_share'])
    low = count(monte_carlo.START, 0.0, 0.0, pwm=(10.0, 200.0, 200.0, 200.0))
    assert monte_carlo.metrics(low, Vehicle())['saturated_share'] == 1.0


@pytest.mark.parametrize('believed, true', [
    ((10.0, 290.0), (0.0, 500.0)), ((0.0, 500.0), (10.0, 290.0)), ((0.0, 290.0), (10.0, 295.0))])
def test_motors_are_saturated_at_the_limits_of_the_controller_and_of_the_vehicle(believed, true):
    limits = {f'{vehicle}.{name}': value for vehicle, pair in (
        ('controller_node.vehicle', believed), ('sim_node.simulator.vehicle', true))
        for name, value in zip(('pwm_min', 'pwm_max'), pair)}
    flight = scenario(
        estimator='ground_truth', trajectory='circle', duration=8.0, land=False, overrides=limits)
    (row,) = monte_carlo.fly_many([flight])
    pwm = recorded(flight)[0].pwm
    limited = ((pwm >= 290.0) | (pwm <= 10.0)).any(axis=1)
    running = pwm.max(axis=1) > 0.0
    assert row['saturated_share'] == (limited & running).sum() / running.sum() > 0.02
    assert row == monte_carlo.fly_with_sensors(flight) | {'shutdown_time': row['shutdown_time']}


@pytest.mark.parametrize('given', [
    {'duration': 1.0}, {'duration': 6.0, 'overrides': {'sim_node.simulator.vehicle.mass': 0.2}}])
def test_a_flight_that_never_took_off_has_no_errors_in_flight(given):
    flight = scenario(estimator='ground_truth', land=False, **given)
    (row,) = monte_carlo.fly_many([flight])
    assert repr(row) == repr(monte_carlo.fly_with_sensors(flight))
    for name in ('tracking', 'estimation'):
        assert all(math.isnan(row[f'{name}_{kind}']) for kind in ('rms', 'rms_z', 'max', 'final'))
    begun = replaced(flight, {'sim_node.simulator.plant.initial_position': (0.0, 0.0, -0.5)})
    (row,) = monte_carlo.fly_many([begun])  # it begins in the air
    assert math.isfinite(row['tracking_rms'])


def test_motors_of_a_vehicle_that_a_hand_carries_are_stopped_and_it_tracks_nothing():
    row = monte_carlo.fly_with_sensors(scenario('hand_loop', carried=True, duration=8.0))
    assert row['energy'] == row['pwm_max'] == 0.0 and math.isnan(row['saturated_share'])
    assert all(math.isnan(row[name]) for name in row if name.startswith('tracking'))
    assert 0.0 < row['estimation_rms'] < row['estimation_max']
    assert not row['fallen'] and not row['strayed']


def test_a_scenario_without_an_end_is_refused():
    with pytest.raises(ValueError, match='duration'):
        list(monte_carlo.fly_many([scenario(duration=0.0)]))


COORDINATE = st.floats(-10.0, 10.0)
STEPS = st.lists(st.tuples(
    st.tuples(*[COORDINATE] * 3), st.tuples(*[COORDINATE] * 3), st.tuples(*[COORDINATE] * 3),
    st.sampled_from([0, 1, 2, 3, 4]), st.tuples(*[st.sampled_from([0.0, 10.0, 200.0, 500.0])] * 4),
    st.booleans()), min_size=1, max_size=12)


@given(steps=STEPS)
@settings(max_examples=60, deadline=None)
def test_any_flight_has_the_metrics_of_its_arrays(steps):
    tally, vehicle = monte_carlo.START, Vehicle()
    for k, (truth, estimate, reference, phase, pwm, stopped) in enumerate(steps):
        tally = monte_carlo.count(tally, 0.005 * k, truth, estimate, reference, phase, pwm,
                                  stopped, 3 if stopped else 0,
                                  (vehicle.pwm_min, vehicle.pwm_max), (0.2,) * 4)
    row = monte_carlo.metrics(tally, vehicle)
    truth, estimate, reference, phase, pwm, stopped = map(np.array, zip(*steps))
    flown = (phase > GROUND) & (phase < LANDED)
    for name, error in (('tracking', truth - reference), ('estimation', estimate - truth)):
        length = np.linalg.norm(error, axis=1)
        assert row[f'{name}_final'] == pytest.approx(length[-1])
        if flown.any():
            assert row[f'{name}_rms'] == pytest.approx(math.sqrt((length[flown]**2).mean()))
            assert row[f'{name}_max'] == pytest.approx(length[flown].max())
            assert row[f'{name}_rms'] <= row[f'{name}_max'] * (1.0 + 1e-12)
        else:
            assert math.isnan(row[f'{name}_rms']) and math.isnan(row[f'{name}_max'])
    running = pwm.max(axis=1) > 0.0
    limited = (pwm >= vehicle.pwm_max).any(axis=1) | (pwm <= vehicle.pwm_min).any(axis=1)
    if running.any():
        assert row['saturated_share'] == (limited & running).sum() / running.sum()
    assert row['pwm_max'] == pwm.max() and row['energy'] >= 0.0
    down = stopped & (phase < LANDED)
    assert row['shutdown'] == down.any()
    if down.any():
        assert row['shutdown_time'] == 0.005 * np.argmax(down)


@given(runs=st.lists(st.tuples(
    st.sampled_from([0.0, 0.5]), st.sampled_from([0.0, 0.1, 1.0]), st.integers(0, 4),
    st.integers(1, 80), st.booleans()), min_size=1, max_size=6))
@settings(max_examples=60, deadline=None)
def test_a_fall_is_counted_as_it_is_judged_in_a_bag(runs):
    height, wanted, phase, turning = (np.repeat(part, [run[3] for run in runs]) for part in zip(
        *[(*run[:3], run[4]) for run in runs]))
    t, tally, zero = 0.005 * np.arange(len(phase)), monte_carlo.START, (0.0,) * 4
    for now, z, asked, part, turns in zip(t, -height, -wanted, phase, turning):
        truth = 0.0, 0.0, z
        tally = monte_carlo.count(
            tally, now, truth, truth, (0.0, 0.0, asked), part, (200.0 * turns,) * 4, False, 0,
            (10.0, 500.0), zero)
    row = monte_carlo.metrics(tally, Vehicle(), standing=True)
    assert row['fallen'] == bool(
        height_fault(t, height, wanted, phase) or landing_fault(t, height, phase, turning))
    assert not monte_carlo.metrics(tally, Vehicle(), floor=False)['fallen']


@pytest.mark.parametrize('speed', [1.9, 2.1])
def test_a_vehicle_that_hits_the_floor_has_fallen(speed):
    t = 0.005 * np.arange(400)
    height = np.clip(1.003 - speed * t, 0.0, 1.0)
    tally, zero = monte_carlo.START, (0.0,) * 4
    for now, z in zip(t, -height):
        tally = monte_carlo.count(
            tally, now, (0.0, 0.0, z), (0.0, 0.0, z), (0.0, 0.0, 0.0), TRACK, (200.0,) * 4, False,
            0, (10.0, 500.0), zero)
    assert monte_carlo.metrics(tally, Vehicle())['fallen'] == (speed > 2.0) == bool(
        landing_fault(t, height, np.full(400, TRACK), np.ones(400, bool)))


@given(runs=st.lists(st.tuples(
    st.sampled_from([0.0, 1.9, 4.0, 8.0]), st.sampled_from([0.0, 1.0, 2.5, 9.0]),
    st.sampled_from([0.0, 4.9, 5.1]), st.integers(0, 4), st.sampled_from([100, 399, 401])),
    min_size=1, max_size=4))
@settings(max_examples=60, deadline=None)
def test_a_flight_strays_as_it_is_judged_in_a_bag(runs):
    height, wanted, beside, phase = (
        np.repeat(part, [run[4] for run in runs]) for part in zip(*[run[:4] for run in runs]))
    t, tally, zero = 0.005 * np.arange(len(phase)), monte_carlo.START, (0.0,) * 4
    for now, z, y, asked, part in zip(t, -height, beside, -wanted, phase):
        truth = 0.6 * y, -0.8 * y, z
        tally = monte_carlo.count(
            tally, now, truth, truth, (0.0, 0.0, asked), part, zero, False, 0,
            (10.0, 500.0), zero)
    row = monte_carlo.metrics(tally, Vehicle(), floor=False)
    assert row['strayed'] == bool(
        height_fault(t, height, wanted, phase, False) or distance_fault(t, beside, phase))


def test_the_speed_is_the_median_without_the_flight_that_compiles(monkeypatch):
    took = [9.0, 0.5, 0.25, 4.0]  # the first compiles, the last is disturbed
    times = np.repeat(np.cumsum([0.0, *took]), 2)[1:-1].tolist()
    monkeypatch.setattr(monte_carlo, 'fly_with_sensors', lambda flight: None)
    monkeypatch.setattr(monte_carlo.time, 'process_time', lambda: times.pop(0))
    found = monte_carlo.speed(scenario(duration=10.0), False, 3)
    assert found.real_time_factor == pytest.approx(10.0 / 0.5)
    assert found.drone_steps == pytest.approx(20.0 * 1000.0)


def test_a_flight_on_motion_capture_has_the_error_of_the_estimate_that_it_was_flown_on():
    plain = scenario(estimator='ground_truth', duration=6.0, land=False)
    r = closed_loop.fly(plain)
    located = np.zeros((len(r.t), 61))
    located[:, :13] = r.truth
    located[:, 0] += 1.0  # m
    on_map = scenario(estimator='joint', duration=6.0, land=False, overrides={
        'estimator_node.joint.pose.enabled': True, 'controller_node.estimate': 'map'})
    for flight, wrong in ((on_map, 1.0), (plain, 0.0)):
        row = monte_carlo.measure(flight, r._replace(located=located))
        assert row['estimation_rms'] == pytest.approx(wrong, abs=1e-12)
