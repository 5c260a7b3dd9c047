"""For every pytest run below this folder, also a package's own: ROS that only sees itself."""

import fcntl
import gc
import os
from pathlib import Path
import resource
import tempfile

import pytest


def own_domain():
    """Return a ROS domain that no other pytest on this machine has, and the file that holds it."""
    for number in range(101, 50, -1):  # free of ephemeral ports, and flights take the lowest
        try:
            held = open(Path(tempfile.gettempdir()) / f'mambo_tests_domain_{number}.lock', 'a')
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            continue  # of another run, or of another user
        return number, held
    raise pytest.UsageError('no ROS domain is free: 51 test runs are under way on this machine')


_DOMAIN, _HELD = own_domain()
os.environ['ROS_DOMAIN_ID'] = str(_DOMAIN)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(
    Path(__file__).parent / 'src/mambo_ros/mambo_ros/fastdds_loopback.xml')
os.environ.setdefault(
    'HYPOTHESIS_STORAGE_DIRECTORY', str(Path(__file__).parent / '.cache/hypothesis'))

from hypothesis import settings  # noqa: E402 (reads the folder above)

# The same examples in every run, so that a failure repeats and a pass is no luck. No deadline for
# one example: the first compiles, and machines are shared.
settings.register_profile('mambo', derandomize=True, database=None, deadline=None, max_examples=60)
settings.load_profile('mambo')


SLOW = frozenset((Path(__file__).parent / 'tests' / 'slow.txt').read_text().splitlines())


@pytest.hookimpl(tryfirst=True)  # before slow ones are left out
def pytest_collection_modifyitems(items):
    """Mark what tools/slow_tests.py found slow."""
    for item in items:
        if item.nodeid.partition('[')[0] in SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def small_disk():
    """Return a function: from now on no file grows beyond so many bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def ros():
    """Initialise ROS for one test and destroy the nodes that it leaves behind."""
    import rclpy  # of the tests of nodes alone
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    for thing in gc.get_objects():  # or later tests find their publishers
        if issubclass(type(thing), Node):
            thing.destroy_node()
    rclpy.try_shutdown()
