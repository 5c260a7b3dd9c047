"""For every pytest run below this folder, also a package's own: ROS that only sees itself."""

import os

# One domain for each run: packages are tested side by side. 1 to 101 avoid the ephemeral ports.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 101)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
