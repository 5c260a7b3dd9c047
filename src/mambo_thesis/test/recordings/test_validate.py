"""Tables of the recordings: text and Markdown, and what each section measures of made files."""

import json
from types import SimpleNamespace

from hypothesis import given, strategies as st
from mambo_analysis.identify import columns
from mambo_analysis.identify.regression import Value
from mambo_bags.mcap_reader import BagError
from mambo_thesis.recordings import validate
from mambo_thesis.recordings.validate import find, main, rejected_poses, Table
import numpy as np
import pytest
from scipy.io import savemat

TABLE = Table('A title', ('', 'value', 'note'), ('', '.2f', ''), [
    ('first', 1.234, 'a'), ('the second', -10.0, 'b c')])


def test_a_table_for_a_terminal_is_aligned_in_columns():
    assert TABLE.text().splitlines() == [
        'A title', '               value  note', '  first         1.23     a',
        '  the second  -10.00   b c']


def test_a_table_for_a_document_has_numbers_to_the_right():
    assert TABLE.markdown().splitlines() == [
        '### A title', '', '|  | value | note |', '| --- | ---: | ---: |',
        '| first | 1.23 | a |', '| the second | -10.00 | b c |']


def test_a_row_of_another_length_is_a_mistake():
    with pytest.raises(ValueError, match='zip'):
        TABLE._replace(rows=[('first', 1.0)]).cells()


def test_files_are_found_in_order_or_their_pattern_is_named(tmp_path):
    for name in ('b.mat', 'a.mat', 'c.txt'):
        (tmp_path / name).write_text('')
    assert [path.name for path in find(tmp_path, '*.mat')] == ['a.mat', 'b.mat']
    with pytest.raises(BagError, match=r'no file \*\.csv there; give the folder'):
        find(tmp_path, '*.csv')


@pytest.fixture(scope='module')
def data(tmp_path_factory):
    """Return a folder with a bench recording of motors on the power law of the thesis."""
    folder = tmp_path_factory.mktemp('data')
    (folder / 'rolling_spider_bench').mkdir()
    a, b = validate.thrust.THESIS
    pwm = np.repeat(np.arange(60.0, 440.0, 20.0), 4)
    force = a * pwm**b * (1.0 + 0.01 * np.random.default_rng(0).standard_normal(len(pwm)))
    values = np.zeros((len(pwm), 4))
    values[:, 0], values[:, 3] = pwm, force
    savemat(folder / 'rolling_spider_bench' / 'thrustdata.mat',
            {'thrust_recdata': {'data': values}})
    return folder


def test_motors_of_the_thesis_have_its_numbers(data, tmp_path):
    table, = validate.bench(data, tmp_path)
    rows = {row[0]: row for row in table.rows}
    for name in ('a of the power law [1e-4 N], thesis (Mambo)',
                 'b of the power law, thesis (Mambo)', 'thrust at 250 [N]'):
        assert rows[name][1] == pytest.approx(rows[name][3], rel=0.05)
    assert rows['the same at 250'][1] == pytest.approx(1.0, abs=0.01)
    low, high = map(float, rows['b of the power law, thesis (Mambo)'][2].split(' to '))
    assert low < validate.thrust.THESIS[1] < high


def test_columns_of_the_bench_are_command_and_force(data):
    path = data / 'rolling_spider_bench' / 'thrustdata.mat'
    assert columns.column(columns.read(path), 'thrust_recdata.data[0]', path)[1][0] == 60.0


def test_the_command_prints_a_table_markdown_or_json(data, tmp_path, capsys):
    arguments = [str(data), '--only', 'bench']
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert text.startswith('Rolling Spider bench: motor map\n')
    assert main([*arguments, '--markdown']) == 0
    assert capsys.readouterr().out.startswith('### Rolling Spider bench: motor map\n')
    assert main([*arguments, '--json', '-']) == 0
    found, = json.loads(capsys.readouterr().out)
    assert found['title'] == 'Rolling Spider bench: motor map' and len(found['rows']) == 8 - 1


@pytest.mark.parametrize('only', ['pendulum', 'hall', 'crazyflie', 'rolling_spider'])
def test_recordings_that_are_missing_are_one_line(data, capsys, only):
    assert main([str(data), '--only', only]) == 2
    error = capsys.readouterr().err
    assert error.startswith('validate_recordings: ') and error.count('\n') == 1
    assert 'docs/evidence/real_recordings.md lists' in error


def test_a_missing_folder_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path / 'none')]) == 2
    assert 'none: not a folder; the recordings are not part of this repository' in (
        capsys.readouterr().err)


def test_flights_with_poses_left_out_are_a_table(monkeypatch):
    class Imported:
        def __init__(self, count):
            self.metadata = {'import': {'mocap_poses_impossible': count}}
    monkeypatch.setattr(validate, 'read_bag', lambda path, topics: Imported(path))
    table, = rejected_poses({'one': '0', 'two': '12'})
    assert table.rows == [('two', 12.0)]
    assert rejected_poses({'one': '0'}) == []


TEXTS = st.text(st.sampled_from('abc xyz-_[]/0123456789'), max_size=12).map(str.strip)


