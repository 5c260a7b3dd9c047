"""What is written is whole or not there, whatever the disk does."""

import os

from mambo_model import whole_file
from mambo_model.errors import InputError, JobError
import pytest


def test_a_file_and_its_folders_are_made(tmp_path):
    file = tmp_path / 'a' / 'b.txt'
    assert whole_file.write_text(file, 'é') == file and file.read_text(encoding='utf-8') == 'é'
    assert os.listdir(file.parent) == ['b.txt']


def test_what_the_disk_does_not_take_leaves_the_old_file_and_nothing_else(tmp_path, small_disk):
    small_disk(4096)
    for name, left in (('old', ['old']), ('new', ['old'])):
        (tmp_path / 'old').write_text('as it was')
        with pytest.raises(JobError, match=f'{name}: cannot be written .File too large'):
            whole_file.write_text(tmp_path / name, 'x' * 100_000)
        assert os.listdir(tmp_path) == left and (tmp_path / 'old').read_text() == 'as it was'


def test_a_link_that_leads_nowhere_exists_and_too_long_a_name_is_an_error(tmp_path):
    link = tmp_path / 'link'
    assert not whole_file.exists(link)
    link.symlink_to(tmp_path / 'nothing')
    assert whole_file.exists(link) and not whole_file.exists(tmp_path / 'nothing')
    with pytest.raises(OSError):
        whole_file.exists(tmp_path / ('n' * 300))


def test_a_link_is_followed_and_a_device_is_written_to(tmp_path):
    (tmp_path / 'file').write_text('old')
    (tmp_path / 'link').symlink_to('file')
    whole_file.write_text(tmp_path / 'link', 'new')
    assert (tmp_path / 'link').is_symlink() and (tmp_path / 'file').read_text() == 'new'
    ends = os.openpty()  # a device that nobody misses, should the code replace it
    terminal = whole_file.Path(os.ttyname(ends[1]))
    whole_file.write_text(terminal, 'x')
    assert os.read(ends[0], 1) == b'x' and terminal.is_char_device()
    for end in ends:
        os.close(end)


def test_what_the_work_raises_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_file.replacing(tmp_path / 'a') as part:
        part.write_text(str(1 / 0))
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize('name', ['.', 'file/x', 'x' * 300, 'x' * 300 + '/y', 'loop', 'loop/x'])
def test_a_path_that_cannot_be_is_wrong_input_in_one_line(tmp_path, name):
    (tmp_path / 'file').write_text('')
    (tmp_path / 'loop').symlink_to('loop')
    with pytest.raises(InputError, match='cannot be written'):
        whole_file.write_text(tmp_path / name, 'x')
    assert sorted(os.listdir(tmp_path)) == ['file', 'loop']


def test_a_full_device_is_the_fault_of_the_disk():
    with pytest.raises(JobError, match='/dev/full: cannot be written .No space left'):
        whole_file.write_text(whole_file.Path('/dev/full'), 'x')


def test_a_name_that_is_not_utf_8_does_not_keep_a_page_from_being_written(tmp_path):
    page = whole_file.write_text(tmp_path / 'page.html', 'bag: x\udcff')
    assert page.read_text(encoding='utf-8') == r'bag: x\xff'


def test_a_path_that_can_be_written_is_left_as_it_was(tmp_path):
    (tmp_path / 'old').write_text('as it was')
    for name in ('old', 'new', 'a/b/new', '.'):
        whole_file.check_writable(tmp_path / name)
    whole_file.check_writable(whole_file.Path('/dev/null'))
    assert os.listdir(tmp_path) == ['old'] and (tmp_path / 'old').read_text() == 'as it was'


@pytest.mark.parametrize('name, reason', [
    ('/proc/none/new', 'No such file or directory'), ('old/new', 'Not a directory'),
    ('old/a/new', 'Not a directory'), ('x' * 300, 'File name too long'),
    (f'{"x" * 300}/new', 'File name too long'), ('loop', 'Too many levels of symbolic links')])
def test_a_path_that_cannot_be_written_is_one_line(name, reason, tmp_path):
    (tmp_path / 'old').write_text('as it was')
    (tmp_path / 'loop').symlink_to('loop')
    with pytest.raises(InputError, match=f'cannot be written .{reason}'):
        whole_file.check_writable(tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == ['loop', 'old']


def test_a_full_disk_is_a_failed_job(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(os, 'open', full)
    with pytest.raises(JobError, match='cannot be written .No space left'):
        whole_file.check_writable(tmp_path / 'a/new')
    assert os.listdir(tmp_path) == []


def test_an_output_must_be_new(tmp_path):
    whole_file.refuse_existing(None)
    whole_file.refuse_existing(tmp_path / 'new')
    nowhere = tmp_path / 'nowhere'
    nowhere.symlink_to('gone')
    for path in (tmp_path, nowhere):
        with pytest.raises(InputError, match='exists: give another --output or remove it$'):
            whole_file.refuse_existing(path)
    with pytest.raises(JobError, match='exists: name another or remove it$'):
        whole_file.refuse_existing(nowhere, 'name another', JobError)
    with pytest.raises(InputError, match='xx: File name too long$'):
        whole_file.refuse_existing(tmp_path / ('x' * 300))


OLD = {
    whole_file.PAGE: ('page.htm', b'\xef\xbb\xbf\n<!DOCTYPE HTML>\n'),
    whole_file.PICTURE: ('a.PNG', b'\x89PNG\r\n\x1a\n...'),
    whole_file.COMPARISON: ('a.csv', b'comparison,quantity,unit\n'),
    whole_file.JSON: ('a.json', b'{}')}


@pytest.mark.parametrize('kind', OLD)
def test_a_file_of_the_same_kind_is_replaced_and_no_other(kind, tmp_path):
    name, content = OLD[kind]
    (tmp_path / name).write_bytes(content)
    whole_file.write_text(tmp_path / name, 'new', kind)
    assert (tmp_path / name).read_text() == 'new'
    (tmp_path / 'link').symlink_to(name)
    for other in (name, 'notes.txt', 'link'):  # now it begins as none of them
        (tmp_path / 'notes.txt').write_bytes(content)
        with pytest.raises(InputError, match=f'{other} exists and is not a {kind.name}: choose'):
            whole_file.write_text(tmp_path / other, 'x', kind)
    assert (tmp_path / name).read_text() == 'new'
    assert (tmp_path / 'notes.txt').read_bytes() == content
    (tmp_path / 'empty').touch()
    for free in ('empty', 'new', '/dev/null'):
        whole_file.refuse_other_kind(tmp_path / free, kind)


def test_an_output_has_no_name_of_a_part_of_a_bag(tmp_path):
    (tmp_path / 'a_0.mcap').write_text('it')
    for name in ('a_0.mcap', 'b.mcap', 'b.db3', 'b.mcap.zstd', 'metadata.yaml'):
        with pytest.raises(InputError, match=f'{name} is .*part.* of a bag|parts of bags'):
            whole_file.write_text(tmp_path / name, 'x', whole_file.PAGE)
    assert os.listdir(tmp_path) == ['a_0.mcap'] and (tmp_path / 'a_0.mcap').read_text() == 'it'
