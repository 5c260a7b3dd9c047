"""
Write the access policy of the nodes for SROS2: who may publish, subscribe and answer what.

The file has the format of SROS2 (design.ros2.org/articles/ros2_access_control_policies.html), one
enclave for each node with the topics and services that its class declares, its own parameter
services and the log; everything else is denied. Of several drones, each has its own nodes, and one
enclave is for each node that watches all of them. ``ros2 security create_permission KEYSTORE
ENCLAVE FILE`` turns it into signed permissions. It needs an installed ROS 2: the wheels are built
without security.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any
from xml.etree import ElementTree

from mambo_bags.command import guard, Parser
from mambo_flight.flight_options import DRONES
from mambo_flight.world.formation import namespaces
from mambo_model.whole_file import refuse_existing, write_text
from mambo_ros import topics

from .flight.natnet import CLIENT, SERVER
from .flight.nodes import DESCRIPTION, FLIGHT_NODES, RECORDER, SIMULATOR, VIEW

NODES = (SIMULATOR, *FLIGHT_NODES, RECORDER, VIEW, DESCRIPTION, SERVER, CLIENT,
         ('mambo_bags', 'replay_node'))
WATCHERS = (VIEW, DESCRIPTION)
"""Nodes of which there is one for all drones."""
SERVICES = ('describe_parameters', 'get_parameter_types', 'get_parameters',
            'get_type_description', 'list_parameters', 'set_parameters',
            'set_parameters_atomically')
"""Services that rclpy gives every node, below its own name."""
_SUBSCRIBED = {'sim_node': (topics.LINKS,), 'replay_node': (topics.LINKS,),
               'recorder_node': (*topics.AIDED, *topics.COMMANDED)}
"""What a node subscribes besides the topics of its class: while it waits, or on request."""


def node_class(package: str, name: str) -> Any:
    """Return the class of a node of the workspace."""
    module = import_module(f'{package}.{name}')
    return next(value for key, value in vars(module).items()
                if key.lower() == name.replace('_', ''))


def _resolved(listed: Iterable[topics.Topic], namespace: str) -> list[str]:
    """Return full names of topics, sorted."""
    return sorted({topics.full_name(topic, namespace) for topic in listed})


def allowed(package: str, name: str, namespace: str) -> dict[str, list[str]]:
    """
    Return what a node may do.

    Parameters
    ----------
    package, name
        Of the node.
    namespace
        Of its drone, with a leading slash.

    Returns
    -------
    dict of str to list of str
        Full names by ``publish``, ``subscribe`` (topics), ``reply`` and, for a node that sends
        commands, ``request`` (services), sorted.

    """
    node_type = node_class(package, name)
    subscribed = (*node_type.subscribes, *_SUBSCRIBED.get(name, ()))
    called = sorted({f'{namespace}/{service.name}' for service in node_type.calls})
    return {
        'publish': sorted([*_resolved((*node_type.publishes, topics.LINKS), namespace),
                           '/parameter_events', '/rosout']),
        'subscribe': _resolved(subscribed, namespace),
        'reply': sorted([*(f'{namespace}/{name}/{service}' for service in SERVICES),
                         *(f'{namespace}/{service.name}' for service in node_type.serves)]),
        **({'request': called} if called else {})}


def watching(package: str, name: str, drones: Sequence[str]) -> dict[str, list[str]]:
    """
    Return what a node that watches several drones may do, as :func:`allowed` for one drone.

    Parameters
    ----------
    package, name
        One of :data:`WATCHERS`, which runs once, in the namespace of a drone that flies alone.
    drones
        Namespaces of the drones.

    """
    own = allowed(package, name, topics.NAMESPACE)
    below, private = f'{topics.NAMESPACE}/', f'{topics.NAMESPACE}/{topics.LINKS.name}'
    out: dict[str, list[str]] = {}
    each = [allowed(package, name, space) for space in drones]
    for kind in ('publish', 'subscribe'):
        kept = {full for full in own[kind] if full == private or not full.startswith(below)}
        of_drones = {full for one in each for full in one[kind]
                     if not full.endswith(f'/{topics.LINKS.name}')}
        out[kind] = sorted((kept if kind == 'publish' else set()) | of_drones)
    if (package, name) == DESCRIPTION:  # the frames of all drones, with their prefixes
        out['publish'] = sorted({*out['publish'], topics.TF.name})
        out['subscribe'] = sorted({*out['subscribe'], *(
            topics.full_name(topics.TF, space) for space in drones)})
    out['reply'] = own['reply']
    if 'request' in own:
        out['request'] = sorted({full for one in each for full in one['request']})
    return out


def _enclave(name: str, namespace: str, may: Mapping[str, list[str]]) -> ElementTree.Element:
    """Return the element of a node."""
    out = ElementTree.Element('enclave', path=f'{namespace}/{name}')
    profile = ElementTree.SubElement(
        ElementTree.SubElement(out, 'profiles'), 'profile', ns=namespace, node=name)
    for kind, names in may.items():
        one = 'service' if kind in ('reply', 'request') else 'topic'
        listed = ElementTree.SubElement(profile, f'{one}s', {kind: 'ALLOW'})
        for full in names:
            ElementTree.SubElement(listed, one).text = full
    return out


def policy(namespaces: Sequence[str]) -> str:
    """
    Return the policy of every node of some drones as XML.

    Parameters
    ----------
    namespaces
        Of the drones, with a leading slash.

    """
    out = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(out, 'enclaves')
    several = len(namespaces) > 1
    for namespace in namespaces:
        for package, name in NODES:
            if not several or (package, name) not in WATCHERS:
                enclaves.append(_enclave(name, namespace, allowed(package, name, namespace)))
    for package, name in WATCHERS if several else ():
        enclaves.append(_enclave(
            name, topics.NAMESPACE, watching(package, name, namespaces)))
    ElementTree.indent(out)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(out, "unicode")}\n'


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_text(options.output, policy(namespaces(options.drones)))
    once = len(WATCHERS) * (options.drones - 1)  # fewer
    print(f'{options.output}: {len(NODES) * options.drones - once} enclaves')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('policy', __doc__)
    out.add_output('XML', 'policy to write', required=True)
    out.add_argument('--drones', type=DRONES, default=1, metavar='N',
                     help='number of drones, named as by mambo run (default: 1)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo policy``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('policy', lambda: _run(options))
