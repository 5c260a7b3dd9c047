"""The report: one file, all numbers finite, nothing from elsewhere, and drawn by a browser."""

from html.parser import HTMLParser
import json
import re

import browser
from mambo_analysis.compare import events, report
from mambo_analysis.compare.compare import compare, compare_bags
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from synthetic import E_TOTAL, make_flight, truth_position

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
        assert self.open.pop() in (tag, None, 'data', 'library')

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
                assert len(line['x']) == len(line['y']) > 0
                assert any(y is not None for y in line['y'])
                assert len(line['x']) <= 2 * report.POINTS
    names, values = data['signals']['names'], data['signals']['values']
    assert len(names) == len(values) > 20
    assert {len(row) for row in values} == {report.INSTANTS}
    replay = data['replay']
    for vehicle in replay['vehicles']:
        assert len(vehicle['p']) == len(vehicle['q']) == len(replay['t'])


def test_what_is_drawn_is_what_was_compared(one):
    figure = next(f for f in one.figures if f.name == 'estimation: position error')
    error, running = figure.panels[-1].lines
    assert np.nanmedian(error.y) == pytest.approx(E_TOTAL, abs=0.002)  # 1 mm of noise an axis
    assert running.y[np.isfinite(running.y)][-1] == pytest.approx(E_TOTAL, abs=0.002)
    assert np.isnan(error.y).any()  # the gap of Optitrack
    assert one.cards[0][1] == '0.013 m'


def test_every_plot_has_a_text_for_those_who_do_not_see_it(page):
    labels = Page(page).labels
    assert len(labels) == 3 + len(json.loads(Page(page).data)['figures'])  # replay, any signal
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
    assert [plot.name for plot in made.figures] == [
        'position', 'height', 'flow', 'innovations', 'imu-spectrum']
    assert len(made.replay['vehicles']) == 1 and 'estimation' in ' '.join(made.notes)


SECTIONS = {'position', 'errors', 'motors', 'height', 'flow', 'innovations', 'covariance',
            'imu-spectrum', 'motor-spectrum'}


def test_one_bag_and_two_have_the_same_figures_of_each_bag(one, two):
    assert {plot.name for plot in one.figures} >= SECTIONS
    assert {plot.name for plot in two.figures} >= {
        f'bag-{letter}-{name}' for letter in 'AB' for name in SECTIONS}
    names = [plot.name for plot in two.figures]
    assert names.index('bag-B-height') == names.index('bag-A-height') + 1  # side by side


@pytest.mark.long
def test_figures_and_events_of_a_bag_whose_clock_is_off_are_on_the_clock_of_the_other(
        flights, ended):
    result, comparison, alignment = compare_bags(ended, flights[1])
    late = alignment._replace(offset=2_000_000_000)
    made = report.of_two(ended, flights[1], result, comparison, late)
    pwm = {plot.name: plot.panels[0].lines[0].x for plot in made.figures
           if plot.name.endswith('-motors')}
    assert pwm['bag-A-motors'][0] == pytest.approx(2.0) and pwm['bag-B-motors'][0] == 0.0
    assert [(one.bag, one.t, one.role) for one in made.events] == [('A', 11.0, 'bad')]
    text = report.html(made)
    assert '>A: sim_node: failsafe &lt;b&gt;<' in text and 'data-t="11.000"' in text
    assert json.loads(Page(text).data)['events'] == [['A', 'bad', 11.0]]


@pytest.fixture(scope='module')
def ended(tmp_path_factory):
    return read_bag(make_flight(
        tmp_path_factory.mktemp('bags') / 'ended', 18.0,
        diagnostics=[('sim_node', 2, 9.0, 'failsafe <b>')]))


def test_a_bag_without_anything_to_plot_still_has_a_page(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 0.1, leave_out=[
        'imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure', 'ground_truth/odom',
        'optitrack/pose', 'estimate/odom', 'estimator/state', 'reference', 'motor_pwm']))
    made = report.of_one(bag, compare(bag))
    text = report.html(made)
    assert made.figures == [] and made.cards == [] and 'id="scene"' not in text
    assert Page(text).open == [] and '/mambo/sensor_tick' in text


