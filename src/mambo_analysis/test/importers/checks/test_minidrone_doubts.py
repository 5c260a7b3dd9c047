"""Doubts about real logs of a Rolling Spider: none as they are, one for each part changed."""

import dataclasses
import functools
from pathlib import Path

from mambo_analysis.importers.checks.minidrone_doubts import onboard_doubts, sensor_doubts
from mambo_analysis.importers.common import read_source
from mambo_analysis.importers.mat_file import variables
from mambo_analysis.importers.minidrone import read_log
import pytest

FLIGHTS = sorted((Path(__file__).resolve().parents[6] / 'shared' / 'data'
                  / 'rolling_spider_flights').glob('*.mat'))
ON_ITS_SIDE = '1a_y_rest__5230543'
FLOWN = [path for path in FLIGHTS if path.stem.startswith(('RSdata_', 'p9_', 'square_'))]
needs_data = pytest.mark.skipif(
    not FLIGHTS, reason='flight logs are not beside the repo (../shared/data)')


@functools.cache
def plain(path):
    source = read_source(path)
    return read_log(source, variables(path, source.content))


def read(path, **changes):
    """Return a log, with signals made from it by {name: function of the log}."""
    log = plain(path)
    return dataclasses.replace(log, signals={
        **log.signals, **{name: change(log.signals) for name, change in changes.items()}})


def doubts(log):
    return sensor_doubts(log, 20.0) + onboard_doubts(log)


@needs_data
@pytest.mark.parametrize('path', FLIGHTS, ids=lambda path: path.stem)
def test_nothing_is_said_about_real_flights(path):
    found = doubts(read(path))
    if path.stem == ON_ITS_SIDE:
        assert [line.split(':')[0] for line in found] == [
            'ddzb has a median of 1.17 m/s^2, usual are -13 to -7']
    else:
        assert not found


@needs_data
@pytest.mark.parametrize('name, change, begins', [
    ('ddzb', lambda s: -s['ddzb'], ['ddzb has a median of ']),
    ('ddzb', lambda s: s['ddxb'], ['the length of ddxb, ddyb, ddzb has a median of ']),
    ('pa', lambda s: -s['pa'], ['pa turns as the -roll rate']),
    ('pa', lambda s: s['qa'], ['pa turns as the pitch rate']),
    ('qb', lambda s: -s['qb'], ['qa turns as the -pitch rate']),
    ('rb', lambda s: -s['rb'], ['ra turns as the -yaw rate']),
    ('X', lambda s: 1000.0 * s['X'], ['X moves ']),
    ('Y', lambda s: -s['Y'], ['Y moves ']),
    ('Y', lambda s: s['X'], ['Y moves ']),
    ('Z', lambda s: -s['Z'], ['Z moves ']),
    ('Z', lambda s: 1000.0 * s['Z'], ['Z moves ', 'altitude_sonarb is 0.001']),
    ('dx', lambda s: -s['dx'], ['X moves ', 'Y moves ']),
    ('yaw', lambda s: s['yaw'] + 0.8, ['X moves ', 'Y moves ']),
    ('altitude_sonarb', lambda s: s['altitude_sonarb'] / 0.3048, ['altitude_sonarb is ']),
    ('altitude_sonarb', lambda s: s['altitude_sonarb'] * 0.5, ['altitude_sonarb is 0.']),
    ('altitude_sonarb', lambda s: s['altitude_sonarb'] * 2.0, ['altitude_sonarb is ']),
    ('motors_refout', lambda s: s['motors_refout'] / 500.0, ['motors_refout has a median of 0.']),
])
def test_each_part_that_was_changed_is_told_of_real_flights(name, change, begins):
    """Of all eight in the air, but for one that moves along x as along y (Y that is X)."""
    missed = [path.stem for path in FLOWN if not any(
        line.startswith(begin) for line in doubts(read(path, **{name: change}))
        for begin in begins)]
    assert missed in ([], ['RSdata_exampleflight__5c88b34'] if name == 'Y' else [])


@needs_data
def test_too_few_samples_aloft_say_nothing_about_heights():
    log = read(FLIGHTS[-1], altitude_sonarb=lambda s: 0.0 * s['altitude_sonarb'])
    assert not onboard_doubts(log)
