"""Messages of the graph become poses of the page; what cannot be shown is counted."""

import math

from mambo_model.motion.rigid_body import State
from mambo_ros import diagnostics, messages, topics
from mambo_view.drone_state import ESTIMATE, MEASURED, TRUTH
from mambo_view.live import Mailbox
from mambo_view.view_node import statuses
import pytest

Q = (math.cos(0.1), 0.0, math.sin(0.1), 0.0)  # NED: pitch up by 0.2 rad
AT = State((1.0, 2.0, -1.5), (0.1, 0.0, 0.0), Q, (0.0,) * 3)
NONE = (0.0,) * 36


def put(box, *pairs):
    for topic, data in pairs:
        box.put(topic, data)
    return box.read()


def test_poses_are_in_the_world_with_z_up():
    box = Mailbox(statuses)
    assert put(box, (topics.GROUND_TRUTH, messages.ground_truth(2_500_000_000, AT)),
               (topics.OPTITRACK, messages.optitrack(0, AT.rho, AT.q)),
               (topics.MOTOR_PWM, messages.motor_pwm(0, (1.0, 2.0, 3.0, 4.0), False, 0)))
    for role in (TRUTH, MEASURED):
        pose = box.state.poses[role]
        assert pose.position == (1.0, -2.0, 1.5)
        assert pose.attitude == pytest.approx((Q[0], 0.0, -Q[2], 0.0))
    assert (box.state.t, box.state.pwm, box.refused) == (2.5, (1.0, 2.0, 3.0, 4.0), 0)
    assert not box.read()


def test_the_last_message_of_a_topic_counts_and_estimates_in_map_win():
    box = Mailbox(statuses)
    near, far = AT._replace(rho=(0.1, 0.0, 0.0)), AT._replace(rho=(9.0, 0.0, 0.0))
    put(box, (topics.ESTIMATE, messages.estimate(0, AT, NONE, NONE)),
        (topics.ESTIMATE, messages.estimate(5, near, NONE, NONE)))
    assert box.state.poses[ESTIMATE].position[0] == 0.1
    put(box, (topics.LOCATED, messages.located(10, far, NONE, NONE)))
    put(box, (topics.ESTIMATE, messages.estimate(10, near, NONE, NONE)))
    assert box.state.poses[ESTIMATE].position[0] == 9.0


@pytest.mark.parametrize('data', [
    b'', b'\0' * 7, b'\xff' * 1000, b'\0' * 70_000,
    messages.ground_truth(0, AT._replace(rho=(math.nan, 0.0, 0.0))),
    messages.ground_truth(0, AT._replace(q=(0.0,) * 4))],
    ids=['empty', 'short', 'noise', 'large', 'nan', 'no attitude'])
def test_what_is_no_pose_is_counted_and_not_shown(data):
    box = Mailbox(statuses)
    put(box, (topics.GROUND_TRUTH, data))
    assert box.refused == 1 and not box.state.poses and math.isnan(box.state.t)


def test_health_is_that_of_each_node_and_bounded():
    box = Mailbox(statuses)
    put(box, *((topics.DIAGNOSTICS, diagnostics.report(0, name, level, text, {}))
               for name, level, text in (('a', diagnostics.OK, 'flying'),
                                         ('b', diagnostics.ERROR, 'lost'),
                                         ('a', diagnostics.WARN, 'late'))))
    assert box.state.health == {'a': (1, 'late'), 'b': (2, 'lost')}
    for number in range(200):
        put(box, (topics.DIAGNOSTICS, diagnostics.report(0, str(number), diagnostics.OK, '', {})))
    assert len(box.state.health) == 64
    put(box, (topics.DIAGNOSTICS, b'\0\1\0\0' + b'\xff' * 40))
    assert box.refused == 1
