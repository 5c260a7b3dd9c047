"""Helpers for nodes in this process: wait for links, serve nodes from a thread, clean up."""

from __future__ import annotations

from contextlib import contextmanager
import threading
import time

from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode

PATIENCE = 60.0  # s; the condition takes milliseconds on an idle machine


def until(condition, what, step=None):
    """Wait for a condition; call ``step`` meanwhile."""
    limit = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < limit, f'waited {PATIENCE:g} s for {what}'
        if step is None:
            time.sleep(0.002)
        else:
            step()


def readers(node: MamboNode, topic) -> int:
    """Return the number of readers that a node's messages on a topic reach."""
    name = node.resolve_topic_name(topic.name)
    return sum(output.matched for output in node.outputs if output.publisher.topic_name == name)


@contextmanager
def serving(*nodes):
    """Serve nodes by one loop in a thread; yield the loop."""
    loop = Loop(*nodes)
    thread = threading.Thread(target=loop.run, daemon=True)
    thread.start()
    try:
        yield loop
    finally:
        loop.stop()
        thread.join(PATIENCE)
        loop.close()
        for node in nodes:
            node.destroy_node()
    assert not thread.is_alive(), 'the loop did not stop'
