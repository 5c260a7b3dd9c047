"""The node shows the drones of the graph, publishes nothing, and sends what is clicked."""

from pathlib import Path
from statistics import median
import threading
import time
import urllib.request

from free_port import free_port
from mambo_model.errors import InputError
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_ros import diagnostics, messages, node, topics
from mambo_ros.commands import client, table
from mambo_ros.commands.services import Services
from mambo_ros.loop import Loop
from mambo_view.drone_state import TRUTH
from mambo_view.view_node import read_course, ViewNode, ViewNodeParams, watch
import pytest
from rclpy.executors import SingleThreadedExecutor
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
    # 20 ms; one that comes late on a busy machine is close to the next
    assert 5 <= len(times) <= 27 and median(b - a for a, b in zip(times, times[1:])) > 0.01
    loop.close()
    shown.finish()


class Flight(node.MamboNode[type(None)]):
    """Answers take-off and pause as the nodes of a commanded flight do; never a landing."""

    def __init__(self):
        node.Node.__init__(self, 'flight', namespace='/mambo')
        self.heights = []
        Services(self).offer((table.TAKEOFF, self._take_off), (table.PAUSE, self._pause))

    def _take_off(self, request):
        self.heights.append(request.height)
        return len(self.heights) == 1, 'from t = 0.000 s' if len(self.heights) == 1 else 'flying'

    @staticmethod
    def _pause(request):
        return True, 'paused' if request.data else 'going on'


def test_its_buttons_call_the_services_of_the_flight_and_show_the_answers(ros, monkeypatch):
    monkeypatch.setattr(client, 'FIND', 0.5)
    shown, flight = view('/mambo'), Flight()
    loop, theirs = Loop(shown), SingleThreadedExecutor()
    theirs.add_node(flight)
    controls = shown.page.controls

    def until(done):
        limit = time.monotonic() + 60.0
        while not done():
            assert time.monotonic() < limit, controls._log.content
            loop.once(0.02)
            theirs.spin_once(0.0)
            shown.frame(time.monotonic())

    def press(name):
        for callback in controls._buttons[name]._impl.update_cb:
            callback(None)
    until(lambda: not controls._buttons['takeoff'].disabled
          and not controls._buttons['pause'].disabled)
    press('takeoff')
    until(lambda: 'take off to 1 m: from t = 0.000 s' in controls._log.content)
    press('takeoff')
    until(lambda: 'take off to 1 m: flying' in controls._log.content)
    press('pause')
    until(lambda: 'pause: paused' in controls._log.content)
    press('land')
    until(lambda: 'has no land: it takes commands if' in controls._log.content)
    assert flight.heights == [1.0, 1.0]
    theirs.shutdown()
    flight.destroy_node()
    until(lambda: controls._buttons['takeoff'].disabled)
    loop.close()
    shown.finish()


def test_the_commands_can_be_left_out(ros):
    shown = ViewNode(parameter_overrides=[
        Parameter('port', value=free_port()), Parameter('commands', value=False)])
    assert shown.page.controls is None
    shown.frame(time.monotonic())
    shown.finish()


@pytest.mark.long
def test_a_trajectory_is_sent_as_mambo_follow_sends_it():
    path = Path(__file__).parents[3] / 'examples/figure_eight.csv'
    assert read_course(path).startswith('duration,x^0')


@pytest.mark.parametrize('drones', ['', 'mambo', '/a,b', '/', '/a b', '/a/', '/a-1', '/a,/a'])
def test_names_that_are_no_namespaces_are_refused(ros, drones):
    with pytest.raises(InputError, match='namespace|twice'):
        view(drones)


def test_a_folder_of_trajectories_must_be_there():
    with pytest.raises(ParameterError, match="trajectories: '/nowhere' is no folder"):
        ViewNodeParams(trajectories='/nowhere')