@given(rows=st.lists(st.tuples(TEXTS, st.floats(-1e3, 1e3), TEXTS), max_size=5))
def test_every_cell_is_in_both_forms_of_a_table(rows):
    table = Table('A title', ('name', 'value', 'note'), ('', '.2f', ''), rows)
    lines = table.markdown().splitlines()
    assert len(lines) == 4 + len(rows) and all(line.count('|') == 4 for line in lines[2:])
    for (name, value, note), line in zip(rows, lines[4:], strict=True):
        assert [cell.strip() for cell in line.split('|')[1:-1]] == [name, f'{value:.2f}', note]
    widths = {len(line) for line in table.text().splitlines()[1:] if not line.endswith(' ')}
    assert all(width <= max(widths) for width in widths)
    assert table.text().count('\n') == len(rows) + 1


def test_an_interval_has_its_digits():
    value = Value(1.23456, 1.0, 1.5, 'm')
    assert validate._interval(value, 2) == '1.00 to 1.50'
    assert validate._interval(value, 0) == '1 to 2'


@pytest.fixture
def swings(tmp_path, monkeypatch):
    """Return a folder with logs of three swings, whose fits are known."""
    folder = tmp_path / 'swings' / 'crazyflie_optitrack'
    folder.mkdir(parents=True)
    t, fits = np.arange(0.0, 2.0, 0.01), {}
    for k, axis in enumerate('xyz', 1):
        degrees = 20.0 * k * np.sin(10.0 * t)
        (folder / f'lab_lab03_{axis}_data.json').write_text(json.dumps({f'gyro.{axis}': {
            'time': t.tolist(), 'data': degrees.tolist()}}))
        fits[k] = SimpleNamespace(
            frequency=Value(10.0 + k, 9.0, 12.0, ''), quadratic=Value(0.1 * k, 0.0, 1.0, ''),
            linear=Value(0.01 * k, 0.0, 0.5, ''), amplitude=0.4,
            fit=SimpleNamespace(rms=0.1 * float(np.std(np.radians(degrees)))))

    def fit_swing(times, rate):
        assert times.tolist() == t.tolist()
        return fits[round(np.abs(rate).max() / np.radians(20.0))]  # the rate is in rad/s
    monkeypatch.setattr(validate.inertia, 'fit_swing', fit_swing)
    return folder.parent


def test_each_swing_of_a_pendulum_is_fitted_in_radians(swings, tmp_path):
    table, = validate.pendulum(swings, tmp_path)
    assert [row[0] for row in table.rows] == ['x', 'y', 'z']
    for k, row in enumerate(table.rows, 1):
        values = dict(zip(table.columns, row, strict=True))
        assert values['omega_0 [rad/s]'] == 10.0 + k and row[2] == '9.000 to 12.000'
        assert values['K_D/J [1/rad]'] == pytest.approx(0.1 * k)
        assert values['C/J [1/s]'] == pytest.approx(0.01 * k)
        assert values['left over [%]'] == pytest.approx(10.0)


def test_a_swing_that_is_missing_is_named(swings, tmp_path):
    (tmp_path / 'crazyflie_optitrack').mkdir()
    with pytest.raises(BagError, match=r'no file \*lab03_x_data\*.json'):
        validate.pendulum(tmp_path, tmp_path)


def test_the_rate_and_the_gaps_of_a_motion_capture_are_counted(monkeypatch, tmp_path):
    """200 Hz for 5 s; a gap of one pose at 1.5 s and one of four poses at 3.5 s."""
    t = np.delete(np.arange(0.0, 5.0, 0.005), [300, 700, 701, 702, 703])
    monkeypatch.setattr(validate, 'find', lambda folder, pattern: [folder / pattern])
    monkeypatch.setattr(validate, 'read_bag', lambda path, topics: {
        f'/{topics[0]}': SimpleNamespace(t=t)})
    table, = validate.hall(tmp_path, tmp_path)
    found = {row[0]: row[1] for row in table.rows}
    assert found['rate [Hz]'] == pytest.approx(200.0) and found['duration [s]'] == t[-1]
    assert (found['gaps of one lost pose or more'], found['gaps over 20 ms']) == (2.0, 1.0)
    assert found['poses lost [%]'] == pytest.approx(0.5)
    assert found['mean poses in a gap'] == 2.5
    assert found['longest gap [s]'] == pytest.approx(0.025)


