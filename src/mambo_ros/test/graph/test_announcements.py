"""An announcement counts when the graph says that the node it names has published it."""

from types import SimpleNamespace

from mambo_interfaces.msg import NodeLinks
from mambo_ros.cdr import serialize
from mambo_ros.graph.announcements import Announcements
import pytest

ONE, TWO, THREE = (bytes([k]) * 16 for k in (1, 2, 3))


class Owner:
    """A node in a graph of publishers by their GIDs."""

    def __init__(self):
        self.graph, self.warned = {}, []

    def resolve_topic_name(self, name):
        return f'/mambo/{name}'

    def get_publishers_info_by_topic(self, _):
        return [SimpleNamespace(endpoint_gid=gid, node_name=name, node_namespace='/mambo')
                for gid, name in self.graph.items()]

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **_: self.warned.append(text))


@pytest.fixture
def heard():
    """Return announcements as a node takes them in a graph of two others."""
    made = Announcements(Owner())
    made._owner.graph = {ONE: 'estimator', TWO: 'controller'}
    return made


def links(name, count=0):
    return serialize(NodeLinks(node=f'/mambo/{name}', published=['/x'], matched=[count]))


def test_a_node_may_announce_itself_and_no_other(heard):
    heard(links('estimator'), ONE)
    heard(links('estimator', 7), TWO)
    assert heard.look() == ['/mambo/estimator', '/mambo/controller']
    assert list(heard.known) == ['/mambo/estimator']
    assert list(heard.known['/mambo/estimator'].matched) == [0]


def test_the_newest_of_many_announcements_is_read(heard):
    for count in range(100):
        heard(links('estimator', count), ONE)
    heard.look()
    assert list(heard.known['/mambo/estimator'].matched) == [99]


def test_an_announcement_waits_until_the_graph_knows_its_node(heard):
    del heard._owner.graph[ONE]
    heard(links('estimator'), ONE)
    heard.look()
    assert not heard.known
    heard._owner.graph[ONE] = 'estimator'
    heard.look()
    assert list(heard.known) == ['/mambo/estimator']


def test_of_two_nodes_of_a_name_the_first_is_accepted_until_it_leaves(heard):
    heard(links('estimator', 1), ONE)
    heard.look()
    heard._owner.graph[THREE] = 'estimator'
    heard(links('estimator', 2), THREE)
    heard.look()
    assert list(heard.known['/mambo/estimator'].matched) == [1]
    del heard._owner.graph[ONE]
    heard.look()
    assert list(heard.known['/mambo/estimator'].matched) == [2]


def test_what_cannot_be_read_is_ignored_with_one_warning(heard):
    heard(b'\xff' * 40, ONE)
    heard(bytes(100_000), TWO)
    heard.look()
    heard.look()
    assert not heard.known
    assert heard._owner.warned == [
        'graph/links: ignored 40 bytes of /mambo/estimator that are not a NodeLinks']


def test_publishers_that_come_and_go_take_no_place_for_long(heard):
    for number in range(300):
        heard(links('x'), number.to_bytes(16))
    assert len(heard._newest) == 100
    heard.look()
    heard.look()
    heard(links('estimator'), ONE)
    heard.look()
    assert list(heard.known) == ['/mambo/estimator']
