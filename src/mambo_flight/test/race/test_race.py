"""The command race: refusals in one line, a race that goes on, its page."""

import json
from pathlib import Path
import re
import signal

from mambo_flight.race import race
from mambo_flight.race.comparison import NAMES
from mambo_flight.sweep import table
import pytest

ROW = {'tracking_rms': 0.01, 'tracking_max': 0.1, 'tracking_final': 0.02, 'saturated_share': 0.0,
       'energy': 50.0, 'shutdown': False, 'failsafe': '', 'fallen': False, 'fault': ''}


@pytest.mark.parametrize('options, message', [
    (['--controllers', 'indi,foo'], "controller 'foo' is unknown: give a file"),
    (['--controllers', 'foo'], f'or one of {", ".join(NAMES)}'),
    (['--controller', 'none.py'], 'none.py: No such file'),
    (['--courses', ''], '--courses:  is unknown; known: circle, '),
    (['--controllers', ''], "controller '' is unknown"),
    (['--courses', 'square'], '--courses: square is unknown; known: circle, '),
    (['--state', 'dreamt'], '--state: dreamt is unknown; known: true, estimated, aided'),
    (['--add'], 'controllers.json: No such file or directory: race without --add first'),
    (['--conditions', 'storm'], '--conditions: storm is unknown; known: known, '),
    (['--state', 'true,true'], '--state: true is given twice'),
    (['--draws', '0'], '--draws: 0 must be within 1 to 10000'),
    (['--draws', '10001'], '--draws: 10001 must be within 1 to 10000'),
    (['--workers', '0'], '--workers: 0 must be within 1 to 1024')])
def test_what_cannot_be_flown_is_refused_in_one_line(tmp_path, capsys, options, message):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(race.main(['-o', str(tmp_path / 'out'), *options]))
    error = capsys.readouterr().err
    assert end.value.code == 2 and message in error and error.count('\n') == 1
    assert not (tmp_path / 'out').exists()


def test_the_help_names_every_controller(capsys):
    with pytest.raises(SystemExit):
        race.main(['--help'])
    text = ' '.join(capsys.readouterr().out.split())
    assert f'names out of {", ".join(NAMES)} (default: all but predictive' in text
    assert 'toolbox' in NAMES


def test_the_folder_of_a_bag_is_left_alone(tmp_path, capsys):
    (tmp_path / 'metadata.yaml').write_text('')
    assert race.main(['-o', str(tmp_path), '--draws', '1']) == 2
    assert capsys.readouterr().err == f'race: {tmp_path}: is a bag; give a folder for the page\n'
    assert [path.name for path in tmp_path.iterdir()] == ['metadata.yaml']


def test_a_race_writes_its_page_and_goes_on_after_an_interruption(
        tmp_path, monkeypatch, capsys):
    out, flown = tmp_path / 'out', []

    def fly(flights, ideal):
        flown.append(len(flights))
        if len(flown) == 2:
            raise KeyboardInterrupt(signal.SIGTERM)
        return [ROW for _ in flights]
    monkeypatch.setattr('mambo_flight.sweep.run.fly', fly)
    monkeypatch.setattr(race, 'step_time', lambda flight: 0.5)
    arguments = ['-o', str(out), '--controllers', 'indi', '--courses', 'circle,step',
                 '--conditions', 'twenty_percent', '--draws', '2', '--workers', '1']
    with pytest.raises(KeyboardInterrupt) as end:  # of which `mambo` makes a line and exit code
        race.main([*arguments, '--state', 'true'])
    assert end.value.args == (signal.SIGTERM, table.KEPT)
    assert not (out / 'controllers.md').exists()
    assert race.main([*arguments, '--state', 'true', '--draws', '3']) == 2
    assert 'not begun by this race and this version' in capsys.readouterr().err
    assert race.main([*arguments, '--state', 'true']) == 0
    assert sum(flown) == 5  # four flights, the interrupted one twice
    page = json.loads((out / 'controllers.json').read_text())
    assert [(r['course'], r['flights'], r['rms']) for r in page['results']] == [
        ('circle', 2, 0.01), ('step', 2, 0.01)]
    assert page['steps_us'] == {'indi': ['Smeur 2016, Sun 2022', 0.5]}
    assert (out / 'controllers.md').read_text().startswith('# Controllers compared')
    assert (out / 'controllers_twenty_percent.png').exists()
    assert not list(out.glob('*.rows'))


