"""The numbers of the task and its spaces are those of the page."""

import dataclasses
from pathlib import Path
import re

from mambo_flight.gym.task import ACTIONS, commanded, OBSERVED, TaskParams
from mambo_model.vehicle.parameters import Vehicle

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
