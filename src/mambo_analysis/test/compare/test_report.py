"""The report: one file, all numbers finite, nothing from elsewhere, and drawn by a browser."""

from html.parser import HTMLParser
import json
import re

import browser
from mambo_analysis.compare import report
from mambo_analysis.compare.compare import compare, compare_bags
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from synthetic import E_TOTAL, make_flight

VOID = ('meta', 'br', 'input', 'link')


class Page(HTMLParser):
    """Collects what a page refers to; every tag that opens must close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.references, self.data, self.labels = [], [], [], '', []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.open += [] if tag in VOID else [attrs.get('id') if tag == 'script' else tag]
        self.ids += [attrs['id']] if 'id' in attrs else []
        self.labels += [attrs['aria-label']] if attrs.get('role') == 'img' else []
        self.references += [value for name, value in attrs.items()
                            if name in ('src', 'href', 'action', 'poster', 'srcset')]

    def handle_endtag(self, tag):
        assert self.open.pop() in (tag, None, 'data')

    def handle_data(self, data):
        if self.open and self.open[-1] == 'data':
            self.data += data


@pytest.fixture(scope='module')
def flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    drop = {'optitrack/pose': set(range(300, 420))}  # a gap, so that NaN has to be told
    return [read_bag(make_flight(folder / name, 18.0, noise=0.001, drop=drop))
            for name in ('a <b> a', 'other')]


@pytest.fixture(scope='module')
def two(flights):
    result, comparison, alignment = compare_bags(*flights)
    return report.of_two(*flights, result, comparison, alignment)


@pytest.fixture(scope='module')
def one(flights):
    return report.of_one(flights[0], compare(flights[0]))


@pytest.fixture(scope='module', params=['one', 'two'])
def page(request):
    return report.html(request.getfixturevalue(request.param))


def numbers(value):
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from numbers(inner)
    elif isinstance(value, float | int):
        yield value


def test_the_page_is_whole_and_refers_to_nothing_outside(page):
    parsed = Page(page)
    assert parsed.open == [] and parsed.references == []
    assert len(parsed.ids) == len(set(parsed.ids))
    assert "default-src 'none'" in page
    ours = page[:page.index('<script>')]  # before the library, which is the plotly project's
    assert not re.search(r'https?://|@import|url\(', ours)
    assert 'a <b> a' not in page[:page.index('id="data"')]
    # plotly reads the names of lines as HTML
    assert '"name":"A: a <b> a' not in page


def test_all_data_are_finite_numbers_or_gaps(page):
    data = json.loads(Page(page).data)
    assert np.isfinite(list(numbers(data))).all()
    for figure in data['figures']:
        for panel in figure['panels']:
            assert re.search(r'\[.+\]$', panel['label'])
            for line in panel['lines']:
                assert len(line['t']) == len(line['y']) > 0
                assert any(y is not None for y in line['y'])
                assert len(line['t']) <= 2 * report.POINTS
    replay = data['replay']
    for vehicle in replay['vehicles']:
        assert len(vehicle['p']) == len(vehicle['q']) == len(replay['t'])


def test_what_is_drawn_is_what_was_compared(one):
    figure = next(f for f in one.figures if f['id'] == 'estimation-position-error')
    error, running = figure['panels'][-1]['lines']
    known = [y for y in error['y'] if y is not None]
    assert np.median(known) == pytest.approx(E_TOTAL, abs=0.002)  # 1 mm of noise an axis
    assert running['y'][-1] == pytest.approx(E_TOTAL, abs=0.002)
    assert None in error['y']  # the gap of Optitrack
    assert one.cards[0][1] == '0.013 m'


def test_every_plot_has_a_text_for_those_who_do_not_see_it(page):
    labels = Page(page).labels
    assert len(labels) == 2 + len(json.loads(Page(page).data)['figures'])
    assert all(len(label) > 20 for label in labels)


def test_vehicles_are_where_their_bags_have_them(two, flights):
    truth = flights[0]['ground_truth/odom']
    k = 200
    at = np.abs(truth.t - two.replay['t'][k]).argmin()
    np.testing.assert_allclose(two.replay['vehicles'][0]['p'][k], truth.position[at], atol=1e-3)


def test_the_page_follows_light_dark_narrow_and_paper(page):
    for rule in ('prefers-color-scheme:dark', 'max-width: 700px', '@media print',
                 'width=device-width'):
        assert rule in page


def test_a_bag_of_one_topic_has_a_report(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 2.0, leave_out=(
        'reference', 'optitrack/pose', 'ground_truth/odom', 'motor_pwm')))
    made = report.of_one(bag, compare(bag))
    assert made.figures == [] and len(made.replay['vehicles']) == 1
    assert 'estimation' in ' '.join(made.notes)


@browser.NEEDED
def test_a_browser_draws_every_plot(two, tmp_path):
    tab = browser.opened(report.html(two), tmp_path)
    ready, live, layers = tab.evaluate("""
        return [document.documentElement.dataset.ready,
          document.querySelectorAll('[data-live="yes"]').length,
          document.querySelectorAll('.plot .scatterlayer').length];
    """)
    assert ready in ('webgl', 'flat')
    assert live == len(two.figures) and layers >= len(two.figures)
