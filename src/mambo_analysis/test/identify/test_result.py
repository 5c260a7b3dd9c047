"""What every identification command writes: table, JSON, picture and vehicle file."""

import json
from pathlib import Path

from mambo_analysis.identify import result
from mambo_analysis.identify.regression import IdentifyError, Value
from mambo_bags.mcap_reader import BagError
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import load, PRESETS
from matplotlib.figure import Figure
import numpy as np
import pytest
from synthetic import Maker


def report(**changed):
    drawn = []
    out = result.Report(
        'Drag of a test', {'drag': Value(0.0425, 0.04, 0.045, 'kg/s'),
                           'k': Value(-2.0, -3.0, -1.0, '1')},
        {'samples': 4000, 'rms': 0.1234567, 'file': 'a.csv'}, ['only forward'],
        {'mass': (0.07, 'a scale')}, lambda figure: drawn.append(figure))
    return out._replace(**changed), drawn


def test_the_table_has_every_value_with_unit_and_interval_in_a_column():
    lines = result.table(report()[0]).splitlines()
    assert lines[0] == 'Drag of a test' and not lines[1]
    assert lines[2].split() == ['drag', '0.0425', 'kg/s', '95', '%:', '0.04', '..', '0.045']
    assert lines[3].split()[:3] == ['k', '-2', '1']
    assert lines[2].index('95 %') == lines[3].index('95 %')
    assert lines[4].split() == ['samples', '4000']       # a count as it is
    assert lines[5].split() == ['rms', '0.123457']       # a number to six digits
    assert lines[-2:] == ['note: only forward', result.METHOD]


def test_an_interval_without_width_is_explained_and_a_narrow_one_shown():
    found, _ = report(values={'noise': Value(0.0, 0.0, 0.0, 'rad/s'),
                              'k': Value(1234.5678, 1234.5677, 1234.5679, '1')})
    lines = result.table(found).splitlines()
    assert lines[3].split()[-3:] == ['1234.5677', '..', '1234.5679']
    assert 'note: noise: an interval without width: its samples do not scatter' in '\n'.join(lines)
    assert not any(line.startswith('note: k') for line in lines)


@pytest.mark.parametrize(('largest', 'noted'), [(2.1e-4, False), (2.5e-4, True)])
def test_an_inertia_that_no_body_has_is_noted(largest, noted):
    found, _ = report(vehicle={'inertia': ((largest, 1e-4, 1e-4), 'a pendulum')})
    assert ('note: no vehicle can be flown with this inertia yet: the largest moment, 0.00025 kg '
            'm^2, exceeds the sum of the others by 25 %' in result.table(found)) is noted


def test_json_holds_the_same_and_no_nan():
    content = json.loads(result.as_json(report()[0]))
    assert content['values']['drag'] == {
        'value': 0.0425, 'low': 0.04, 'high': 0.045, 'unit': 'kg/s'}
    assert (content['level'], content['notes']) == (0.95, ['only forward'])
    assert content['facts'] == {'samples': 4000, 'rms': 0.1234567, 'file': 'a.csv'}
    with pytest.raises(ValueError, match='JSON'):
        result.as_json(report(facts={'rms': float('nan')})[0])


def test_a_folder_gets_json_picture_vehicle_and_what_is_besides(tmp_path):
    base, (found, drawn) = next(iter(PRESETS)), report(files={'raw.csv': 't,x\n'})
    files = result.write('drag', found, tmp_path / 'new' / 'out', base)
    assert [file.name for file in files] == ['drag.json', 'raw.csv', 'drag.yaml', 'drag.png']
    assert all(file.parent == tmp_path / 'new' / 'out' for file in files)
    assert json.loads(files[0].read_text())['title'] == found.title
    assert files[1].read_text() == 't,x\n'
    assert files[3].read_bytes()[:4] == b'\x89PNG' and len(drawn) == 1
    vehicle = load(files[2])
    assert vehicle.mass == 0.07
    assert vehicle.arm == PRESETS[base].arm  # all else is the base's


def test_without_vehicle_values_there_is_no_vehicle_file(tmp_path):
    files = result.write('drag', report(vehicle={})[0], tmp_path, next(iter(PRESETS)))
    assert [file.name for file in files] == ['drag.json', 'drag.png']
    assert sorted(file.name for file in tmp_path.iterdir()) == ['drag.json', 'drag.png']


def test_a_value_no_vehicle_can_have_writes_nothing(tmp_path):
    with pytest.raises(ParameterError, match='mass'):
        result.write('drag', report(vehicle={'mass': (-1.0, 'a scale')})[0], tmp_path / 'out',
                     next(iter(PRESETS)))
    assert not (tmp_path / 'out').exists()


def run(arguments, work):
    options = result.parser('drag', 'Measures drag.').parse_args(arguments)
    return result.run('drag', options, work)


def test_a_command_prints_its_table_and_names_its_files(tmp_path, capsys):
    found, _ = report()
    assert run(['--output', str(tmp_path)], lambda: found) == 0
    output = capsys.readouterr().out
    assert output.startswith(result.table(found))
    assert str(tmp_path / 'drag.json') in output and str(tmp_path / 'drag.png') in output


