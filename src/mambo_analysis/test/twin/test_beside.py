"""The page shows every flight beside its simulation, one after the other."""

import browser
from flown import steered, TRUE
from mambo_analysis.compare import report
from mambo_analysis.twin.beside import Beside, page, PAUSE, write
from mambo_analysis.twin.loop import fly
from mambo_analysis.twin.recorded import Onboard
import numpy as np
import pytest

TABLE = ('a caption', ['flight', 'error'], [['one', '0.123']])


@pytest.fixture(scope='module')
def pairs():
    out = []
    for seed in range(2):
        one = steered(seed, seconds=6.0)
        unknown = np.full_like(one.position, np.nan)
        one = one._replace(onboard=Onboard(
            one.position, unknown, unknown, np.full((len(one.t), 4), np.nan)))
        out.append(Beside(one, fly(one, TRUE, False)))
    return out


def test_flights_follow_each_other_and_have_their_numbers(pairs):
    made = page(pairs, [TABLE], ['a note'])
    assert made.replay['t'][-1] == pytest.approx(2.0 * 5.99 + PAUSE, abs=0.05)
    assert [track['name'] for track in made.replay['tracks']] == [
        'reference', 'flown', 'simulated']
    rms = [one.flown.rms(one.flight)[2] for one in pairs]
    places = [entry for entry in made.sections if entry['quantity'] == 'position']
    assert [entry['rows'][0]['rms_total'] for entry in places] == pytest.approx(rms)
    assert [number for _, number, _ in made.cards] == [f'{100.0 * x:.1f} cm' for x in rms]


def test_without_a_simulation_there_is_the_path_alone(pairs):
    made = page([one._replace(flown=None) for one in pairs], [TABLE], [])
    assert not made.figures and not made.sections and len(made.replay['vehicles']) == 1


def test_tables_and_notes_are_on_the_page(pairs, tmp_path):
    text = write(tmp_path / 'twin.html', pairs, [TABLE], ['a <note>']).read_text()
    assert '<caption>a caption</caption>' in text and '0.123' in text
    assert 'a &lt;note&gt;' in text and 'https://' not in text.split('<script>')[0]


@browser.NEEDED
def test_a_browser_draws_it(pairs, tmp_path):
    made = page(pairs, [TABLE], [])
    tab = browser.opened(report.html(made), tmp_path)
    ready, live = tab.evaluate("""
        return [document.documentElement.dataset.ready,
          document.querySelectorAll('[data-live="yes"]').length];
    """)
    assert ready in ('webgl', 'flat') and live == len(made.figures)
