"""Whatever goes wrong in a tool is one line: its output, the disk, the memory."""

import os
from pathlib import Path
import socket
import subprocess
import sys
from types import SimpleNamespace

from mambo_bags import command
from mambo_bags.cli.option_types import whole
from mambo_bags.command import guard
from mambo_bags.reader import BagError
from mambo_model.errors import InputError, JobError
from matplotlib.figure import Figure
import numpy as np
import pytest

TOOL = """
import errno, os, sys
from mambo_model.errors import JobError
from mambo_bags.command import guard
def work():
    {work}
code = guard('tool', work)
sys.exit(code)
"""
MANY = 'for k in range(100000): print(k)'


def run(work, shell='"$@"'):
    """Run a tool by a shell, so that its output goes where that says."""
    return subprocess.run(
        ['bash', '-c', f'set -o pipefail; {shell}', 'bash', sys.executable, '-c',
         TOOL.format(work=work)], text=True, capture_output=True, timeout=100)


@pytest.mark.parametrize('work', ["print('short')", MANY], ids=['short', 'long'])
@pytest.mark.parametrize('where, message', [
    ('> /dev/full', 'tool: the output cannot be written: No space left on device\n'),
    ('>&-', 'tool: the output is closed: redirect it to /dev/null to discard it\n'),
    ('>&- 2>&-', '')])
def test_an_output_that_takes_nothing_is_one_line(work, where, message):
    done = run(work, f'"$@" {where}')
    assert (done.returncode, done.stdout, done.stderr) == (1, '', message)


def test_a_reader_that_goes_is_no_word_worth_and_the_work_is_done(tmp_path):
    written = f"{MANY}\n    open({str(tmp_path / 'page')!r}, 'w').write('whole')"
    done = run(written, '"$@" | head -n 1')
    assert (done.returncode, done.stdout, done.stderr) == (1, '0\n', '')
    assert (tmp_path / 'page').read_text() == 'whole'
    done = run(f'{MANY}\n    raise JobError("in vain")', '"$@" | head -n 1')
    assert (done.returncode, done.stdout, done.stderr) == (1, '0\n', 'tool: in vain\n')


@pytest.mark.parametrize('error, code, message', [
    (OSError(28, 'No space left on device', '/disk/bag'), 1, '/disk/bag: No space left on device'),
    (OSError(28, 'No space left on device'), 1, 'No space left on device'),
    (OSError(24, 'Too many open files'), 1,
     'Too many open files: this shell allows too few (ulimit -n)'),
    (OSError(36, 'File name too long', 'x' * 9000), 2, 'File name too long'),
    (FileNotFoundError(2, 'No such file or directory', 'x'), 2, 'x: No such file'),
    (np.linalg.LinAlgError('SVD'), 2, 'the numbers are too extreme to compute with (SVD)'),
    (MemoryError(), 1, 'out of memory'),
    (RecursionError(), 2, 'the input is nested too deeply'),
    (RuntimeError("can't start new thread"), 1,
     'this user may have no more processes and threads (ulimit -u)'),
    (JobError('no engine'), 1, 'no engine'),
    (BagError('two\nlines'), 2, 'two lines')])
def test_errors_are_one_short_line_and_the_right_exit_code(error, code, message, capsys):
    def work():
        raise error
    assert guard('tool', work) == code
    printed = capsys.readouterr().err
    assert printed.startswith('tool: ') and message in printed
    assert printed.count('\n') == 1 and len(printed) < 2100


def test_a_null_character_is_refused(capsys):
    parser = command.Parser('tool', 'Reads.')
    parser.add_argument('file', type=Path)
    with pytest.raises(SystemExit) as end:
        parser.parse_args(['a\0b'])
    error = capsys.readouterr().err
    assert end.value.code == 2 and 'null character' in error and error.count('\n') == 1


