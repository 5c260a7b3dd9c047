"""The size of a request is read from the memory of its generated C structure."""

import array
import ctypes

from mambo_ros.commands import request_size
from mambo_ros.commands.request_size import bounded, PARAMETER, STRING, TooLarge
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters

CONVERTER = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)
CREATOR = ctypes.CFUNCTYPE(ctypes.c_void_p)
DESTROYER = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def function(kind, capsule):
    return kind(request_size._pointer(capsule, None))


def read(srv_type, request, element, most, largest):
    """Do what rclpy does: fill the C structure of a request, and read it by the bounded type."""
    kind, small = type(request).__class__, bounded(srv_type, element, most, largest, 'things')
    assert small.Response is srv_type.Response
    meta = type(small.Request)
    assert meta._CREATE_ROS_MESSAGE is kind._CREATE_ROS_MESSAGE
    address = function(CREATOR, kind._CREATE_ROS_MESSAGE)()
    try:
        assert function(CONVERTER, kind._CONVERT_FROM_PY)(request, address)
        return function(request_size._Converter, meta._CONVERT_TO_PY)(address)
    finally:
        function(DESTROYER, meta._DESTROY_ROS_MESSAGE)(address)


@pytest.mark.parametrize('value, characters', [
    ({'string_value': 'four'}, 4), ({'byte_array_value': [b'a', b'b']}, 2),
    ({'bool_array_value': [True]}, 1), ({'integer_array_value': array.array('q', [4, 5, 6])}, 3),
    ({'double_array_value': [1.0] * 5}, 5), ({'string_array_value': ['ab', 'c']}, 2),
    ({'integer_value': 2**40, 'double_value': 1e300, 'bool_value': True, 'type': 9}, 0)])
def test_characters_and_elements_of_parameters_count(value, characters):
    """Each array and text is counted at its place of the structure, and nothing else is."""
    request = SetParameters.Request(parameters=[
        Parameter(name='gain'), Parameter(name='bias', value=ParameterValue(**value))])
    assert read(SetParameters, request, PARAMETER, 2, 8 + characters) == request
    refused = read(SetParameters, request, PARAMETER, 2, 7 + characters)
    assert isinstance(refused, TooLarge) and refused.count == 2
    assert refused.reason == (
        f'more than {7 + characters} characters and numbers in one request')


def test_more_elements_than_the_limit_are_not_read():
    request = GetParameters.Request(names=['a', 'bc', 'd'])
    assert read(GetParameters, request, STRING, 3, 4) == request
    refused = read(GetParameters, request, STRING, 2, 4)
    assert (refused.reason, refused.count) == ('more than 2 things in one request', 3)
    assert isinstance(read(GetParameters, request, STRING, 3, 3), TooLarge)
    assert read(GetParameters, GetParameters.Request(), STRING, 0, 0) == GetParameters.Request()


def test_what_fails_is_told(monkeypatch):
    monkeypatch.setattr(request_size, '_length', lambda *_: 1 // 0)
    refused = read(GetParameters, GetParameters.Request(), STRING, 3, 4)
    assert refused.reason == 'the request cannot be read: integer division or modulo by zero'
