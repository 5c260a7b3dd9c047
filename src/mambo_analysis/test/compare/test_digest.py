"""The digest of a figure changes with what it shows, and with nothing else."""

from mambo_analysis.compare import digest
from mambo_model.errors import InputError
from matplotlib.figure import Figure
import numpy as np
import pytest


def drawn(change=lambda figure, axes: None):
    """Return a figure with a line, a bar, an area and a text, and one thing changed."""
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 2.0], [0.0, 0.5, 1.0], label='height', color='#123456')
    axes.bar([0.0], [1.0])
    axes.fill_between([0.0, 1.0], [0.0, 0.0], [1.0, 2.0])
    axes.text(0.5, 0.5, 'here')
    axes.set_xlabel('t [s]')
    change(figure, axes)
    return figure


CHANGES = {
    'a number': lambda f, a: a.lines[0].set_ydata([0.0, 0.5, 1.00001]),
    'a missing number': lambda f, a: a.lines[0].set_ydata([0.0, np.nan, 1.0]),
    'a colour': lambda f, a: a.lines[0].set_color('#123457'),
    'a style': lambda f, a: a.lines[0].set_linestyle('--'),
    'a width': lambda f, a: a.lines[0].set_linewidth(3.0),
    'a marker': lambda f, a: a.lines[0].set_marker('o'),
    'a name': lambda f, a: a.lines[0].set_label('depth'),
    'a bar': lambda f, a: a.patches[0].set_height(1.1),
    'a bar of another colour': lambda f, a: a.patches[0].set_facecolor('red'),
    'an area': lambda f, a: a.collections[0].set_facecolor('red'),
    'a text': lambda f, a: a.texts[0].set_text('there'),
    'a label': lambda f, a: a.set_xlabel('t [min]'),
    'a title': lambda f, a: a.set_title('x', loc='left'),
    'one line more': lambda f, a: a.plot([0.0], [0.0])}


@pytest.mark.parametrize('what', CHANGES)
def test_whatever_is_seen_to_change_changes_it(what):
    assert digest.digest(drawn(CHANGES[what])) != digest.digest(drawn())


def test_what_is_not_seen_does_not_change_it():
    same = digest.digest(drawn())
    assert digest.digest(drawn()) == same and len(same) == 16
    last = digest.digest(drawn(lambda f, a: a.lines[0].set_ydata([0.0, 0.5, 1.0 + 1e-9])))
    assert last == same  # the last bits differ between machines
    minus = digest.digest(drawn(lambda f, a: a.lines[0].set_ydata([-0.0, 0.5, 1.0])))
    assert minus == same
    assert digest.digest(drawn(lambda f, a: f.set_size_inches(9.0, 9.0))) == same


def test_a_saved_figure_carries_its_digest_and_two_are_the_same_bytes(tmp_path):
    for name in 'ab':
        digest.save(drawn(), tmp_path / name, 50.0)
    assert digest.saved(tmp_path / 'a') == digest.digest(drawn())
    assert (tmp_path / 'a').read_bytes() == (tmp_path / 'b').read_bytes()
    digest.save(drawn(), tmp_path / 'c', 50.0, 'of its source')
    assert digest.saved(tmp_path / 'c') == 'of its source'
    (tmp_path / 'take.csv').write_text('t,x\n')
    with pytest.raises(InputError, match='take.csv exists and is not a PNG picture'):
        digest.save(drawn(), tmp_path / 'take.csv', 50.0)
    assert (tmp_path / 'take.csv').read_text() == 't,x\n'


@pytest.mark.parametrize('keep', [0, 7, 8, 20, 60])
def test_a_file_without_a_digest_or_cut_short_has_none(tmp_path, keep):
    digest.save(drawn(), tmp_path / 'a', 50.0)
    (tmp_path / 'b').write_bytes((tmp_path / 'a').read_bytes()[:keep])
    assert digest.saved(tmp_path / 'b') is None
    drawn().savefig(tmp_path / 'plain.png')
    assert digest.saved(tmp_path / 'plain.png') is None


def test_texts_do_not_run_together():
    assert digest.of_text('ab', 'c') != digest.of_text('a', 'bc') != digest.of_text('abc')
