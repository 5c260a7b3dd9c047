"""Every page: usable by keyboard and screen reader, whole on paper, its plots linked."""

from html.parser import HTMLParser
import re
import shutil
import subprocess

import browser
from mambo_analysis.compare import report, tables
from mambo_analysis.compare.compare import compare, compare_bags
from mambo_bags.reader import read_bag
from mambo_thesis.figures import claim, drawing, page as thesis
from matplotlib.image import imread
import numpy as np
import pytest
from synthetic import make_flight

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    return [read_bag(make_flight(folder / name, 18.0, noise=0.001)) for name in ('one', 'other')]


def reproduction():
    t = np.linspace(0.0, 1.0, 20)
    curve = (t, np.stack([t, np.full_like(t, np.nan), -t], axis=1))
    made = drawing.positions({'reference': (t, np.stack([t, t, t], axis=1)), 'IMU': curve})
    wanted = claim.at_most('an error', 0.1, 1.0, 'm'), claim.at_most('another', 2.0, 1.0, 'm')
    results = [claim.Result([], remark='a photograph'), *(
        claim.Result(list(wanted[:k]), made) for k in (1, 2))]
    return thesis.page([thesis.Examined(claim.Claim(f'5.{k}', 'it works', 'fig_5_3', None), result)
                        for k, result in enumerate(results)])


@pytest.fixture(scope='module', params=['one', 'two', 'thesis'])
def text(request, flights):
    if request.param == 'one':
        return report.html(report.of_one(flights[0], compare(flights[0])))
    if request.param == 'two':
        return two(flights)
    return reproduction()


def two(flights):
    result, comparison, alignment = compare_bags(*flights)
    return report.html(report.of_two(*flights, result, comparison, alignment))


