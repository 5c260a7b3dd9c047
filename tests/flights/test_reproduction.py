"""What docs/evidence/reproduction.md says is what flights show, and could have been otherwise."""

from pathlib import Path
import re

from mambo_flight import scenario_file
from mambo_flight.scenario import override
from mambo_thesis import reproduce
from mambo_thesis.figures import chapter_5, flights
from mambo_thesis.figures.claim import (
    at_least, at_most, near, NOT_REPRODUCED, NOTHING, PARTLY, REPRODUCED, Result, verdict)
from mambo_thesis.figures.flights import Flight
from mambo_thesis.figures.page import markdown
import numpy as np
import pytest

DOCUMENT = Path(__file__).parents[2] / 'docs' / 'evidence' / 'reproduction.md'
NUMBER = re.compile(r'-?\d+(?:\.\d+)?(?:e-?\d+)?')


@pytest.fixture(scope='module')
def examined():
    return reproduce.examine(reproduce.chosen([]))


@pytest.mark.slow
def test_the_document_is_what_the_command_says(examined):
    written, made = DOCUMENT.read_text().splitlines(), markdown(examined).splitlines()
    assert len(written) == len(made), 'write it anew: mambo reproduce'
    for old, new in zip(written, made, strict=True):
        # words and verdicts to the letter; numbers as far as another numpy may round them
        assert NUMBER.sub('#', old) == NUMBER.sub('#', new)
        for a, b in zip(map(float, NUMBER.findall(old)), map(float, NUMBER.findall(new)),
                        strict=True):
            assert a == pytest.approx(b, rel=0.05, abs=1e-3), f'{old}\n{new}'


def test_every_scenario_of_the_thesis_is_looked_at(examined):
    looked_at = {each.claim.flights for each in examined}
    assert {name for name in scenario_file.names() if name.startswith('fig_')} <= looked_at


def test_what_does_not_hold_says_why(examined):
    for each in examined:
        if each.verdict != REPRODUCED:
            assert each.result.why_not, each.claim.number


def test_verdicts_follow_from_what_was_measured():
    good, bad = at_most('x', [1.0, 2.0], 3.0), at_least('x', [1.0, 5.0], 3.0)
    assert (good.holds, bad.holds) == (True, False)
    assert near('x', [0.9, 1.1], 1.0, 0.11).holds and not near('x', [0.9, 1.2], 1.0, 0.11).holds
    assert not at_most('x', float('nan'), 3.0).holds and not near('x', np.nan, 1.0, 9.0).holds
    assert [verdict(Result(m)) for m in ([], [good], [bad], [good, bad])] == [
        NOTHING, REPRODUCED, NOT_REPRODUCED, PARTLY]


def other_sensor(monkeypatch, changes):
    """Have every flight of a figure flown with another simulated sensor."""
    def fly(name, seed=None):
        over = {'seed': scenario_file.Place(seed or 1, '--seed')}
        return Flight(override(scenario_file.load(name, over)[1], changes))
    monkeypatch.setattr(flights, 'fly', fly)
    monkeypatch.setattr(flights, 'SEEDS', (1, 2))


@pytest.mark.parametrize(('figure', 'changes'), [
    # a factor that does not depend on the height: no drift
    (chapter_5.figure_5_11, {'sim_node.simulator.optical_flow.factor_slope': 0.0}),
    (chapter_5.figure_5_13, {'sim_node.simulator.optical_flow.factor_slope': 0.0}),
    # a factor of 1.5: the estimate is not adequate
    (chapter_5.figure_5_10, {'sim_node.simulator.optical_flow.factor_offset': 1.5}),
])
def test_another_drone_would_not_have_done_it(monkeypatch, figure, changes):
    other_sensor(monkeypatch, changes)
    assert verdict(figure()) != REPRODUCED


def test_figures_are_chosen_by_number_and_by_chapter():
    assert [claim.number for claim in reproduce.chosen(['6'])] == [f'6.{n}' for n in range(1, 7)]
    assert [claim.number for claim in reproduce.chosen(['c.3', '5.11'])] == ['5.11', 'C.3']


def test_an_unknown_figure_is_refused_with_the_known_ones(capsys):
    assert reproduce.main(['7.1']) == 2
    assert capsys.readouterr().err.startswith("reproduce: no figure '7.1'; known: 2.1; 3.1")


def test_the_report_is_written_whole(examined, tmp_path):
    page = reproduce.write([each for each in examined if each.claim.number in ('3.1', '5.12')],
                           tmp_path / 'deep' / 'report')
    text = page.read_text()
    assert 'Figure 5.12' in text and 'data:image/png;base64,' in text
    assert not re.search(r'(src|href)="(?!data:|#)', text)  # nothing from a network
    assert (page.parent / 'fig_5_12.png').stat().st_size > 5000
    assert {path.name for path in page.parent.iterdir()} == {
        'index.html', 'fig_5_12.png', 'reproduction.md', 'reproduction.json'}
