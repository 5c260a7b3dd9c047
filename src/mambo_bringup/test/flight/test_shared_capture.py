"""Cameras that look at all drones of a hall: when they do, and what each node gets."""

from types import SimpleNamespace

from mambo_bringup.flight import shared_capture
from mambo_flight.world.world_file import Hall
from mambo_model.motion.rigid_body import State
from mambo_sim.sensors.hall_capture import HallCaptureParams
from mambo_sim.sensors.optitrack import OptitrackParams
from mambo_sim.world import WorldParams
import numpy as np

STEP = 5_000_000  # ns


class Cameras:
    """Stand-in for the node of one drone's cameras."""

    def __init__(self, log):
        self.params = SimpleNamespace(optitrack=OptitrackParams())
        self.got, self.warm, self._log = [], [], log
        self.on_truth = None

    def warm_up(self, view):
        self.warm.append(view.shape)

    def expose(self, t, state, view):
        self.got.append((t, state.rho, view.copy()))

    def get_logger(self):
        return SimpleNamespace(warning=self._log.append)


def shared(**capture):
    log = []
    nodes = [Cameras(log), Cameras(log)]
    hall = Hall(WorldParams(drones=2, capture=HallCaptureParams(**capture)), {
        '/mambo1': (0.0, 0.0, 0.0), '/mambo2': (0.0, 2.0, 0.0)})
    return shared_capture.share(nodes, hall), nodes, log


def at(y):
    return State((0.0, y, -1.0), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)


def test_cameras_of_drones_that_do_not_disturb_each_other_stay_apart():
    made, nodes, _ = shared()
    assert made is None and all(node.on_truth is None for node in nodes)
    assert shared_capture.share([], Hall(WorldParams(), {})) is None


def test_a_step_is_exposed_when_all_drones_are_known():
    _, nodes, _ = shared(occlusion=True)
    assert [node.warm for node in nodes] == [[(12,)]] * 2
    nodes[1].on_truth(0, at(0.0))
    assert not nodes[0].got and not nodes[1].got
    nodes[0].on_truth(0, at(0.1))
    for node, y in zip(nodes, (0.1, 0.0), strict=True):
        (t, rho, view), = node.got
        assert (t, rho) == (0, (0.0, y, -1.0))
        np.testing.assert_array_equal(view, [0.0, y, -1.0, 1.0, 0.0, 0.0, 0.0, *[1.0] * 5])


def test_a_drone_whose_sample_is_missing_is_left_out():
    _, nodes, _ = shared(occlusion=True)
    nodes[0].on_truth(0, at(0.0))
    for node in nodes:
        node.on_truth(STEP, at(0.0))
    assert [t for t, *_ in nodes[0].got] == [0, STEP] and [t for t, *_ in nodes[1].got] == [STEP]


def test_drones_that_are_taken_for_each_other_are_logged_once():
    _, nodes, log = shared(swap_distance=0.5)
    for k, y in enumerate((0.0, 0.0, 1.7, 1.7, 1.7)):
        nodes[0].on_truth(k * STEP, at(y))
        nodes[1].on_truth(k * STEP, at(0.0))
    assert log == ['motion capture takes /mambo1 and /mambo2 for each other from t = 0.017 s on']
    assert nodes[0].got[-1][2][1] == 2.0 and nodes[1].got[-1][2][1] == -2.0 + 1.7
