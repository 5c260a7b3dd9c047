"""The angular acceleration is found again; offsets come from the past, or from other flights."""

from flown import flight, SPIN, steered, TRUE
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.twin.recorded import MIX
from mambo_analysis.twin.torque import fit_torque, integrate, joined, prepare, TorqueModel
from mambo_model.vehicle.motor_mixer import mix
from mambo_model.vehicle.parameters import preset
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

LEANING = SPIN._replace(offset=(0.6, -0.4, 0.2))


def errors(start, model):
    p, v, turn = integrate(start, TRUE, model)
    return [np.abs(x).max() for x in (
        p - start.end[0], v - start.end[1],
        (turn.inv() * Rotation.from_quat(start.end[2])).magnitude())]


def test_the_mix_is_that_of_the_vehicle():
    """Its body is FRD: pitch and yaw have the other sign there; its length is the arm."""
    vv = preset('crazyflie').values()
    for j, thrust in enumerate(np.eye(4).tolist()):
        _, (roll, pitch, yaw) = mix(tuple(thrust), vv)
        assert MIX[:, j] == pytest.approx([roll / vv.arm, -pitch / vv.arm, -yaw / vv.yaw_ratio])


def test_the_true_model_predicts_to_the_last_digits():
    for past in (0.0, 1.0):
        assert max(errors(prepare(steered(), TRUE, 0.5, past), SPIN)) < 1e-9


@pytest.mark.long
def test_the_fit_finds_the_model_on_other_flights():
    found = fit_torque([steered(1), steered(2)], TRUE, 0.5, 1.0)
    assert found.gain == pytest.approx(SPIN.gain, rel=0.02)
    assert found.sway == pytest.approx(SPIN.sway, rel=0.05)
    assert found.damping == pytest.approx(SPIN.damping, abs=0.2)
    assert max(errors(prepare(steered(3), TRUE, 0.5, 1.0), found)) < 0.01


@pytest.mark.long
def test_offsets_are_seen_in_the_past_or_fitted_without_one():
    leaning = steered(1, torque=LEANING)
    before = prepare(leaning, TRUE, 0.5, 1.0)
    assert max(errors(before, SPIN)) < 1e-9
    # 0.6 rad/s^2 for half a second turn it by 0.075 rad
    assert errors(prepare(leaning, TRUE, 0.5, 0.0), SPIN)[2] > 0.07
    found = fit_torque([leaning, steered(2, torque=LEANING)], TRUE, 0.5, 0.0)
    assert found.offset == pytest.approx(LEANING.offset, abs=0.05)


def test_windows_of_several_flights_are_those_of_each():
    parts = [prepare(steered(seed, seconds=6.0), TRUE, 0.5, 1.0) for seed in range(2)]
    whole = joined(parts)
    assert len(whole.p) == len(parts[0].p) + len(parts[1].p) == whole.past.shape[1]
    turned = integrate(whole, TRUE, SPIN)[2].as_quat()
    assert np.allclose(turned[len(parts[0].p):], integrate(parts[1], TRUE, SPIN)[2].as_quat())


def test_too_few_windows_are_named():
    with pytest.raises(IdentifyError, match='^steered 0: 3 windows, 50 are needed'):
        fit_torque([steered(seconds=2.1)], TRUE, 0.5, 1.0)


def test_a_model_of_no_torque_keeps_the_rate():
    one = flight(noise=0.0)
    nothing = TorqueModel((0.0, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0))
    start = prepare(one, TRUE, 0.5, 0.0)
    kept = integrate(start, TRUE, nothing)[2]
    turned = Rotation.from_quat(start.q) * Rotation.from_rotvec(0.5 * start.rate)
    assert np.linalg.norm(start.rate, axis=1).max() > 0.1
    assert np.allclose((kept.inv() * turned).magnitude(), 0.0, atol=1e-7)
