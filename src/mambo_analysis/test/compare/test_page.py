"""The page of a flight: complete, self-contained, the same colour for the same signal."""

from html.parser import HTMLParser
import re

from mambo_analysis.compare import figures
from mambo_analysis.compare.compare import compare, phases
from mambo_analysis.compare.page import html, write_page
from mambo_bags.reader import read_bag
from mambo_model import palette
from mambo_signals import metrics
from matplotlib import pyplot as plt
from matplotlib.image import imread
import numpy as np
import pytest
from synthetic import E_TOTAL, make_flight, VARIANCE


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return read_bag(make_flight(tmp_path_factory.mktemp('bags') / 'fl <i> ght', 18.0, noise=0.001))


@pytest.fixture(scope='module')
def page(flight):
    return html(flight, compare(flight))


class Checker(HTMLParser):
    """Collects tags, ids and references; every tag that opens must close."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.references, self.labels, self.tags = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.append(tag)
        if tag not in ('meta', 'br', 'img', 'use', 'path'):
            self.open.append(tag)
        self.ids += [attrs['id']] if 'id' in attrs else []
        if tag == 'svg':
            assert attrs['role'] == 'img'
            self.labels.append(attrs['aria-label'])
        self.references += [v for k, v in attrs.items() if v and ('href' in k or k == 'src')]
        self.references += re.findall(r'url\((.*?)\)', ' '.join(v or '' for v in attrs.values()))

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in ('meta', 'br', 'img', 'use', 'path'):
            assert self.open.pop() == tag


def test_page_is_whole_and_needs_nothing_from_elsewhere(page):
    checker = Checker()
    checker.feed(page)
    assert checker.open == []
    assert len(checker.ids) == len(set(checker.ids))
    for reference in checker.references:
        assert reference.startswith(('#', 'data:image/png;base64,')), reference[:80]
        if reference.startswith('#'):
            assert reference[1:] in checker.ids
    assert not re.search(r'(src|href)="https?:', page) and '<script' not in page


def test_every_figure_has_a_text_for_those_who_do_not_see_it(page, flight):
    checker = Checker()
    checker.feed(page)
    assert len(checker.labels) == len(figures.plots(flight)) == 8
    assert all(len(label) > 40 for label in checker.labels)


def test_page_follows_light_and_dark_and_narrow_screens(page):
    assert 'prefers-color-scheme:dark' in page and 'width=device-width' in page
    figure = page.partition('</style>')[2]
    assert not any(colour in figure for colour in palette.COLOURS.values())
    assert 'var(--ink)' in page.partition('</style>')[2]


def test_letters_have_the_size_that_their_distances_are_for(page):
    scales = set(re.findall(r'transform="scale\(([\d.]+)\)"', page))
    assert scales == {'0.015625'}  # 64 units of the font a point


def test_page_escapes_names_and_shows_the_numbers_of_the_table(page):
    assert 'fl &lt;i&gt; ght' in page and '<i>' not in page
    for text in ('0.0374', 'real-time factor 4.25', 'take-off ends at 8.00 s', 'scenario.yaml'):
        assert text in page


def test_page_is_the_same_for_the_same_flight(page, flight):
    assert html(flight, compare(flight)) == page


def test_files_are_written_and_replaced(flight, tmp_path):
    out = tmp_path / 'deep' / 'page'
    for _ in range(2):
        assert write_page(flight, compare(flight), out) == out / 'index.html'
    image = imread(out / 'flight.png')
    assert image.shape[1] > 1000 and image[..., :3].std() > 0.05


def drawn(flight, name):
    plot = next(plot for plot in figures.plots(flight) if plot.name == name)
    return figures.figure_of(plot, flight)


def test_signals_keep_their_colour_in_every_figure(flight):
    wanted = {'reference': 'reference', 'estimate': 'estimate', 'Optitrack': 'optitrack',
              'ground truth': 'truth'}
    for name in ('position', 'path', 'height'):
        lines = {line.get_label(): line.get_color()
                 for line in drawn(flight, name).axes[0].get_lines()}
        for label, colour in wanted.items():
            if label in lines:
                assert lines[label] == palette.COLOURS[colour]
    flow, = drawn(flight, 'flow').axes[0].get_lines()
    assert flow.get_color() == palette.COLOURS['flow']


def test_every_axis_has_its_unit(flight):
    for plot in figures.plots(flight):
        shown = [ax for ax in figures.figure_of(plot, flight).axes if ax.axison]
        for ax in shown:
            assert re.search(r'\[.+\]$', ax.get_ylabel()), plot.name
        assert re.search(r'\[(s|m)\]$', shown[-1].get_xlabel()), plot.name


def test_error_figure_shows_the_error(flight):
    lines = drawn(flight, 'errors').axes[0].get_lines()
    estimation = next(line for line in lines if line.get_label().startswith('estimation'))
    # known error, noise of 1 mm an axis
    assert np.nanmedian(estimation.get_ydata()) == pytest.approx(E_TOTAL, abs=0.002)


def test_band_of_the_filter_is_three_standard_deviations(flight):
    for ax, variance in zip(drawn(flight, 'covariance').axes, VARIANCE[:3]):
        heights = ax.collections[0].get_paths()[0].vertices[:, 1]
        assert heights.max() == -heights.min() == pytest.approx(3.0 * np.sqrt(variance))


def test_refused_samples_are_counted(flight):
    state = flight['estimator/state']
    refused = int((state.sonar_test_ratio > 1.0).sum())
    taken = int(np.isfinite(state.sonar_innovation).sum())
    axes = drawn(flight, 'innovations').axes
    assert axes[0].get_title(loc='right') == f'{refused} of {taken} refused' and refused > 0
    assert len(axes) == 3  # the barometer was never used


def test_thinning_keeps_the_peaks():
    t = np.arange(100_000) * 0.005
    values = np.zeros(100_000)
    values[[12_345, 54_321]] = [7.0, -9.0]
    values[20_000:30_000] = np.nan
    thin_t, thin = metrics.envelope(t, values, figures.POINTS)
    assert len(thin) <= figures.POINTS + 200
    assert (np.nanmax(thin), np.nanmin(thin)) == (7.0, -9.0)
    assert np.isnan(thin).any() and (np.diff(thin_t) >= 0).all()


def test_a_bag_without_anything_to_plot_still_has_a_page(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 0.1, leave_out=[
        'imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure', 'ground_truth/odom',
        'optitrack/pose', 'estimate/odom', 'estimator/state', 'reference', 'motor_pwm']))
    assert figures.plots(bag) == [] and phases(bag).takeoff_end is None
    write_page(bag, compare(bag), tmp_path / 'page')
    assert (tmp_path / 'page' / 'flight.png').is_file()


@pytest.mark.parametrize('value', [np.inf, -np.inf, np.nan])
def test_motor_commands_that_are_not_finite_are_no_reason_to_have_no_page(tmp_path, value):
    bag = read_bag(make_flight(tmp_path / 'flight', 4.0))
    for rows in (slice(100, 110), slice(None)):
        bag['motor_pwm'].pwm[rows] = value
        figure, axes = plt.subplots(4)
        figures.draw_motors(list(axes), bag, phases(bag))
        assert np.isfinite([ax.get_ylim() for ax in axes]).all()
        plt.close(figure)