def test_a_part_with_too_few_samples_is_named_in_place_of_a_number(one):
    few = [{**entry, 'rows': entry['rows'][:1], 'too_few': {'after take-off': 3}}
           for entry in one.sections[:1]]
    assert report._cards(few, 'A', 'B') == [
        ('position RMS', '–', 'after take-off, 3 samples: too few for statistics')]


def test_the_delay_names_who_is_late(two):
    row = {**two.sections[0]['rows'][0], 'delay': [-0.02, -0.03, None]}
    entry = {**two.sections[0], 'rows': [row], 'too_few': {}}
    assert report._cards([entry], 'one', 'other')[3] == ('delay', '25 ms', 'one ahead of other')


def test_the_page_is_the_same_for_the_same_flight_and_not_large(one, flights):
    text = report.html(one)
    assert report.html(report.of_one(flights[0], compare(flights[0]))) == text
    assert len(text) < 6_000_000


def test_numbers_keep_their_digits_and_never_are_infinite():
    assert report._numbers(np.array([0.0123456789, np.nan, np.inf])) == [
        pytest.approx(0.0123457, abs=5e-8), None, None]
    assert report._numbers(np.array([123456.789])) == [123457.0]
    assert report._numbers(np.array([1e300, -1e-300])) == pytest.approx([1e300, 0.0])
    assert report._numbers(np.zeros(1)) == [0.0] and report._numbers(np.zeros(0)) == []


@browser.NEEDED
def test_a_browser_draws_every_plot(two, tmp_path):
    tab = browser.opened(report.html(two), tmp_path)
    ready, live, layers = tab.evaluate("""
        return [document.documentElement.dataset.ready,
          document.querySelectorAll('[data-live="yes"]').length,
          document.querySelectorAll('.plot .scatterlayer').length];
    """)
    assert ready in ('webgl', 'flat')
    assert live == len(two.figures) + 1 and layers >= len(two.figures)


@pytest.fixture(scope='module')
def tab(ended, tmp_path_factory):
    page = report.html(report.of_one(ended, compare(ended)))
    return browser.opened(page, tmp_path_factory.mktemp('page'))


def place(tab):
    """Return the time of the replay, and where each cursor stands."""
    return tab.evaluate("""
        return [document.getElementById('clock').value,
          [...document.querySelectorAll('.cursor')].map((line) => line.style.transform),
          document.querySelectorAll('.plot[data-time]').length];
    """)


KEY = "document.body.dispatchEvent(new KeyboardEvent('keydown', { key: '%s', bubbles: true }));"


@browser.NEEDED
def test_keys_move_one_time_through_all_plots(tab):
    clock, before, count = place(tab)
    assert len(before) == count > 5
    tab.evaluate(KEY % 'ArrowRight')
    later, after, _ = place(tab)
    assert float(later.split()[0]) == pytest.approx(float(clock.split()[0]) + 0.1, abs=0.011)
    assert all(a != b for a, b in zip(before, after))
    tab.evaluate("document.querySelector('.when').click();")
    assert place(tab)[0] == '9.00 s'
    zoom = "return document.querySelector('#position .plot')._fullLayout.xaxis.range;"
    whole = tab.evaluate(zoom)
    tab.evaluate(KEY % '+' + 'await new Promise((done) => setTimeout(done, 500));')
    near = tab.evaluate(zoom)
    assert whole[0] < near[0] < 9.0 < near[1] < whole[1]
    tab.evaluate(KEY % '0' + 'await new Promise((done) => setTimeout(done, 500));')
    assert tab.evaluate(zoom) == whole


@browser.NEEDED
def test_events_are_marked_in_the_plots(tab):
    shapes = tab.evaluate("return document.querySelector('#height .plot').layout.shapes;")
    assert [s['path'] for s in shapes if s['type'] == 'path'][0] == 'M9,0L9,1'


@browser.NEEDED
def test_the_mode_bar_saves_the_points_as_csv_and_the_picture(tab):
    csv = tab.evaluate("""
        const saved = [], before = URL.createObjectURL;
        URL.createObjectURL = (blob) => { saved.push(blob); return '#'; };
        document.querySelector('#flow [data-do=csv]').click();
        URL.createObjectURL = before;
        return saved[0].text();
    """).splitlines()
    assert csv[0] == '"curve","axis","time [s]","value"'
    assert csv[1].startswith('"optical flow","forward [rad/s]",0,') and len(csv) > 1000
    assert tab.evaluate("""
        const made = await Plotly.toImage(document.querySelector('#flow .plot'));
        return made.slice(0, 22);
    """) == 'data:image/png;base64,'