def test_a_full_disk_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    monkeypatch.setattr(command.shutil, 'disk_usage', lambda folder: SimpleNamespace(
        free=1000 if folder == str(tmp_path) else 1 << 40))
    for number, place in ((28, f'{tmp_path}: '), (122, f'{tmp_path}: '), (5, '')):
        def work(number=number):
            raise OSError(number, 'what the system says')
        assert command.guard('tool', work) == 1
        assert capsys.readouterr().err == f'tool: {place}what the system says\n'


def test_names_cannot_steer_the_terminal(capsys):
    """A topic or a file may be called whatever clears the screen or reads from right to left."""
    name = 'a\x1b[2Jb\u202ec\udcffd\x07\u00e9'

    def work():
        print(f'{name}\tis\nhere')
        raise InputError(name)
    assert guard('tool', work) == 2
    shown = 'a\\x1b[2Jb\\u202ec\\xffd\\x07\u00e9'
    assert capsys.readouterr() == (f'{shown}\tis\nhere\n', f'tool: {shown}\n')


def test_a_name_that_is_not_utf_8_is_named_where_nothing_else_took_care_of_it(capsys):
    def work():
        'the flights:\n- fl\udcfcg\n- b\udcff\n'.encode()
    assert guard('tool', work) == 2
    assert capsys.readouterr() == ('', 'tool: - fl\\xfcg is not UTF-8: rename it\n')

    with pytest.raises(UnicodeEncodeError):  # the fault of the program, not of the name
        guard('tool', lambda: 'é'.encode('ascii'))


def test_what_the_output_has_no_characters_for_is_escaped():
    done = run(r"print('\u00e9 \udcfc'); print(1)", 'PYTHONIOENCODING=ascii:strict "$@"')
    assert (done.returncode, done.stdout, done.stderr) == (0, '\\xe9 \\xfc\n1\n', '')


@pytest.fixture
def line():
    """Return a command line with an output, a number and a choice."""
    out = command.Parser('tool', 'Makes a bag.')
    out.add_argument('source')
    out.add_output('BAG', 'to make', required=True, positional=True)
    out.add_argument('--seed', type=whole(0, 9))
    out.add_argument('--height', type=lambda text: float(text))
    out.add_argument('--mode', choices=('lockstep', 'realtime'))
    out.add_json()
    return out


@pytest.mark.parametrize('arguments', [
    ['a', 'b'], ['a', '-o', 'b'], ['a', '--output', 'b'], ['a', '--out', 'b'],
    ['a', '--seed', '1', 'b'], ['--out', 'b', 'a'], ['--seed', '1', 'a', 'b']])
def test_the_output_is_an_option_or_the_last_argument(line, arguments):
    options = line.parse_args(arguments)
    assert (options.source, options.output) == ('a', Path('b'))


@pytest.mark.parametrize('text', ['-1', '-0.5', '-.5', '-1e-3', '-2.5E+7', '-inf', '-7.'])
def test_a_negative_number_is_a_value_and_not_an_option(line, text):
    assert line.parse_args(['a', 'b', '--height', text]).height == float(text)


def test_help_has_one_name_for_the_output(line):
    assert '--output BAG' in line.format_help() and '--out ' not in line.format_help()


@pytest.mark.parametrize('arguments, message', [
    (['a'], '--output is missing'), (['a', 'b', '-o', 'c'], '--output is given already'),
    (['a', 'b', '--seed', '1', '--sede', '1'], '--sede: unknown option; did you mean --seed?'),
    (['a', 'b', 'c'], 'c: unknown argument'), (['a', 'b', '--seed', 'x'], "'x' is not a whole"),
    (['a', 'b', '--height', 'x'], "--height: 'x' is not a number"),
    (['a', '-o', '-'], '--output: - is not the name of a file'),
    (['a', 'b', '--mode', 'realtme'], 'did you mean realtime?'), ([], 'source')])
