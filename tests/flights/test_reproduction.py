"""What docs/evidence/reproduction.md says is what flights show, and could have been otherwise."""

from pathlib import Path
import re

from mambo_flight import scenario_file
from mambo_thesis import reproduce
from mambo_thesis.figures.claim import (
    at_least, at_most, BY_CONSTRUCTION, near, NOT_REPRODUCED, NOTHING, PARTLY, REPRODUCED, Result,
    verdict)
from mambo_thesis.figures.page import markdown
import numpy as np
import pytest

EVIDENCE = Path(__file__).parents[2] / 'docs' / 'evidence'
DOCUMENT, MATRIX = EVIDENCE / 'reproduction.md', EVIDENCE / 'claims.md'
NUMBER = re.compile(r'-?\d+(?:\.\d+)?(?:e-?\d+)?')


@pytest.fixture(scope='module')
def examined():
    return reproduce.examine(reproduce.select_figures([]))


@pytest.mark.long
def test_the_document_is_what_the_command_says(examined):
    written, made = DOCUMENT.read_text().splitlines(), markdown(examined).splitlines()
    assert len(written) == len(made), 'write it anew: mambo reproduce'
    for old, new in zip(written, made, strict=True):
        # words and verdicts to the letter; numbers as far as another numpy may round them
        assert NUMBER.sub('#', old) == NUMBER.sub('#', new)
        for a, b in zip(map(float, NUMBER.findall(old)), map(float, NUMBER.findall(new)),
                        strict=True):
            assert a == pytest.approx(b, rel=0.05, abs=1e-3), f'{old}\n{new}'


@pytest.mark.long
def test_every_scenario_of_the_thesis_is_looked_at(examined):
    looked_at = {each.claim.scenario for each in examined}
    assert {name for name in scenario_file.names() if name.startswith('fig_')} <= looked_at


@pytest.mark.long
def test_what_does_not_hold_says_why(examined):
    for each in examined:
        if each.verdict == BY_CONSTRUCTION:
            assert each.claim.contains and each.claim.tests, each.claim.number
        elif each.verdict != REPRODUCED:
            assert each.result.remark, each.claim.number


def test_verdicts_follow_from_what_was_measured():
    good, bad = at_most('x', [1.0, 2.0], 3.0), at_least('x', [1.0, 5.0], 3.0)
    assert (good.holds, bad.holds) == (True, False)
    assert near('x', [0.9, 1.1], 1.0, 0.11).holds and not near('x', [0.9, 1.2], 1.0, 0.11).holds
    assert not at_most('x', float('nan'), 3.0).holds and not near('x', np.nan, 1.0, 9.0).holds
    assert [verdict(Result(m)) for m in ([], [good], [bad], [good, bad])] == [
        NOTHING, REPRODUCED, NOT_REPRODUCED, PARTLY]


def rows_of(page):
    """Return the first cell and the others of each row of the tables of a page."""
    return [[cell.strip() for cell in line.strip('|').split('|')]
            for line in page.read_text().splitlines() if line.startswith('| ')]


@pytest.mark.long
def test_the_matrix_has_every_claim_with_its_verdict_and_what_breaks_it(examined):
    rows = rows_of(MATRIX)
    for each in examined:
        if not each.result.measured:
            continue
        verdicts, says = (row for row in rows if row[0] == each.claim.title)
        assert verdicts[1] == each.verdict, 'write it anew: mambo reproduce --mutations'
        assert says[1:3] == [each.claim.contains, each.claim.tests]
        assert set(each.claim.broken_by) <= set(says[3].split(', ')), each.claim.title


@pytest.mark.long
def test_every_tolerance_has_its_reason(examined):
    for each in examined:
        for m in each.result.measured:
            assert m.reason, f'{each.claim.title}: {m.what}'


def test_figures_are_chosen_by_number_and_by_chapter():
    assert [claim.number for claim in reproduce.select_figures(['6'])] == [
        '6.1', '6.2', '6.3', 'Section 6.3', '6.4', 'Section 6.4', '6.5', '6.6']
    assert [claim.number for claim in reproduce.select_figures(['c.3', '5.11'])] == ['5.11', 'C.3']


def test_an_unknown_figure_is_refused_with_the_known_ones(capsys):
    assert reproduce.main(['7.1']) == 2
    assert capsys.readouterr().err.startswith(
        "reproduce: no figure '7.1': choose one of 2.1; Table 2.1; 3.1")


@pytest.mark.long
def test_the_report_is_written_whole(examined, tmp_path):
    page = reproduce.write([each for each in examined if each.claim.number in ('3.1', '5.12')],
                           tmp_path / 'deep' / 'report')
    text = page.read_text()
    assert 'Figure 5.12' in text and 'data:image/png;base64,' in text
    assert not re.search(r'(src|href)="(?!data:|#)', text)  # nothing from a network
    assert (page.parent / 'fig_5_12.png').stat().st_size > 5000
    assert {path.name for path in page.parent.iterdir()} == {
        'index.html', 'fig_5_12.png', 'reproduction.md', 'reproduction.json'}
