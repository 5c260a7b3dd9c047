"""Each flight is predicted by the others; real ones where they are at hand."""

import json
from pathlib import Path
import shutil
from typing import NamedTuple

import flown
from flown import bag, steered, table_of
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.importers.any_table import import_table, shipped
from mambo_analysis.twin.loop import Flown
from mambo_analysis.twin.motors import MotorWindows
from mambo_analysis.twin.twin import (
    as_json, as_text, leave_one_out, main, refuse_unlike_commands, Row, table, translation,
    unlike_batteries)
from mambo_analysis.twin.windows import Windows
import numpy as np
import pytest

NANOBENCH = Path(__file__).parents[4] / '../shared/data/nanobench'


class Named(NamedTuple):
    """Stands for a flight of which only the name matters."""

    name: str


def folder_bag(tmp_path, seed):
    """Return the path of a bag of a flight with turning motors, and a reference."""
    folder = tmp_path / f'turned {seed}'
    folder.mkdir()
    return str(table_of(steered(seed), folder, reference=True))


def bags(tmp_path, count=2):
    folders = [tmp_path / str(seed) for seed in range(count)]
    for folder in folders:
        folder.mkdir()
    return [str(bag(folder, seconds=8.0, seed=seed, noise=0.05))
            for seed, folder in enumerate(folders)]


@pytest.mark.long
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


def test_a_flight_that_is_given_twice_is_refused_also_as_a_copy(tmp_path, capsys):
    first, second = bags(tmp_path)
    copy = shutil.copytree(first, tmp_path / 'copy')
    assert main([str(first), str(second), str(copy)]) == 2
    assert f'{copy}: the same flight as {first}' in capsys.readouterr().err


@pytest.mark.long
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
    assert main([*paths, '--motors', '--loop', '--json', str(tmp_path / 'twin.json')]) == 0
    flights = json.loads((tmp_path / 'twin.json').read_text())['flights']
    for flight in flights:
        assert flight['ratio'] < 0.25 and max(flight['mae_m']) < 0.016
        motors = flight['motors']
        assert motors['position'] < 0.6 * motors['constant_position']
        assert motors['attitude'] < 0.7 * motors['turned']
        # the firmware's own estimate explains at least a third of the horizontal distance
        true, own = flight['loop_rms_m'], flight['loop_by_estimate_rms_m']
        assert own['horizontal'] < 0.67 * true['horizontal'] < 0.1


@pytest.mark.long
def test_motors_loop_and_page(tmp_path, capsys):
    """All three comparisons of bags with a reference, and the page that shows them."""
    names = [folder_bag(tmp_path, seed) for seed in range(2)]
    page = tmp_path / 'twin.html'
    assert main([*names, '--motors', '--loop', '--html', str(page), '--json',
                 str(tmp_path / 'twin.json')]) == 0
    out = capsys.readouterr().out
    assert 'from the motors alone, mean error after 0.5 s' in out
    assert 'closed loop, RMS between simulated and flown path [cm]' in out
    for one in json.loads((tmp_path / 'twin.json').read_text())['flights']:
        assert one['motors']['attitude'] < 0.3 * one['motors']['turned']
        assert one['loop_rms_m']['total'] > 0.0 and 'loop_by_estimate_rms_m' not in one
    text = page.read_text()
    assert text.count('bag: position, simulated minus flown') >= 2
    assert 'from the motors alone' in text and 'model x' in text


@pytest.mark.long
def test_flights_on_unlike_batteries_are_told():
    def on(name, volts):
        plain = flown.flight(0)
        return plain._replace(name=name, voltage=np.full_like(plain.voltage, volts))
    known = [on('full', 4.0), on('used', 3.3), on('none', np.nan)]
    assert unlike_batteries(known) == [] == unlike_batteries(known[2:])
    assert unlike_batteries([*known, on('half', 1.75)]) == [
        'the battery of half shows 1.75 V in the mean, that of full 4 V: check unit and channel, '
        'or give flights of one kind of battery']