class Steps:
    """Stands for validate_flights: knows what each flight gives, without replaying it."""

    JOINT_COUNTS, SQUARE_DURATION = 409.0, 15.0
    Odometry = staticmethod(lambda *columns: columns)

    def __init__(self):
        self.identified_on = []

    def import_crazyflies(self, logs, folder, treatment, counts=488.0):
        return {log.stem: f'{log.stem} {treatment} {counts:.0f}' for log in logs}

    def samples_of(self, path):
        return SimpleNamespace(t=[0, 1], velocity=np.array([3.0, 4.0]),
                               height=np.array([0.3, 0.5]))

    def factor_of(self, samples, law='constant'):
        value = Value(0.8, 0.7, 0.9, '')
        return SimpleNamespace(offset=value, leak=value, slope=value)

    def identify(self, path):
        self.identified_on.append(path)
        return SimpleNamespace(range_noise=0.004, height=0.5, lag=0.0, missing_density=0.02,
                               missing_mean=0.05)

    def mocap_truth(self, bag):
        return 'truth'

    def variants(self, found):
        return {'Q = 1': 'first', 'identified Q': 'second'}

    def replayed(self, bag, params):
        return params

    def joint_params(self, vehicle):
        assert vehicle == 'crazyflie'
        return 'joint'

    def range_offset(self, bag):
        return 0.07

    def errors(self, estimate, truth, longest=0.0, markers=None):
        known = {'first': 1.0, 'second': 2.0, 'joint': 3.0}
        assert markers == (0.07 if estimate in known else None)  # onboard heights are their own
        return (known.get(estimate, 4.0), longest, 0.0, 0.0, 0.0, 0.0)

    def height_errors(self, log, folder):
        return (0.1, 90.0, 0.0, 1.0), (0.2, 80.0, 0.0, 1.5)

    def recording_name(self, path):
        return path.stem

    def against_onboard(self, log, folder, scale):
        return [30.0, scale, 0.1, 10.0 * scale, 1.0, 2.0]


class StandInBag(dict):
    metadata = {'import': {'mocap_poses_impossible': '3', 'counts_per_radian': '488'}}

    def __missing__(self, key):
        return SimpleNamespace(stamp=0, position=0, velocity=0, orientation=0)


@pytest.fixture
def steps(monkeypatch):
    stand_in = Steps()
    monkeypatch.setattr(validate, 'flights', stand_in)
    monkeypatch.setattr(validate, 'captured', stand_in)
    monkeypatch.setattr(validate, 'read_bag', lambda path, topics=None: StandInBag())
    return stand_in


def logs(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text('')


def test_the_sensors_of_a_crazyflie_are_identified_on_one_flight(steps, tmp_path):
    logs(tmp_path, 'crazyflie_optitrack/lab02_square.json', 'crazyflie_optitrack/other.json',
         'crazyflie_optitrack/lab03_x_data.json')  # the last one is a pendulum
    tables = {table.title: table for table in validate.crazyflie(tmp_path, tmp_path)}
    assert steps.identified_on == ['lab02_square leave 488', 'lab02_square zero 488']
    flown = tables['Crazyflie: estimator against motion capture, repeated counts as zero'].rows
    assert [row[:3] for row in flown] == [
        (name, variant, value) for name in ('lab02_square', 'other') for variant, value in (
            ('Q = 1', 1.0), ('identified Q', 2.0), ('onboard estimate', 4.0))]
    joint = tables['Crazyflie: joint filter against motion capture'].rows
    assert [(row[0], row[1], row[2]) for row in joint] == [
        (name, 3.0, longest) for name in ('lab02_square', 'other')
        for longest in (15.0, float('inf'))]
    factors = tables['Crazyflie: factor of the flow, repeated counts left out'].rows
    assert factors[0][1] == 2.0 and factors[0][2] == pytest.approx(np.sqrt(12.5))
    assert factors[0][6] == 488.0 / 0.8  # counts per radian that make the factor 1
    assert tables['Crazyflie: impossible poses rejected by the import'].rows == [
        ('lab02_square', 3.0), ('other', 3.0)]


def test_without_the_flight_for_the_identification_there_is_one_line(steps, tmp_path, capsys):
    logs(tmp_path, 'crazyflie_optitrack/other.json')
    assert main([str(tmp_path), '--only', 'crazyflie']) == 2
    error = capsys.readouterr().err
    assert 'no flight lab02_square, which the sensors are identified on' in error
    assert error.count('\n') == 1


def test_rolling_spider_flights_are_compared_for_both_scales_of_the_flow(steps, tmp_path):
    logs(tmp_path, 'rolling_spider_flights/a.mat')
    minus, heights = validate.rolling_spider(tmp_path, tmp_path)
    first, second = validate.FLOW_SCALES
    assert minus.rows == [('a', 30.0, first, 0.1, 10.0 * first, 1.0, 2.0, second, 10.0 * second)]
    assert heights.rows == [('a', 0.1, 90.0, 0.0, 1.0, 0.2, 80.0, 0.0, 1.5)]
    assert minus.cells()[0][2] == f'xy rms, {first:g} [m]'


def test_sections_are_evaluated_in_the_order_that_is_given(monkeypatch, tmp_path):
    calls = []

    def section(name):
        def work(data, folder):
            calls.append((name, data, folder.is_dir()))
            return [TABLE._replace(title=name)]
        return work
    monkeypatch.setattr(validate, 'SECTIONS', {name: section(name) for name in 'abc'})
    assert [table.title for table in validate.validate(tmp_path, ['c', 'a'])] == ['c', 'a']
    assert calls == [('c', tmp_path, True), ('a', tmp_path, True)]
    assert [table.title for table in validate.validate(tmp_path)] == ['a', 'b', 'c']
