"""The names of a Crazyflie log's signals."""

from mambo_analysis.importers.checks.crazyflie_doubts import TOGETHER
from mambo_analysis.importers.crazyflie_names import GYRO, MOTORS, ODOMETRY, USED


def test_what_is_taken_together_is_used():
    assert {name for _, names in TOGETHER for name in names} <= {*USED, *GYRO}
    assert len(set(USED)) == len(USED)
    assert set(MOTORS) == {'m_1', 'm_2', 'm_3', 'm_4'} and len(ODOMETRY) == 12
