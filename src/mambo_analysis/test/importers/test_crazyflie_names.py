"""The names of a Crazyflie log's signals."""

from mambo_analysis.importers.checks.crazyflie_doubts import TOGETHER
from mambo_analysis.importers.crazyflie_names import (
    GYRO, like_commands, MOTORS, ODOMETRY, QUANTITIES, select, USED)
import numpy as np
import pytest


def test_what_is_taken_together_is_used():
    assert {name for _, names in TOGETHER for name in names} <= set(USED)
    assert len(set(USED)) == len(USED)
    assert set(MOTORS) == {'m_1', 'm_2', 'm_3', 'm_4'} and len(ODOMETRY) == 12


def test_each_quantity_has_as_many_names_in_the_firmware():
    assert {name for one in QUANTITIES for name in one.course} == set(USED)
    assert all(len(names) == len(one.course) for one in QUANTITIES for names in one.firmware)


def signals(*names):
    return {name: (np.arange(3.0), np.full(3, k + 1.0)) for k, name in enumerate(names)}


RATES = ('w_x', 'w_y', 'w_z')


@pytest.mark.parametrize(('there', 'taken', 'doubled', 'ignored'), [
    (RATES, {}, 0, []),
    (GYRO, dict(zip(RATES, GYRO)), 0, []),
    (RATES + GYRO, {}, 1, []),
    (RATES[:2] + GYRO, dict(zip(RATES, GYRO)), 0, ['w_x', 'w_y']),
    (RATES[:2] + GYRO[:1], {}, 0, ['gyro.x']),
    (GYRO[:1], dict(zip(RATES, GYRO)), 0, []),  # of which the others are missing
    (RATES + ('d0', 'lighthouse.x'), {}, 0, ['d0', 'lighthouse.x'])])
def test_the_course_s_signals_come_first_if_they_are_complete(there, taken, doubled, ignored):
    chosen = select(signals(*there))
    assert chosen.origin == taken and len(chosen.doubled) == doubled
    assert chosen.ignored == ignored
    for name, (_, values) in chosen.signals.items():
        source = taken.get(name, name)
        unit = np.pi / 180.0 if source in GYRO else 1.0
        np.testing.assert_allclose(values, unit * (1.0 + there.index(source)))


def test_an_attitude_of_the_stabilizer_goes_with_an_estimate_without_one():
    names = [f'stateEstimate.{name}' for name in ('x', 'y', 'z', 'vx', 'vy', 'vz')]
    attitude = [f'stabilizer.{name}' for name in ('yaw', 'pitch', 'roll')]
    chosen = select(signals(*names, *attitude))
    assert [chosen.origin[name] for name in ('psi', 'theta', 'phi')] == attitude
    assert chosen.signals['theta'][1][0] < 0.0 < chosen.signals['phi'][1][0]


def test_a_heading_of_the_firmware_goes_on_beyond_half_a_turn():
    found = signals(*QUANTITIES[6].firmware[0])
    found['stateEstimate.yaw'] = np.arange(3.0), np.array([170.0, 179.0, -172.0])
    heading = select(found).signals['psi'][1]
    np.testing.assert_allclose(np.degrees(heading), [170.0, 179.0, 188.0])


def test_names_that_may_be_commands():
    names = ['pwm.m1_pwm', 'motorPower.m2', 'm_3', 'sim.motor4', 'extravars.sum_1', 'pm.vbat']
    assert like_commands(names) == names[:4]
