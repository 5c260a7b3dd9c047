"""Columns of MATLAB files by name, field and number; of other files as before."""

from mambo_analysis.importers import any_table
from mambo_analysis.importers.common import read_source
from mambo_analysis.importers.logs.named_columns import read_columns
from mambo_analysis.importers.table_map import read_map
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
import numpy as np
import pytest
import scipy.io

MAP = """\
time: {column: log.t, unit: ms}
topics:
  imu/data_raw:
    angular_velocity: {columns: ["gyro[0]", "gyro[1]", "gyro[2]"], unit: deg/s}
    acceleration: [ax, log.a.y, "log.a.z[0]"]
"""
N = 30


def content(**changed):
    t = 10.0 * np.arange(N)
    return {'log': {'t': t, 'a': {'y': 0.2 * t, 'z': np.column_stack([0.0 * t + 9.8])}},
            'gyro': np.arange(3.0 * N).reshape(N, 3), 'ax': 0.1 * t, 'other': 1.0} | changed


def read(tmp_path, held, mapping=MAP):
    scipy.io.savemat(tmp_path / 'a.mat', held)
    (tmp_path / 'map.yaml').write_text(mapping)
    return read_columns(read_source(tmp_path / 'a.mat'), read_map(tmp_path / 'map.yaml'))


def test_variables_fields_and_columns_are_found(tmp_path):
    found, others, _ = read(tmp_path, content())
    np.testing.assert_array_equal(found['log.t'], 10.0 * np.arange(N))
    np.testing.assert_array_equal(found['gyro[2]'], 3.0 * np.arange(N) + 2.0)
    np.testing.assert_array_equal(found['log.a.z[0]'], np.full(N, 9.8))
    assert others == ['other']


def test_a_matlab_file_becomes_a_bag(tmp_path):
    read(tmp_path, content())
    assert any_table.main([str(tmp_path / 'a.mat'), str(tmp_path / 'bag'), '--map',
                           str(tmp_path / 'map.yaml')]) == 0
    imu = read_bag(tmp_path / 'bag')['imu/data_raw']
    assert imu.t == pytest.approx(0.01 * np.arange(N))
    assert imu.angular_velocity[4] == pytest.approx(np.radians([12.0, 13.0, 14.0]))
    assert imu.acceleration[10] == pytest.approx([10.0, 20.0, 9.8])


@pytest.mark.parametrize(('held', 'said'), [
    ({'ax': np.arange(5.0)}, 'ax has 5 values, its times in log.t 30'),
    ({'ax': 'text'}, 'ax holds what is no number'),
    ({'ax': np.zeros((N, 2))}, 'name one column, ax[0] is the first'),
    ({'gyro': np.zeros((N, 2))}, 'gyro has the shape (30, 2): no column 2, counted from 0'),
    ({'log': np.zeros(3)}, "no 'log.t'; log holds no fields"),
    ({'log': {'time': np.zeros(N)}}, "no 'log.t'"),
    ({'ax': np.full(N, 1e40)}, '1e+40 is absurd')])
def test_what_cannot_be_used_is_named(tmp_path, held, said):
    with pytest.raises(BagError) as caught:
        read(tmp_path, content(**held))
    assert str(caught.value).startswith(f'{tmp_path / "a.mat"}: ') and said in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_missing_variable_names_the_like(tmp_path):
    with pytest.raises(BagError, match="no 'ay'") as caught:
        read(tmp_path, content(), MAP.replace('[ax,', '[ay,'))
    assert 'gyro' in str(caught.value)


def test_a_table_is_read_as_before(tmp_path):
    (tmp_path / 'a.csv').write_text('t,v,w\n0,1,2\n10,3,4\n')
    (tmp_path / 'map.yaml').write_text(
        'time: {column: t, unit: ms}\ntopics:\n  battery: {voltage: [v]}\n')
    found, others, _ = read_columns(
        read_source(tmp_path / 'a.csv'), read_map(tmp_path / 'map.yaml'))
    np.testing.assert_array_equal(found['v'], [1.0, 3.0])
    assert others == ['w']
