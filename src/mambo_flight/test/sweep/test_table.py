"""The journal of a sweep and its table: nothing finished is lost, nothing foreign is taken."""

import resource
import signal
from types import SimpleNamespace

from hypothesis import given, settings, strategies as st
from mambo_flight.sweep import table
from mambo_flight.sweep.table import batches, columns, Journal, parameters, SweepError, write
from mambo_model.errors import JobError
import numpy as np
import pyarrow.parquet as parquet
import pytest


def swept(*rows, names=('mass', 'wind'), defaults=(0.068, 'none')):
    """Return a sweep of two axes, one of them a number."""
    axes = [SimpleNamespace(name=name, field=SimpleNamespace(default=default))
            for name, default in zip(names, defaults)]
    return SimpleNamespace(axes=axes, rows=list(rows))


def test_a_vector_is_a_column_for_each_element_and_a_number_is_a_float():
    sweep = swept((1, (0.5, -1.0, 0.0)))
    found = parameters(sweep, 0)
    assert found == {'mass': 1.0, 'wind.0': 0.5, 'wind.1': -1.0, 'wind.2': 0.0}
    assert type(found['mass']) is float
    counted = parameters(swept((3, 'calm'), defaults=(7, 'none')), 0)
    assert counted == {'mass': 3, 'wind': 'calm'} and type(counted['mass']) is int


def test_the_table_has_a_row_for_each_flight_in_the_order_of_the_sweep():
    sweep = swept((0.06, 'calm'), (0.07, 'gust'))
    found = columns(sweep, {1: {'rms': 0.2}, 0: {'rms': 0.1}})  # finished in any order
    assert found == {'flight': [0, 1], 'mass': [0.06, 0.07], 'wind': ['calm', 'gust'],
                     'rms': [0.1, 0.2]}
    assert list(found) == ['flight', 'mass', 'wind', 'rms']
    with pytest.raises(KeyError):
        columns(sweep, {0: {'rms': 0.1}})


def rows_of(path, head='a'):
    journal = Journal(path, head)
    journal.close()
    return journal.rows


def test_rows_come_back_to_the_bit(tmp_path):
    value = 0.1 + 0.2
    journal = Journal(tmp_path / 'new' / 'folder' / 'rows', 'a')
    journal.add(3, {'rms': value, 'worst': float('nan'), 'why': 'tilt'})
    journal.add(0, {'rms': -0.0, 'worst': 1.0, 'why': ''})
    journal.close()
    found = rows_of(journal.path)
    assert sorted(found) == [0, 3] and found[3]['rms'] == value
    assert np.isnan(found[3]['worst']) and found[3]['why'] == 'tilt'
    assert np.signbit(found[0]['rms'])


@pytest.mark.parametrize('cut', [1, 5, 17])
def test_a_line_that_was_cut_off_is_flown_again_and_written_over(tmp_path, cut):
    journal = Journal(tmp_path / 'rows', 'a')
    for number in range(3):
        journal.add(number, {'rms': 0.125 * number})
    journal.close()
    content = journal.path.read_bytes()
    journal.path.write_bytes(content[:-cut])
    again = Journal(journal.path, 'a')
    assert sorted(again.rows) == [0, 1]
    again.add(2, {'rms': 0.25})
    again.close()
    assert journal.path.read_bytes() == content


def test_damage_in_the_middle_loses_what_is_behind_it_and_no_more(tmp_path):
    journal = Journal(tmp_path / 'rows', 'a')
    for number in range(4):
        journal.add(number, {'rms': 1.0})
    journal.close()
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b''.join([*lines[:2], b'[1, 2]\n', *lines[3:]]))
    assert sorted(rows_of(journal.path)) == [0]
    assert rows_of(journal.path).keys() == {0}


def test_the_rows_of_another_sweep_are_refused_and_stay(tmp_path):
    journal = Journal(tmp_path / 'rows', 'a')
    journal.add(0, {'rms': 1.0})
    journal.close()
    before = journal.path.read_bytes()
    with pytest.raises(SweepError, match='rows: not begun by this sweep file and this version'):
        Journal(journal.path, 'b')
    assert journal.path.read_bytes() == before


def test_a_journal_without_a_row_leaves_no_file(tmp_path):
    Journal(tmp_path / 'rows', 'a').leave()
    assert not list(tmp_path.iterdir())
    journal = Journal(tmp_path / 'rows', 'a')
    journal.add(0, {'rms': 1.0})
    journal.leave()
    assert rows_of(journal.path) == {0: {'rms': 1.0}}