def test_wrong_use_is_one_line_with_a_suggestion_and_exit_code_2(line, arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        line.parse_args(arguments)
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.startswith('tool: ') and error.count('\n') == 1
    assert message in error and '_' not in error and 'lambda' not in error


def test_the_words_of_the_user_name_a_command(monkeypatch, capsys):
    monkeypatch.setattr(command, '_program', None)
    command.set_program('mambo tool')

    def work():
        raise BagError('nothing in it')
    assert guard('tool', work) == 2
    assert capsys.readouterr().err == 'mambo tool: nothing in it\n'
    assert command.Parser('tool', '').prog == 'mambo tool'


def test_json_is_printed_or_written_but_never_over_another_file(line, tmp_path, capsys):
    assert line.parse_args(['a', 'b', '--json']).json == '-'
    command.write_json('-', '{}')
    assert capsys.readouterr().out == '{}\n'
    file = tmp_path / 'new' / 'a.json'
    command.write_json(str(file), '{}')
    assert line.parse_args(['a', 'b', '--json', str(file)]).json == str(file)
    bag = tmp_path / 'a.mcap'
    bag.touch()
    with pytest.raises(SystemExit):
        line.parse_args(['--json', str(bag), 'a', 'b'])
    assert 'is not a .json file' in capsys.readouterr().err


@pytest.mark.parametrize('words, message', [
    ('{a} --csv {a}', '--csv: {a} is an input: give another'),
    ('{a} --csv {link}', '--csv: {link} is an input: give another'),
    ('{a} --csv {bag}', '--csv: {bag} is part of a bag, which is never written over'),
    ('{a} --csv {new} --out {new}', '--csv: {new} is also that of --output: give another')])
def test_a_file_that_is_read_is_never_written_over(words, message, tmp_path, capsys):
    parser = command.Parser('tool', '')
    parser.add_argument('files', nargs='*')
    parser.add_argument('--csv', type=Path)
    parser.add_output('FILE', '')
    places = {name: tmp_path / name for name in ('a', 'link', 'new')}
    places['bag'] = tmp_path / 'b_0.mcap'
    places['a'].touch()
    places['bag'].touch()
    places['link'].symlink_to('a')
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(words.format(**places).split())
    assert ended.value.code == 2 and message.format(**places) in capsys.readouterr().err
    parser.parse_args(['/dev/null', '--csv', '/dev/null', '--out', str(tmp_path)])


@pytest.mark.parametrize('words', [
    ['a', '--output', ''], ['a', 'b', '--json', ''], ['a', 'b', '--csv', ''], ['a', '']])
def test_an_empty_name_is_refused(line, words, capsys):
    line.add_argument('--csv', type=Path)
    with pytest.raises(SystemExit) as ended:
        line.parse_args(words)
    err = capsys.readouterr().err
    assert ended.value.code == 2 and "'' is not the name of a file" in err
    assert words[-2] in err or words == ['a', '']


def test_an_option_without_effect_is_refused(line):
    options = line.parse_args(['a', 'b', '--seed', '3'])
    command.refuse_unused(line, options, ('height', 'mode'), 'nothing flies')
    with pytest.raises(InputError, match='^--seed: has no effect, as nothing flies: leave it out'):
        command.refuse_unused(line, options, ('height', 'seed'), 'nothing flies')


def test_an_error_of_ours_is_not_hidden():
    with pytest.raises(KeyError):
        guard('tool', lambda: {}['x'])


@pytest.mark.skipif(not os.access('/dev/full', os.W_OK), reason='no /dev/full')
def test_a_disk_that_is_full_is_named(tmp_path, capsys, monkeypatch):
    from mambo_bags import writer
    opened = writer.BagWriter._open

    def full(self):
        opened(self).close()
        return open('/dev/full', 'wb')
    monkeypatch.setattr(writer.BagWriter, '_open', full)

    def work():
        with writer.BagWriter(tmp_path / 'bag', {'a.txt': bytes(100_000)}) as bag:
            bag.close()
    assert guard('tool', work) == 1
    printed = capsys.readouterr().err
    assert 'bag_0.mcap: No space left on device' in printed and printed.count('\n') == 1


@pytest.mark.parametrize('where, code, message', [
    ('> /dev/full', 1, 'tool: the output cannot be written: No space left on device\n'),
    ('>&-', 1, 'tool: the output is closed: redirect it to /dev/null to discard it\n'),
    ('> /dev/null', 0, '')])
def test_a_help_that_nobody_takes_is_one_line(where, code, message):
    done = run("command.Parser('tool', 'Makes a bag.').parse_args(['--help'])".replace(
        'command.', 'from mambo_bags import command; command.', 1), f'"$@" {where}')
    assert (done.returncode, done.stdout, done.stderr) == (code, '', message)


def test_a_value_that_ends_the_options_is_none(line, capsys):
    with pytest.raises(SystemExit) as end:
        line.parse_args(['a', '--output=--'])
    assert end.value.code == 2 and "'--' is not a value" in capsys.readouterr().err


@pytest.mark.parametrize('name', ['x' * 5000, 'a\0b'])
def test_a_name_that_no_file_can_have_is_refused(line, name, capsys):
    with pytest.raises(SystemExit) as end:
        line.parse_args(['a', '-o', 'b', '--json', name])
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.count('\n') == 1 and len(error) < 2200
    assert '--json: ' in error and ('File name too long' in error or 'no file can have' in error)


def test_numbers_that_overflow_do_not_fill_the_screen(capsys, recwarn):
    assert guard('tool', lambda: print(np.square(np.array([1e308])))) == 0
    assert capsys.readouterr() == ('[inf]\n', '') and not recwarn.list


def test_a_sign_that_the_font_lacks_is_no_word_on_the_screen(tmp_path, recwarn):
    def work():
        figure = Figure()
        figure.suptitle('\N{HELICOPTER}')
        figure.savefig(tmp_path / 'sheet.png')
    assert guard('tool', work) == 0
    assert [str(warning.message) for warning in recwarn] == []


def test_a_folder_or_a_pipe_is_no_file_to_write_and_a_file_no_folder(tmp_path, capsys):
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'file').touch()
    os.mkfifo(tmp_path / 'pipe')
    parser = command.Parser('tool', 'Writes.')
    parser.add_output('DIR', 'to write into')
    parser.add_json()
    parser.add_argument('--html', type=Path)
    for option, name, text in (
            ('--json', 'folder', 'is a folder: give the name of a file'),
            ('--html', 'folder', 'is a folder: give the name of a file'),
            ('--html', 'pipe', 'is a pipe or socket: give the name of a file'),
            ('-o', 'pipe', 'is not a folder: give another'),
            ('-o', 'file', 'is not a folder: give another'), ('-o', '/dev/null', 'is not a fol')):
        with pytest.raises(SystemExit) as end:
            parser.parse_args([option, str(tmp_path / name)])
        error = capsys.readouterr().err
        assert end.value.code == 2 and text in error and error.count('\n') == 1
    given = ['-o', str(tmp_path / 'folder'), '--html', '/dev/null']
    assert parser.parse_args(given).html == Path('/dev/null')


@pytest.mark.parametrize('option', ['--html', '--json', '--csv', '-o'])
def test_a_pipe_without_a_name_is_no_file_to_write(option, capsys):
    """As /dev/stdout is one behind which another program reads."""
    parser = command.Parser('tool', 'Writes.')
    parser.add_output('FILE', 'to write')
    parser.add_json()
    parser.add_argument('--html', type=Path)
    parser.add_argument('--csv', type=Path)
    read, write = os.pipe()
    one, other = socket.socketpair()
    try:
        for number in (write, one.fileno()):
            with pytest.raises(SystemExit) as end:
                parser.parse_args([option, f'/dev/fd/{number}'])
            assert end.value.code == 2
            assert (f'/dev/fd/{number} is a pipe or socket: give the name of a file'
                    in capsys.readouterr().err)
    finally:
        os.close(read)
        os.close(write)
        one.close()
        other.close()