class Elements(HTMLParser):
    """Collects (tag, attributes) of a page."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def all(self, *tags):
        return [attrs for tag, attrs in self.found if tag in tags]


@pytest.mark.long
def test_a_page_has_what_a_screen_reader_needs(text):
    page = Elements(text)
    assert page.all('html')[0]['lang'] == 'en' and len(page.all('title')) == 1
    assert len(page.all('main')) == len(page.all('h1')) == 1
    levels = [int(tag[1]) for tag, _ in page.found if re.fullmatch('h[1-6]', tag)]
    assert all(b <= a + 1 for a, b in zip(levels, levels[1:]))
    assert all(cell.get('scope') in ('col', 'row') for cell in page.all('th'))
    assert len(page.all('caption')) == len(page.all('table')) > 0
    assert all(image.get('alt') for image in page.all('img'))
    assert all(control.get('aria-label') for control in page.all('button', 'input', 'select',
                                                                  'nav'))
    scrolling = [box for box in page.all('div', 'pre') if box.get('class') == 'scroll'] \
        + page.all('pre')
    assert all(box['tabindex'] == '0' and box['aria-label'] for box in scrolling)


@browser.AXE_NEEDED
@pytest.mark.parametrize('theme', ['light', 'dark'])
@pytest.mark.parametrize('width', [1280, 390])
def test_axe_finds_nothing(text, width, theme, tmp_path):
    assert browser.findings(text, tmp_path, width=width, theme=theme) == []
    across = browser.started().evaluate('return document.documentElement.scrollWidth')
    assert across <= width  # only tables scroll sideways, in frames of their own


RANGES = """return [...document.querySelectorAll('.plot[data-time]')].map(({ _fullLayout: all }) =>
    [all.xaxis, all.yaxis].map(({ range }) => range.map((v) => Number(v.toPrecision(4)))));"""


@browser.NEEDED
def test_a_double_click_resets_every_plot(flights, tmp_path):
    tab = browser.opened(two(flights), tmp_path)
    before = tab.evaluate(RANGES)
    tab.evaluate("""
        Plotly.setPlotConfig({ doubleClickDelay: 60000 }); // ms: the machine may be slow, and
        const boxes = [...document.querySelectorAll('.plot[data-time]')]; // a redrawn plot asks it
        boxes[1]._context.doubleClickDelay = 60000;
        await Plotly.relayout(boxes[1], { 'xaxis.range[0]': 3, 'xaxis.range[1]': 5,
          'yaxis.range': [0, 900] });
        await Plotly.relayout(boxes[0], { 'yaxis.range': [0, 900] });
        boxes[1].scrollIntoView();
    """)
    zoomed = tab.evaluate(f'for (let k = 0; k < 100; k += 1) {{ await new Promise('
                          f'requestAnimationFrame); }} {RANGES}')
    assert len(before) > 3 and all(time[1] > 17.9 for time, _ in before)
    assert all(time == [3, 5] for time, _ in zoomed) and zoomed[0][1] == [0, 900]
    tab.double_click(*tab.evaluate("""
        const area = document.querySelectorAll('.plot[data-time]')[1].querySelector('.nsewdrag')
          .getBoundingClientRect();
        return [area.left + 40, area.top + 20];
    """))
    after = tab.evaluate(f"""
        const ranges = () => {{ {RANGES} }};
        for (let k = 0; k < 100 && !ranges().every(([time]) => time[1] > 17.9); k += 1)
          await new Promise((done) => setTimeout(done, 50));
        return ranges();
    """)
    # the room that plotly leaves around lines depends a little on the height of the plot
    np.testing.assert_allclose(np.array(after), before, rtol=1e-3, atol=1e-3)


@browser.NEEDED
@pytest.mark.skipif(shutil.which('pdftoppm') is None, reason='needs pdftoppm of poppler-utils')
@pytest.mark.parametrize('theme', ['light', 'dark'])
def test_a_printed_page_is_whole_on_its_right(text, theme, tmp_path):
    file = browser.printed(text, tmp_path, theme=theme)
    subprocess.run(['pdftoppm', '-r', '50', '-png', file, tmp_path / 'sheet'], check=True)
    sheets = [imread(file)[..., :3] for file in sorted(tmp_path.glob('sheet*.png'))]
    assert len(sheets) > 0 and sum(float((sheet < 0.5).mean()) for sheet in sheets) > 0.005
    for sheet in sheets:  # the margin is white: nothing is cut off at it
        assert sheet[:, -14:].min() > 0.95


DIAGNOSTICS = (
    ('sim_node', 2, 9.0, 'failsafe: motors stopped'),
    ('sim_node: inputs', 1, 4.0, 'refused messages: 1 motor_pwm too far in the future'),
    ('sim_node: inputs', 1, 5.0, 'refused messages: 7 motor_pwm too far in the future'))


@pytest.fixture(scope='module')
def ended(tmp_path_factory):
    """Return a flight that ended early, whose simulator refused messages."""
    return read_bag(make_flight(tmp_path_factory.mktemp('bags') / 'ended', 18.0, noise=0.001,
                                diagnostics=DIAGNOSTICS))


@pytest.mark.long
def test_every_page_says_what_ended_a_flight_early_and_what_was_refused(flights, ended):
    result = compare(ended)
    against, comparison, alignment = compare_bags(flights[0], ended)
    for shown, entries, name in (
            (report.html(report.of_one(ended, result)), result, ''),
            (report.html(report.of_two(flights[0], ended, against, comparison, alignment)),
             against, 'B: ')):
        for line in (f'{name}sim_node at 9.000 s: failsafe: motors stopped',
                     f'{name}sim_node refused messages: 7 motor_pwm too far in the future'):
            assert line in shown and line in tables.table(entries)
        assert '>A: sim_node' not in shown and 'refused messages: 1 ' not in shown


@pytest.mark.long
def test_every_page_says_that_a_part_has_too_few_samples(flights):
    made = report.of_one(flights[0], compare(flights[0]))
    assert '1 sample: too few for statistics' in report.html(made._replace(sections=[
        {**entry, 'too_few': {'after take-off': 1}} for entry in made.sections]))


def test_a_curve_without_values_is_not_in_the_legend():
    t = np.arange(3.0)
    made = drawing.positions({'Optitrack': (t, np.ones((3, 3))), 'optical flow': (
        t, np.full((3, 3), np.nan))})
    assert [text.get_text() for text in made.legends[0].get_texts()] == ['Optitrack']


def test_the_thesis_says_that_z_is_down():
    t = np.arange(3.0)
    assert drawing.positions({'IMU': (t, np.ones((3, 3)))}).axes[2].get_ylabel() == '$z$ down [m]'
    assert 'NED, z down' in reproduction()
