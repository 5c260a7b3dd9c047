"""A vehicle carried by hand is where the hand is, level, and feels what it should."""

from mambo_model.motion.trajectory import flat_output, FlightPlanParams
from mambo_sim import simulator
from mambo_sim.hand import HandParams
from mambo_sim.sensors.imu import ImuParams
from mambo_sim.simulator import advance, generators, initial_state, sense, SimulatorParams
import numpy as np
import pytest

PLAN = FlightPlanParams(trajectory='hand_loop')
CARRIED = SimulatorParams(
    hand=HandParams(enabled=True, plan=PLAN), noise=False, imu=ImuParams(accel_resolution=0.0))


@pytest.mark.long
def test_it_is_where_the_hand_is_whatever_the_motors_do():
    values, rngs, state = CARRIED.values(), generators(1), initial_state(CARRIED)
    for tick in range(2400):
        state, samples = sense(state, tick, rngs, values)
        body, (rho, v, a, *_) = state.plant.body, flat_output(tick * 0.005, PLAN.values())
        assert body.rho == rho and body.nu == v and body.q == (1.0, 0.0, 0.0, 0.0)
        assert samples.gyro == (0.0, 0.0, 0.0)
        # the bandwidth of the accelerometer, a lag of a few ms of a jerk below 3 m/s^3
        assert samples.accel == pytest.approx((a[0], a[1], a[2] - 9.81), abs=0.05)
        if samples.flow_new and -rho[2] > 0.5:
            height = -rho[2]
            assert samples.flow[0] * height * (0.92 + 0.07 * min(height, 2.5)) == pytest.approx(
                v[0], abs=0.06)
        state = advance(state, (300.0,) * 4, False, values)
    assert np.ptp([state.plant.body.rho[2]]) == 0.0


def test_a_vehicle_without_a_hand_does_not_know_of_it():
    assert SimulatorParams().values().hand is None
    assert simulator.SimulatorParams(hand=HandParams(plan=PLAN)).values() == (
        SimulatorParams().values())
