"""A flight starts when every node is up and every link between them is matched."""

from dataclasses import dataclass
import threading
import time

from mambo_interfaces.msg import NodeLinks
from mambo_ros import messages, topics
from mambo_ros.endpoints import qos
from mambo_ros.graph.links import Links
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_helpers import PATIENCE, serving, until

pytestmark = pytest.mark.usefixtures('ros')
IMU, PWM = '/mambo/imu/data_raw', '/mambo/motor_pwm'


@dataclass(frozen=True)
class NoParams:
    """Nothing to set."""


def node(name, says=(), hears=(), **options):
    made = MamboNode(name, NoParams, **options)
    for topic in says:
        made.advertise(topic)
    for topic in hears:
        made.subscribe(topic, lambda data: None)
    return made


def announced(name, published=None, subscribed=None):
    """Return the announcement of a node, from the number of matched ends of each topic."""
    published, subscribed = published or {}, subscribed or {}
    return NodeLinks(node=name, published=list(published), subscribed=list(subscribed),
                     matched=[*published.values(), *subscribed.values()])


@pytest.fixture
def links():
    """
    Return the links of a simulator that waits for two nodes and has received no announcement.
    """
    return Links(node('sim', [topics.IMU], [topics.MOTOR_PWM]), 'estimator, controller')


def test_only_named_nodes_are_waited_for():
    assert Links(node('sim'), '').missing() == ''
    assert Links(node('sim'), ' , ').missing() == ''


def test_missing_nodes_are_named_one_and_all(links):
    assert links.missing() == 'node /mambo/estimator, /mambo/controller'
    links._heard.update(announced('/mambo/estimator'))
    assert links.missing() == 'node /mambo/controller'
    links._heard.update(announced('/mambo/controller'))
    assert links.missing() == ''


def test_a_node_of_another_namespace_can_be_named():
    links = Links(node('sim'), '/hall/mocap')
    assert links.missing() == 'node /hall/mocap'
    links._heard.update(announced('/hall/mocap'))
    assert links.missing() == ''


def test_names_are_relative_to_the_namespace_of_the_waiting_node():
    assert Links(node('sim', namespace='two'), 'estimator').missing() == 'node /two/estimator'


def test_a_reader_that_a_publisher_has_not_matched_is_counted_and_named(links):
    links._heard.update(announced('/mambo/estimator', subscribed={IMU: 1}))
    links._heard.update(announced('/mambo/controller', published={PWM: 0}, subscribed={IMU: 1}))
    links._heard.update(announced('/mambo/sim', published={IMU: 1}, subscribed={PWM: 1}))
    assert links.missing() == f'1 of 1 readers of {PWM} at /mambo/controller'
    links._heard.update(announced('/mambo/controller', published={PWM: 1}, subscribed={IMU: 1}))
    assert links.missing() == f'1 of 2 readers of {IMU} at /mambo/sim'
    links._heard.update(announced('/mambo/sim', published={IMU: 2}, subscribed={PWM: 1}))
    assert links.missing() == ''


def test_a_publisher_that_a_reader_has_not_matched_is_counted_and_named(links):
    links._heard.update(announced('/mambo/estimator'))
    links._heard.update(announced('/mambo/controller', published={PWM: 1}))
    links._heard.update(announced('/mambo/sim', published={IMU: 0}, subscribed={PWM: 0}))
    assert links.missing() == f'1 of 1 publishers of {PWM} at /mambo/sim'
    links._heard.update(announced('/mambo/sim', published={IMU: 0}, subscribed={PWM: 1}))
    assert links.missing() == ''


def test_every_publisher_of_a_shared_topic_must_know_every_reader(links):
    links._heard.update(announced('/mambo/estimator', published={'/tf': 1}))
    links._heard.update(announced('/mambo/controller', published={'/tf': 0}))
    assert links.missing() == ''  # no readers
    links._heard.update(announced('/mambo/viewer', subscribed={'/tf': 2}))
    assert links.missing() == '1 of 1 readers of /tf at /mambo/controller'


def test_a_topic_without_readers_or_a_foreign_reader_is_no_obstacle(links):
    links._heard.update(announced('/mambo/estimator', published={IMU: 3}))
    links._heard.update(announced('/mambo/controller', subscribed={PWM: 0}))
    assert links.missing() == ''


def test_an_incomplete_announcement_is_ignored(links):
    links._heard.update(announced('/mambo/estimator'))
    links._heard.update(NodeLinks(
        node='/mambo/controller', published=[PWM], subscribed=[IMU], matched=[1]))
    assert links.missing() == 'node /mambo/controller'


