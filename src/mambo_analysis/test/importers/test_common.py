"""What the importers share: times to stamps, new samples, words for errors."""

import hashlib

from hypothesis import given, strategies as st
from mambo_analysis.importers import common
from mambo_bags.mcap_reader import BagError
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_flight.scenario import from_yaml, load
import numpy as np
import pytest

SECONDS = st.floats(0.0, common.LONGEST)


@given(st.lists(SECONDS, max_size=20))
def test_seconds_become_the_nearest_nanoseconds(times):
    stamps = common.stamps_ns(times)
    assert stamps.dtype == np.int64 and stamps.shape == (len(times),)
    # a float of up to 1e9 s has steps of up to 1.2e-7 s: no more is lost, and half a nanosecond
    for time, stamp in zip(times, stamps.tolist()):
        assert abs(stamp - time * 1e9) <= 0.5 + 1e-15 * time * 1e9


@given(st.integers(0, 10**15))
def test_whole_nanoseconds_of_eleven_days_survive_being_seconds(stamp):
    assert common.stamps_ns([stamp * 1e-9]).tolist() == [stamp]


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=30))
def test_new_samples_are_those_that_differ_from_the_step_before(rows):
    values = np.array(rows, float)
    want = [k for k in range(1, len(rows)) if rows[k] != rows[k - 1]]
    assert common.new_samples(values).tolist() == want
    assert common.new_samples(values[:, 0]).tolist() == [
        k for k in range(1, len(rows)) if rows[k][0] != rows[k - 1][0]]


@pytest.mark.parametrize(('values', 'sound'), [
    ([0.0, -1e29], True), ([1e31], False), ([np.nan], False), ([np.inf], False), ([], True)])
def test_sound_numbers_fit_single_precision(values, sound):
    assert common.is_sound(np.array(values)) == sound


@pytest.mark.long
@given(st.lists(st.text(max_size=200), max_size=40))
def test_names_in_an_error_are_few_and_short(names):
    text = common.shortened(names)
    assert len(text) <= 12 * 62 + 20
    assert (f' and {len(names) - 12} more' in text) == (len(names) > 12)


@given(st.text(max_size=300))
def test_a_quoted_word_is_one_short_line(word):
    text = common.quoted(word)
    assert '\n' not in text and text[0] in '\'"' and len(text) < 700


def test_a_source_is_read_once_with_its_checksum(tmp_path):
    path = tmp_path / 'log.csv'
    path.write_bytes(b'\xef\xbb\xbfa;b\n')
    source = common.read_source(path)
    assert source.text() == 'a;b\n'  # without the mark of its encoding
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    path.write_bytes(b'abc\xff')
    with pytest.raises(BagError, match=r'log\.csv: not a text file in UTF-8 \(byte 3\)'):
        common.read_source(path).text()
    with pytest.raises(BagError, match='none.csv'):
        common.read_source(tmp_path / 'none.csv')


def test_provenance_is_text_with_nine_digits():
    record = common.provenance('a.mat', 'f' * 64, 'import_x', 'log', {'scale': 1 / 3, 'n': 7})
    assert record == {'import': {
        'source_file': 'a.mat', 'source_sha256': 'f' * 64, 'importer': 'mambo_analysis.import_x',
        'source_kind': 'log', 'scale': '0.333333333', 'n': '7'}}


@pytest.mark.parametrize('path', sorted(common.ESTIMATORS.glob('*.yaml')), ids=lambda p: p.stem)
def test_a_log_brings_the_estimator_of_its_vehicle_and_what_it_alone_knows(path):
    files = common.estimator_parameters(
        path.stem, {'kalman': {'sonar': {'noise': 0.07}}, 'joint': {'sonar': {'max_range': 2.5}}})
    node = from_yaml(files.pop('scenario.yaml')).estimator_node
    vehicle = load(path).estimator_node
    assert not files and node.estimator == 'joint'
    assert node.kalman.sonar.noise == 0.07 and node.joint.sonar.max_range == 2.5
    assert node.joint.sonar.noise == vehicle.joint.sonar.noise != JointParams().sonar.noise


def test_what_was_not_used_is_one_line_or_none():
    assert common.unused([]) == []
    assert common.unused(['a', 'b']) == ['not used: a, b']
    assert common.unused(['a', '']) == ['not used: a, a column without a name']


def test_the_command_line_of_an_importer_reads_a_file_and_creates_a_bag(capsys):
    parser = common.importer_parser('import_x', 'Import X.\n\nDetails.', 'log', 'a log of X')
    options = parser.parse_args(['x.log', 'bag'])
    assert (str(options.log), str(options.output)) == ('x.log', 'bag')
    assert 'Import X.' in parser.format_help() and 'Details' not in parser.format_help()
    with pytest.raises(SystemExit):
        parser.parse_args(['x.log'])
    assert '-o/--output is missing' in capsys.readouterr().err


@pytest.mark.parametrize('text', ['1.5', ' -2e3 ', '0'])
def test_a_cell_is_a_number(text):
    assert common.number(text) == float(text)


@pytest.mark.parametrize('text', ['1_0.5', '\u0661\u0662', 'one', ''])
def test_what_python_alone_reads_is_no_number(text):
    with pytest.raises(ValueError):
        common.number(text)
