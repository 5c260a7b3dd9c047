"""The command identify_sensors: what it prints, draws and writes, and in which order."""

import json

from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors.command import main, measure
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest
from scipy.io import savemat


@pytest.fixture(scope='module')
def bench(tmp_path_factory):
    """Return two recordings of 5 s of a resting IMU, the second with twice the noise."""
    folder, rng = tmp_path_factory.mktemp('bench'), np.random.default_rng(0)
    values = rng.standard_normal((1000, 6)) * [*[0.02] * 3, *[0.001] * 3]
    for name, size in (('quiet.mat', 1.0), ('loud.mat', 2.0)):
        savemat(folder / name, {'noisedata': size * values + [0.0, 0.0, -9.81, 0.0, 0.0, 0.0]})
    return folder


def sonar(n=100):
    t = np.arange(n) * 0.04
    return Stream(t, 1.0 + 0.01 * np.sin(7.0 * t))


def test_all_sensors_of_a_recording_are_measured():
    t = np.arange(300) * 0.02
    pressure = Stream(t, 101325.0 + np.random.default_rng(0).standard_normal(300))
    found, curves = measure(Recording('r', sonar=sonar(), barometer=pressure))
    assert {line.sensor for line in found} == {'sonar', 'barometer'}
    assert curves == {'allan': {}, 'latency': None}


def test_a_recording_that_holds_its_readings_is_refused():
    t, values = np.arange(400) * 0.01, np.random.default_rng(0).normal(1.0, 0.004, 100)
    with pytest.raises(BagError, match='sonar/range: 75 % of the readings repeat the one before'):
        measure(Recording('r', sonar=Stream(t, np.repeat(values, 4))))


def test_a_recording_of_nothing_is_refused_by_name():
    with pytest.raises(BagError, match='^short: too few samples to tell anything of a sensor$'):
        measure(Recording('short', sonar=sonar(5)))


@pytest.mark.parametrize('factor', [1000.0, 1e-6])
def test_stamps_in_another_unit_are_refused(factor):
    t = factor * np.arange(300) * 0.02
    pressure = Stream(t, 101325.0 + np.random.default_rng(0).standard_normal(300))
    with pytest.raises(BagError, match='^r: barometer: .* s from sample to sample, possible are'):
        measure(Recording('r', barometer=pressure))
    held = Recording('r', barometer=pressure, held=True)  # of new values alone, at any time
    assert measure(held)[0]


def test_one_file_has_a_table_and_several_a_summary(bench, capsys):
    assert main([str(bench / 'quiet.mat')]) == 0
    alone = capsys.readouterr().out
    assert alone.startswith('quiet.mat\nsensor ') and 'median over recordings' not in alone
    assert main([str(bench / 'quiet.mat'), str(bench / 'loud.mat')]) == 0
    both = capsys.readouterr().out
    assert both.startswith(alone)
    heading = both[both.index('median over recordings'):].splitlines()[1]
    assert 'lowest to highest' in heading and '95 %' not in heading


def test_json_has_every_line_of_every_file_in_order(bench, capsys):
    files = [str(bench / 'loud.mat'), str(bench / 'quiet.mat')]
    assert main([*files, '--json', '-']) == 0
    content = json.loads(capsys.readouterr().out)  # and no table besides
    assert [entry['file'] for entry in content['recordings']] == files
    loud, quiet = ({(m['sensor'], m['quantity']): m for m in entry['measured']}
                   for entry in content['recordings'])
    key = 'gyro x', 'noise at rest'
    assert loud[key]['value'] == pytest.approx(2.0 * quiet[key]['value'])
    assert quiet[key]['low'] < 0.001 < quiet[key]['high'] and quiet[key]['unit'] == 'rad/s'


def test_a_value_that_cannot_be_told_is_null(bench, tmp_path, monkeypatch):
    from mambo_analysis.identify.sensors import command
    from mambo_analysis.identify.sensors.table import Measured
    line = Measured('flow', 'latency', 'ms', np.nan, np.nan, np.nan, 9, 'why')
    monkeypatch.setattr(command, 'measure', lambda _: ([line], {'allan': {}, 'latency': None}))
    assert main([str(bench / 'quiet.mat'), '--json', str(tmp_path / 'a.json')]) == 0
    measured, = json.loads((tmp_path / 'a.json').read_text())['recordings'][0]['measured']
    assert measured['value'] is measured['low'] is None and measured['samples'] == 9


@pytest.mark.long
def test_figures_are_numbered_so_that_files_of_one_name_both_stay(bench, tmp_path, capsys):
    file = str(bench / 'quiet.mat')
    assert main([file, file, '--output', str(tmp_path / 'a' / 'b')]) == 0
    names = ['01_quiet_sensors.png', '02_quiet_sensors.png']
    assert sorted(path.name for path in (tmp_path / 'a' / 'b').iterdir()) == names
    output = capsys.readouterr().out
    assert all(f'figure: {tmp_path / "a" / "b" / name}' in output for name in names)


def test_one_bad_file_prints_no_table_of_the_others(bench, capsys):
    assert main([str(bench / 'quiet.mat'), str(bench / 'none.mat')]) == 2
    output = capsys.readouterr()
    assert not output.out and output.err.startswith('identify_sensors: ')
    assert 'none.mat' in output.err and output.err.count('\n') == 1