FLIGHT = {
    'sim': ([topics.IMU], [topics.MOTOR_PWM]), 'estimator': ([topics.ESTIMATE], [topics.IMU]),
    'controller': ([topics.MOTOR_PWM], [topics.ESTIMATE])}


def flight(*names, **options):
    """Return nodes of a small lockstep graph, by default all, the owner of time first."""
    return [node(name, *FLIGHT[name], **options) for name in names or FLIGHT]


def test_one_who_does_not_wait_can_look():
    sim, estimator, controller = flight()
    links, loop = Links(sim, 'estimator,controller'), Loop(sim)

    def look():
        loop.once(0.01)
        loop.turn()
        return links.look() == ''
    with serving(estimator, controller):
        until(look, 'the announcements')
    links.close()
    assert links.missing() == ''
    loop.close()


def test_a_complete_graph_proceeds_and_its_first_message_arrives():
    sim, estimator, controller = flight()
    heard = []
    estimator.subscribe(topics.CLOCK, heard.append)
    publish = sim.advertise(topics.CLOCK)
    links, loop = Links(sim, 'estimator,controller'), Loop(sim)
    assert links.missing()
    with serving(estimator, controller):
        assert links.wait(loop, PATIENCE) is True
        assert links.missing() == ''
        publish(messages.clock(5))
        until(lambda: heard, 'the first message')
    loop.close()
    assert [bytes(data) for data in heard] == [messages.clock(5)]


def test_links_between_nodes_of_one_loop_count_as_others_do():
    # in a namespace of its own: nodes of other tests in this process may still have subscriptions
    sim, estimator, controller = flight(namespace='alone')
    links, loop = Links(sim, 'estimator,controller'), Loop(sim, controller)
    with serving(estimator):
        assert links.wait(loop, PATIENCE) is True
    loop.close()
    assert [output.matched for output in controller.outputs] == [1]  # the simulator, in the loop
    assert not controller.outputs[0].publisher.get_subscription_count()


def test_an_owner_of_time_that_is_not_alone_names_the_other(monkeypatch):
    sim, other = node('sim', [topics.CLOCK]), node('sim', [topics.CLOCK], namespace='two')
    logged = []
    monkeypatch.setattr(type(sim.get_logger()), 'error', lambda self, text: logged.append(text))
    links = Links(sim, '')
    until(lambda: len(sim.get_publishers_info_by_topic('/clock')) == 2, 'the other')
    assert not links.alone(topics.CLOCK)
    assert logged[0].startswith('/two/sim publishes /clock too: give each of several drones')
    other.destroy_node()
    until(lambda: links.alone(topics.CLOCK), 'its end')


def test_an_owner_of_time_stops_waiting_when_it_is_not_alone(monkeypatch):
    monkeypatch.setattr('mambo_ros.graph.links._ASK_AGAIN', 0.1)
    sim, other = node('sim', [topics.CLOCK]), node('sim', [topics.CLOCK], namespace='two')
    links, loop, logged = Links(sim, 'estimator'), Loop(sim), []
    monkeypatch.setattr(type(sim.get_logger()), 'error', lambda self, text: logged.append(text))
    until(lambda: len(sim.get_publishers_info_by_topic('/clock')) == 2, 'the other')
    assert links.wait(loop, PATIENCE) is False
    loop.close()
    assert len(logged) == 1 and logged[0].startswith('/two/sim publishes /clock too')
    other.destroy_node()


def test_an_owner_of_time_that_expects_nobody_finds_a_flight_that_it_discovers_late(monkeypatch):
    monkeypatch.setattr('mambo_ros.graph.links._CROWDED', 0.3)
    sim, others, logged = node('sim', [topics.CLOCK]), [], []
    monkeypatch.setattr(type(sim.get_logger()), 'error', lambda self, text: logged.append(text))
    links, loop = Links(sim, ''), Loop(sim)
    timer = threading.Timer(0.5, lambda: others.append(
        node('sim', [topics.CLOCK], namespace='two')))
    timer.start()
    assert links.wait(loop, PATIENCE) is False
    timer.join()
    loop.close()
    assert len(logged) == 1 and 'the flight does not begin: /clock: 2 publishers' in logged[0]
    others[0].destroy_node()


