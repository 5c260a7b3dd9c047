"""Sensors of a recording in body FRD: axes, units, held values, and what is no recording."""

from pathlib import Path

from hypothesis import given, settings, strategies as st
from mambo_analysis.identify import recording
from mambo_analysis.identify.recording import read_sensors
from mambo_analysis.importers.common import provenance
from mambo_analysis.importers.minidrone import FLOW_SCALE, MOTOR_SIGNS, SIGNALS
from mambo_analysis.twin import recorded
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest
from scipy.io import savemat
from synthetic import Maker, STEP

TOPICS = ('imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure', 'motor_pwm')


def bag(path, topics=TOPICS, kind='', stamps=(0, 1, 2, 3), **details):
    """Write a bag in FLU, each value different from its neighbours' and along each axis."""
    maker = Maker(path, topics, attachments={}, metadata=(
        provenance('log.mat', '', 'importers', kind, details) if kind else {}))
    rows = {
        'imu/data_raw': lambda k: {
            'angular_velocity': maker.Vector3(0.1, 0.2, 0.3 + k),
            'linear_acceleration': maker.Vector3(1.0, 2.0, np.nan if k == 2 else 9.81)},
        'sonar/range': lambda k: {'range': (1.5, 0.0, np.inf, 1.25)[k % 4]},
        'optical_flow': lambda k: {'rate_x': 0.5, 'rate_y': 0.25, 'quality': 0 if k == 1 else 9},
        'barometer/pressure': lambda k: {'fluid_pressure': 101325.0 - k},
        'motor_pwm': lambda k: {'pwm': np.array([1.0, 2.0, 3.0, 4.0 + k])}}
    for k, stamp in enumerate(stamps):
        for topic in topics:
            maker.write(topic, stamp * STEP, **rows[topic](k))
    maker.writer.close()
    return path


@pytest.fixture(scope='module')
def found(tmp_path_factory):
    return read_sensors(bag(tmp_path_factory.mktemp('bags') / 'flu'))


def test_axes_of_a_bag_turn_from_flu_to_frd(found):
    assert found.name == 'flu'
    np.testing.assert_allclose(found.gyro.values[0], [0.1, -0.2, -0.3])
    np.testing.assert_allclose(found.accel.values[0], [1.0, -2.0, -9.81])
    np.testing.assert_allclose(found.flow.values[0], [0.5, -0.25])  # forward and right


def test_samples_without_a_value_are_nan_and_those_of_the_imu_left_out(found):
    np.testing.assert_array_equal(found.sonar.values, [1.5, np.nan, np.nan, 1.25])
    assert np.isnan(found.flow.values).all(axis=1).tolist() == [False, True, False, False]
    np.testing.assert_allclose(found.gyro.t, np.array([0, 1, 3]) * 0.005)
    np.testing.assert_allclose(found.barometer.values, 101325.0 - np.arange(4))
    np.testing.assert_allclose(found.pwm.values[3], [1.0, 2.0, 3.0, 7.0])


def test_stamps_come_in_order_and_a_repeated_one_once(tmp_path):
    found = read_sensors(bag(tmp_path / 'a', ('barometer/pressure',), stamps=(4, 2, 2, 6)))
    np.testing.assert_allclose(found.barometer.t, np.array([2, 4, 6]) * 0.005)
    np.testing.assert_allclose(found.barometer.values, 101325.0 - np.array([1, 0, 3]))
    assert found.gyro is None and found.sonar is None and found.flow is None


def test_held_values_are_those_of_imported_logs(tmp_path):
    assert not read_sensors(bag(tmp_path / 'a')).held
    assert read_sensors(bag(tmp_path / 'b', kind='minidrone flight log')).held


def test_topics_of_which_only_changes_were_imported_are_known(tmp_path):
    assert read_sensors(bag(tmp_path / 'a', kind='table')).changes == frozenset()
    some = read_sensors(bag(tmp_path / 'b', kind='table', only_changes='sonar/range, battery'))
    assert some.changes == {'sonar/range', 'battery'} and not some.held


def test_a_bag_without_a_sensor_is_named_with_what_it_has(tmp_path):
    with pytest.raises(BagError, match='a: no sensor in it; wanted one of imu/data_raw.*motor_pw'):
        read_sensors(bag(tmp_path / 'a', ('motor_pwm',)))