@pytest.mark.parametrize('options', [[], ['--json', '-'], ['--output', 'out']])
def test_a_value_no_vehicle_can_have_is_refused_before_the_table(
        tmp_path, capsys, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    assert run(options, lambda: report(vehicle={'mass': (-1.0, 'a scale')})[0]) == 2
    output = capsys.readouterr()
    assert not output.out and not (tmp_path / 'out').exists()
    assert 'vehicle.mass = -1' in output.err and output.err.count('\n') == 1


def test_json_to_stdout_is_json_alone(capsys):
    found, _ = report()
    assert run(['--json', '-'], lambda: found) == 0
    assert json.loads(capsys.readouterr().out)['title'] == found.title


def test_an_unknown_base_is_told_before_the_work(capsys):
    assert run(['--base', 'mamba'], lambda: pytest.fail('worked')) == 2
    output = capsys.readouterr()
    assert output.err.startswith("drag: --base: vehicle 'mamba' is unknown; known: ")
    assert output.err.count('\n') == 1 and not output.out


def test_data_that_cannot_answer_ends_in_one_line(capsys):
    def work():
        raise IdentifyError('a.csv: too short')
    assert run([], work) == 2
    assert capsys.readouterr().err == 'drag: a.csv: too short\n'


@pytest.mark.parametrize('text, said', [
    ('too short', 'bench/a.csv: too short'), ('a.csv: too short', 'a.csv: too short'),
    ('--mass must be above 0', '--mass must be above 0')])
@pytest.mark.parametrize('name', ['file', 'bag'])
def test_an_error_about_the_data_names_their_file(capsys, text, said, name):
    def work():
        raise IdentifyError(text)
    options = result.parser('drag', 'Measures drag.').parse_args([])
    setattr(options, name, Path('bench/a.csv'))
    assert result.run('drag', options, work) == 2
    assert capsys.readouterr().err == f'drag: {said}\n'


def test_bags_are_folders_and_mcap_files(tmp_path):
    (tmp_path / 'bag').mkdir()
    assert result.is_bag(tmp_path / 'bag') and result.is_bag(tmp_path / 'a.mcap')
    assert not result.is_bag(tmp_path / 'a.csv')


def test_a_bag_must_have_messages_of_each_topic(tmp_path):
    maker = Maker(tmp_path / 'bag', ('motor_pwm', 'optical_flow'))
    maker.write('motor_pwm', 0)
    maker.writer.close()
    assert len(result.open_bag(tmp_path / 'bag', ('motor_pwm',))['motor_pwm']) == 1
    with pytest.raises(BagError, match='bag: .*optical_flow has no messages'):
        result.open_bag(tmp_path / 'bag', ('motor_pwm', 'optical_flow'))
    with pytest.raises(BagError, match='imu/data_raw'):
        result.open_bag(tmp_path / 'bag', ('imu/data_raw',))


def test_a_bag_with_stamps_that_go_back_is_refused(tmp_path):
    maker = Maker(tmp_path / 'bag', ('motor_pwm', 'optical_flow'))
    for k, stamp in enumerate((0, 2, 1)):
        maker.writer.write('/mambo/motor_pwm', maker.message('motor_pwm', stamp * 10**9), k)
        maker.write('optical_flow', k)
    maker.writer.close()
    assert len(result.open_bag(tmp_path / 'bag', ('optical_flow',))['optical_flow']) == 3
    with pytest.raises(BagError, match='motor_pwm: stamps go back, first from 2.000 to 1.000 s'):
        result.open_bag(tmp_path / 'bag', ('motor_pwm',))


def vehicle_of(folder, text):
    path = folder / 'own.yaml'
    path.write_text(text)
    return path


OWN = """description: mine
base: crazyflie
mass: {value: 0.033, unit: kg, source: a scale}
arm: {value: 0.04, unit: m, source: a ruler}
"""


def test_a_base_may_be_a_file_whose_values_are_kept(tmp_path, capsys):
    base, (found, _) = vehicle_of(tmp_path, OWN), report()
    assert run(['--base', str(base), '--output', str(tmp_path / 'out')], lambda: found) == 0
    got = load(tmp_path / 'out' / 'drag.yaml')
    assert (got.mass, got.arm) == (0.07, 0.04)  # as found; as in the file
    assert got.power_b == PRESETS['crazyflie'].power_b
    assert 'of own.yaml' in (tmp_path / 'out' / 'drag.yaml').read_text()


@pytest.mark.parametrize('text, said', [
    (OWN.replace('base: crazyflie\n', ''), 'a known "base"'),
    (OWN.replace('crazyflie', 'other.yaml'), 'a known "base"'), ('mass: 1', 'no description')])
def test_a_file_that_is_no_base_is_one_line(tmp_path, capsys, text, said):
    base = vehicle_of(tmp_path, text)
    assert run(['--base', str(base)], lambda: pytest.fail('worked')) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and str(base) in error and '\n' not in error


@pytest.mark.parametrize('axes', ['xyz', 'xy', 'z'])
def test_a_specific_force_is_drawn_measured_and_as_fitted(axes):
    t, rng = np.arange(50) * 0.05, np.random.default_rng(0)
    measured, residual = rng.standard_normal((2, 50, 3))
    figure = Figure()
    result.drawn_force(t, measured, residual, axes)(figure)
    assert [row.get_title()[21] for row in figure.axes] == list(axes)
    for row, axis in zip(figure.axes, axes, strict=True):
        i = 'xyz'.index(axis)
        shown, fitted = (line.get_ydata() for line in row.lines)
        np.testing.assert_array_equal(shown, measured[:, i])
        np.testing.assert_allclose(fitted, measured[:, i] - residual[:, i])
    assert figure.axes[-1].get_xlabel() == 'time [s]'
    words = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert words == ['accelerometer', 'model']
