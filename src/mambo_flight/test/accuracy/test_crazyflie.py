"""How the bindings of the Crazyflie's firmware are driven: a stand-in keeps what it gets."""

import importlib
import sys
from types import ModuleType, SimpleNamespace

from mambo_flight.accuracy import crazyflie
from mambo_flight.offline_replay import steps_of
from mambo_model.errors import InputError
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

TOLD = crazyflie.Told(0.02, 50.0, 0.01, 0.32)
N, START = 21, 10


def stand_in():
    """Return a module of the names that are used, and what it was called with."""
    cf, calls = ModuleType('cffirmware'), []
    for name in ('Axis3f', 'flowMeasurement_t', 'tofMeasurement_t', 'kalmanCoreData_t',
                 'kalmanCoreParams_t', 'state_t'):
        setattr(cf, name, SimpleNamespace)
    for name in ('Predict', 'AddProcessNoise', 'Finalize', 'UpdateWithTof', 'UpdateWithFlow',
                 'Init'):
        setattr(cf, f'kalmanCore{name}',
                lambda *arguments, name=name: calls.append((name, arguments)))
    cf.kalmanCoreDefaultParams = lambda params: None

    def externalize(core, out, accel):
        out.position = SimpleNamespace(x=1.0, y=2.0, z=3.0)
        out.velocity = SimpleNamespace(x=0.1, y=0.2, z=0.3)
        x, y, z, w = Rotation.from_euler('z', 90.0, degrees=True).as_quat()
        out.attitudeQuaternion = SimpleNamespace(w=w, x=x, y=y, z=z)
    cf.kalmanCoreExternalizeState = externalize
    return cf, calls


def samples():
    """Return steps with a range at step 4 and a flow at step 6."""
    k = np.arange(N, dtype=float)
    sonar, flow = np.full(N, np.nan), np.full((N, 3), np.nan)
    sonar[4], flow[6] = 1.2, (0.5, 0.25, 200.0)
    return steps_of(SimpleNamespace(
        t=np.arange(N) * 5_000_000, imu=np.column_stack([k, 2.0 * k, 3.0 * k, -k, k, -9.81 + k]),
        sonar=sonar, flow=flow, pressure=np.full(N, np.nan)))


@pytest.fixture
def driven(monkeypatch):
    cf, calls = stand_in()
    monkeypatch.setitem(sys.modules, 'cffirmware', cf)
    return crazyflie.states(samples(), START, TOLD), calls


def test_it_predicts_every_10_ms_and_adds_noise_every_millisecond(driven):
    _, calls = driven
    times = [arguments[4] for name, arguments in calls if name == 'Predict']
    assert times == list(range(10, 101, 10))
    assert [a[2] for name, a in calls if name == 'AddProcessNoise'] == list(range(1, 101))
    assert [a[5] for name, a in calls if name == 'Predict'] == [t >= 5 * START for t in times]
    assert calls[0][0] == 'Init' and calls[0][1][1].dragB_x == calls[0][1][1].dragB_y == 0.32


def test_a_prediction_gets_the_mean_since_the_last_one_in_its_axes(driven):
    accel, gyro = next(a[2:4] for name, a in driven[1] if name == 'Predict')
    # over steps 0, 1, 2, between which all grows evenly: that of step 1; y and z change sign
    assert (gyro.x, gyro.y, gyro.z) == pytest.approx((1.0, -2.0, -3.0))
    assert (accel.x, accel.y, accel.z) == pytest.approx((-1.0, -1.0, 8.81))


def test_flow_is_in_counts_and_range_in_metres(driven):
    names = [name for name, _ in driven[1]]
    (flow, still), = [a[1:] for name, a in driven[1] if name == 'UpdateWithFlow']
    per_rad = 35.0 / 0.71674 / 0.1
    assert (flow.dpixelx, flow.dpixely) == pytest.approx(
        (per_rad * 0.02 * 0.5, -per_rad * 0.02 * 0.25))
    assert flow.stdDevX == flow.stdDevY == pytest.approx(per_rad * 0.02 * 0.02)
    assert flow.dt == 0.02 and not vars(still)
    (distance,), = [a[1:] for name, a in driven[1] if name == 'UpdateWithTof']
    assert (distance.distance, distance.stdDev) == (1.2, 0.01)
    # at 20 ms: after the prediction and the noise of that millisecond, before its end
    at = names.index('UpdateWithTof')
    assert names[at - 2:at + 2] == ['Predict', 'AddProcessNoise', 'UpdateWithTof', 'Finalize']


def test_states_are_turned_to_ned_and_the_velocity_to_body_axes(driven):
    states, _ = driven
    assert states.shape == (11, 13)
    np.testing.assert_allclose(states[3, :3], (1.0, -2.0, -3.0))
    # forward is y of the map, left is -x of it: the body moves (0.2, -0.1, 0.3) FLU
    np.testing.assert_allclose(states[3, 3:6], (0.2, 0.1, -0.3), atol=1e-12)
    np.testing.assert_allclose(states[3, 6:10], np.array([1.0, 0.0, 0.0, -1.0]) / np.sqrt(2.0))
    np.testing.assert_allclose(states[1, 10:], (1.0, 2.0, 3.0))


def test_without_the_bindings_one_line_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, 'path', [*sys.path])
    monkeypatch.setitem(sys.modules, 'cffirmware', None)
    monkeypatch.delenv(crazyflie.FOLDER, raising=False)
    with pytest.raises(InputError, match='no module cffirmware on the Python path: run .make '
                                         'bindings_python. .* set CFFIRMWARE'):
        crazyflie.bindings()
    with pytest.raises(InputError, match=f'no module cffirmware in {tmp_path}'):
        crazyflie.bindings(str(tmp_path))


def test_the_bindings_are_found_where_the_variable_says(monkeypatch, tmp_path):
    (tmp_path / 'cffirmware.py').write_text('NAME = "found"\n')
    importlib.invalidate_caches()
    monkeypatch.setattr(sys, 'path', [*sys.path])
    monkeypatch.delitem(sys.modules, 'cffirmware', raising=False)
    monkeypatch.setenv(crazyflie.FOLDER, str(tmp_path))
    assert crazyflie.bindings().NAME == 'found'
    monkeypatch.delitem(sys.modules, 'cffirmware')