def test_a_journal_that_is_being_written_is_refused_until_it_is_closed(tmp_path):
    journal = Journal(tmp_path / 'rows', 'a')
    journal.add(0, {'rms': 1.0})
    before = journal.path.read_bytes()
    for head in 'ab':
        with pytest.raises(SweepError, match='rows: is written by another process now: let it'):
            Journal(journal.path, head)
    assert journal.path.read_bytes() == before
    journal.close()
    assert rows_of(journal.path) == {0: {'rms': 1.0}}


def test_a_journal_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(SweepError, match='file'):
        Journal(tmp_path / 'file' / 'rows', 'a')


def test_a_row_that_cannot_be_written_is_one_line_with_the_file(tmp_path):
    journal = Journal(tmp_path / 'a.rows', 'head')
    journal.add(0, {'x': 1.0})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60, before[1]))
        with pytest.raises(JobError, match=r'a\.rows: cannot be written \(File too large\); '
                                           'finished flights are kept'):
            for number in range(1, 9):
                journal.add(number, {'x': 1.0})
        journal.leave()  # as the command does; nothing of it is written once more
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, old)
    assert Journal(tmp_path / 'a.rows', 'head').rows[0] == {'x': 1.0}


def test_a_journal_is_removed_when_the_result_has_everything(tmp_path):
    journal = Journal(tmp_path / 'rows', 'a')
    journal.add(0, {'rms': 1.0})
    journal.remove()
    assert not list(tmp_path.iterdir())


def flights(rows=((0.06, 'calm'),), names=('mass', 'wind')):
    return SimpleNamespace(sweep=swept(*rows, names=names), bases={})


def test_the_digest_depends_on_values_names_sensors_and_numerics(monkeypatch):
    first = table.digest(flights(), False)
    assert first == table.digest(flights(), False)
    others = {table.digest(flights(), True), table.digest(flights(((0.07, 'calm'),)), False),
              table.digest(flights(names=('mass', 'gust')), False),
              table.digest(flights(((0.06, 'calm'), (0.06, 'calm'))), False)}
    monkeypatch.setattr(table, 'source_digest', lambda: 'another version')
    others.add(table.digest(flights(), False))
    assert len(others | {first}) == 6


def test_a_file_has_columns_of_their_type_and_its_title(tmp_path):
    write(tmp_path / 'a.parquet', {'flight': [0, 1], 'rms': [0.5, float('nan')],
                                   'why': ['', 'tilt']}, 'Short flights')
    found = parquet.read_table(tmp_path / 'a.parquet')
    assert found.schema.metadata == {b'title': b'Short flights'}
    assert [str(field.type) for field in found.schema] == ['int64', 'double', 'string']
    assert found['why'].to_pylist() == ['', 'tilt'] and np.isnan(found['rms'][1].as_py())


def test_batches_hold_every_number_once():
    assert list(batches(range(7), 3)) == [range(0, 3), range(3, 6), range(6, 7)]
    assert list(batches([], 3)) == []
    assert list(batches([5, 2], 10)) == [[5, 2]]


VALUES = st.one_of(st.floats(), st.booleans(), st.integers(-10**9, 10**9), st.text(max_size=20))
ROWS = st.dictionaries(st.integers(0, 50), st.dictionaries(
    st.sampled_from(['rms', 'why', 'shutdown', 'energy']), VALUES), min_size=1, max_size=6)


@given(rows=ROWS, data=st.data())
@settings(max_examples=40, deadline=None)
def test_a_journal_cut_anywhere_keeps_the_whole_lines_before(rows, data, tmp_path_factory):
    path = tmp_path_factory.mktemp('journal') / 'rows'
    journal = Journal(path, 'a')
    for number, row in rows.items():
        journal.add(number, dict(row))
    journal.close()
    content = path.read_bytes()
    head = content.index(b'\n') + 1
    cut = data.draw(st.integers(head, len(content)))
    path.write_bytes(content[:cut])
    kept = list(rows)[:content[:cut].count(b'\n') - 1]
    found = rows_of(path)
    assert list(found) == kept
    for number in kept:  # NaN is not equal to itself; its text is
        assert repr(found[number]) == repr(rows[number])
    assert path.read_bytes() == content[:content[:cut].rindex(b'\n') + 1]


@given(numbers=st.lists(st.integers(), max_size=30), size=st.integers(1, 12))
def test_batches_are_the_numbers_in_order_and_full_but_the_last(numbers, size):
    found = [list(batch) for batch in batches(numbers, size)]
    assert [number for batch in found for number in batch] == numbers
    assert all(len(batch) == size for batch in found[:-1])
    assert all(1 <= len(batch) <= size for batch in found)
