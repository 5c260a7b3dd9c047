"""Sensors that stop while the vehicle moves are told, and those with nothing to tell are not."""

from mambo_analysis.importers import any_table
from mambo_analysis.importers.checks import stopped
from mambo_analysis.importers.common import Publisher
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_signals import motion
import numpy as np
import pytest

RATE = 100
T = np.arange(0.0, 20.0, 1.0 / RATE)
FLOWN = np.column_stack([
    0.5 * np.sin(T), 0.5 * np.cos(0.7 * T), 1.0 + 0.5 * np.sin(0.5 * T)])
NOISE = np.random.default_rng(0).standard_normal((len(T), 6))
LEVEL = np.column_stack([FLOWN[:, :2], np.ones(len(T))])


def held(values, begin, end=None, columns=slice(None)):
    """Return values, (n,) or (n, k), of which some columns are the same from a sample on."""
    out = np.array(values, float).reshape(len(T), -1)
    out[begin:end, columns] = out[begin, columns]
    return out


def told(path, name, rows, flown=FLOWN, own='onboard/odom', importer=''):
    """Write a motion and a topic at the same times; return what is told. None: no message."""
    record = {'import': {'importer': importer}}
    with BagWriter(path, metadata=record) as writer:
        out = Publisher(writer, {one: any_table.TYPES[one] for one in (own, name)})
        for k, (p, row) in enumerate(zip(flown, rows)):
            stamp, pose = round(1e9 * T[k]), out.pose(p, (0.0, 0.0, 0.0, 1.0))
            out.publish(own, stamp, 'odom', **(
                {'pose': pose} if own == 'optitrack/pose' else
                out.odometry(pose, (0.0,) * 3, (0.0,) * 3)))
            if row is not None:
                out.publish(name, stamp, 'base_link', **fields(out, name, row))
    bag = read_bag(path, namespace='/mambo')
    return stopped.describe(bag, {own: motion.read(bag, own)})


def fields(out, name, row):
    x = np.asarray(row, float).tolist()
    return {'imu/data_raw': lambda: out.imu(x[:3], x[3:]),
            'sonar/range': lambda: {'min_range': 0.4, 'max_range': 4.0, 'range': x[0]},
            'optical_flow': lambda: {'rate_x': x[0], 'rate_y': x[1], 'quality': 255},
            'barometer/pressure': lambda: {'fluid_pressure': x[0]}}[name]()


@pytest.mark.parametrize('own', ['onboard/odom', 'optitrack/pose'])
@pytest.mark.parametrize('columns, flown, said', [
    ([], FLOWN, ''),
    ([0], FLOWN, 'x of its gyro'), ([5], FLOWN, 'z of its accelerometer'),
    ([0, 1, 2], FLOWN, 'its gyro'), (slice(None), FLOWN, 'it'),
    (slice(None), 0.0 * FLOWN, '')])
def test_an_axis_a_sensor_or_both_that_stop_are_told(tmp_path, own, columns, flown, said):
    found = told(tmp_path / 'bag', 'imu/data_raw', held(NOISE, 700, columns=columns), flown, own)
    line = f'imu/data_raw: {said} repeats one value from 7.00 to 19.99 s, while {own} moves: it'
    assert [one[:len(line)] for one in found] == [line] * bool(said)


def test_every_axis_that_stops_is_told(tmp_path):
    found = told(tmp_path / 'bag', 'imu/data_raw', held(NOISE, 700, 1000, [1, 3]))
    assert [one[:one.index(' repeats')] for one in found] == [
        'imu/data_raw: y of its gyro', 'imu/data_raw: x of its accelerometer']


def test_an_axis_of_coarse_steps_that_often_repeats_is_not_told(tmp_path):
    slow = np.column_stack([np.round(2.0 * np.sin(0.5 * T)), NOISE[:, 1:]])
    assert not told(tmp_path / 'bag', 'imu/data_raw', slow)


STOOD = FLOWN[:, 2] * np.clip(T - 3.0, 0.0, 1.0)  # on the floor for 3 s
RANGES = FLOWN[:, 2] + 0.005 * NOISE[:, 0]
LOW = np.clip(0.5 + 0.4 * np.sin(0.3 * T), 0.1, None)


