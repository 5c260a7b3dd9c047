"""What the tests of nodes share."""

import gc

import pytest
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


@pytest.fixture
def ros():
    """Have ROS in this process for one test, which may leave its nodes lying about."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    for thing in gc.get_objects():
        if issubclass(type(thing), Node):
            thing.destroy_node()
    rclpy.try_shutdown()
