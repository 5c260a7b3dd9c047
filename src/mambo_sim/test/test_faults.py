"""Faults strike the sensor they are set for, in their time, and nothing else changes."""

from dataclasses import replace
import math

from mambo_model import schema
from mambo_sim import faults, simulator
from mambo_sim.faults import FaultParams, FaultsParams, Outbox
from mambo_sim.simulator import SimulatorParams
import numpy as np
import pytest

STEPS = 120  # 0.6 s
START, END = 40, 80  # ticks
WINDOW = {'start': START * 0.005, 'duration': (END - START) * 0.005}


def samples(params):
    """Return the samples of a vehicle that rests in the air, where every sensor sees the floor."""
    params = replace(params, plant=replace(
        params.plant, ground=False, initial_position=(0.0, 0.0, -1.5)))
    state, rngs = simulator.initial_state(params), simulator.generators(params.seed)
    values, out = params.values(), []
    for tick in range(STEPS):
        state, sample = simulator.sense(state, tick, rngs, values)
        out.append(sample)
    return out


def faulty(**kinds):
    """Return parameters with faults, {sensor: kind}."""
    return schema.build(SimulatorParams, {
        'seed': 3, 'faults': {name: {'kind': kind, **WINDOW} for name, kind in kinds.items()}})


CLEAN = samples(SimulatorParams(seed=3))
FIELDS = {'gyro': 'gyro', 'accel': 'accel', 'sonar': 'sonar', 'optical_flow': 'flow',
          'barometer': 'pressure'}
NEW = {'gyro': lambda s: True, 'accel': lambda s: True, 'sonar': lambda s: s.sonar_new,
       'optical_flow': lambda s: s.flow_new, 'barometer': lambda s: s.baro_new}


def numbers(value):
    return np.atleast_1d(np.asarray(value, float))


def test_without_faults_nothing_is_asked_and_nothing_is_drawn():
    assert FaultsParams().values() is None
    assert simulator.initial_state(SimulatorParams()).faults is None
    assert all(sample.deliveries == simulator.IN_TIME for sample in CLEAN)


@pytest.mark.parametrize('name', FIELDS)
@pytest.mark.parametrize('kind', ['not_a_number', 'infinite', 'stuck', 'wild'])
def test_a_bad_reading_is_in_its_window_and_in_no_other_sensor(name, kind):
    last = None
    for tick, (clean, bad) in enumerate(zip(CLEAN, samples(faulty(**{name: kind})))):
        for other, field in FIELDS.items():
            x, y = numbers(getattr(clean, field)), numbers(getattr(bad, field))
            if other != name or not START <= tick < END or not NEW[name](clean):
                np.testing.assert_array_equal(x, y)
                if other == name and NEW[name](clean):
                    last = x
            elif kind == 'not_a_number':
                assert np.isnan(y).all()
            elif kind == 'infinite':
                assert np.isinf(y).all()
            elif kind == 'stuck':
                np.testing.assert_array_equal(y, last)
            else:
                assert (y != x).all() and np.isfinite(y).all()


DELIVERIES = {
    'missing': faults.DELIVERY_LOST, 'late': faults.DELIVERY_LATE,
    'repeated': faults.DELIVERY_TWICE}


@pytest.mark.parametrize('name, field', [
    ('imu', 'imu'), ('sonar', 'sonar'), ('optical_flow', 'flow'), ('barometer', 'barometer')])
@pytest.mark.parametrize('kind', DELIVERIES)
def test_a_bad_delivery_is_that_of_the_samples_in_its_window(name, field, kind):
    sensor = 'gyro' if name == 'imu' else name
    for tick, sample in enumerate(samples(faulty(**{name: kind}))):
        if NEW[sensor](sample):
            struck = START <= tick < END
            assert getattr(sample.deliveries, field) == (
                DELIVERIES[kind] if struck else faults.DELIVERY_SENT)


def test_out_of_order_samples_are_held_until_after_the_next():
    deliveries = [s.deliveries.sonar for s in samples(faulty(sonar='out_of_order')) if s.sonar_new]
    held = faults.DELIVERY_HELD
    assert deliveries == [0] * 5 + [held, 0, held, 0, held] + [0] * 5


def test_a_share_strikes_some_samples_and_the_seed_says_which():
    params = faulty(gyro='not_a_number')
    some = replace(params, faults=replace(
        params.faults, gyro=replace(params.faults.gyro, share=0.5)))
    bad = [math.isnan(s.gyro[0]) for s in samples(some)]
    assert 8 < sum(bad) < 32  # 4 standard deviations of 40 coins
    assert bad == [math.isnan(s.gyro[0]) for s in samples(some)]
    assert bad != [math.isnan(s.gyro[0]) for s in samples(replace(some, seed=4))]


def test_a_range_is_a_number_of_its_message_also_when_it_is_wild():
    wild = [s.sonar for s in samples(faulty(sonar='wild')) if s.sonar_new]
    assert all(float(np.float32(x)) == x for x in wild)


@pytest.mark.parametrize('deliveries, sent', [
    ([faults.DELIVERY_SENT] * 3, [(0, 'a'), (1, 'b'), (2, 'c')]),
    ([faults.DELIVERY_SENT, faults.DELIVERY_LOST, faults.DELIVERY_SENT], [(0, 'a'), (2, 'c')]),
    ([faults.DELIVERY_TWICE] * 2, [(0, 'a'), (0, 'a'), (1, 'b'), (1, 'b')]),
    ([faults.DELIVERY_HELD, faults.DELIVERY_SENT, faults.DELIVERY_SENT],
     [(1, 'b'), (1, 'a'), (2, 'c')]),
    ([faults.DELIVERY_LATE, faults.DELIVERY_LATE, faults.DELIVERY_SENT],
     [(2, 'a'), (2, 'c'), (3, 'b')])])
def test_the_outbox_does_to_the_messages_what_their_deliveries_say(deliveries, sent):
    out = []
    box = Outbox(lambda data: out.append((tick, data)), delay=2)
    for tick in range(5):
        box.catch_up(tick)
        if tick < len(deliveries):
            box.put(tick, 'abc'[tick], deliveries[tick])
        assert box.count == len(out)
    assert out == sent


@pytest.mark.parametrize('values, complaint', [
    ({'faults': {'sonar': {'kind': 'broken'}}}, 'not one of none, not_a_number'),
    ({'faults': {'gyro': {'kind': 'late'}}},
     'not one of none, not_a_number, infinite, stuck, wild'),
    ({'faults': {'imu': {'kind': 'wild'}}}, 'not one of none, missing'),
    ({'faults': {'sonar': {'share': 1.5}}}, r'outside \[0, 1\]'),
    ({'faults': {'sonar': {'delay': 0.0}}}, 'outside'),
    ({'faults': {'lidar': {'kind': 'wild'}}}, 'unknown parameter')])
def test_a_fault_that_cannot_be_is_refused_by_name(values, complaint):
    with pytest.raises(schema.ParameterError, match=complaint):
        schema.build(SimulatorParams, values)


def test_the_window_is_in_whole_ticks():
    values = FaultParams(kind='wild', start=1.0, duration=0.5).values()
    assert (values.first_tick, values.end_tick) == (200, 300)
