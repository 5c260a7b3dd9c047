"""What came of the figures, as text, Markdown, JSON and one page: every verdict everywhere."""

from html.parser import HTMLParser
import json

from hypothesis import given, settings, strategies as st
from mambo_flight import scenario_file
from mambo_thesis import reproduce  # noqa: F401 (registers the figures)
from mambo_thesis.figures.claim import at_most, Claim, CLAIMS, Measured, Result
from mambo_thesis.figures.page import (
    _anchor, data, Examined, line, markdown, page, picture, summary)
from matplotlib.figure import Figure
import pytest


def examined(number, *holds, figure=None, why='', flights='', says='the drone hovers'):
    measured = [Measured(f'error {k}', 0.1, 0.2, 'm', 'at most 0.3', h, 'noise')
                for k, h in enumerate(holds)]
    claim = Claim(number, says, flights, lambda: None, 'a floor', 'its height', ('wind',))
    return Examined(claim, Result(measured, figure, why))


ALL = [examined('5.3', True, True, flights='fig_5_3'), examined('5.4', True, False),
       examined('C.1', False, why='no wind'), examined('4.1, 4.2', why='they show no data')]


def test_a_summary_counts_each_verdict():
    assert summary(ALL) == '1 reproduced, 1 partly, 1 not reproduced, 1 nothing to measure'
    assert summary([ALL[0], ALL[0]]) == '2 reproduced'


def test_a_line_has_the_verdict_and_every_number():
    rows = line(ALL[1]).splitlines()
    assert rows[0].split() == ['Figure', '5.4', 'partly']
    assert rows[1] == '    ok  error 0: 0.1 to 0.2 m (expected: at most 0.3)'
    assert rows[2].startswith('    NO  error 1: ')


def test_markdown_has_a_section_and_a_table_for_each_figure():
    text = markdown(ALL)
    assert text.count('\n## ') == 4 and f': {summary(ALL)}.' in text
    assert '## Figure 5.3: reproduced\n\nThe drone hovers. Scenario `fig_5_3`.' in text
    assert '*In the simulator:* a floor. *Tested:* its height.' in text
    assert '| error 1 | 0.1 to 0.2 m | at most 0.3 | noise | **no** |' in text
    assert '| error 0 | 0.1 to 0.2 m | at most 0.3 | noise | yes |' in text
    head = text[:text.index('## Figure')]
    assert '| reproduced | 1 |' in head and '| by construction | 0 |' in head
    assert '\nNo wind.\n' in text
    nothing = text[text.index('## Figures 4.1, 4.2'):]
    assert '|' not in nothing and 'They show no data.' in nothing


def test_data_is_plain_and_whole():
    found = json.loads(json.dumps(data(ALL)))
    assert [entry['verdict'] for entry in found] == [
        'reproduced', 'partly', 'not reproduced', 'nothing to measure']
    assert found[2]['remark'] == 'no wind' and found[0]['scenario'] == 'fig_5_3'
    assert found[1]['measured'][1] == {
        'what': 'error 1', 'low': 0.1, 'high': 0.2, 'unit': 'm', 'expected': 'at most 0.3',
        'holds': False, 'reason': 'noise'}
    assert (found[0]['contains'], found[0]['tests']) == ('a floor', 'its height')