def test_flights_of_two_vehicles_are_refused():
    def with_commands(name, factor):
        plain = flown.flight(0)
        return plain._replace(name=name, command=factor * plain.command)
    refuse_unlike_commands([with_commands('one', 1.0), with_commands('other', 1.5)])
    with pytest.raises(IdentifyError, match='the motors of small have a command of .*, those of '
                                            'large of .*: they are not of one vehicle'):
        refuse_unlike_commands([with_commands('large', 100.0), with_commands('small', 1.0)])


def test_a_loop_needs_a_reference(tmp_path, capsys):
    assert main([*bags(tmp_path), '--loop']) == 2
    assert 'no reference (onboard/reference) in' in capsys.readouterr().err


def test_text_has_a_column_for_each_head():
    lines = as_text(('what', ['flight', 'm'], [['one', '10000.5'], ['a longer one', '1.0']]))
    assert lines.splitlines() == [
        'what', 'flight              m', 'one           10000.5', 'a longer one      1.0']


def test_large_numbers_do_not_run_together():
    """A minute without a model: distances of kilometres."""
    windows = Windows(np.full((4, 3), 12.3456), np.full((4, 3), 1234.5678))
    line = table([Row(Named('one'), windows)], 0.5).splitlines()[2]
    assert line.split()[1:7] == ['12345.6'] * 3 + ['1234567.8'] * 3


def test_the_table_has_a_line_for_each_flight():
    windows = Windows(np.full((4, 3), [0.003, -0.001, 0.002]), np.full((4, 3), [0.1, 0.0, 0.0]))
    lines = table([Row(Named('one'), windows), Row(Named('another'), windows)], 0.5).splitlines()
    assert lines[0].startswith('position after 0.5 s, mean absolute error')
    assert [line.split() for line in lines[2:]] == [
        [name, '3.0', '1.0', '2.0', '100.0', '0.0', '0.0', '0.04', '4']
        for name in ('one', 'another')]


def test_json_holds_the_same_numbers():
    windows = Windows(np.full((4, 3), [0.003, -0.001, 0.002]), np.full((4, 3), [0.1, 0.0, 0.0]))
    found = json.loads(as_json([Row(Named('one'), windows)], 0.5, 1.0))
    assert found['flights'] == [{
        'name': 'one', 'mae_m': pytest.approx([0.003, 0.001, 0.002]),
        'ratio': pytest.approx(0.0374166, rel=1e-5),
        'constant_velocity_mae_m': pytest.approx([0.1, 0.0, 0.0]), 'windows': 4}]
    assert (found['horizon_s'], found['past_s']) == (0.5, 1.0)


@pytest.mark.long
def test_without_the_second_before_there_are_more_windows(tmp_path):
    paths = [Path(path) for path in bags(tmp_path)]
    plain, trimmed = (leave_one_out(paths, 0.5, past) for past in (0.0, 1.0))
    for one, other in zip(plain, trimmed):
        assert len(one.windows.model) == len(other.windows.model) + 10


def test_the_table_of_the_page_holds_the_same_numbers():
    windows = Windows(np.full((4, 3), [0.003, -0.001, 0.002]), np.full((4, 3), [0.1, 0.0, 0.0]))
    caption, head, rows = translation([Row(Named('one'), windows)], 0.5)
    assert caption == 'position after 0.5 s, mean absolute error in x, y, z [mm]'
    assert len(head) == len(rows[0])
    assert rows == [['one', '3.0', '1.0', '2.0', '100.0', '0.0', '0.0', '0.04', '4']]


def test_json_holds_motors_and_loops_where_they_were_asked_for():
    one = steered(seconds=6.0)
    flown = Flown(one.position + [0.03, 0.0, 0.04], one.velocity, one.attitude)
    windows = Windows(np.zeros((1, 3)), np.ones((1, 3)))
    motors = MotorWindows(*(np.full(2, 0.1 * i) for i in range(7)))
    found = json.loads(as_json([Row(one, windows, motors, (None, flown))], 0.5, 0.0))['flights'][0]
    assert found['motors']['kept'] == pytest.approx(0.6)
    assert found['loop_by_estimate_rms_m'] == pytest.approx(
        {'horizontal': 0.03, 'vertical': 0.04, 'total': 0.05})
    assert 'loop_rms_m' not in found