def test_the_log_names_what_is_missing_when_patience_ends(monkeypatch):
    sim, estimator = flight('sim', 'estimator')
    links, loop, logged = Links(sim, 'estimator,controller'), Loop(sim), []
    monkeypatch.setattr(type(sim.get_logger()), 'error', lambda self, text: logged.append(text))
    with serving(estimator):
        until(lambda: links.missing() == 'node /mambo/controller', 'the estimator',
              serve(links, loop))
        began = time.monotonic()
        assert links.wait(loop, 0.2) is False
        assert 0.2 <= time.monotonic() - began < PATIENCE
    assert logged == ['gave up after 0.2 s without node /mambo/controller']
    loop.close()


def test_a_stopped_loop_ends_the_wait(monkeypatch):
    (sim,) = flight('sim')
    links, loop, logged = Links(sim, 'estimator,controller'), Loop(sim), []
    monkeypatch.setattr(type(sim.get_logger()), 'error', lambda self, text: logged.append(text))
    timer = threading.Timer(0.1, loop.stop)
    timer.start()
    assert links.wait(loop, PATIENCE) is False
    assert logged == []
    loop.close()


def test_a_waiting_node_logs_regularly_what_it_waits_for(monkeypatch):
    monkeypatch.setattr('mambo_ros.graph.links._ASK_AGAIN', 0.05)
    (sim,) = flight('sim')
    links, loop, logged = Links(sim, 'estimator'), Loop(sim), []
    monkeypatch.setattr(type(sim.get_logger()), 'warning', lambda self, text: logged.append(text))
    assert links.wait(loop, 0.3) is False
    assert 1 <= len(logged) <= 6 and set(logged) == {'waiting for node /mambo/estimator'}
    loop.close()


def test_a_late_joiner_learns_of_the_links_that_were_announced_before():
    estimator, controller = flight('estimator', 'controller')
    with serving(estimator, controller):
        time.sleep(0.3)  # they have made their announcements
        late = node('late')
        links = Links(late, 'estimator,controller')
        loop = Loop(late)
        assert links.wait(loop, PATIENCE) is True
        loop.close()


def test_a_change_of_the_graph_is_announced_again():
    got, plain = [], Node('plain')
    plain.create_subscription(NodeLinks, '/mambo/graph/links', got.append, 10)
    executor = SingleThreadedExecutor()
    executor.add_node(plain)

    def turn():
        executor.spin_once(timeout_sec=0.01)

    (sim,) = flight('sim')
    with serving(sim):
        until(lambda: got, 'an announcement', turn)
        first = got[-1]
        assert (first.node, list(first.published), list(first.subscribed)) == (
            '/mambo/sim', [IMU], [PWM])
        assert list(first.matched) == [0, 0]
        reader = node('reader', hears=[topics.IMU])
        loop = Loop(reader)
        until(lambda: list(got[-1].matched) == [1, 0], 'the new reader', turn)
        count = len(got)
        for _ in range(20):
            turn()
        assert len(got) == count  # nothing changed, so nothing is announced
        loop.close()
        reader.destroy_node()
        until(lambda: list(got[-1].matched) == [0, 0], 'the loss of the reader', turn)
    executor.shutdown()


def announcer(name='stranger'):
    """Return a node of another origin, and what publishes its announcements."""
    stranger = Node(name, namespace='mambo')
    return stranger, stranger.create_publisher(NodeLinks, '/mambo/graph/links', qos(topics.LINKS))


def serve(links, loop):
    """Return what takes announcements and looks at the graph once."""
    def step():
        loop.once(0.01)
        links.look()
    return step


def said_by(monkeypatch, sim, level):
    said = []
    monkeypatch.setattr(type(sim.get_logger()), level, lambda self, text, **_: said.append(text))
    return said


def test_announcements_that_cannot_be_read_or_name_another_node_are_ignored():
    sim = node('sim', [topics.IMU])
    links, loop, (_, publisher) = Links(sim, 'controller'), Loop(sim), announcer('other')
    until(publisher.get_subscription_count, 'the link', loop.turn)
    for data in (b'\xff' * 64, bytes(100_000), announced('/mambo/controller'),
                 announced('/mambo/sim', published={IMU: 0}, subscribed={IMU: 0}),
                 NodeLinks(node='/mambo/other', published=['/x', '/y'], matched=[1])):
        publisher.publish(data)
        for _ in range(30):
            serve(links, loop)()
    assert set(links._heard.known) <= {'/mambo/sim'}
    assert list(links._heard.known.get('/mambo/sim', announced('')).subscribed) != [IMU]
    publisher.publish(announced('/mambo/other'))
    until(lambda: '/mambo/other' in links._heard.known, 'the honest one', serve(links, loop))
    assert links.missing() == 'node /mambo/controller'
    loop.close()


