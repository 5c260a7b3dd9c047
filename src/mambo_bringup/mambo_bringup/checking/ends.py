"""What the graph knows of a node that is checked: its topics, types and quality of service."""

from __future__ import annotations

from collections.abc import Collection
import time
from typing import Any

from mambo_ros.endpoints import qos
from mambo_ros.graph.peers import incompatible, who
from mambo_ros.topics import Topic
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from .transcript import BROKEN, Transcript, UNSEEN

_ASK = 2.0  # s of wall time for an answer of its parameter service


def publishers(node: Node, topic: Topic) -> list[TopicEndpointInfo]:
    """Return who publishes a topic, but for this node."""
    return [info for info in node.get_publishers_info_by_topic(
        node.resolve_topic_name(topic.name)) if info.node_name != node.get_name()]


def same_type(node: Node, topic: Topic, graph: Collection[str] = ()) -> list[str]:
    """Return other topics of the type of a topic, which a publisher outside a graph may mean."""
    name, known = node.resolve_topic_name(topic.name), {node.get_name(), *graph}
    return sorted(other for other, types in node.get_topic_names_and_types()
                  if topic.type_name in types and other != name and any(
                      info.node_name not in known
                      for info in node.get_publishers_info_by_topic(other)))


def check_absent(node: Node, transcript: Transcript) -> None:
    """Say that nobody publishes the answer, and what may have been meant instead."""
    topic = transcript.contract.answer
    name, others = node.resolve_topic_name(topic.name), same_type(node, topic)
    about = f'; {", ".join(others)} has its type' if others else ''
    transcript.note('publishes', False, f'nobody publishes {name}{about}')


def check(node: Node, transcript: Transcript) -> bool:
    """Judge the node that publishes the answer by its ends; return whether it can be flown."""
    contract = transcript.contract
    topic = contract.answer
    name = node.resolve_topic_name(topic.name)
    infos = publishers(node, topic)
    transcript.note('publishes', True, name)
    first = infos[0]
    type_name = first.topic_type
    transcript.note('type', type_name == topic.type_name, type_name if (
        type_name == topic.type_name) else f'{type_name}, wanted {topic.type_name}')
    transcript.note('one publisher', len(infos) == 1, who(first) if len(infos) == 1 else (
        f'{", ".join(map(who, infos))}, wanted one'))
    weak = list(incompatible(name, first.qos_profile, qos(topic), who(first), 'the graph'))
    missing = []
    for wanted in contract.inputs:
        full = node.resolve_topic_name(wanted.name)
        own = [info for info in node.get_subscriptions_info_by_topic(full)
               if (info.node_name, info.node_namespace) == (
                   first.node_name, first.node_namespace)]
        if not own:
            missing.append(f'{full} is not subscribed')
        for info in own:
            if info.topic_type != wanted.type_name:
                missing.append(f'{full} as {info.topic_type}, wanted {wanted.type_name}')
            weak += list(incompatible(full, qos(wanted), info.qos_profile, 'the graph', who(info)))
            if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                weak.append(f'{full} is subscribed best effort: messages may be lost; wanted '
                            'reliable')
    transcript.note('subscribes', not missing, '; '.join(missing) or ', '.join(
        node.resolve_topic_name(wanted.name) for wanted in contract.inputs))
    transcript.note('qos', not weak, '; '.join(weak) or 'reliable')
    return type_name == topic.type_name


def check_sim_time(node: Any, loop: Any, transcript: Transcript) -> None:
    """Ask for ``use_sim_time``, and judge it by the stamps."""
    found = publishers(node, transcript.contract.answer)
    if not found:
        return
    client = node.create_client(GetParameters, f'{who(found[0])}/get_parameters')
    limit = time.monotonic() + _ASK
    while not client.service_is_ready() and time.monotonic() < limit:
        loop.once(0.01)
    if not client.service_is_ready():
        transcript.notes['use_sim_time'] = (UNSEEN, 'the node has no parameter service')
        return
    future = client.call_async(GetParameters.Request(names=['use_sim_time']))
    while not future.done() and time.monotonic() < limit:
        loop.once(0.01)
        loop.turn()
    if not future.done() or not future.result().values:
        transcript.notes['use_sim_time'] = (UNSEEN, 'the node did not answer for its parameters')
        return
    used = future.result().values[0].bool_value
    wrong = any(one.rule == 'stamps' and one.verdict == BROKEN for one in transcript.findings())
    text = f'{str(used).lower()}, and the stamps are those of its inputs'
    if wrong:
        text = (f'{str(used).lower()}, and the stamps are not those of its inputs: take the stamp '
                'of the message that is answered')
    transcript.note('use_sim_time', not wrong, text)
