"""The command mambo: every verb is there, typing errors get a suggestion, options complete."""

import argparse
from importlib import import_module
import os
from pathlib import Path
import resource
import shutil
import subprocess
import sys
import time

from mambo_bags import command
from mambo_bringup import mambo
import pytest

ROOT = Path(__file__).parents[3]
MODULES = {name: entry.module for name, entry in mambo.COMMANDS.items()
           if not mambo.is_script(entry)}


@pytest.fixture(autouse=True)
def own_name(monkeypatch):
    monkeypatch.setattr(command, '_program', None)


@pytest.mark.parametrize('name', MODULES)
def test_every_command_has_a_parser_and_a_help(name, capsys):
    module = import_module(MODULES[name])
    assert isinstance(module.parser(), command.Parser)
    with pytest.raises(SystemExit) as end:
        mambo.main([*name.split(), '--help'])
    assert not end.value.code
    assert capsys.readouterr().out.startswith(f'usage: mambo {name} ')


@pytest.mark.parametrize('name', MODULES)
def test_an_unknown_option_is_one_line_with_the_words_of_the_user(name, capsys):
    with pytest.raises(SystemExit) as end:
        mambo.main([*name.split(), '--no-such-option'])
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.count('\n') == 1 and error.startswith(f'mambo {name}: ')


HOSTILE = ('nan', '-nan', 'inf', '-inf', '1e400', '-1e400', '9' * 5000, '', 'x', '-1e300')
TEXTS = {'--flow-lag', '--mocap-offset'}  # numbers or words, bounded by functions of their own


@pytest.mark.parametrize('name', MODULES)
def test_every_number_of_a_command_line_has_limits(name):
    parser = import_module(MODULES[name]).parser()
    for action in parser._actions:
        assert action.type not in (int, float, complex), action.option_strings
        if action.type in (None, Path) or 'option_types' not in getattr(
                action.type, '__module__', '') and not TEXTS & set(action.option_strings):
            continue
        for text in HOSTILE:
            with pytest.raises(argparse.ArgumentError):
                print(parser._get_value(action, text))


@pytest.mark.parametrize('name', MODULES)
@pytest.mark.parametrize('place', ['{file}/new', '/proc/none/new'])
def test_what_cannot_be_written_is_one_line_before_any_work(name, place, tmp_path, capsys):
    """Every option that names a file to write, of every command."""
    (tmp_path / 'file').touch()
    target = place.format(file=tmp_path / 'file')
    parser = import_module(MODULES[name]).parser()
    for action in parser._actions:
        if action.dest in command._WRITTEN and action.option_strings[0] != '--out':
            with pytest.raises(SystemExit) as end:
                parser._refuse_unwritable({action.dest: target})
            error = capsys.readouterr().err
            assert end.value.code == 2 and error.count('\n') == 1
            assert f'--{action.dest}: {target}: cannot be written (' in error


def test_a_file_that_cannot_be_written_is_noticed_before_anything_is_flown(tmp_path, capsys):
    for line in ('bound circle --seeds 10000 --json', 'consistency --json',
                 'race -o', 'sweep none.yaml -o', 'fly circle -o',
                 'trajectory plan none.yaml -o'):
        began = time.monotonic()
        with pytest.raises(SystemExit) as end:
            mambo.main([*line.split(), '/proc/none/new.json'])
        assert end.value.code == 2 and 'cannot be written' in capsys.readouterr().err, line
        assert time.monotonic() - began < 5.0


@pytest.mark.parametrize('line', [
    'fly x.yaml -o new', 'fly --vehicle x.yaml -o new', 'fly --trajectory x.csv -o new',
    'fly --controller x.py -o new', 'fly --again x.mcap -o new', 'sweep x.yaml -o new.parquet',
    'urdf --vehicle x.yaml', 'trajectory check x.csv', 'trajectory check x.yaml',
    'identify thrust x.csv', 'identify inertia x.mat', 'identify sensors x.mcap',
    'import table x.csv new --map px4', 'import bag x.db3 new', 'import minidrone x.mat new',
    'import motive x.csv new', 'import crazyflie x.json new', 'estimate x.mcap', 'compare x.mcap',
    'recover x.mcap new', 'digest x.mcap', 'view x.mcap', 'drift --write x.md'])
def test_a_pipe_or_a_device_is_not_read(line, tmp_path, monkeypatch, capsys):
    """Some never end; this one does, so that the test does without the check."""
    monkeypatch.chdir(tmp_path)
    [name] = (word for word in line.split() if word.startswith('x.'))
    Path(name).symlink_to('/dev/null')
    assert mambo.main(line.split()) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and f'{name}: not a regular file; copy its content' in error


def test_every_script_is_there():
    scripts = [entry.module for entry in mambo.COMMANDS.values() if mambo.is_script(entry)]
    assert scripts and all((ROOT / script).is_file() for script in scripts)