def test_a_flood_of_forged_announcements_delays_no_start():
    sim, estimator, controller = flight()
    links, loop, (_, publisher) = Links(sim, 'estimator,controller'), Loop(sim), announcer()
    until(publisher.get_subscription_count, 'the link', loop.turn)
    over = threading.Event()

    def forge():
        number = 0
        while not over.is_set():
            for name in ('/mambo/estimator', '/mambo/controller', f'/mambo/x{number}'):
                publisher.publish(announced(name, subscribed={IMU: 0}, published={PWM: 0}))
            number += 1
            time.sleep(0.001)
    thread = threading.Thread(target=forge)
    thread.start()
    try:
        with serving(estimator, controller):
            assert links.wait(loop, PATIENCE) is True
    finally:
        over.set()
        thread.join()
    assert set(links._heard.known) == {'/mambo/sim', '/mambo/estimator', '/mambo/controller'}
    loop.close()


def test_a_node_that_nobody_expects_holds_up_the_start_for_a_while_only(monkeypatch):
    monkeypatch.setattr('mambo_ros.graph.links._GUESTS', 0.5)
    sim, estimator, controller = flight()
    links, loop, (_, publisher) = Links(sim, 'estimator,controller'), Loop(sim), announcer()
    until(publisher.get_subscription_count, 'the link', loop.turn)
    publisher.publish(announced('/mambo/stranger', subscribed={IMU: 1}))
    until(lambda: '/mambo/stranger' in links._heard.known, 'the guest', serve(links, loop))
    said = said_by(monkeypatch, sim, 'warning')
    with serving(estimator, controller):
        assert links.wait(loop, PATIENCE) is True
    assert f'begins without 1 of 2 readers of {IMU} at /mambo/sim' in said
    loop.close()


@pytest.mark.parametrize('every', [0.1, 2.0])  # s; the second: it came since the last look
@pytest.mark.parametrize('kind', ['namesake', 'publisher'])
def test_a_second_node_of_a_name_or_publisher_of_a_topic_is_no_flight(monkeypatch, kind, every):
    monkeypatch.setattr('mambo_ros.graph.links._LOOK_EVERY', every)
    monkeypatch.setattr('mambo_ros.graph.links._CROWDED', 0.5)
    sim, estimator, controller = flight()
    links, loop = Links(sim, 'estimator,controller'), Loop(sim)
    other = node('controller') if kind == 'namesake' else node('other', [topics.IMU])
    until(lambda: len(sim.get_publishers_info_by_topic('/mambo/graph/links')) > 2, 'the other')
    said = said_by(monkeypatch, sim, 'error')
    with serving(estimator, controller):
        assert links.wait(loop, PATIENCE) is False
    begin = {
        'namesake': '2 nodes are named /mambo/controller, expected one: end the other',
        'publisher': f'{IMU}: 2 publishers (/mambo/other, /mambo/sim), expected one'}[kind]
    assert said[0].startswith(f'the flight does not begin: {begin}')
    loop.close()
    other.destroy_node()


def test_a_publisher_that_only_another_node_has_found_is_one_too_many(monkeypatch):
    monkeypatch.setattr('mambo_ros.graph.links._CROWDED', 0.5)
    sim = node('sim', [topics.IMU])
    links, loop, (_, publisher) = Links(sim, 'estimator'), Loop(sim), announcer('estimator')
    until(publisher.get_subscription_count, 'the link', loop.turn)
    said = said_by(monkeypatch, sim, 'error')
    publisher.publish(announced('/mambo/estimator', subscribed={IMU: 2}))
    assert links.wait(loop, PATIENCE) is False
    assert said == [f'the flight does not begin: {IMU}: 2 publishers at /mambo/estimator, '
                    'expected 1: end the others']
    loop.close()


def test_a_publisher_that_left_before_the_flight_is_forgotten_before_it_begins():
    sim, reader = node('sim', [topics.CLOCK], namespace='left'), node('reader', namespace='left')
    stranger = node('stranger', [topics.CLOCK], namespace='left')
    heard = []
    reader.subscribe(topics.CLOCK, heard.append, single=True)
    links, loop = Links(sim, 'reader'), Loop(sim)
    with serving(reader):
        def send():
            stranger.outputs[0](messages.clock(3))
            return heard
        until(send, 'the message of the stranger')
        stranger.destroy_node()
        assert links.wait(loop, PATIENCE) is True
        sim.outputs[0](messages.clock(5))
        until(lambda: messages.clock(5) in map(bytes, heard), 'the first message')
    loop.close()
    assert not reader.refused()
