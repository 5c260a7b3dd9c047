"""Recordings from a script."""

from pathlib import Path
import shutil

import mambo
import numpy as np
import pytest

CIRCLE = Path(__file__).parents[3] / 'bags/circle_short'


@pytest.fixture(scope='module')
def bag():
    return mambo.open_bag(CIRCLE)


def test_a_bag_says_what_is_in_it(bag):
    lines = repr(bag).splitlines()
    assert lines[0].startswith(f'{CIRCLE}: ')
    (imu,) = (line.split() for line in lines if '/mambo/imu/data_raw' in line)
    assert imu[2:] == ['sensor_msgs/msg/Imu', '200.0', 'Hz']
    assert {messages.topic for messages in bag} <= set(bag.topics)
    assert all(len(messages) for messages in bag)


def test_tab_completion_offers_topics_and_fields(bag):
    assert 'estimate/odom' in bag._ipython_key_completions_()
    estimate = bag['estimate/odom']
    assert {'pose', 'position', 'to_pandas'} <= set(dir(estimate))
    assert 'pose.pose.position.x' in estimate._ipython_key_completions_()
    assert repr(estimate).startswith('</mambo/estimate/odom: ')


def test_a_comparison_prints_as_the_command_and_is_a_table(bag, capsys):
    from mambo_analysis.compare import compare as command
    result = mambo.compare(CIRCLE)
    assert command.main([str(CIRCLE)]) == 0
    assert capsys.readouterr().out.strip() == repr(result).strip()
    table = result.to_pandas()
    row = table[table.part == 'whole flight'].iloc[0]
    assert row.rms == pytest.approx(np.sqrt(row.rms_x**2 + row.rms_y**2 + row.rms_z**2))
    assert '<pre>' in result._repr_html_()


@pytest.mark.long
@pytest.mark.parametrize('other', [(), (CIRCLE,)])
def test_a_comparison_writes_the_page_of_the_command(other, tmp_path):
    from mambo_analysis.compare import compare as command
    page = mambo.compare(CIRCLE, *other).to_html(tmp_path / 'page.html')
    paths = [str(path) for path in (CIRCLE, *other)]
    assert command.main([*paths, '-o', str(tmp_path), '--html', str(tmp_path / 'two.html')]) == 0
    text = page.read_text(encoding='utf-8')
    assert text == (tmp_path / 'two.html').read_text(encoding='utf-8')
    assert text == (tmp_path / 'index.html').read_text(encoding='utf-8')
    assert 'id="explore"' in text


def test_a_page_is_never_written_over_a_bag(tmp_path):
    copy = tmp_path / 'bag'
    shutil.copytree(CIRCLE, copy)
    for name in ('metadata.yaml', next(copy.glob('*.mcap')).name):
        before = (copy / name).read_bytes()
        with pytest.raises(mambo.InputError, match=f'{name} is part of a bag, which is never'):
            mambo.compare(copy).to_html(copy / name)
        assert (copy / name).read_bytes() == before


@pytest.mark.long
def test_a_page_is_never_written_over_what_is_no_page(tmp_path, monkeypatch, capsys):
    from mambo_analysis.compare import compare as command
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'pf').write_text('mass: 1.0')
    with pytest.raises(mambo.InputError, match='^pf exists and is not a page: choose another'):
        mambo.compare(CIRCLE).to_html('pf')
    assert command.main([str(CIRCLE), '--html', 'page.htm', '--csv', 'a.csv']) == 0
    assert capsys.readouterr().out.endswith('numbers: a.csv\n\npage: page.htm\n')
    assert command.main([str(CIRCLE), '--html', 'page.htm', '--csv', 'a.csv']) == 0
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'index.html').write_text('mass: 1.0')
    assert command.main([str(CIRCLE), '-o', 'out']) == 2
    assert (tmp_path / 'pf').read_text() == 'mass: 1.0'
    assert (tmp_path / 'out' / 'index.html').read_text() == 'mass: 1.0'


@pytest.mark.long
def test_two_flights_are_compared(bag):
    flight = mambo.fly(duration=12.0, seed=2, landing=False)
    result = mambo.compare(flight, bag)
    assert 'minus' in repr(result) and result['compared'][0] == result['compared'][1]


def test_an_estimate_answers_what_was_recorded_bit_for_bit(bag):
    found = mambo.estimate(bag)
    recorded = bag['estimate/odom']
    np.testing.assert_array_equal(found.bag['estimate/odom'].position, recorded.position)
    assert found.to_pandas()['x'].iloc[-1] == recorded.position[-1, 0]
    assert 'bit for bit' in repr(found) and 'did not diverge' in found.verdict


@pytest.mark.long
def test_an_estimator_that_is_edited_in_a_session_is_the_one_of_now(bag, tmp_path):
    ours = Path(__file__).parents[3] / 'examples/alpha_beta_filter.py'
    mine, found = tmp_path / 'mine.py', []
    for alpha in (0.3, 0.9):
        mine.write_text(ours.read_text().replace('quantity(0.3,', f'quantity({alpha},'))
        found.append(mambo.estimate(bag, str(mine)).to_pandas())
    assert not found[0].equals(found[1])


def test_another_parameter_gives_another_estimate(bag):
    other = mambo.estimate(bag, parameters={'kalman.optical_flow.constant': 1.5})
    assert not np.array_equal(other.bag['estimate/odom'].position, bag['estimate/odom'].position)
    toolbox = mambo.estimate(bag, 'toolbox')
    assert np.isfinite(toolbox.numbers.state).all()


@pytest.mark.parametrize('call, what', [
    (lambda: mambo.open_bag('no/such/bag'), 'no/such/bag'),
    (lambda: mambo.estimate(CIRCLE, 'kalmann'), 'kalmann'),
    (lambda: mambo.estimate(CIRCLE, 'ground_truth'), 'ground_truth'),
    (lambda: mambo.estimate(CIRCLE, parameters={'kalman.x': 1}), 'kalman.x'),
    (lambda: mambo.estimate(CIRCLE, parameters={'joint.gravity': 9.8}), 'has no effect'),
    (lambda: mambo.compare(CIRCLE, a_topic='nowhere', b_topic='optitrack/pose'), 'nowhere')])
def test_wrong_input_is_one_line(call, what):
    with pytest.raises(mambo.InputError) as error:
        call()
    assert what in str(error.value) and '\n' not in str(error.value)
