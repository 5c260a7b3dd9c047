"""Doubts about real logs of a Crazyflie: none as they are, one for each part changed."""

import dataclasses
import functools
from pathlib import Path

from mambo_analysis.importers.checks.crazyflie_doubts import unusual
from mambo_analysis.importers.common import read_source
from mambo_analysis.importers.crazyflie import read_log
import pytest

LOGS = sorted((Path(__file__).resolve().parents[6] / 'shared' / 'data'
               / 'crazyflie_optitrack').glob('*.json'))
SQUARES = [path for path in LOGS if 'lab02' in path.stem or 'lab07_square' in path.stem]
needs_data = pytest.mark.skipif(
    not LOGS, reason='Crazyflie logs are not beside the repo (../shared/data)')


@functools.cache
def plain(path):
    return read_log(read_source(path))


def changed(path, names, factor):
    """Return a log whose signals are those of other names, times a factor."""
    log = plain(path)
    return dataclasses.replace(log, drone=log.drone | {
        name: (log.drone[source][0], factor * log.drone[source][1])
        for name, source in names.items()})


@needs_data
@pytest.mark.parametrize('path', LOGS, ids=lambda path: path.stem)
def test_nothing_is_said_about_real_flights(path):
    assert not unusual(plain(path))


@needs_data
@pytest.mark.parametrize('path', SQUARES, ids=lambda path: path.stem)
@pytest.mark.parametrize('names, factor, said', [
    ({'v_x': 'v_y', 'v_y': 'v_x'}, 1.0, ['onboard/odom: v_x shows the motion of p_y',
                                         'onboard/odom: v_y shows the motion of p_x']),
    ({'v_x': 'v_x'}, -1.0, ['onboard/odom: v_x shows the motion of -p_x']),
    ({'p_z': 'p_z'}, -1.0, ['onboard/odom: v_z shows the motion of -p_z']),
    ({'n_x': 'n_y', 'n_y': 'n_x'}, 1.0, ['optical_flow: n_x shows the motion along y',
                                         'optical_flow: n_y shows the motion along x']),
    ({'n_y': 'n_y'}, -1.0, ['optical_flow: n_y shows the motion along -y']),
    ({f'p_{x}_des': f'p_{x}_des' for x in 'xyz'}, 1000.0, [
        'onboard/reference: the goals are ']),
    ({f'm_{k}': f'm_{k}' for k in (1, 2, 3, 4)}, 0.01, ['motor_pwm: the commands are up to 655']),
    ({'m_1': 'm_3'}, 1.0, ['motor_pwm: m_1 and m_3 are the same throughout, the others differ']),
])
def test_each_part_that_was_changed_is_told(path, names, factor, said):
    found = unusual(changed(path, names, factor))
    assert all(any(line.startswith(begin) for line in found) for begin in said), found
