"""Nodes of these tests start as copies of this process, as those of ``./run`` do: in less time."""

from functools import cache
from importlib import import_module
from pathlib import Path

from mambo_bringup import processes, replay
from mambo_bringup.flight import natnet, nodes
import pytest


@cache
def loaded():
    """Return the modules of nodes that this process can copy: none if it has used ROS itself."""
    if 'librmw_fastrtps' in Path('/proc/self/maps').read_text():
        return set()  # it may have threads of the middleware, which a copy does not get
    every = {*nodes.FLIGHT_NODES, nodes.RECORDER, nodes.SIMULATOR, nodes.COMPOSED,
             nodes.HALL_CAPTURE, nodes.VIEW, natnet.SERVER, natnet.CLIENT, replay.ESTIMATOR,
             replay.PLAYER}
    return {import_module('.'.join(node)).__name__ for node in every}


@pytest.fixture(scope='module', autouse=True)
def nodes_are_copies():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, '_LOADED', loaded())
        yield


@pytest.hookimpl(tryfirst=True)  # before slow ones are left out
def pytest_collection_modifyitems(items):
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.slow)
