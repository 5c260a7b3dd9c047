"""Rows of real recordings, on logs with a known answer."""

from pathlib import Path

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
