"""Fixtures shared by the tests of nodes."""

import gc

import pytest
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


@pytest.fixture
def ros():
    """Initialise ROS for one test and destroy the nodes that it leaves behind."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    for thing in gc.get_objects():
        if issubclass(type(thing), Node):
            thing.destroy_node()
    rclpy.try_shutdown()