def test_a_controller_of_ones_own_races_beside_the_others(tmp_path, monkeypatch):
    flown = []

    def fly(flights, ideal):
        flown.extend(flight.controller_node.controller for flight in flights)
        return [ROW for _ in flights]
    monkeypatch.setattr('mambo_flight.sweep.run.fly', fly)
    monkeypatch.setattr(race, 'step_time', lambda flight: 0.5)
    pd = str(Path(__file__).parents[4] / 'examples/pd_controller.py')
    assert race.main([
        '-o', str(tmp_path / 'out'), '--controllers', 'indi', '--controller', pd, '--courses',
        'circle', '--conditions', 'known', '--state', 'true', '--workers', '1']) == 0
    assert flown == ['indi', pd]
    page = (tmp_path / 'out/controllers.md').read_text()
    assert '| `pd_controller` | 10 |' in page
    assert re.search(r'\| `pd_controller` \| pd_controller .*sha256 [0-9a-f]{64} \| 0.50 \|', page)


def test_a_race_with_a_controller_that_failed_says_so(tmp_path, monkeypatch, capsys):
    rows = iter(('', 'mine.py:3: ValueError: no'))
    monkeypatch.setattr('mambo_flight.sweep.run.fly', lambda flights, ideal: [
        {**ROW, 'fault': next(rows)} for _ in flights])
    monkeypatch.setattr(race, 'step_time', lambda flight: 0.5)
    assert race.main([
        '-o', str(tmp_path), '--controllers', 'indi,geometric', '--courses', 'circle',
        '--conditions', 'known', '--state', 'true', '--workers', '1']) == 1
    assert capsys.readouterr() == (
        f'page: {tmp_path / "controllers.md"}\n',
        'race: a component failed in 1 of 2 flights, the first is geometric/circle/known/0/true: '
        'mine.py:3: ValueError: no\n')


@pytest.mark.parametrize('at', ['draw', 'markdown'])
def test_a_race_that_is_ended_while_it_writes_goes_on(tmp_path, monkeypatch, at):
    flown, held = [], getattr(race.report, at)

    def ended(*_):
        monkeypatch.setattr(race.report, at, held)
        raise KeyboardInterrupt(signal.SIGINT)
    monkeypatch.setattr('mambo_flight.sweep.run.fly', lambda flights, ideal: (
        flown.append(len(flights)), [ROW for _ in flights])[1])
    monkeypatch.setattr(race, 'step_time', lambda flight: 0.5)
    monkeypatch.setattr(race.report, at, ended)
    arguments = ['-o', str(tmp_path), '--controllers', 'indi', '--courses', 'circle',
                 '--conditions', 'known', '--draws', '1', '--workers', '1', '--state', 'true']
    with pytest.raises(KeyboardInterrupt):
        race.main(arguments)
    assert race.main(arguments) == 0 and flown == [1]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'controllers.json', 'controllers.md', 'controllers_known.png']
    assert race.main(arguments) == 2  # it has ended


@pytest.mark.parametrize('name', [
    'controllers.md', 'controllers.json', 'controllers_known.png'])
def test_a_page_is_not_written_over(tmp_path, capsys, name):
    (tmp_path / name).write_text('mine')
    assert race.main(['-o', str(tmp_path), '--draws', '1']) == 2
    error = capsys.readouterr().err
    assert f'{name} exists: --add keeps what it has' in error and error.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == 'mine'


def test_a_page_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    old = {race.PAGE: b'old', race.NUMBERS: b'old',
           'controllers_known.png': b'\x89PNG\r\n\x1a\nold'}
    for name, data in old.items():
        (tmp_path / name).write_bytes(data)
    result = race.report.Result(
        'indi', 'circle', 'known', 'true', 1, 1.0, 0.1, 0.1, 0.1, 0.1, 0.0, 1.0)

    def fail(path, *_):
        path.write_text('half')
        raise ZeroDivisionError
    monkeypatch.setattr(race.report, 'draw', fail)
    with pytest.raises(ZeroDivisionError):
        race._write(tmp_path, [result], {'indi': ('', 1.0)})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == old


def test_a_race_adds_to_a_page(tmp_path, monkeypatch):
    rows = iter((0.01, 0.02, 0.03))
    monkeypatch.setattr('mambo_flight.sweep.run.fly', lambda flights, ideal: [
        {**ROW, 'tracking_rms': next(rows)} for _ in flights])
    monkeypatch.setattr(race, 'step_time', lambda flight: 0.5)
    arguments = ['-o', str(tmp_path), '--courses', 'circle', '--conditions', 'twenty_percent',
                 '--draws', '1', '--workers', '1']
    for more in (['--controllers', 'indi', '--state', 'true'],
                 ['--controllers', 'geometric', '--state', 'aided', '--add'],
                 ['--controllers', 'indi', '--state', 'true', '--add']):
        assert race.main([*arguments, *more]) == 0
    page = json.loads((tmp_path / 'controllers.json').read_text())
    assert [(r['entrant'], r['state'], r['rms']) for r in page['results']] == [
        ('indi', 'true', 0.03), ('geometric', 'aided', 0.02)]
    assert list(page['steps_us']) == ['indi', 'geometric']
    (tmp_path / 'controllers.json').write_text('{"draws": 4}')
    assert race.main([*arguments, '--controllers', 'indi', '--add']) == 2