@pytest.mark.parametrize('words', [['--help'], ['help'], ['-h']])
def test_the_help_lists_every_command_with_one_line(words, capsys):
    assert mambo.main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, entry in mambo.COMMANDS.items():
        assert [line for line in lines if line.startswith(f'  {name} ')
                and line.endswith(entry.summary)], name
    assert max(map(len, lines)) < 100


def test_help_of_one_command_and_of_a_family(capsys):
    with pytest.raises(SystemExit):
        mambo.main(['help', 'recover'])
    assert capsys.readouterr().out.startswith('usage: mambo recover ')
    assert mambo.main(['identify', '--help']) == 0
    text = capsys.readouterr().out
    assert 'identify thrust' in text and 'recover' not in text


@pytest.mark.parametrize('words, message', [
    (['comapre'], 'did you mean compare?'),
    (['identify', 'trust'], 'did you mean identify thrust?'),
    (['import'], 'say which of import bag'), (['xyzzy'], 'mambo --help lists them'),
    ([], '')])
def test_a_typing_error_is_one_line_and_exit_code_2(words, message, capsys):
    assert mambo.main(words) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == bool(words)


def test_a_table_is_imported_without_a_word_for_its_kind():
    words = ['import', 'flight.csv', 'BAG', '--map', 'nanobench']
    assert mambo.find(words) == ('import table', words[1:])


@pytest.mark.long
@pytest.mark.parametrize('line, wanted', [
    ('mambo rec', {'recover', 'recordings'}), ('mambo identify th', {'thrust '}),
    ('mambo compare --ht', {'--html '}), ('mambo run --estimator k', {'kalman '})])
def test_commands_options_and_choices_complete(line, wanted, tmp_path):
    out = tmp_path / 'out'
    environment = {
        **os.environ, '_ARGCOMPLETE': '1', '_ARGCOMPLETE_SHELL': 'bash', 'COMP_LINE': line,
        'COMP_POINT': str(len(line)), '_ARGCOMPLETE_COMP_WORDBREAKS': ' ',
        '_ARGCOMPLETE_STDOUT_FILENAME': str(out), '_ARGCOMPLETE_IFS': '\n'}
    subprocess.run([sys.executable, '-m', 'mambo_bringup.mambo'], env=environment, timeout=100)
    assert set(out.read_text().split('\n')) == wanted


SHORT = 'title: short\ntrajectory: circle\nduration: 4\n'
SWEEP = 'title: t\nscenario: short.yaml\nvary: {seed: [1, 2]}\n'


@pytest.mark.slow
@pytest.mark.parametrize('line, size', [
    pytest.param('fly short.yaml -o OUT', 150_000, marks=pytest.mark.long),
    ('recover BAG OUT', 150_000),
    ('estimate BAG -o OUT', 150_000),
    ('import bag BAG OUT --map /mambo/imu/data_raw:=imu/data_raw', 60_000),
    ('compare BAG --html OUT', 150_000), ('compare BAG -o OUT', 9_000),
    ('compare BAG --csv OUT', 600), ('compare BAG --json OUT', 600),
    ('identify motor BAG -o OUT', 100), ('identify sensors BAG -o OUT', 9_000),
    ('sweep sweep.yaml -o OUT --workers 1', 1_000),
    pytest.param('reproduce 3.3 -o OUT', 9_000, marks=pytest.mark.long)])
def test_a_full_disk_is_one_line_and_no_half_file(
        line, size, tmp_path, monkeypatch, capsys, small_disk):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'short.yaml').write_text(SHORT)
    (tmp_path / 'sweep.yaml').write_text(SWEEP)
    bag = ROOT / 'bags/circle_short'
    words = line.replace('BAG', str(bag)).replace(' OUT', ' {}').split(' ')
    if words[0] in ('fly', 'estimate', 'sweep', 'reproduce'):  # compiled code has its own files
        assert mambo.main([word.format('warm') for word in words]) == 0
        shutil.rmtree('warm') if os.path.isdir('warm') else os.unlink('warm')
    before = set(os.listdir())
    small_disk(size)
    assert mambo.main([word.format('out') for word in words]) == 1
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'File too large' in error
    left = [file for file in Path('out').rglob('*') if file.is_file()] + [
        Path(name) for name in set(os.listdir()) - before if os.path.isfile(name)]
    assert not [file for file in left if file.suffix == '.part']
    small_disk(resource.RLIM_INFINITY)
    if size > 50_000 and words[0] != 'compare':  # a bag: what is in it is not lost
        assert mambo.main(['recover', 'out', 'saved']) == 0
        assert mambo.main(['import', 'bag', 'out']) == 2  # nobody takes it for whole
    else:
        assert not [file for file in left if file.suffix not in ('.rows', '.json', '.yaml')]
