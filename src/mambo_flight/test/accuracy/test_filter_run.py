"""The joint filter over recorded samples: what each column of its answer is."""

from mambo_estimation.joint import filter as joint
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_flight.accuracy import filter_run
from mambo_flight.offline_replay import Steps
import numpy as np
import pytest

N, DT = 400, 0.005  # two seconds: the alignment takes one


def still(n=N):
    """Return steps of a drone that stands on a level floor."""
    t = np.arange(n) * round(DT * 1e9)
    pressure = np.where(np.arange(n) % 3, np.nan, 101325.0)
    return Steps(
        t, np.full(n, DT), np.zeros((n, 3)), np.tile([0.0, 0.0, -9.81], (n, 1)),
        np.full(n, np.nan), np.full((n, 2), np.nan), np.zeros(n, np.int64), pressure,
        np.ones(n, np.bool_), np.zeros((n, 4), np.int64))


@pytest.fixture(scope='module')
def made():
    return filter_run.run(still(), JointParams())


@pytest.mark.long
def test_every_step_has_a_row_and_they_are_those_of_the_filter(made):
    """The last row, against the filter stepped by hand."""
    assert made.x.shape == (N, 24) and made.P.shape == (N, SIZE, SIZE)
    values, s = JointParams().values(), still()
    memory = joint.initial(values)
    for k in range(N):
        memory, answer = joint.step(
            memory, DT, tuple(s.gyro[k]), tuple(s.accel[k]), s.sonar[k], tuple(s.flow[k]), 0,
            s.pressure[k], values)
    x = memory.x
    expected = [*x.p, *x.v, *x.q, *x.gyro_bias, *x.accel_bias, x.scale, x.slope, *x.drag,
                x.latency, x.leak, x.range_offset, x.pressure_offset]
    np.testing.assert_array_equal(made.x[-1], expected)
    np.testing.assert_array_equal(made.P[-1], memory.P)
    np.testing.assert_array_equal(made.nu[-1], answer.state.nu)
    np.testing.assert_array_equal(
        made.twist[-1], np.reshape(answer.twist_covariance, (6, 6))[:3, :3])


def test_a_drone_that_stands_still_is_at_rest_and_level(made):
    assert made.resting.all()
    np.testing.assert_allclose(made.x[-1, 6:10], [1.0, 0.0, 0.0, 0.0], atol=1e-3)
    assert np.abs(made.nu).max() < 1e-3


def test_a_covariance_is_symmetric_and_has_no_negative_variance(made):
    for P in made.P[::50]:
        np.testing.assert_allclose(P, P.T, atol=1e-12)
        assert np.linalg.eigvalsh(P).min() > -1e-12
    assert not np.shares_memory(made.P[-1], made.P[-2])


def test_test_ratios_are_squared_innovations_over_their_variance(made):
    """The filter divides by its gate squared; without a sample there is no ratio."""
    seen = np.isfinite(made.ratios)
    assert not seen[:, :2].any()  # no sonar, no flow
    used = made.ratios[seen[:, 2], 2]
    assert len(used) > 20 and (used >= 0.0).all() and used.max() < 1.0  # exact pressures
