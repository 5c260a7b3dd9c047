"""The node shows the drones of the graph and publishes nothing that the flight would notice."""

import threading
import time
import urllib.request

from free_port import free_port
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_ros import diagnostics, messages, node, topics
from mambo_ros.loop import Loop
from mambo_view.drone_state import TRUTH
from mambo_view.view_node import ViewNode, watch
import pytest
from rclpy.parameter import Parameter

Q = (1.0, 0.0, 0.0, 0.0)


def view(drones):
    return ViewNode(parameter_overrides=[
        Parameter('drones', value=drones), Parameter('port', value=free_port()),
        Parameter('rate', value=50.0)])


class Talker(node.MamboNode[type(None)]):
    """Publishes the truth and health of one drone of several."""

    def __init__(self, space):
        node.Node.__init__(self, 'talker', namespace=space)
        self.truth = self.create_publisher(topics.GROUND_TRUTH.msg_type, 'ground_truth/odom', 10)
        self.health = self.create_publisher(topics.DIAGNOSTICS.msg_type, 'diagnostics', 10)


def test_it_follows_every_drone_and_its_health(ros):
    shown = view('/mambo1, /mambo2')
    talkers = [Talker('/mambo1'), Talker('/mambo2')]
    loop = Loop(shown)
    frames = [drone._frames[TRUTH] for drone in shown.page._drones]
    end, t = time.monotonic() + 30.0, 0
    while time.monotonic() < end and not (
            all(frame.visible for frame in frames) and 'flying' in shown.page._health.content
            and shown.page._plot is not None):
        t += 20_000_000
        for number, talker in enumerate(talkers):
            talker.truth.publish(messages.ground_truth(
                t, State((1.0 + number, 0.0, -1.5), (0.0,) * 3, Q, (0.0,) * 3)))
            talker.health.publish(diagnostics.report(t, 'sim_node', diagnostics.OK, 'flying', {}))
        loop.once(0.02)
        shown.frame(time.monotonic())
    assert [tuple(frame.position) for frame in frames] == [(1.0, 0.0, 1.5), (2.0, 0.0, 1.5)]
    assert 'flying' in shown.page._health.content and 't = ' in shown.page._status.content
    assert not shown.outputs  # publishes nothing but its links
    loop.close()
    shown.finish()
    with pytest.raises(OSError):
        urllib.request.urlopen(shown.page.address, timeout=2)


def test_frames_come_at_its_rate_until_it_is_told_to_stop(ros, monkeypatch):
    shown = view('/mambo')
    loop, times = Loop(shown), []
    monkeypatch.setattr(shown, 'frame', times.append)
    threading.Timer(0.5, loop.stop).start()
    watch(shown, loop)
    assert 5 <= len(times) <= 27 and min(b - a for a, b in zip(times, times[1:])) > 0.001
    loop.close()
    shown.finish()


@pytest.mark.parametrize('drones', ['', 'mambo', '/a,b'])
def test_names_that_are_no_namespaces_are_refused(ros, drones):
    with pytest.raises(ParameterError, match='must be namespaces'):
        view(drones)
