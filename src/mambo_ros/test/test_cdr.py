"""The bytes of any message, and the stamp in them."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from mambo_interfaces.msg import EstimatorState, OpticalFlow, Reference
from mambo_ros.cdr import restamped, serialize, stamp_ns
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, Range
from tf2_msgs.msg import TFMessage


def test_variable_messages_equal_the_middleware_but_for_alignment():
    array = DiagnosticArray(status=[
        DiagnosticStatus(level=b'\x01', name='estimator', message='no flow', hardware_id='m1',
                         values=[KeyValue(key='a', value='1'), KeyValue(key='bcd', value='')]),
        DiagnosticStatus()])
    array.header.frame_id = 'x'
    for message in (array, TFMessage(transforms=[TransformStamped(), TransformStamped()]),
                    EstimatorState(), Reference(), OpticalFlow(), Range()):
        ours, theirs = serialize(message), serialize_message(message)
        assert len(ours) == -(-len(theirs) // 4) * 4  # bytes, whole words on the wire
        assert deserialize_message(ours, type(message)) == message


def test_stamp_is_read_from_bytes():
    message = Imu()
    message.header.stamp = Time(sec=12, nanosec=345)
    assert stamp_ns(serialize_message(message)) == 12_000_000_345
    assert stamp_ns(restamped(serialize_message(message), 7_000_000_001)) == 7_000_000_001
