"""For every pytest run below this folder, also a package's own: ROS that only sees itself."""

import os
import resource

import pytest

# One domain for each run: packages are tested side by side. 1 to 101 avoid the ephemeral ports.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 101)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


@pytest.fixture
def small_disk():
    """Return a function: from now on no file grows beyond so many bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
