"""The step computes the same bits wherever it is called from, and fast."""

import time

from estimation_truth import circle, COLUMNS, estimate, fly, Run, run_rows, sense, TYPICAL
from mambo_estimation import kalman
from mambo_estimation.kalman import EstimatorParams
from mambo_estimation.measurements.barometer import BarometerParams
import numpy as np
import pytest

PARAMS = EstimatorParams(barometer=BarometerParams(enabled=True))
TRUTH = fly(circle(), 12.0)
SAMPLES = sense(TRUTH, TYPICAL, seed=21)


def flatten(x):
    if isinstance(x, tuple):
        return [number for element in x for number in flatten(element)]
    return [float(x)]


def alone(samples, params):
    """Call the step from Python, sample by sample, as the node does."""
    m, values, out = kalman.initial(params.values()), params.values(), []
    for k in range(len(samples.dt)):
        m, e = kalman.step(
            m, float(samples.dt[k]), tuple(samples.gyro[k].tolist()),
            tuple(samples.accel[k].tolist()), float(samples.sonar[k]),
            tuple(samples.flow[k].tolist()), int(samples.quality[k]),
            float(samples.pressure[k]), values)
        out.append(e)
    return m, out


@pytest.mark.long
def test_same_bits_alone_and_in_a_compiled_loop():
    loop = estimate(SAMPLES, PARAMS)
    memory, estimates = alone(SAMPLES, PARAMS)
    assert flatten(memory) == flatten(loop.memory)
    last = Run(loop.rows, None)
    for k in range(0, len(estimates), 7):
        e = estimates[k]
        np.testing.assert_array_equal(flatten(e.state), np.concatenate([
            last.rho[k], last.nu[k], last.q[k], last.omega[k]]))
        np.testing.assert_array_equal(e.pose_covariance, last.pose_covariance[k].ravel())
        np.testing.assert_array_equal(e.twist_covariance, last.twist_covariance[k].ravel())
        np.testing.assert_array_equal(e.flow_innovation, last.flow_innovation[k])


@pytest.mark.long
def test_two_runs_give_the_same_bits():
    np.testing.assert_array_equal(estimate(SAMPLES).rows, estimate(SAMPLES).rows)


def test_step_does_not_change_its_memory():
    m = kalman.initial(PARAMS.values())
    before = flatten(m)
    kalman.step(m, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), 1.0, (0.1, 0.1), 255, 1e5,
                PARAMS.values())
    assert flatten(m) == before


def test_a_step_costs_microseconds_in_a_compiled_loop():
    s, values = SAMPLES, PARAMS.values()
    out, best = np.empty((len(s.dt), COLUMNS)), np.inf
    for _ in range(10):
        start = time.perf_counter()
        run_rows(kalman.initial(PARAMS.values()), s.dt, s.gyro, s.accel, s.sonar, s.flow,
                 s.quality.astype(np.int64), s.pressure, values, out)
        best = min(best, time.perf_counter() - start)
    # 1 to 2 us on an idle core; the bound is for busy machines
    assert best / len(s.dt) < 10e-6
