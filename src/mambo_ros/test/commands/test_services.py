"""Services answer, survive what anybody sends, and take no more than they can."""

import logging
from types import SimpleNamespace

from mambo_ros.commands import services, table
import pytest


class Node:
    """What the services need of a node."""

    def __init__(self):
        self.callbacks = {}

    def create_service(self, srv_type, name, callback):
        self.callbacks[name] = lambda request: callback(request, srv_type.Response())

    def get_logger(self):
        log = logging.getLogger('services')
        return SimpleNamespace(warning=lambda text, **_: log.warning(text))


@pytest.fixture
def wall(monkeypatch):
    wall = SimpleNamespace(now=10.0)
    monkeypatch.setattr(services, 'time', SimpleNamespace(monotonic=lambda: wall.now))
    return wall


def test_an_answer_has_success_and_message(wall):
    node = Node()
    services.Services(node).offer(
        (table.STOP, lambda request: (True, 'from t = 1 s')),
        (table.TAKEOFF, lambda request: (request.height < 1.0, f'{request.height:g}')))
    stop = node.callbacks['stop'](table.STOP.srv_type.Request())
    assert (stop.success, stop.message) == (True, 'from t = 1 s')
    takeoff = node.callbacks['takeoff'](table.TAKEOFF.srv_type.Request(height=2.0))
    assert (takeoff.success, takeoff.message) == (False, '2')


def test_an_error_is_an_answer_and_a_warning(wall, caplog):
    node = Node()
    offered = services.Services(node)
    offered.offer((table.STOP, lambda request: 1 / 0))
    response = node.callbacks['stop'](table.STOP.srv_type.Request())
    assert not response.success and 'division by zero' in response.message
    assert offered.refused == 1 and 'stop: ignored a request' in caplog.text


def test_a_flood_is_refused_until_the_second_is_over(wall):
    node, done = Node(), []
    offered = services.Services(node)
    offered.offer((table.STOP, lambda request: (not done.append(1), '')))
    answers = [node.callbacks['stop'](None) for _ in range(services.MOST + 5)]
    assert len(done) == services.MOST and answers[-1].message == services.BUSY
    assert offered.refused == 5
    wall.now += 1.1
    assert node.callbacks['stop'](None).success


def test_a_duration_is_in_seconds():
    assert services.seconds(SimpleNamespace(sec=2, nanosec=500_000_000)) == 2.5
    with pytest.raises(ValueError, match='duration.nanosec = 4294967295, not below 1e9'):
        services.seconds(SimpleNamespace(sec=0, nanosec=4294967295))
