"""Each flight is predicted by the others; real ones where they are at hand."""

import json
from pathlib import Path

from flown import bag
from mambo_analysis.importers.any_table import import_table, shipped
from mambo_analysis.twin.twin import as_json, leave_one_out, main, Row, table
from mambo_analysis.twin.windows import Windows
import numpy as np
import pytest

NANOBENCH = Path(__file__).parents[4] / '../shared/data/nanobench'


def bags(tmp_path, count=2):
    folders = [tmp_path / str(seed) for seed in range(count)]
    for folder in folders:
        folder.mkdir()
    return [str(bag(folder, seconds=8.0, seed=seed, noise=0.05))
            for seed, folder in enumerate(folders)]


def test_leaves_each_out(tmp_path, capsys):
    assert main([*bags(tmp_path), '--json', str(tmp_path / 'twin.json')]) == 0
    found = json.loads((tmp_path / 'twin.json').read_text())
    assert len(found['flights']) == 2 and found['horizon_s'] == 0.5
    for flight in found['flights']:
        assert flight['ratio'] < 0.1 and max(flight['mae_m']) < 0.01
    assert 'constant velocity' in capsys.readouterr().out


@pytest.mark.parametrize('arguments, said', [
    ([], 'at least two'), (['--horizon', '9'], 'within 0.05 to 3 s'),
    (['--past', 'nan'], 'within 0 to 5 s')])
def test_wrong_input_is_one_line(tmp_path, capsys, arguments, said):
    try:
        code = main([*bags(tmp_path, 1), *arguments])
    except SystemExit as error:
        code = error.code
    assert code == 2 and said in capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.skipif(not NANOBENCH.is_dir(), reason='the recordings of NanoBench are not at hand')
def test_real_flights_of_a_crazyflie(tmp_path):
    """
    Three flights of 16 to 18 s, of which mambo twin tells 5 to 13 mm on all seven.

    Constant velocity is wrong by 50 to 100 mm along x and y: the bounds tell a model from none.
    """
    paths = []
    for name in ('B2_circle_fast', 'B2_circle_medium', 'B3_figure8_medium'):
        import_table(NANOBENCH / f'{name}_rep1.csv', tmp_path / name, shipped()['nanobench'])
        paths.append(str(tmp_path / name))
    assert main([*paths, '--json', str(tmp_path / 'twin.json')]) == 0
    for flight in json.loads((tmp_path / 'twin.json').read_text())['flights']:
        assert flight['ratio'] < 0.25 and max(flight['mae_m']) < 0.016


def test_the_table_has_a_line_for_each_flight():
    windows = Windows(np.full((4, 3), [0.003, -0.001, 0.002]), np.full((4, 3), [0.1, 0.0, 0.0]))
    lines = table([Row('one', windows), Row('another', windows)], 0.5).splitlines()
    assert lines[0].startswith('position after 0.5 s, mean absolute error')
    assert [line.split() for line in lines[2:]] == [
        [name, '3.0', '1.0', '2.0', '100.0', '0.0', '0.0', '0.04', '4']
        for name in ('one', 'another')]


def test_json_holds_the_same_numbers():
    windows = Windows(np.full((4, 3), [0.003, -0.001, 0.002]), np.full((4, 3), [0.1, 0.0, 0.0]))
    found = json.loads(as_json([Row('one', windows)], 0.5, 1.0))
    assert found['flights'] == [{
        'name': 'one', 'mae_m': pytest.approx([0.003, 0.001, 0.002]),
        'ratio': pytest.approx(0.0374166, rel=1e-5),
        'constant_velocity_mae_m': pytest.approx([0.1, 0.0, 0.0]), 'windows': 4}]
    assert (found['horizon_s'], found['past_s']) == (0.5, 1.0)


def test_without_the_second_before_there_are_more_windows(tmp_path):
    paths = [Path(path) for path in bags(tmp_path)]
    plain, trimmed = (leave_one_out(paths, 0.5, past) for past in (0.0, 1.0))
    for one, other in zip(plain, trimmed):
        assert len(one.windows.model) == len(other.windows.model) + 10
