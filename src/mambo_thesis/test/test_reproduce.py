"""The command reproduce: which figures are meant, and what is written of them."""

import json

from mambo_thesis import reproduce
from mambo_thesis.figures.claim import Claim, CLAIMS, Measured, Result
from mambo_thesis.figures.page import Examined
from matplotlib.figure import Figure
import pytest


@pytest.fixture
def claims(monkeypatch):
    """Let there be three figures that need no flight."""
    figure = Figure()
    figure.subplots().plot([0, 1])

    def result(holds, drawn):
        return Result([Measured('x', 1.0, 1.0, 'm', 'at most 1', holds)], drawn)
    found = {number: Claim(number, 'a claim', '', lambda r=r: r, broken_by=('wind',))
             for number, r in (
        ('C.1', result(False, None)), ('5.10', result(True, None)), ('5.3', result(True, figure)),
        ('5.9, 5.12', result(True, figure)))}
    monkeypatch.setattr(reproduce, 'CLAIMS', found)
    return found


def numbers(*arguments):
    return [claim.number for claim in reproduce.select_figures(list(arguments))]


def test_no_number_selects_all_figures_in_the_order_of_the_thesis(claims):
    assert numbers() == ['5.3', '5.9, 5.12', '5.10', 'C.1']


def test_a_number_a_chapter_or_an_appendix_is_chosen(claims):
    assert numbers('5.10') == ['5.10']
    assert numbers('c.1') == numbers('C') == ['C.1']
    assert numbers('5') == ['5.3', '5.9, 5.12', '5.10']
    assert numbers('C', '5.3') == ['5.3', 'C.1']  # in the order of the thesis


def test_5_1_is_not_5_10(claims, capsys):
    assert reproduce.main(['5.1']) == 2
    assert capsys.readouterr().err == (
        "reproduce: no figure '5.1': choose one of 5.3; 5.9, 5.12; 5.10; C.1; or a chapter\n")


def test_a_report_has_a_page_its_data_and_a_picture_of_each_figure(claims, tmp_path, capsys):
    assert reproduce.main(['-o', str(tmp_path / 'out')]) == 0
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == [
        'fig_5_3.png', 'fig_5_9_and_5_12.png', 'index.html', 'reproduction.json',
        'reproduction.md']
    output = capsys.readouterr().out
    assert '3 reproduced, 1 not reproduced' in output
    assert output.endswith(f'page: {tmp_path / "out" / "index.html"}\n')
    found = json.loads((tmp_path / 'out' / 'reproduction.json').read_text())
    assert [entry['figure'] for entry in found][-1] == 'Figure C.1'


def test_the_matrix_is_written_and_a_verdict_that_nothing_breaks_is_refused(
        claims, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(reproduce.matrix, 'MUTATIONS', {})
    assert reproduce.main(['5.3', '--mutations', '-o', str(tmp_path)]) == 1
    output = capsys.readouterr()
    assert output.out.startswith('Figure 5.3       reproduced       notices nothing\n')
    assert output.err == ('reproduce: Figure 5.3: does not notice wind; Figure 5.3: is '
                          'reproduced, but notices no mutation\n')
    assert {path.name for path in tmp_path.iterdir()} == {'claims.md', 'claims.json'}
    assert '| Figure 5.3 | reproduced |' in (tmp_path / 'claims.md').read_text()


def test_a_file_in_place_of_the_folder_is_refused_before_anything_is_flown(
        claims, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(reproduce, 'examine', lambda _: pytest.fail('flown'))
    (tmp_path / 'out').write_text('')
    with pytest.raises(SystemExit) as end:
        reproduce.main(['5.3', '-o', str(tmp_path / 'out')])
    assert end.value.code == 2 and capsys.readouterr().err == (
        f'reproduce: --output: {tmp_path / "out"} is not a folder: give another; '
        'reproduce --help says more\n')
    with pytest.raises(SystemExit) as end:
        reproduce.main(['5.3', '-o', str(tmp_path / 'out' / 'below')])
    assert end.value.code == 2 and capsys.readouterr().err == (
        f'reproduce: --output: {tmp_path / "out" / "below"}: cannot be written '
        '(Not a directory)\n')


def test_each_claim_is_examined_once_and_keeps_its_place(claims):
    found = reproduce.examine(reproduce.select_figures(['5']))
    assert [type(e) for e in found] == [Examined] * 3
    assert [e.verdict for e in found] == ['reproduced'] * 3


def test_every_figure_of_the_thesis_is_there():
    assert {f'5.{k}' for k in (3, 4, 5, 6, 7, 8, 9, 10)} <= set(CLAIMS)
    assert {f'C.{k}' for k in range(1, 9)} <= set(CLAIMS)
    assert {f'6.{k}' for k in range(1, 7)} <= set(CLAIMS)


def test_a_chapter_is_not_a_prefix_of_a_number(claims, capsys):
    assert numbers('5') == ['5.3', '5.9, 5.12', '5.10']
    assert reproduce.main(['5.']) == 2
    assert "no figure '5.'" in capsys.readouterr().err


def test_the_first_unknown_number_is_named_and_nothing_is_flown(claims, monkeypatch, capsys):
    monkeypatch.setattr(reproduce, 'examine', lambda _: pytest.fail('flown'))
    assert reproduce.main(['5.3', '9.9', '8.8']) == 2
    error = capsys.readouterr().err
    assert "no figure '9.9'" in error and '8.8' not in error and error.count('\n') == 1


def test_the_markdown_and_the_json_of_a_report_agree(claims, tmp_path):
    reproduce.write(reproduce.examine(reproduce.select_figures([])), tmp_path)
    text = (tmp_path / 'reproduction.md').read_text()
    for entry in json.loads((tmp_path / 'reproduction.json').read_text()):
        assert f'## {entry["figure"]}: {entry["verdict"]}' in text
        for measured in entry['measured']:
            assert f'| {measured["what"]} |' in text


def test_a_report_replaces_an_older_one(claims, tmp_path):
    for number in ('5.3', 'C.1'):
        reproduce.write(reproduce.examine(reproduce.select_figures([number])), tmp_path)
    assert 'Figure 5.3' not in (tmp_path / 'index.html').read_text()
    assert 'Figure C.1' in (tmp_path / 'index.html').read_text()


@pytest.mark.parametrize(('number', 'name'), [
    ('5.3', '5_3'), ('C.1', 'c_1'), ('5.9, 5.12', '5_9_and_5_12')])
def test_the_file_of_a_figure_is_named_by_its_number(number, name):
    assert reproduce._file(number) == name


def test_every_figure_has_a_docstring_and_can_be_selected_alone():
    for number, entry in CLAIMS.items():
        assert entry.examine.__doc__, number
        selected = [claim.number for claim in reproduce.select_figures([number])]
        assert number in selected, number
        # a number also selects the table of that number and its subsections
        assert all(f'{CLAIMS[name].place}.'.startswith(f'{entry.place}.') for name in selected)
