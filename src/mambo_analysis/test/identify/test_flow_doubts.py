"""What speaks against a factor of the flow: lag, axes, size, floor, copies and gyro."""

from pathlib import Path
from types import SimpleNamespace

from mambo_analysis.identify import flow, flow_doubts
from mambo_analysis.identify.regression import IdentifyError
from mambo_bags.reader import read_bag
import numpy as np
import pytest

BAG = Path(__file__).parents[4] / 'bags/circle_short'
T = 0.02 * np.arange(1000)


def moved(t):
    """Return velocity over depth, (n, 2) rad/s, of a hand's motion."""
    return np.stack([0.6 * np.sin(1.1 * t), 0.5 * np.sin(1.7 * t + 0.4)], axis=1)


def seen(lag=0.0, factor=(1.0, 1.0)):
    """Return a flow with noise and an offset."""
    noise = np.random.default_rng(3).standard_normal((len(T), 2))
    return np.array(factor) * moved(T - lag) + 0.03 * noise + [0.02, -0.01]


@pytest.mark.parametrize('lag', [-0.4, -0.2, 0.0, 0.1, 0.3])
def test_a_lag_is_found(lag):
    assert flow_doubts.late(T, seen(lag), moved(T)) == pytest.approx(lag, abs=0.011)


def test_noise_alone_has_no_lag():
    noise = np.random.default_rng(4).standard_normal((len(T), 2))
    assert flow_doubts.late(T, noise, moved(T)) == 0.0


@pytest.mark.parametrize(('lag', 'said'), [
    (0.3, 'the flow is 0.30 s late against the motion capture: .* --shift 0.30'),
    (-0.2, 'the flow is 0.20 s early against the motion capture: .* --shift -0.20')])
def test_another_clock_is_refused(lag, said):
    with pytest.raises(IdentifyError, match=said):
        flow_doubts.refuse_late(T, seen(lag), moved(T))


def test_the_lag_of_a_sensor_is_a_note_with_its_remedy():
    for lag in (0.0, 0.005, -0.005):
        assert flow_doubts.refuse_late(T, seen(lag), moved(T)) == []
    for lag in (0.02, 0.03, 0.1, -0.03):
        line, = flow_doubts.refuse_late(T, seen(lag), moved(T))
        found = flow_doubts.small_lag(T, seen(lag), moved(T))
        assert found.low <= lag <= found.high and found.value == pytest.approx(lag, abs=0.003)
        assert line.endswith(f'which may look like a slope of Q: --shift {found.value:.3f} '
                             'allows for it')
    few = slice(0, 80)
    assert flow_doubts.small_lag(T[few], seen()[few], moved(T)[few]) is None


def test_axes_of_two_factors_are_noted():
    assert flow_doubts.unequal(seen(), moved(T)) == []
    assert flow_doubts.unequal(seen(factor=(0.97, 1.03)), moved(T)) == []
    line, = flow_doubts.unequal(seen(factor=(1.2, 1.0)), moved(T))
    assert line.startswith('the flow along x is 1.20 times that along y for one motion')


def test_a_factor_of_no_sensor_is_noted():
    assert flow_doubts.size(1.06) == flow_doubts.size(0.66) == []
    assert '2.05; 0.6 to 1.7 are usual' in flow_doubts.size(2.05)[0]


def test_the_floor_of_the_motion_capture_is_compared_with_the_range(monkeypatch):
    bag = read_bag(BAG)
    tracked = flow_doubts.motion.read(bag, 'optitrack/pose')
    assert flow_doubts.floor(bag, tracked) == []
    beside = flow_doubts.height_check.beside

    def raised(bag, tracked):
        ranges, position = beside(bag, tracked)
        return ranges, position + [0.0, 0.0, off]
    monkeypatch.setattr(flow_doubts.height_check, 'beside', raised)
    for off, more in ((0.2, '0.20 m more'), (0.05, '0.05 m more'), (-0.05, '0.05 m less')):
        line, = flow_doubts.floor(bag, tracked)
        assert f'above the floor is {more} than' in line and f'--floor {off:.2f} allows' in line
        assert flow_doubts.floor(bag, tracked, off) == []


def test_doubled_flow_is_refused_with_topic_and_time(monkeypatch):
    class Doubled(dict):
        start = 10**9
    monkeypatch.setattr(flow_doubts.height_check, 'of_bag', lambda bag: [])
    stamps = np.array([2, 3, 4, 5]) * 10**9
    flow_doubts.refuse(Doubled(optical_flow=SimpleNamespace(stamp=stamps)))
    twice = Doubled(optical_flow=SimpleNamespace(stamp=np.append(stamps, [4 * 10**9])))
    with pytest.raises(IdentifyError, match='optical_flow has 1 messages with the stamp of anoth'
                                            'er one, the first at 3.000 s'):
        flow_doubts.refuse(twice)


@pytest.mark.parametrize('signs', [(-1.0, -1.0, 1.0), (1.0, -1.0, -1.0)])
def test_a_gyro_that_contradicts_the_attitude_is_refused(monkeypatch, signs):
    compare = flow_doubts.gyro_check.compare
    monkeypatch.setattr(flow_doubts.gyro_check, 'compare', lambda t, gyro, *tracked: compare(
        t, gyro * signs, *tracked))
    with pytest.raises(IdentifyError, match='circle_short: imu/data_raw and optitrack/pose: '):
        flow.read(BAG, 0.0, -np.inf, np.inf, 0.0, None)