def test_noisedata_is_acceleration_then_rate_every_5_ms(tmp_path):
    values = np.arange(60.0).reshape(10, 6)
    savemat(tmp_path / 'noisedata.mat', {'noisedata': values})
    found = read_sensors(tmp_path / 'noisedata.mat')
    np.testing.assert_array_equal(found.accel.values, values[:, :3])
    np.testing.assert_array_equal(found.gyro.values, values[:, 3:])
    np.testing.assert_allclose(found.gyro.t, np.arange(10) * 0.005)
    assert not found.held


@pytest.mark.parametrize('values', [np.zeros((9, 5)), np.zeros((9, 6)) * np.nan, 'text'])
def test_other_noisedata_is_one_line(tmp_path, values):
    savemat(tmp_path / 'noisedata.mat', {'noisedata': values})
    with pytest.raises(BagError, match=r'noisedata.mat: noisedata (has the shape|is no matrix)'):
        read_sensors(tmp_path / 'noisedata.mat')


def log(path, **changed):
    """Write a log of the educational toolbox, 0.2 s of values each of its own size."""
    signals = {name: np.full((40, width) if width > 1 else 40, 0.1 * k)
               for k, (name, width) in enumerate(SIGNALS.items())}
    signals['motors_refout'] = np.tile(np.array(MOTOR_SIGNS) * 200.0, (40, 1))
    signals |= changed
    entries = np.array([(f'a/{name}', value) for name, value in signals.items()],
                       dtype=[('blockName', object), ('values', object)])
    savemat(path, {'rt_yout': {'time': np.arange(40) * 0.005, 'signals': entries}})
    return path


def test_a_minidrone_log_is_in_frd_already_and_its_motors_lose_their_signs(tmp_path):
    held = np.repeat([0.0, 1.0, 1.2, 1.1], 10)
    flow = np.zeros((40, 3))
    flow[10:20, :2], flow[20:, :2] = (0.01, -0.02), (0.03, 0.04)
    found = read_sensors(log(
        tmp_path / 'log.mat', altitude_sonarb=held, opticalFlow_datout=flow,
        pa=np.full(40, 0.3), qa=np.full(40, -0.4), ra=np.full(40, 0.5), ddzb=np.full(40, -9.81)))
    np.testing.assert_allclose(found.gyro.values[0], [0.3, -0.4, 0.5])
    assert found.accel.values[0, 2] == -9.81
    np.testing.assert_allclose(found.pwm.values[0], [200.0] * 4)
    # a sample of a slow sensor is where its value changes; 0 of the sonar is no echo
    np.testing.assert_allclose(found.sonar.t, [0.0, 0.05, 0.1, 0.15])
    np.testing.assert_array_equal(found.sonar.values, [np.nan, 1.0, 1.2, 1.1])
    # 0 of the flow is none yet; the rest is in rad/s
    np.testing.assert_allclose(found.flow.t, [0.05, 0.1])
    np.testing.assert_allclose(found.flow.values, FLOW_SCALE * np.array(
        [[0.01, -0.02], [0.03, 0.04]]))
    assert found.held


@settings(max_examples=6)  # bags, each of many vectors
@given(st.lists(st.tuples(*[st.floats(-20.0, 20.0)] * 6), min_size=2, max_size=40))
def test_every_vector_survives_from_flu_to_frd_with_its_length_and_hand(tmp_path_factory, rows):
    path, wire = tmp_path_factory.mktemp('bags') / 'bag', np.array(rows)
    maker = Maker(path, ('imu/data_raw',), attachments={})
    for k, row in enumerate(rows):
        maker.write('imu/data_raw', k * STEP, angular_velocity=maker.Vector3(*row[:3]),
                    linear_acceleration=maker.Vector3(*row[3:]))
    maker.writer.close()
    found = read_sensors(path)
    np.testing.assert_array_equal(found.gyro.values * [1, -1, -1], wire[:, :3])
    np.testing.assert_array_equal(found.accel.values * [1, -1, -1], wire[:, 3:])
    # a half turn about x and no mirror: the cross product turns with its factors
    np.testing.assert_allclose(
        np.cross(found.gyro.values, found.accel.values) * [1, -1, -1],
        np.cross(wire[:, :3], wire[:, 3:]), atol=1e-9)


@pytest.mark.parametrize('reader', [recording.read_sensors, recorded.read_flight])
def test_two_flights_in_one_bag_are_refused(reader, monkeypatch):
    def refuse(bag):
        raise BagError('two flights')
    monkeypatch.setattr(recording.stamps, 'refuse_mixed', refuse)
    with pytest.raises(BagError, match='two flights'):
        reader(Path(__file__).parents[4] / 'bags/circle_short')
