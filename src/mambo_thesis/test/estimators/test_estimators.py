"""The command ``mambo estimators``: which rows it compares, and what it prints."""

import json
from pathlib import Path

from mambo_model.errors import InputError
from mambo_thesis.estimators import estimators as command, simulated_rows
from mambo_thesis.estimators.case import Case
from mambo_thesis.estimators.paired_rows import Row
import numpy as np
import pytest

PAGE = Path(__file__).parents[4] / 'docs/evidence/estimators.md'


def made(seeds, others):
    return [Row('one', 'off [m]', 0.1, np.array([1.0] * len(seeds)),
                np.array([0.5] * len(seeds)), dict.fromkeys(others, 3.0))]


CASES = [Case('faults', 'accel stuck', made), Case('faults', 'gyro stuck', made),
         Case('thesis', 'circle', made)]


@pytest.fixture
def no_flight(monkeypatch):
    monkeypatch.setattr(simulated_rows, 'cases', lambda: CASES)


def test_rows_are_chosen_by_section_or_by_pattern():
    assert command.chosen(CASES, None) == CASES
    assert command.chosen(CASES, ['thesis']) == CASES[2:]
    assert command.chosen(CASES, ['faults/accel*', 'thesis/circle']) == [CASES[0], CASES[2]]
    with pytest.raises(InputError, match=r'--rows thesi: no such rows; .*did you mean thesis\?'):
        command.chosen(CASES, ['thesi'])
    with pytest.raises(InputError, match='no such recording; give DATA'):
        command.chosen(CASES, ['crazyflie'])


def test_an_interrupt_says_how_many_cases_were_compared(monkeypatch):
    def ended(seeds, others):
        raise KeyboardInterrupt
    cases = [CASES[0], Case('thesis', 'ended', ended)]
    monkeypatch.setattr(simulated_rows, 'cases', lambda: cases)
    with pytest.raises(KeyboardInterrupt, match='1 of 2 cases were done, none is kept'):
        command.main(['--seeds', '2'])


def test_the_command_prints_tables_and_the_decision(no_flight, capsys):
    assert command.main(['--seeds', '2', '--rows', 'faults', '--beside', 'toolbox']) == 0
    text = capsys.readouterr().out
    assert 'A sensor that fails in flight' in text and 'toolbox' in text
    assert text.splitlines()[-2:] == [
        'Of 2 rows the joint filter is better in 2, worse in 0; 0 are undecided.',
        'No row is worse.']
    assert command.main(['--seeds', '3', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['may_be_default'] and list(found['sections']) == ['faults', 'thesis']
    assert found['sections']['thesis'][0]['compared'] == 3


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--seeds', '0'], '--seeds: 0 must be within 1 to 10000'),
    (['--rows', 'nonesuch'], '--rows nonesuch: no such rows; sections are thesis, slopes'),
    (['--beside', 'kalman'], "--beside: 'kalman' is not one of toolbox"),
    (['nowhere'], 'nowhere: not a folder; docs/evidence/real_recordings.md')])
def test_wrong_input_is_one_line(arguments, message, no_flight, capsys):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(command.main(arguments))
    error = capsys.readouterr().err
    assert end.value.code in (1, 2) and message in error and error.count('\n') == 1


def test_a_short_comparison_flies_and_agrees_with_the_page(capsys):
    """Two flights of one case; the page has every simulated case, in the order of the command."""
    assert command.main(['--seeds', '2', '--rows', 'thesis/circle_rising', '--json']) == 0
    rows = json.loads(capsys.readouterr().out)['sections']['thesis']
    assert rows[0]['joint'] < 0.15 < rows[0]['kalman'] and rows[0]['bound'] < 0.05
    page = PAGE.read_text(encoding='utf-8')
    lines = [line.split(' | ')[0][2:] for line in page.splitlines() if line.startswith('| ')]
    for case in simulated_rows.cases():
        if case.section == 'faults':
            assert lines.count(case.name) == 2, case.name
    assert all(lines.count(name) == 5 for name in simulated_rows.PATHS.values())
    assert 'Of ' in page and 'rows the joint filter is better in' in page


def test_recordings_of_a_vehicle_have_a_row_over_all_of_them():
    recorded = [Case('crazyflie', name, made) for name in ('lab05', 'lab06')]
    found = command.compare([*CASES[2:], *recorded], range(2), [])
    assert [row.case for row in found['thesis']] == ['one']  # flights are not pooled
    assert [row.case for row in found['crazyflie']] == ['one', 'one', 'all flights']
    assert found['crazyflie'][-1].joint.tolist() == [0.5, 0.5]


def test_a_pattern_named_twice_compares_once_and_in_the_order_of_the_tables():
    assert command.chosen(CASES, ['thesis', 'faults/*', 'faults']) == CASES


def test_tables_are_markdown_on_request_and_numbers_go_to_a_file(no_flight, tmp_path, capsys):
    file = tmp_path / 'numbers.json'
    assert command.main(['--rows', 'thesis', '--markdown', '--json', str(file)]) == 0
    text = capsys.readouterr().out
    assert '| one | off [m] | 0.1 | 1 | 0.707 |' in text
    assert json.loads(file.read_text())['sections']['thesis'][0]['joint'] == pytest.approx(
        0.5 ** 0.5)


def test_the_firmware_is_looked_for_before_anything_is_flown(no_flight, monkeypatch, capsys):
    monkeypatch.delenv('CFFIRMWARE', raising=False)
    monkeypatch.setattr(command, 'compare', lambda *_: pytest.fail('flown'))
    name = command.FIRMWARE[0] if isinstance(command.FIRMWARE, tuple) else min(command.FIRMWARE)
    assert command.main(['--beside', name]) == 2
    error = capsys.readouterr().err
    assert 'CFFIRMWARE' in error and error.count('\n') == 1