@browser.NEEDED
def test_any_signal_is_drawn_against_any_other(tab):
    t, x, y, title = tab.evaluate("""
        const [across, up] = ['across', 'up'].map((name) => document.getElementById(name));
        const index = (choice, text) => [...choice.options].findIndex(
          (option) => option.textContent === text);
        across.selectedIndex = index(across, 'ground_truth/odom pose.pose.position.x');
        up.selectedIndex = index(up, 'motor_pwm pwm[2]');
        up.dispatchEvent(new Event('change'));
        const box = document.querySelector('#explore .plot');
        const { t } = JSON.parse(document.getElementById('data').textContent).signals;
        return [t, box.data[0].x, box.data[0].y, box.layout.yaxis.title.text];
    """)
    t, x, y = np.array([t, x, y], float)[:, :-1]  # the last may be that of another topic
    np.testing.assert_allclose(x, truth_position(t)[:, 0], atol=1e-3)
    turning = t > 0.999  # from the take-off on, t to 1 ms
    np.testing.assert_allclose(y, turning * (247.0 + 20.0 * np.sin(t + 2)), atol=0.02)
    assert title == 'motor_pwm pwm[2]'


def test_no_text_of_a_bag_can_hide_the_end_of_the_data(one):
    """A browser does not end the element at its end tag once it has read ``<!--<script>``."""
    evil = '/<!--<script>'
    made = one._replace(signals={**one.signals, 'names': [evil] * len(one.signals['names'])})
    page = report.html(made)
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', page)[1]
    assert '<' not in data
    assert json.loads(data)['signals']['names'] == made.signals['names']
    assert json.loads(data) == json.loads(Page(page).data)


@browser.NEEDED
def test_texts_of_a_bag_never_become_part_of_the_page(ended, tmp_path):
    evil = '</script><!--<script><img src=x onerror="window.hacked = 1">"\'<b>'
    made = report.of_one(ended, compare(ended))
    plot = made.figures[0]
    panel = plot.panels[0]._replace(
        title=evil, lines=[line._replace(name=evil) for line in plot.panels[0].lines])
    text = report.html(made._replace(
        title=evil, lead=evil, ending=[evil], cards=[(evil, evil, evil)], notes=[evil],
        details=[(evil, evil)], below=[(evil, [evil, evil], [[evil, evil]])],
        figures=[plot._replace(title=evil, text=evil, panels=[panel])],
        events=[events.Event(1.0, 'bad', evil)],
        signals={**made.signals, 'names': [evil] * len(made.signals['names'])}))
    tab = browser.opened(text, tmp_path)
    assert tab.evaluate("""
        document.querySelector('#across').dispatchEvent(new Event('change'));
        const bold = [...document.querySelectorAll('b')].filter((b) => !b.closest('figcaption'));
        return [window.hacked || 0, document.images.length, bold.length,
          document.querySelector('#across').options[1].textContent];
    """) == [0, 0, 0, evil]


@browser.NEEDED
def test_the_plots_of_a_bag_have_its_own_events_only(ended, flights, tmp_path):
    result, comparison, alignment = compare_bags(ended, flights[1])
    page = report.html(report.of_two(ended, flights[1], result, comparison, alignment))
    tab = browser.opened(page, tmp_path)
    count = [tab.evaluate(f"""
        return document.querySelector('#{name} .plot').layout.shapes.filter(
          (shape) => shape.path && shape.path.startsWith('M9,')).length;
    """) for name in ('position', 'bag-a-height', 'bag-b-height')]
    assert count == [1, 1, 0]


@browser.NEEDED
def test_the_mode_bar_is_seen_on_the_screen_and_one_stop_of_the_tab_key(tab):
    seen, stops, moved = tab.evaluate("""
        const bar = document.querySelector('.modebar');
        const buttons = [...bar.querySelectorAll('button')];
        const stops = buttons.filter((button) => button.tabIndex === 0).length;
        buttons[0].focus();
        buttons[0].dispatchEvent(
          new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true }));
        return [bar.checkVisibility(), stops, document.activeElement.dataset.do];
    """)
    assert (seen, stops, moved) == (True, 1, 'csv')