@pytest.mark.parametrize('ranges, height, said', [
    (RANGES, FLOWN[:, 2], ''),
    (held(RANGES, 700), FLOWN[:, 2], 'from 7.00 to 19.99 s'),
    (held(RANGES, 700, 1000), FLOWN[:, 2], 'from 7.00 to 9.99 s'),
    (held(RANGES, 700, 850), FLOWN[:, 2], ''),         # a short time
    (held(RANGES, 700), LEVEL[:, 2], ''),              # nothing changes
    (np.maximum(LOW, 0.45), LOW, ''),                  # the floor is nearer than its shortest
    (np.minimum(FLOWN[:, 2], 1.2), FLOWN[:, 2], ''),   # the end of its reach
    (np.where(FLOWN[:, 2] > 1.2, 0.0, RANGES), FLOWN[:, 2], ''),  # no echo
    (np.maximum(STOOD + 0.005 * NOISE[:, 0], 0.45), STOOD, ''),
    (held(0.45 + 0.001 * NOISE[:, 0], 199), STOOD, 'from 1.99 to 19.99 s')])  # on the floor
def test_a_range_that_stops_is_told_and_one_that_is_blind_is_not(tmp_path, ranges, height, said):
    flown = np.column_stack([FLOWN[:, :2], height])
    found = told(tmp_path / 'bag', 'sonar/range', np.reshape(ranges, (-1, 1)), flown)
    line = f'sonar/range: it has no new value {said}, while onboard/odom moves: it had stopped'
    assert found == [line] * bool(said)


PRESSURE = 1e5 - 11.8 * FLOWN[:, 2]


@pytest.mark.parametrize('pressure, flown, said', [
    (PRESSURE + NOISE[:, 0], FLOWN, False),
    (held(PRESSURE + NOISE[:, 0], 700), FLOWN, True),
    (held(PRESSURE + NOISE[:, 0], 700), LEVEL, False),
    (10.0 * np.round(0.1 * PRESSURE), FLOWN, False)])
def test_a_pressure_that_stops_is_told_and_one_in_coarse_steps_is_not(
        tmp_path, pressure, flown, said):
    found = told(tmp_path / 'bag', 'barometer/pressure', np.reshape(pressure, (-1, 1)), flown)
    assert found == ['barometer/pressure: it has no new value from 7.00 to 19.99 s, while '
                     'onboard/odom moves: it had stopped'] * said


FLOW = np.gradient(FLOWN[:, :2], T, axis=0) / FLOWN[:, 2:]


@pytest.mark.parametrize('flow, flown, said', [
    (FLOW, FLOWN, False), (held(FLOW, 700), FLOWN, True),
    (held(FLOW, 700), 0.0 * FLOWN, False), (0.5 * np.round(2.0 * FLOW), FLOWN, False)])
def test_a_flow_that_stops_is_told_and_one_at_rest_or_in_coarse_steps_is_not(
        tmp_path, flow, flown, said):
    found = told(tmp_path / 'bag', 'optical_flow', flow, flown)
    assert found == ['optical_flow: it has no new value from 7.00 to 19.99 s, while onboard/odom '
                     'moves: it had stopped'] * said


@pytest.mark.parametrize('importer, said', [
    ('mambo_analysis.import_minidrone', True), ('mambo_analysis.import_table', False)])
def test_where_new_values_alone_are_kept_none_is_a_value_that_repeats(tmp_path, importer, said):
    rows = [row if k < 700 else None for k, row in enumerate(RANGES[:, None])]
    found = told(tmp_path / 'bag', 'sonar/range', rows, importer=importer)
    assert found == ['sonar/range: it has no new value from 6.99 to 19.99 s, while onboard/odom '
                     'moves: it had stopped'] * said


def test_without_a_motion_nothing_is_told(tmp_path):
    told(tmp_path / 'bag', 'imu/data_raw', held(NOISE, 700))
    assert stopped.describe(read_bag(tmp_path / 'bag', namespace='/mambo'), {}) == []
