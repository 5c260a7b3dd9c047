"""A mapping file says what it means, and what is wrong with it by file, line and key."""

from mambo_analysis.importers.any_table import shipped
from mambo_analysis.importers.table_map import Clock, Quantity, read_map
from mambo_model.schema import ParameterError
import pytest

GOOD = """\
time: {column: t, unit: ms}
world: z_down
body: frd
topics:
  optitrack/pose:
    position: {columns: [x, y, z], unit: mm}
    euler: {columns: [yaw, pitch, roll], unit: deg, order: ZYX}
    time: {offset: -0.02}
  battery:
    voltage: [v]
    only_changes: true
"""


def mapping(tmp_path, text=GOOD):
    file = tmp_path / 'map.yaml'
    file.write_text(text, encoding='utf-8')
    return file


def test_reads_columns_units_frames_and_clocks(tmp_path):
    found = read_map(mapping(tmp_path))
    assert found.clock == Clock('t', 1e-3) and found.world == 'z_down'
    pose = found.topics['optitrack/pose']
    assert pose.quantities['position'] == Quantity(('x', 'y', 'z'), 1e-3)
    assert pose.quantities['euler'].order == 'ZYX'
    assert pose.quantities['euler'].factor == pytest.approx(3.141592653589793 / 180.0, rel=1e-15)
    assert pose.clock == Clock('t', 1e-3, -0.02) and pose.body == 'frd' and not pose.only_changes
    assert found.topics['battery'].only_changes
    assert found.columns() == ['t', 'x', 'y', 'z', 'yaw', 'pitch', 'roll', 'v']


@pytest.mark.parametrize('name', shipped())
def test_what_is_shipped_can_be_read(name):
    assert read_map(shipped()[name]).topics


@pytest.mark.parametrize('old, new, line, text', [
    ('unit: ms', 'unit: minutes', 1, "unit: 'minutes' is not one of s, ms, us, ns"),
    ('time: {column: t, unit: ms}', 'time: {unit: ms}', 1, 'time: needs a column'),
    ('time: {column: t, unit: ms}\n', '', 1, 'time: is missing'),
    ('z_down', 'ned', 2, "world: 'ned' is not one of z_up, z_down, y_up"),
    ('body: frd', 'bodies: frd', 3, 'bodies: unknown; did you mean body?'),
    ('optitrack/pose', 'optitrack', 5, 'no topic of an import; did you mean optitrack/pose?'),
    ('[x, y, z]', '[x, y, y]', 6, 'position: names column y twice'),
    ('[yaw, pitch, roll]', '[yaw, pitch, yaw]', 7, 'euler: names column yaw twice'),
    ('[x, y, z]', '[x, y]', 6, 'position: must name 3 columns'),
    ('position:', 'positions:', 6, 'positions: unknown; did you mean position?'),
    ('order: ZYX', 'order: zyx', 7, "order: 'zyx' is not one of ZYX"),
    (', order: ZYX', '', 7, 'euler: needs an order'),
    ('offset: -0.02', 'offset: soon', 8, "offset: 'soon' is not a number"),
    ('offset: -0.02', 'offset: inf', 8, 'offset: inf s is absurd'),
    ('    euler: {columns: [yaw, pitch, roll], unit: deg, order: ZYX}\n', '', 5,
     'needs attitude (quaternion or euler)'),
    ('    voltage: [v]\n', '', 9, 'battery: needs voltage'),
    ('only_changes: true', 'only_changes: perhaps', 11, 'must be true or false'),
    ('only_changes: true', 'velocity_axes: body', 11, 'velocity_axes: unknown'),
    ('only_changes: true', 'valid: ok', 11, 'must name columns: [...]'),
    ('only_changes: true', 'valid: []', 11, 'must name columns: [...]'),
    ('only_changes: true', 'valid: [a, a]', 11, 'names column a twice'),
    ('body: frd', 'delimiter: ",,"', 3, 'delimiter: must be one ASCII character'),
    ('body: frd', 'delimiter: é', 3, 'delimiter: must be one ASCII character'),
    ('body: frd', "delimiter: '\"'", 3, 'delimiter: must be one ASCII character, no quotation'),
])
def test_says_what_is_wrong_and_where(tmp_path, old, new, line, text):
    assert old in GOOD
    file = mapping(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ParameterError) as error:
        read_map(file)
    assert f'{file}:{line}: ' in str(error.value) and text in str(error.value)


def test_each_clock_has_the_columns_that_are_wanted_at_its_times(tmp_path):
    path = tmp_path / 'map.yaml'
    path.write_text("""\
time: {column: t, unit: us}
topics:
  battery: {voltage: [v], time: {column: slow}}
  motor_pwm: {pwm: [a, b, c, d]}
  sonar/range: {range: [v], time: {column: slow}}
""")
    wanted = read_map(path)
    assert wanted.clocks() == {'t': ['a', 'b', 'c', 'd'], 'slow': ['v']}
    assert set(wanted.columns()) == {'t', 'slow', 'a', 'b', 'c', 'd', 'v'}
