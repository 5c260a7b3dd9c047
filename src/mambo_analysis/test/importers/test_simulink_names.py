"""What the names of logged signals mean, and the file that says it of others."""

from pathlib import Path

from hypothesis import given, strategies as st
from mambo_analysis.importers.mat_file import Signal
from mambo_analysis.importers.simulink_names import (
    by_map, by_name, Column, LAYOUTS, near, PARTS, QUANTITIES)
from mambo_bags.mcap_reader import BagError
from mambo_model.schema import ParameterError
import numpy as np
import pytest

FILE = Path('log.mat')


def signals(**widths):
    """Return signals of so many columns, by the name of the variable."""
    return {name: Signal(name, np.arange(5.0), np.arange(5.0 * width).reshape(5, width))
            for name, width in widths.items()}


def parts(found):
    """Return {part: (variable, column, scale)}."""
    return {part: column and (column.signal.name, column.index, column.scale)
            for part, column in found.items()}


def test_a_vector_of_a_known_name_gives_its_parts_in_order():
    found = parts(by_name(FILE, signals(rt_motor=4)))
    assert found == {f'motor_{k + 1}': ('rt_motor', k, 1.0) for k in range(4)}
    found = parts(by_name(FILE, signals(rt_optical=5)))
    assert found == {'flow_x': ('rt_optical', 1, 1.0), 'flow_y': ('rt_optical', 2, 1.0),
                     'flow_flag': ('rt_optical', 4, 1.0)}


@pytest.mark.parametrize('stem', sorted(LAYOUTS))
@pytest.mark.parametrize('form', ['rt_{}', 'rt_rt_{}', '{}_rt', '{}_rt_rt', 'scope/{}'])
def test_every_known_name_is_known_behind_prefix_and_before_suffix(stem, form):
    name, width = form.format(stem), len(LAYOUTS[stem])
    found = parts(by_name(FILE, signals(**{name: width})))
    assert found == {part: (name, k, 1.0) for k, part in enumerate(LAYOUTS[stem]) if part}


def test_a_bare_name_is_not_known():
    assert by_name(FILE, signals(motor=4, pressure=1, gyro=3)) == {}


def test_another_prefix_is_known_by_the_three_accelerations():
    whole = signals(xx_a_x=1, xx_a_y=1, xx_a_z=1, xx_p=1, yy_q=1)
    assert sorted(by_name(FILE, whole)) == ['accel_x', 'accel_y', 'accel_z', 'gyro_x']
    del whole['xx_a_z']
    assert by_name(FILE, whole) == {}


def test_of_two_names_for_one_quantity_the_first_layout_counts():
    found = by_name(FILE, signals(rt_a_x=1, rt_sensor=10, rt_motor_speeds_2=4, rt_motor=4))
    assert parts(found)['accel_x'] == ('rt_sensor', 0, 1.0)
    assert parts(found)['motor_1'] == ('rt_motor', 0, 1.0)
    assert found['accel_x'].stem == 'sensor'


def test_a_sensor_vector_of_six_is_the_imu_alone():
    found = by_name(FILE, signals(rt_sensor=6))
    assert sorted(found) == sorted(QUANTITIES['accel'] + QUANTITIES['gyro'])
    assert len(by_name(FILE, signals(rt_sensor=10))) == 10
    assert len(by_name(FILE, signals(rt_sensor=12))) == 10  # what is beyond has no name
    assert len(by_name(FILE, signals(rt_sensor=8))) == 6


def test_too_few_columns_are_named():
    with pytest.raises(BagError, match=r'^log.mat: rt_sensor has the shape \(5, 5\), expected '
                                       r'\(5, 6\) or wider$'):
        by_name(FILE, signals(rt_sensor=5))
    with pytest.raises(BagError, match=r'expected \(5, 4\)'):
        by_name(FILE, signals(rt_motor=3))
    assert len(by_name(FILE, signals(rt_optical_flow=2))) == 2


def told(tmp_path, text, **widths):
    (tmp_path / 'map.yaml').write_text(text)
    return parts(by_map(tmp_path / 'map.yaml', signals(**widths)))


def test_a_map_names_variables_columns_signs_and_scales(tmp_path):
    found = told(tmp_path, (
        'accel_y: rx_a_y\ngyro: rt_imu[3:6]\nsonar: -scope[1]\naccel_z: 9.81 * g\n'
        'flow: 2e1*v\npressure: none\n'), rx_a_y=1, rt_imu=6, scope=2, g=1, v=2)
    assert found == {
        'accel_y': ('rx_a_y', 0, 1.0), 'gyro_x': ('rt_imu', 3, 1.0), 'gyro_y': ('rt_imu', 4, 1.0),
        'gyro_z': ('rt_imu', 5, 1.0), 'sonar': ('scope', 1, -1.0), 'accel_z': ('g', 0, 9.81),
        'flow_x': ('v', 0, 20.0), 'flow_y': ('v', 1, 20.0), 'pressure': None}


@given(part=st.sampled_from(PARTS), index=st.integers(0, 7), scale=st.floats(-1e6, 1e6))
def test_any_column_of_any_scale_is_taken_as_it_is_written(tmp_path_factory, part, index, scale):
    folder = tmp_path_factory.getbasetemp()
    if part in QUANTITIES and len(QUANTITIES[part]) > 1:
        return
    found = told(folder, f'{part}: "{scale!r} * log[{index}]"\n', log=8)
    assert found == {part: ('log', index, scale)}


@pytest.mark.parametrize(('text', 'wanted'), [
    ('acel: a\n', 'not known; nearest: accel'),
    ('accel: a\n', r'needs 3 columns, a is \[0:1\] of 1 in a'),
    ('accel_x: m[9]\n', r'needs 1 column, m\[9\] is \[9:10\] of 6 in m'),
    ('gyro: m[1:3]\n', 'needs 3 columns'), ('accel_x: missing\n', 'no logged variable missing'),
    ('accel_x: 2 + a\n', 'is not of the form NAME, NAME'),
    ('accel_x: 1.2.3 * a\n', "'1.2.3' is not a number"),
    ('gyro: m[0:3]\ngyro_x: a\n', 'is given twice'), ('- a\n', 'map')])
def test_a_map_that_does_not_fit_is_named_by_file_and_place(tmp_path, text, wanted):
    with pytest.raises(ParameterError, match=wanted) as caught:
        told(tmp_path, text, a=1, m=6)
    assert 'map.yaml' in str(caught.value) and '\n' not in str(caught.value)


def test_near_names_are_offered_best_first():
    assert near('acel', ['gyro', 'accel', 'accel_x']) == 'accel, accel_x'
    assert near('quaternion', ['sonar']) == 'none is like it'


def test_a_column_has_no_scale_and_no_known_name_unless_told():
    assert Column(signals(a=1)['a'], 0)[2:] == (1.0, '')
