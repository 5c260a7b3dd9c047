"""Limits of what a file may take: their variables, bounds and messages."""

import os
from pathlib import Path

from mambo_model.limits import check_regular, Limit, raised_by, RATIO, unpacked, UNPACKED_MB
from mambo_model.schema import ParameterError
import pytest

LIMIT = Limit('MAMBO_TEST_LIMIT', 7, 100)


def test_without_the_variable_it_is_the_default(monkeypatch):
    monkeypatch.delenv('MAMBO_TEST_LIMIT', raising=False)
    assert LIMIT.value() == 7
    monkeypatch.setenv('MAMBO_TEST_LIMIT', '')
    assert LIMIT.value() == 7


@pytest.mark.parametrize('text', ['1', '8', '100', '007'])
def test_the_variable_sets_another(monkeypatch, text):
    monkeypatch.setenv('MAMBO_TEST_LIMIT', text)
    assert LIMIT.value() == int(text)
    assert raised_by(LIMIT) == f'MAMBO_TEST_LIMIT (now {int(text)}) raises the limit'


@pytest.mark.parametrize(
    'text', ['0', '101', '-3', '1.5', '1e3', 'many', '\u0665' * 3, '9' * 5000])
def test_what_is_no_whole_number_in_its_range_is_one_short_line(monkeypatch, text):
    monkeypatch.setenv('MAMBO_TEST_LIMIT', text)
    with pytest.raises(ParameterError, match='must be a whole number from 1 to 100$') as caught:
        LIMIT.value()
    assert str(caught.value).startswith('MAMBO_TEST_LIMIT=') and len(str(caught.value)) < 150


def test_a_file_unpacks_to_the_limit_or_twenty_times_its_size(monkeypatch):
    monkeypatch.setenv(UNPACKED_MB.name, '3')
    assert unpacked(10) == 3_000_000
    assert unpacked(150_000) == 3_000_000
    assert unpacked(150_001) == RATIO * 150_001


@pytest.mark.parametrize('name', ['/dev/zero', '/proc/kmsg', '/proc/self/mem', 'pipe'])
def test_what_reading_may_wait_for_is_refused(tmp_path, name):
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(ParameterError, match=f'{name}: not a regular file; copy its content'):
        check_regular(tmp_path / name)


@pytest.mark.parametrize('name', ['full', 'empty', 'link', '', 'none', 'zero\0'])
def test_files_folders_and_what_is_not_there_pass(tmp_path, name):
    (tmp_path / 'full').write_text('content')
    (tmp_path / 'empty').touch()
    (tmp_path / 'link').symlink_to('full')
    check_regular(tmp_path / Path(name))
