"""Parameters that changed in a flight that was recorded."""

from __future__ import annotations

from mambo_bags.reader import Bag
from mambo_model.motion import parameter_change
from mambo_model.motion.parameter_change import Change
from mambo_ros import topics
from mambo_ros.commands.change_message import decode

from .changes import NODES
from .scenario import override, Scenario

RECORD = (topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.name[1:])
"""Topics that a bag with the changes of a flight is read with, of one drone or of several."""


def changes_of(bag: Bag) -> dict[str, str]:
    """Return {node.changes: text} of a bag that was read with :data:`RECORD`."""
    out: dict[str, list[Change]] = {node: [] for node in NODES}
    namespace = bag.namespace or topics.NAMESPACE
    name = topics.full_name(topics.DIAGNOSTICS, namespace)
    for data in bag[name].raw if name in bag else ():
        for node, change in decode(data, namespace):
            if node in out:
                out[node].append(change)
    return {f'{node}.changes': parameter_change.to_text(found) for node, found in out.items()}


def estimated(flight: Scenario, bag: Bag) -> Scenario:
    """Return the scenario of a bag, read with :data:`RECORD`, with what its estimator changed."""
    name = 'estimator_node.changes'
    return override(flight, {name: changes_of(bag)[name]})
