"""The comparison as tables, and what it says about the default."""

import math

from mambo_thesis.estimators import paired_table
from mambo_thesis.estimators.paired_rows import Row
import numpy as np

GOOD = Row('(5.4)', 'drift [m]', 0.03, np.array([1.0, 1.2, 0.9]), np.array([0.01, 0.01, 0.02]),
           {'toolbox': 2.0})
BAD = Row('lab', 'height [m]', math.nan, np.array([0.01]), np.array([0.04]), {})
NOISE = Row('hover', 'drift [m]', 0.1, np.array([1.0, 2.0]), np.array([2.0, 1.1]), {})


def test_a_section_shows_bound_errors_difference_and_who_is_better():
    assert paired_table.section('thesis', [GOOD]).markdown().splitlines()[2:] == [
        '| case | quantity | bound | kalman | joint | toolbox | joint / kalman - 1 [%] | 95 % '
        '| better |', '| --- ' + '| ---: ' * 8 + '|',
        '| (5.4) | drift [m] | 0.03 | 1.02 | 0.115 | 2 | -88.9 | -94.2 to -78.8 | joint |']
    single = paired_table.section('crazyflie', [BAD]).markdown().splitlines()[-1]
    assert single == '| lab | height [m] | - | 0.1 | 0.2 | +100.0 |  | kalman |'


def test_one_row_that_is_worse_forbids_the_default_and_is_named():
    found = {'thesis': [GOOD], 'crazyflie': [BAD]}
    assert not paired_table.may_be_default(found)
    assert paired_table.decision(found).splitlines() == [
        'Of 2 rows the joint filter is better in 1, worse in 1; 0 are undecided.',
        '- worse: Crazyflie against motion capture, lab, height [m]: 0.2 against 0.1',
        'As it is worse in a row, it should not be the default estimator.']


def test_a_difference_within_chance_is_named_but_forbids_nothing():
    found = {'thesis': [GOOD, NOISE]}
    assert paired_table.may_be_default(found)
    lines = paired_table.decision(found).splitlines()
    assert lines[1].startswith('- larger, but undecided: ') and 'hover, drift [m]' in lines[1]
    assert lines[-1] == 'No row is worse.'


def test_json_has_no_number_that_json_does_not_know():
    found = paired_table.numbers({'crazyflie': [BAD]})
    one = found['sections']['crazyflie'][0]
    assert one['bound'] is None and one['better'] == 'kalman' and one['compared'] == 1
    assert one['ratio'][1:] == [None, None] and not found['may_be_default']
