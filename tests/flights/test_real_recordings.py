"""
The tables of docs/evidence/real_recordings.md are measured again on the recordings.

Every number is compared. The same samples go through the same deterministic code, so a number may
differ by its last printed digit, and by what another version of scipy or another order of
summation makes of an iterative fit or of a filter whose gates decide: 2 %.
"""

from pathlib import Path
import re

from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mambo_thesis.recordings import validate
import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / 'shared/data'
recorded = pytest.mark.skipif(
    not DATA.is_dir(), reason='real recordings are not beside the checkout')
NUMBER = re.compile(r'-?\d+\.?\d*(?:e-?\d+)?')


def documented():
    """Return {title: rows of cells} of the tables in the document."""
    out, title = {}, ''
    page = ROOT / 'docs/evidence/real_recordings.md'
    for line in page.read_text(encoding='utf-8').splitlines():
        if line.startswith('### '):
            title = line[4:]
        elif line.startswith('| ') and not line.startswith('| ---'):
            out.setdefault(title, []).append([cell.strip() for cell in line[1:-1].split('|')])
    return out


def assert_agrees(cell, wanted, where):
    """Compare text as it is, and numbers within their last digit and 2 %."""
    assert NUMBER.sub('#', cell) == NUMBER.sub('#', wanted), where
    for got, number in zip(NUMBER.findall(cell), NUMBER.findall(wanted), strict=True):
        digits = len(number.partition('.')[2])
        assert float(got) == pytest.approx(
            float(number), rel=0.02, abs=1.01 * 10.0 ** -digits), where


def test_poses_that_the_import_left_out_are_a_table(tmp_path):
    bags = {}
    for name, count in (('whole', 0), ('flipped', 12)):
        bags[name] = tmp_path / name
        with BagWriter(bags[name], metadata={
                'import': {'mocap_poses_impossible': str(count)}}) as bag:
            bag.add_topic('/mambo/imu/data_raw', 'sensor_msgs/msg/Imu')
            bag.write('/mambo/imu/data_raw', bytes(8), 0)
    table, = validate.rejected_poses(bags)
    assert table.rows == [('flipped', 12.0)] and 'impossible poses rejected' in table.title
    assert validate.rejected_poses({'whole': bags['whole']}) == []


@pytest.mark.long
@recorded
@pytest.mark.parametrize('section', validate.SECTIONS)
def test_a_section_of_the_document_is_measured_again(section):
    tables = documented()
    for table in validate.validate(DATA, [section]):
        rows = tables[table.title]
        cells = table.cells()
        assert len(rows) == len(cells), table.title
        for row, wanted in zip(cells, rows, strict=True):
            for cell, text in zip(row, wanted, strict=True):
                assert_agrees(cell, text, f'{table.title}: {wanted}')


@recorded
def test_the_line_of_the_bench_is_the_constant_of_the_toolbox():
    bench, = validate.validate(DATA, ['bench'])
    assert bench.rows[0][1] == pytest.approx(1530.7, rel=1e-3)


def test_without_recordings_there_is_one_line(tmp_path, capsys):
    for folder in (tmp_path / 'nowhere', tmp_path):
        assert validate.main([str(folder)]) == 2
        output = capsys.readouterr().err
        assert output.startswith(f'validate_recordings: {folder}') and output.count('\n') == 1


@pytest.mark.parametrize('section, file', [
    ('bench', 'rolling_spider_bench/thrustdata.mat'),
    ('pendulum', 'crazyflie_optitrack/a_lab03_x_data.json'),
    ('crazyflie', 'crazyflie_optitrack/lab02_square.json'),
    ('rolling_spider', 'rolling_spider_flights/a.mat'),
    ('hall', 'mcap_bags/cub_stabilize.mcap')])
def test_a_damaged_recording_is_named_in_one_line(section, file, tmp_path, capsys):
    path = tmp_path / file
    path.parent.mkdir()
    path.write_bytes(b'no recording')
    assert validate.main([str(tmp_path), '--only', section]) == 2
    output = capsys.readouterr().err
    assert str(path) in output and output.count('\n') == 1


def test_a_missing_folder_is_an_error_of_its_own(tmp_path):
    with pytest.raises(BagError, match='rolling_spider_bench: no file thrustdata.mat there'):
        validate.validate(tmp_path, ['bench'])