class Checker(HTMLParser):
    """Collects ids, links and texts; every tag that opens must close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.links, self.sources, self.text = [], [], [], [], ''
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag not in ('meta', 'img', '!doctype'):
            self.open.append(tag)
        self.ids += [attrs['id']] if 'id' in attrs else []
        self.links += [attrs['href']] if 'href' in attrs else []
        self.sources += [attrs['src']] if 'src' in attrs else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_a_page_is_whole_and_every_link_leads_to_a_figure():
    checker = Checker(page(ALL))
    assert checker.links == [f'#{name}' for name in checker.ids]
    assert checker.ids == ['figure-5-3', 'figure-5-4', 'figure-c-1', 'figure-4-1--4-2']
    assert 'No wind' in checker.text and checker.text.count('by construction') == 1


def test_a_page_needs_no_network():
    figure = Figure()
    figure.subplots().plot([0, 1])
    checker = Checker(page([examined('5.3', True, figure=figure)]))
    source, = checker.sources
    assert source.startswith('data:image/png;base64,iVBORw0KGgo')


def test_the_statement_of_a_claim_is_escaped():
    text = page([examined('5.3', says='x < y & "z" <script>')])
    assert '<script>' not in text and 'X &lt; y &amp; &quot;z&quot; &lt;script&gt;' in text


@pytest.mark.parametrize(('holds', 'mark'), [
    ((True,), '✓'), ((True, False), '½'), ((False,), '✗')])
def test_a_link_shows_its_verdict_without_its_colour(holds, mark):
    checker = Checker(page([examined('5.3', *holds)]))
    assert f'5.3 {mark}' in checker.text


def test_a_picture_is_a_png_file(tmp_path):
    figure = Figure()
    figure.subplots().plot([0, 1])
    picture(figure, tmp_path / 'a.png')
    assert (tmp_path / 'a.png').read_bytes()[:4] == b'\x89PNG'


def test_a_measurement_in_the_page_is_that_of_the_claim():
    result = Result([at_most('height', [0.1, 0.25], 0.2, 'm')])
    text = page([Examined(Claim('5.3', 'x', '', lambda: result), result)])
    assert '0.1 to 0.25 m' in text and 'at most 0.2' in text and '>no<' in text


SCENARIOS = {'', *(name.partition('/')[0] for name in scenario_file.names())}
LETTERS = st.text(st.characters(codec='utf-8', exclude_categories=('Cc', 'Cs')), max_size=30)
MEASURED = st.builds(
    Measured, LETTERS, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.sampled_from(['', 'm', '%']),
    LETTERS, st.booleans())
EXAMINED = st.builds(
    Examined, st.builds(Claim, st.sampled_from(['2.1', '5.11', 'C.3', '5.9, 5.10']), LETTERS,
                        st.sampled_from(['', 'fig_5_3']), st.none()),
    st.builds(Result, st.lists(MEASURED, max_size=4), st.none(), LETTERS))


@given(examined=st.lists(EXAMINED, max_size=3))
@settings(max_examples=40, deadline=None)
def test_any_texts_make_a_valid_page_with_all_of_them(examined):
    checker = Checker(page(examined))
    assert len(checker.ids) == len(examined)
    for each in examined:
        for m in each.result.measured:
            assert m.what in checker.text and m.expected in checker.text
        assert each.claim.statement[1:] in checker.text


@given(examined=st.lists(EXAMINED, min_size=1, max_size=6))
@settings(max_examples=40, deadline=None)
def test_the_verdicts_of_a_summary_add_up(examined):
    counts = [int(part.split()[0]) for part in summary(examined).split(', ')]
    assert sum(counts) == len(examined)
    assert [entry['verdict'] for entry in data(examined)] == [e.verdict for e in examined]


def test_a_table_has_one_row_of_five_cells_for_each_measurement():
    text = markdown([examined('5.3', True, False, True)])
    rows = [row for row in text.splitlines() if row.startswith('|')]
    head = rows.index('| measured | value | expected | reason | holds |')
    assert len(rows[head:]) == 2 + 3 and all(row.count('|') == 6 for row in rows[head:])


def test_the_registered_figures_have_different_links_and_whole_sentences():
    anchors = [_anchor(Examined(claim, Result([]))) for claim in CLAIMS.values()]
    assert len(set(anchors)) == len(anchors) == len(CLAIMS)
    for claim in CLAIMS.values():
        assert claim.statement and not claim.statement.endswith('.'), claim.number
        assert claim.scenario in SCENARIOS, claim.number


def test_a_figure_that_was_flown_names_its_scenario_and_how_to_fly_it():
    text = page([examined('5.3', True, flights='fig_5_3'), examined('2.1', True)])
    assert text.count('./run --scenario') == 1 and './run --scenario fig_5_3' in text


def test_a_remark_ends_with_one_full_stop():
    for why in ('no wind', 'no wind.'):
        assert '\nNo wind.\n' in markdown([examined('5.3', False, why=why)])


def test_a_figure_without_a_drawing_has_no_image():
    checker = Checker(page([examined('5.3', True)]))
    assert checker.sources == [] and 'measured' in checker.text


def test_a_page_of_nothing_is_valid_and_counts_nothing():
    checker = Checker(page([]))
    assert checker.ids == [] and checker.sources == []
    assert summary([]) == '' and data([]) == []
    assert markdown([]).count('| 0 |') == 5  # every verdict, none of which occurs


@pytest.mark.parametrize(('holds', 'mark'), [((True,), 'yes'), ((False,), '**no**')])
def test_a_row_in_markdown_says_whether_it_holds(holds, mark):
    text = markdown([examined('5.3', *holds)])
    row, = (line for line in text.splitlines() if line.startswith('| error 0 |'))
    assert row.endswith(f'| {mark} |') and '| at most 0.3 |' in row


@pytest.mark.parametrize(('scenario', 'shown'), [('fig_5_3', ' Scenario `fig_5_3`.'), ('', '.')])
def test_a_claim_is_a_sentence_with_its_scenario(scenario, shown):
    text = markdown([examined('5.3', True, flights=scenario)])
    assert f'The drone hovers.{shown if scenario else ""}' in text
    assert ('Scenario' in text) is bool(scenario)
