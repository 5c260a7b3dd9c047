"""A command line names what it cannot write before any work, and leaves the disk as it was."""

import os

from mambo_bags.cli.option_types import whole
from mambo_bags.command import Parser
import pytest


@pytest.fixture
def line():
    """Return a command line with every kind of output."""
    out = Parser('tool', 'Makes files.')
    out.add_argument('number', type=whole(0, 9))
    out.add_output('BAG', 'bag to create')
    out.add_argument('--html')
    out.add_argument('--csv')
    out.add_argument('--figure')
    out.add_json()
    return out


OPTIONS = ('output', 'html', 'csv', 'figure', 'json')


@pytest.mark.parametrize('option', OPTIONS)
@pytest.mark.parametrize('name, reason', [
    ('/proc/none/new', 'No such file or directory'),
    ('{folder}/file/new', 'Not a directory'),
    ('{folder}/' + 'x' * 300, 'File name too long')])
def test_what_cannot_be_written_is_one_line(line, option, name, reason, tmp_path, capsys):
    (tmp_path / 'file').touch()
    target = name.format(folder=tmp_path)
    with pytest.raises(SystemExit) as end:
        line.parse_args(['1', f'--{option}', target])
    error = capsys.readouterr().err
    assert end.value.code == 2
    assert error == f'tool: --{option}: {target}: cannot be written ({reason})\n'


@pytest.mark.parametrize('option', OPTIONS)
def test_what_can_be_written_is_not_made_yet(line, option, tmp_path):
    target = str(tmp_path / 'a/b/new')
    assert str(getattr(line.parse_args(['1', f'--{option}', target]), option)) == target
    assert os.listdir(tmp_path) == []


def test_a_device_and_the_screen_are_outputs(line):
    assert line.parse_args(['1', '--json', '/dev/null']).json == '/dev/null'
    assert line.parse_args(['1', '--json', '-']).json == '-'
    assert line.parse_args(['1', '--json']).json == '-'


def test_a_full_disk_is_exit_code_1(line, tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(os, 'open', full)
    with pytest.raises(SystemExit) as end:
        line.parse_args(['1', '--json', str(tmp_path / 'new')])
    assert end.value.code == 1 and 'No space left on device' in capsys.readouterr().err


@pytest.mark.parametrize('option, kind', [
    ('html', 'page'), ('csv', 'CSV file of a comparison'), ('figure', 'PNG picture'),
    ('json', 'JSON file')])
def test_a_file_of_another_kind_is_kept(line, option, kind, tmp_path, capsys):
    for name in ('take.csv', 'vehicle.yaml', 'pf', f'own.{option}'):
        file = tmp_path / name
        file.write_text('t,x,y\n')
        with pytest.raises(SystemExit) as end:
            line.parse_args(['1', f'--{option}', str(file)])
        error = capsys.readouterr().err
        assert end.value.code == 2 and error.count('\n') == 1 and f'{file} exists and is' in error
        assert option == 'json' or f'not a {kind}: choose another name' in error


@pytest.mark.parametrize('option', OPTIONS)
def test_nothing_is_named_as_if_it_were_of_the_bag_in_its_folder(line, option, tmp_path, capsys):
    (tmp_path / 'metadata.yaml').touch()
    with pytest.raises(SystemExit) as end:
        line.parse_args(['1', f'--{option}', str(tmp_path / 'new_0.mcap')])
    assert end.value.code == 2 and 'new_0.mcap is part of a bag' in capsys.readouterr().err
    assert line.parse_args(['1', '--output', str(tmp_path / 'bags/new.mcap')])
    assert line.parse_args(['1', '--html', str(tmp_path / 'index.html')])
