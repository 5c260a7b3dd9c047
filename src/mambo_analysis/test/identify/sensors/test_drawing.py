"""The figure of a recording's sensors: a panel for each thing known, none for what is not."""

from mambo_analysis.identify.allan import allan
from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors import drawing
from mambo_analysis.identify.sensors.drawing import draw
from matplotlib.figure import Figure
import numpy as np
import pytest

T = np.arange(100) * 0.04


@pytest.fixture
def drawn(monkeypatch):
    """Return the figures made, so that a test reads them and not their pixels."""
    figures = []

    def make(*args, **options):
        figures.append(Figure(*args, **options))
        return figures[-1]
    monkeypatch.setattr(drawing, 'Figure', make)
    return figures


def curves(*names):
    noise = np.random.default_rng(0).standard_normal(400)
    return {name: allan(noise, 200.0) for name in names}


def sonar():
    values = np.full(100, 1.0)
    values[[20, 70]], values[40] = (2.0, 0.4), np.nan
    return Stream(T, values)


def test_each_kind_has_its_panel_in_its_unit(tmp_path, drawn):
    shown = {'allan': curves('gyro x', 'gyro y', 'accel z'),
             'latency': (np.array([0.0, 5.0]), np.array([1.0, 0.5]))}
    assert draw(Recording('name.mat', sonar=sonar()), shown, tmp_path / 'a.png')
    assert (tmp_path / 'a.png').read_bytes()[:4] == b'\x89PNG'
    figure, = drawn
    assert figure.get_suptitle() == 'name.mat'
    gyro, accel, heard, latency = figure.axes
    assert (gyro.get_ylabel(), accel.get_ylabel()) == ('[rad/s]', '[m/s^2]')
    assert gyro.get_xscale() == gyro.get_yscale() == 'log'
    assert len(gyro.get_legend().get_texts()) == 2 and len(accel.get_legend().get_texts()) == 1
    assert heard.get_ylabel() == 'range [m]' and 'late by [ms]' in latency.get_xlabel()


def test_outliers_are_crosses_apart_from_the_values(tmp_path, drawn):
    nothing = {'allan': {}, 'latency': None}
    assert draw(Recording('r', sonar=sonar()), nothing, tmp_path / 'a.png')
    axis, = drawn[0].axes
    level, values, outliers = axis.lines
    np.testing.assert_array_equal(outliers.get_xydata(), [[20 * 0.04, 2.0], [70 * 0.04, 0.4]])
    assert len(values.get_xdata()) == 97 and (values.get_ydata() == 1.0).all()
    assert outliers.get_label() == 'outliers' and len(level.get_xdata()) == 99


def test_an_allan_point_has_its_interval(tmp_path, drawn):
    shown = curves('gyro x')
    draw(Recording('r'), {'allan': shown, 'latency': None}, tmp_path / 'a.png')
    line, _, (bars,) = drawn[0].axes[0].containers[0]
    curve = shown['gyro x']
    np.testing.assert_array_equal(line.get_xydata(), np.c_[curve.tau, curve.deviation])
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    np.testing.assert_allclose(ends, np.c_[curve.low, curve.high])


@pytest.mark.parametrize('heard', [None, Stream(T, np.full(100, np.nan))])
def test_nothing_to_show_writes_nothing(tmp_path, heard):
    assert not draw(Recording('r', sonar=heard), {'allan': {}, 'latency': None},
                    tmp_path / 'a.png')
    assert not list(tmp_path.iterdir())
