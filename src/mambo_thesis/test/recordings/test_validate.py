"""Tables of the recordings: text and Markdown, and what each section measures of made files."""

import json

from mambo_analysis.identify import columns
from mambo_bags.mcap_reader import BagError
from mambo_thesis.recordings import validate
from mambo_thesis.recordings.validate import find, left_out, main, Table
import numpy as np
import pytest
from scipy.io import savemat

TABLE = Table('A title', ('', 'value', 'note'), ('', '.2f', ''), [
    ('first', 1.234, 'a'), ('the second', -10.0, 'b c')])


def test_a_table_for_a_terminal_stands_in_columns():
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


def test_files_are_found_in_order_or_their_pattern_is_told(tmp_path):
    for name in ('b.mat', 'a.mat', 'c.txt'):
        (tmp_path / name).write_text('')
    assert [path.name for path in find(tmp_path, '*.mat')] == ['a.mat', 'b.mat']
    with pytest.raises(BagError, match=r'no \*\.csv there; give the folder'):
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


def test_no_folder_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path / 'none')]) == 2
    assert 'none: no folder; the recordings are not part of this repository' in (
        capsys.readouterr().err)


def test_flights_with_poses_left_out_are_a_table(monkeypatch):
    class Imported:
        def __init__(self, count):
            self.metadata = {'import': {'mocap_poses_impossible': count}}
    monkeypatch.setattr(validate, 'read_bag', lambda path, topics: Imported(path))
    table, = left_out({'one': '0', 'two': '12'})
    assert table.rows == [('two', 12.0)]
    assert left_out({'one': '0'}) == []
