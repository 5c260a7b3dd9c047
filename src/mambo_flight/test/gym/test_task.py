"""The numbers of the task and its spaces are those of the page."""

import dataclasses
import math
from pathlib import Path
import re

from hypothesis import given, strategies as st
from mambo_flight.gym.task import ACTIONS, commanded, OBSERVED, STATE, TaskParams
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import pytest

PAGE = Path(__file__).parents[4] / 'docs/how-to/gymnasium.md'


def rows(text):
    """Return the cells of every row of every table."""
    return [[cell.strip() for cell in line.strip('|').split('|')]
            for line in text.splitlines() if line.startswith('|')]


def test_the_page_has_every_number_of_the_task_with_default_and_unit():
    told = {row[0].strip('`'): row[1:3] for row in rows(PAGE.read_text())}
    for field in dataclasses.fields(TaskParams):
        assert told[field.name] == [f'{field.default:g}', field.metadata['unit']], field.name


def test_the_page_has_every_column_of_the_observation():
    told = []
    for row in rows(PAGE.read_text()):
        if found := re.fullmatch(r'(\d+)-(\d+)', row[0]):
            first, last = map(int, found.groups())
            told += [(i, row[2]) for i in range(first, last + 1)]
    assert told == [(i, channel.unit) for i, channel in enumerate(OBSERVED)]


def test_the_page_has_every_number_of_every_action():
    told = {row[0].strip('`'): row[1] for row in rows(PAGE.read_text())}
    for action in ACTIONS:
        for channel in commanded(action, Vehicle()):
            assert f'`{channel.name}`' in told[action], channel
            assert channel.unit in told[action], channel


def test_times_are_whole_control_steps():
    task = TaskParams()
    assert [task.ticks(s) for s in (0.0, 0.005, 0.0125, 10.0)] == [0, 1, 2, 2000]


@given(limit=st.floats(0.01, math.pi))
def test_the_cosine_of_the_limit_separates_tilts_within_from_tilts_beyond(limit):
    cosine = TaskParams(tilt_limit=limit).values().tilt_cosine
    assert math.cos(0.99 * limit) > cosine
    assert limit > 3.1 or math.cos(limit + 0.01) < cosine


def test_actions_have_the_range_of_the_vehicle():
    heavy = Vehicle(mass=0.08, pwm_max=400.0)
    motors = commanded('pwm', heavy)
    assert [(c.name, c.low, c.high) for c in motors] == [
        (f'motor_{i}', 0.0, 400.0) for i in (1, 2, 3, 4)]
    *angles, thrust = commanded('attitude_thrust', heavy)
    assert (thrust.unit, thrust.low) == ('N', 0.0)
    assert thrust.high == pytest.approx(2.0 * 0.08 * heavy.gravity)  # hover is in the middle
    assert [c.name for c in angles] == ['roll', 'pitch', 'yaw']
    assert all(c.low == -c.high for c in (*angles, *commanded('setpoint', heavy)))


def test_an_observation_names_each_number_once_and_begins_with_the_state():
    names = [channel.name for channel in OBSERVED]
    assert tuple(names[:13]) == STATE and len(set(names)) == len(names)
    assert all(channel.low == -channel.high for channel in OBSERVED)


@pytest.mark.parametrize(('name', 'value'), [
    ('handover', -1.0), ('episode', 0.0), ('repeat', 0), ('tilt_limit', 4.0), ('alive', math.nan)])
def test_a_task_that_cannot_be_is_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name):
        TaskParams(**{name: value})
