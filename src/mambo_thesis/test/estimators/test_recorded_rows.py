"""Rows of real recordings, on logs with a known answer."""

from pathlib import Path
from types import SimpleNamespace

from mambo_analysis.capture.captured import ErrorSeries
from mambo_bags.mcap_reader import BagError
from mambo_thesis.estimators import recorded_rows
from mambo_thesis.recordings.validate_flights import Height
import numpy as np
import pytest


def test_blocks_are_equally_long_and_keep_the_mean_square():
    t = np.arange(500) * 0.01
    error = np.column_stack([np.sin(t), np.cos(t)]) * np.where(t < 2.5, 1.0, 2.0)[:, None]
    found = recorded_rows.blocks(t, error)
    np.testing.assert_allclose(found, [1.0, 4.0])
    assert len(recorded_rows.blocks(t, t)) == 2 and len(recorded_rows.blocks(t[:50], t[:50])) == 1
    np.testing.assert_allclose(recorded_rows.blocks(t, t).mean(), np.mean(t ** 2))


def test_a_path_is_one_number_and_all_else_one_for_each_block():
    t = np.arange(600) * 0.01
    ones = np.ones(600)
    found = recorded_rows._squares(ErrorSeries(
        6.0, t, np.column_stack([3.0 * ones, 4.0 * ones]), 2.0 * ones,
        np.column_stack([ones, ones]), np.radians(np.column_stack([ones, 0.0 * t, 0.0 * t]))))
    np.testing.assert_allclose(found['horizontal position [m]'], [25.0])
    np.testing.assert_allclose(found['drift at the end [m]'], [25.0])
    np.testing.assert_allclose(found['height [m]'], [4.0, 4.0, 4.0])
    np.testing.assert_allclose(found['horizontal velocity [m/s]'], [2.0, 2.0, 2.0])
    np.testing.assert_allclose(found['tilt [deg]'], [1.0, 1.0, 1.0])


def test_a_rolling_spider_is_compared_with_its_sonar(monkeypatch, tmp_path):
    t = np.arange(400) * 0.01
    made = [Height(size, 0.0, 0.0, 0.0, t, np.full(400, size)) for size in (0.3, 0.1)]
    monkeypatch.setattr(recorded_rows.validate_flights, 'height_errors', lambda *_: made)
    row, = recorded_rows._rolling_spider(Path('a__1.mat'), tmp_path, range(1), ['toolbox'])
    np.testing.assert_allclose(row.kalman, [0.09, 0.09])
    np.testing.assert_allclose(row.joint, [0.01, 0.01])
    assert row.case == 'a' and row.verdict == 'joint' and np.isnan(row.others['toolbox'])


def test_cases_are_the_logs_without_the_pendulum(tmp_path):
    logs, flights = tmp_path / 'crazyflie_optitrack', tmp_path / 'rolling_spider_flights'
    for folder, names in ((logs, ['crazyflie-client_lab02_square__1.json', 'lab03_x__2.json']),
                          (flights, ['one__3.mat'])):
        folder.mkdir()
        for name in names:
            (folder / name).write_text('')
    found = recorded_rows.cases(tmp_path, tmp_path)
    assert [(case.section, case.name) for case in found] == [
        ('crazyflie', 'lab02_square'), ('rolling_spider', 'one')]
    (logs / 'crazyflie-client_lab02_square__1.json').rename(logs / 'lab05__1.json')
    with pytest.raises(BagError, match='no flight lab02_square, which the sensors are identified'):
        recorded_rows.cases(tmp_path, tmp_path)
    with pytest.raises(BagError, match=r'nowhere: not a folder; docs/evidence/real_recordings'):
        recorded_rows.cases(tmp_path / 'nowhere', tmp_path)


def series(off, end=6.0):
    """Return an error that is the same all the time, in every quantity."""
    t = np.arange(600) * end / 600
    return ErrorSeries(end, t, np.full((600, 2), off), np.full(600, off), np.full((600, 2), off),
                       np.full((600, 2), np.radians(off)))


def test_each_filter_replays_a_log_with_its_own_flow_counts_and_parameters(monkeypatch, tmp_path):
    imported, replayed = [], []
    errors = {'kalman': series(0.3), 'joint': series(0.1)}

    def import_crazyflies(logs, folder, kind, counts=None):
        imported.append((logs[0].name, kind, counts))
        return {'name': folder / 'bag'}

    def replay(bag, params):
        replayed.append(params)
        return params
    flights, capture = recorded_rows.validate_flights, recorded_rows.captured
    monkeypatch.setattr(flights, 'import_crazyflies', import_crazyflies)
    monkeypatch.setattr(flights, 'joint_params', lambda name: 'joint')
    monkeypatch.setattr(recorded_rows, '_identified', lambda log, folder: 'kalman')
    monkeypatch.setattr(recorded_rows, 'read_bag', lambda path: path)
    monkeypatch.setattr(capture, 'replayed', replay)
    monkeypatch.setattr(capture, 'mocap_truth', lambda bag: None)
    monkeypatch.setattr(capture, 'range_offset', lambda bag: None)
    monkeypatch.setattr(
        capture, 'error_series', lambda estimate, truth, markers: errors[estimate])
    names = ('horizontal position [m]', 'drift at the end [m]', 'height [m]',
             'horizontal velocity [m/s]', 'tilt [deg]')
    lines = [SimpleNamespace(name=name.rpartition(' ')[0], unit=name.rpartition(' ')[2][1:-1],
                             bound=0.01 * k) for k, name in enumerate(names)]
    monkeypatch.setattr(recorded_rows.recorded_bound, 'of_bag', lambda bag, params: (None, lines))
    rows = recorded_rows._crazyflie(
        Path('crazyflie-client_lab05_line__2.json'), Path('on.json'), tmp_path, range(1), ['a'])
    assert replayed == ['kalman', 'joint']
    assert imported == [
        ('crazyflie-client_lab05_line__2.json', 'zero', flights.COUNTS_PER_RADIAN),
        ('crazyflie-client_lab05_line__2.json', 'zero', flights.JOINT_COUNTS)]
    assert [row.quantity for row in rows] == list(names)
    assert [row.bound for row in rows] == [0.01 * k for k in range(5)]
    for row in rows:
        assert row.case == 'lab05_line' and np.isnan(row.others['a'])
        ratio = np.sqrt(row.joint.mean() / row.kalman.mean())
        assert abs(ratio - 1.0 / 3.0) < 1e-9 and row.verdict == 'joint'
    assert [len(row.kalman) for row in rows] == [1, 1, 3, 3, 3]
