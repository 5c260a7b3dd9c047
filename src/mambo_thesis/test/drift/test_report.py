"""Tables of the drift: numbers, and that the document has those of today."""

from pathlib import Path

from hypothesis import given, strategies as st
from mambo_bags.mcap_reader import BagError
from mambo_thesis.drift import experiments, report, table
from mambo_thesis.drift.paths import EXPERIMENTS
import numpy as np
import pytest

DOCUMENT = Path(__file__).parents[4] / 'docs' / 'evidence' / 'drift.md'


def test_the_document_has_the_table_of_mechanisms():
    lines = DOCUMENT.read_text().splitlines()
    made = report.perfect_table(table.table()).splitlines()
    begin = lines.index(made[0])
    assert lines[begin:begin + len(made)] == made


@pytest.mark.long
@pytest.mark.parametrize('name', ['drift_hand_loop', 'drift_w_2'])
def test_the_document_has_what_was_flown(name):
    lines = DOCUMENT.read_text().splitlines()
    for row in report.flown_table({name: experiments.experiment(name)}).splitlines()[2:]:
        assert row in lines


def test_tables_replace_those_of_a_document():
    old = 'text\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\nmore\n'
    new = '| a | b |\n|---|---|\n| 3 | 4 |\n| 5 | 6 |\n'
    assert report.replace_tables([new], old, 'f.md') == (
        'text\n\n| a | b |\n|---|---|\n| 3 | 4 |\n| 5 | 6 |\n\nmore\n')
    with pytest.raises(BagError, match='f.md: no table begins with'):
        report.replace_tables(['| c |\n'], old, 'f.md')


def flown_row(measured, predicted=0.2):
    return report.Flown(0.9, 0.25, predicted, list(measured), [0.01, -0.01, 0.03])


@pytest.mark.parametrize(('x', 'text'), [
    (0.0, '0'), (4.9e-4, '0'), (-4.9e-4, '0'), (0.0012, '+0.001'), (-0.2384, '-0.238')])
def test_a_number_has_a_sign_unless_it_is_zero(x, text):
    assert report.signed(x) == text


def test_a_flown_row_has_mean_and_extremes_of_its_seeds():
    lines = report.flown_table({'drift_w_1': {'d2': flown_row((0.1, 0.3, 0.26))}}).splitlines()
    assert lines[2] == ('| `drift_w_1` | D2 | +0.250 | 0.90 | +0.200 | **+0.220** '
                        '(+0.100 to +0.300) | +0.010 |')
    assert lines[0].count('|') == lines[1].count('|') == lines[2].count('|')


def test_a_found_row_has_its_interval_beside_the_truth():
    found = report.Identification('d2', 'all', ('D',), 0.97, 0.99, -1.02, 0.01)
    line = report.identification_table([found], {'d2': -1.0}).splitlines()[2]
    assert line == '| D2 | all | D | 0.97 | 0.99 | -1.020 +- 0.020 | -1.000 |'
    none = report.identification_table([found._replace(model=())], {'d2': -1.0}).splitlines()[2]
    assert '| none |' in none


def test_the_figure_has_a_plot_for_each_experiment_with_prediction_and_flights():
    drifts = {key: flown_row((0.1, 0.3, 0.26), 0.2) for key in ('a', 'd2')}
    figure = report.draw(dict.fromkeys(EXPERIMENTS, drifts))
    first = figure.axes[0]
    assert [bar.get_height() for bar in first.patches] == pytest.approx(
        [0.25, 0.2, 0.22] * 2)
    assert [label.get_text() for label in first.get_xticklabels()] == ['A', 'D2']
    assert [axes.get_title() for axes in figure.axes[:5]] == [
        report.TITLES[name] for name in EXPERIMENTS]
    last = figure.axes[5]
    np.testing.assert_allclose(last.lines[1].get_xydata()[:, 1], 0.22)
    assert last.get_xscale() == last.get_yscale() == 'log'


def test_a_figure_is_stale_when_its_table_or_colours_change(monkeypatch):
    before = report.figure_digest('| a |\n')
    assert before == report.figure_digest('\n| a |\n\n')
    assert before != report.figure_digest('| b |')
    monkeypatch.setattr(report.palette, 'ROLES', {})
    assert before != report.figure_digest('| a |\n')


@given(x=st.floats(-100.0, 100.0))
def test_a_signed_number_is_read_back_within_half_a_millimetre(x):
    text = report.signed(x)
    assert float(text) == pytest.approx(x, abs=5.001e-4)
    assert text == '0' or text[0] == ('-' if x < 0.0 else '+')


@given(before=st.integers(0, 4), after=st.integers(0, 4), rows=st.integers(0, 5))
def test_a_replaced_table_leaves_the_text_around_it(before, after, rows):
    head = '| a | b |\n|---|---|\n'
    top, bottom = 'x\n' * before + '\n', '\n' + 'y\n' * after
    new = head + '| 1 | 2 |\n' * rows
    document = f'{top}{head}| old | row |\n{bottom}z\n'
    assert report.replace_tables([new], document, 'f.md') == f'{top}{new}{bottom}z\n'
    again = report.replace_tables([new], f'{top}{new}{bottom}z\n', 'f.md')
    assert again == f'{top}{new}{bottom}z\n'


def test_tables_that_are_alike_in_their_rows_are_told_apart_by_their_heads():
    document = '| a |\n|---|\n| 1 |\n\n| b |\n|---|\n| 1 |\n'
    found = report.replace_tables(['| b |\n|---|\n| 2 |\n'], document, 'f.md')
    assert found == '| a |\n|---|\n| 1 |\n\n| b |\n|---|\n| 2 |\n'


@pytest.mark.parametrize(('sigma', 'interval'), [
    (0.01, '0.020'), (0.1, '0.196'), (1e-4, '0.00020'), (0.0, '0')])
def test_an_interval_is_196_deviations(sigma, interval):
    found = report.Identification('a', 'all', ('A',), 0.9, 0.9, 0.068, sigma)
    row = report.identification_table([found], {'a': 0.068}).splitlines()[2]
    assert f' +- {interval} |' in row
