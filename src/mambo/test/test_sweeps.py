"""Sweeps from a script."""

from pathlib import Path

import mambo
from mambo_flight.sweep import command
from mambo_model.errors import InputError
import pandas
import pytest

WHAT = {'scenario': 'fig_5_10', 'vary': {
    'seed': [1, 2], 'sim_node.duration': [2.0], 'sim_node.simulator.vehicle.mass': [0.06, 0.07]}}


def test_a_sweep_is_a_data_frame_with_a_row_per_flight(tmp_path):
    table = mambo.sweep(WHAT, ideal=True, workers=1, output=tmp_path / 'out.parquet')
    assert len(table) == 4 and set(table['seed']) == {1, 2}
    assert table['tracking_rms'].gt(0.0).all()
    pandas.testing.assert_frame_equal(
        table, pandas.read_parquet(tmp_path / 'out.parquet'), check_dtype=False)
    assert (tmp_path / 'out.png').exists()


def test_a_file_and_its_content_are_the_same_sweep(tmp_path):
    import yaml
    file = tmp_path / 'sweep.yaml'
    file.write_text(yaml.safe_dump(WHAT))
    theirs = pandas.DataFrame(command.sweep(file, tmp_path / 'o.parquet', True, 1))
    pandas.testing.assert_frame_equal(mambo.sweep(WHAT, ideal=True, workers=1), theirs)


def test_a_course_that_cannot_be_flown_is_one_warning_at_the_line_of_the_call(
        tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'fast.csv').write_text('t,x,y,height\n0,0,0,1.5\n1.4,6,0,1.5\n2.8,0,0,1.5\n')
    monkeypatch.setattr(command, 'run', lambda flights, *_: pytest.fail())
    with pytest.warns(UserWarning, match='^flight 0: the vehicle cannot fly fast.csv: ') as found:
        with pytest.raises(pytest.fail.Exception):
            mambo.sweep({'vary': {'trajectory': ['fast.csv'], 'seed': [1, 2, 3]}}, workers=1)
    assert len(found) == 1 and found[0].filename == __file__


@pytest.mark.long
def test_a_sweep_flies_a_file_as_it_is_now(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ours = Path(__file__).parents[3] / 'examples/alpha_beta_filter.py'
    what = {'scenario': 'fig_5_10', 'vary': {
        'estimator_node.estimator': ['mine.py'], 'sim_node.duration': [4.0]}}
    found = []
    for alpha in (0.3, 0.9):
        text = ours.read_text().replace('quantity(0.3,', f'quantity({alpha},')
        (tmp_path / 'mine.py').write_text(text)
        found += list(mambo.sweep(what, workers=1)['estimation_rms'])
    assert found[0] != found[1]


@pytest.mark.parametrize('what, message', [
    ({'scenario': 'fig_5_10', 'vary': {'sede': [1]}}, 'sede'), ({'vray': {'seed': [1]}}, 'vray'),
    ({}, 'sweep: is empty: give vary, what differs'),
    ({'vary': {'seed': [1, 1]}}, 'sweep: seed: 1 is there 2 times'),
    ('no/such.yaml', 'no/such.yaml')])
def test_wrong_input_is_one_line(what, message):
    with pytest.raises(mambo.InputError) as error:
        mambo.sweep(what)
    assert message in str(error.value) and '\n' not in str(error.value)
    assert 'mambo_' not in str(error.value)


def test_a_file_that_is_missing_is_named_where_it_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(mambo.InputError) as error:
        mambo.sweep({'scenario': 'no.yaml', 'vary': {'seed': [1]}})
    assert str(error.value) == f'{tmp_path}/no.yaml: No such file or directory'


def test_a_folder_that_no_file_can_name_is_named(tmp_path, monkeypatch):
    folder = tmp_path / 'fl\udcfcg'
    folder.mkdir()
    monkeypatch.chdir(folder)
    for what, name in (({'scenario': 'mine.yaml'}, 'mine.yaml'),
                       ({'vary': {'vehicle': ['heavy.yaml']}}, 'heavy.yaml')):
        with pytest.raises(mambo.InputError) as error:
            mambo.sweep(what)
        assert str(error.value) == (
            rf'sweep: {tmp_path}/fl\xfcg/{name} is not UTF-8: rename the file or folder')


def test_files_of_a_mapping_are_those_of_the_current_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'mine.yaml').write_text(
        'title: Hover\ntrajectory: hover\nduration: 2\nlanding: false\n')
    (tmp_path / 'heavy.yaml').write_text(
        'description: heavy\nbase: identified\nmass: {value: 0.08, unit: kg, source: a test}\n')
    table = mambo.sweep({'scenario': 'mine.yaml', 'vary': {
        'vehicle': ['toolbox', 'heavy.yaml']}}, ideal=True, workers=1)
    assert table['vehicle'].tolist() == ['toolbox', f'{tmp_path}/heavy.yaml']
    assert table['pwm_max'][0] != table['pwm_max'][1]


@pytest.mark.parametrize('workers', [0, -1, 1025, 'a', 1.5, True])
def test_workers_are_a_whole_number(workers):
    with pytest.raises(InputError, match='^workers = .* must be a whole number, 1 to 1024$'):
        mambo.sweep({'title': 'x', 'vary': {'seed': [1]}}, workers=workers)
