"""Tables come back by column; what is no table, or not clearly one, is a line that says why."""

import gzip
import re

from mambo_analysis.importers.table_file import read_table
from mambo_bags.mcap_reader import BagError
import numpy as np
import pandas
import pytest

ROWS = 't,x,y\n0.0,1.5,\n0.1,2.5,7\n'


def refused(path, content, text, wanted=('t', 'x')):
    """Check that a content is refused in one line with the path and a text."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(BagError) as caught:
        read_table(path, list(wanted), ',')
    line = str(caught.value)
    assert line.startswith(f'{path}: ') and text in line and '\n' not in line
    assert not re.search('Error|Exception', line), line


def written(path, data):
    data.to_parquet(path)
    return path


@pytest.mark.parametrize('suffix', ['.csv', '.csv.gz', '.pq', '.parquet'])
def test_wanted_columns_come_as_numbers_and_others_by_name(tmp_path, suffix):
    path = tmp_path / f'a{suffix}'
    if suffix.startswith('.csv'):
        path.write_bytes(gzip.compress(ROWS.encode()) if '.gz' in suffix else ROWS.encode())
    else:
        written(path, pandas.DataFrame({'t': [0.0, 0.1], 'x': [1.5, 2.5], ' y': [None, 7]}))
    found, others = read_table(path, ['y', 't'], ',')
    np.testing.assert_array_equal(found['t'], [0.0, 0.1])
    np.testing.assert_array_equal(found['y'], [np.nan, 7.0])
    assert list(found) == ['y', 't'] and others == ['x']


@pytest.mark.parametrize('content, text', [
    ('t,x,x\n0,1,2\n', "2 columns have the name 'x'"),
    ('t,x\n0,01,1,5\n0,02,1,6\n', 'is a comma the decimal mark'),
    ('t,x\n0,1\n0,1,5\n', 'Expected 2 fields in line 3, saw 3'),
    ('t,x\n0,"1\n', 'EOF inside string'),
    (ROWS.encode('utf-16'), 'byte 0 is no text in UTF-8'),
    (ROWS.encode('utf-16-be'), "no column 't'"),
    ('t,x\n0,1\0\n', "column x: '1\\x00' is not a number"),
    (f't,x\n0,{"9" * 400}\n', 'line 2, column x: inf is absurd'),
    ('t;x\n0;1\n', "no column 't'; the cells are separated by ';': give delimiter: ';' in the "
     "mapping; it has t;x"),
    ('t;x\n0,1;1,5\n', "give delimiter: ';' in the mapping"),
    ('t\tx\n0\t1\n', "give delimiter: '\\t' in the mapping"),
    ('t,x\n0,"1,5"\n', "'1,5' is not a number: write decimal points instead of commas"),
    ('sep=,\nt,x\n0,1\n', "remove the first line, 'sep=,', which only Excel reads"),
    ('sep=;\nt,x\n0,1\n', "remove the first line, 'sep=;', which only Excel reads"),
    ('# a log, of mine\n# x in m\nt,x\n0,1\n', "line 1 is a comment, '# a log,of mine': the "
     'first line must be the names of the columns, without a #'),
    ('{"drone": {"acc.x": [1, 2]}}\n', 'it is JSON, no table: a log of a Crazyflie client is for'),
    ('\n[[1, 2], [3, 4]]', 'it is JSON, no table'),
    ('# t,x\n0,1\n', "line 1 is a comment, '# t,x': the first line must be the names"),
    ('t,x\n\n0,1\n \n"0\n",1\n\n0.2,z\n', "line 8, column x: 'z' is not a number"),
    ('t,x\r\n\r\n0,1\r\n\r\n0.2,z\r\n', "line 5, column x: 'z' is not a number"),
    ('t,x\n\n0,9e99\n', 'line 3, column x: 9e+99 is absurd'),
    (gzip.compress(b't,x\n0,1\n'), 'is no text in UTF-8'), ('\n\n', 'No columns'),
    (','.join(map(str, range(3000))), "no column 't'; it has 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 "
     'and 2988 more')])
def test_a_csv_file_that_is_not_clearly_a_table_is_refused(tmp_path, content, text):
    refused(tmp_path / 'a.csv', content, text)


def test_where_lines_are_not_known_the_row_of_data_is_named(tmp_path):
    path = tmp_path / 'a.csv.gz'
    refused(path, gzip.compress(b't,x\n\n0,1\n\n1,z\n'), "row 2 of the data, column x: 'z' is no")
    path = written(tmp_path / 'a.parquet', pandas.DataFrame({'t': [0.0, 1.0], 'x': ['1', 'z']}))
    with pytest.raises(BagError, match="row 2 of the data, column x: 'z' is not a number"):
        read_table(path, ['t', 'x'], ',')


def test_a_damaged_parquet_file_is_refused(tmp_path):
    path = written(tmp_path / 'a.parquet', pandas.DataFrame({'t': np.arange(99.0), 'x': 1.0}))
    whole = path.read_bytes()
    refused(path, whole[:4] + bytes(60) + whole[64:], 'its content is damaged')
    refused(path, whole[:200], 'no table that can be read')
    refused(path, ROWS, 'no table that can be read')


def test_of_a_small_file_of_huge_columns_the_wanted_are_read_if_allowed(tmp_path, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '30')
    path = written(tmp_path / 'a.parquet', pandas.DataFrame(
        {'t': np.zeros(3_000_000, np.float32), 'x': np.zeros(3_000_000, np.int8)}))
    assert path.stat().st_size < 50_000
    assert len(read_table(path, ['x'], ',')[0]['x']) == 3_000_000
    with pytest.raises(BagError, match='MAMBO_MAX_UNPACKED_MB .now 30. raises the limit'):
        read_table(path, ['t', 'x'], ',')


def test_a_compressed_bomb_names_what_raises_the_limit(tmp_path, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '20')
    refused(tmp_path / 'a.csv.gz', gzip.compress(b',' * 20_000_000), 'MAMBO_MAX_UNPACKED_MB')


@pytest.mark.parametrize('unit', ['ms', 'us', 'ns'])
@pytest.mark.parametrize('kind', ['timedelta64', 'datetime64'])
def test_typed_times_are_no_numbers_of_an_unknown_unit(tmp_path, kind, unit):
    t = np.arange(9).astype(f'{kind}[{unit}]')
    path = written(tmp_path / 'a.parquet', pandas.DataFrame({'t': t, 'x': 1.0}))
    with pytest.raises(BagError, match=rf'column t holds times of the type {kind}\[..\]'):
        read_table(path, ['t', 'x'], ',')


def test_an_arrow_file_is_no_csv_file(tmp_path):
    for suffix in ('.arrow', '.feather'):
        with pytest.raises(BagError, match='Arrow files are not read: save the table as Parquet'):
            read_table(tmp_path / f'a{suffix}', ['t'], ',')
