"""Motors that turn while the phase of the reference asks for none break a rule."""

from mambo_bringup.checking.contract import CONTRACTS
from mambo_bringup.checking.idle import Idle
from mambo_bringup.checking.transcript import BROKEN, KEPT, Transcript, UNSEEN
from mambo_model.motion.flatness import Reference
from mambo_model.motion.trajectory import GROUND, LANDED, TRACK
from mambo_ros import messages
import pytest

ZERO, LEVEL = (0.0,) * 3, (1.0, 0.0, 0.0, 0.0)
REST = Reference(ZERO, ZERO, ZERO, ZERO, ZERO, LEVEL, ZERO, ZERO, 1.0, ZERO)
STEP = 5_000_000  # ns


@pytest.mark.parametrize(('steps', 'verdict', 'seen'), [
    (((GROUND, 0.0), (TRACK, 200.0), (LANDED, 0.0)), KEPT, 'PWM 0 in all of 2 steps'),
    (((GROUND, 0.0), (TRACK, 200.0), (LANDED, 130.0)), BROKEN,
     'turn in 1 of 2 steps of phase GROUND or LANDED, first at 0.010 s in LANDED with PWM 130'),
    (((GROUND, 10.0), (GROUND, 0.0)), BROKEN, 'first at 0.000 s in GROUND with PWM 10'),
    (((GROUND, 0.0), (GROUND, None)), KEPT, 'PWM 0 in all of 1 steps'),  # without an answer
    (((TRACK, 200.0),), UNSEEN, '')])
def test_motors_that_turn_on_the_floor_break_the_rule(steps, verdict, seen):
    one = Transcript(CONTRACTS['controller'])
    idle = Idle(one)
    for k, (phase, pwm) in enumerate(steps):
        idle.hear_reference(messages.reference(k * STEP, REST, phase))
        if pwm is not None:
            idle.hear_command(messages.motor_pwm(k * STEP, (0.0, 0.0, pwm, 0.0), False, 0))
    idle.judge()
    found = next(rule for rule in one.findings() if rule.rule == 'motors off')
    assert found.verdict == verdict and seen in found.seen


def test_motors_that_are_shut_down_do_not_turn():
    one = Transcript(CONTRACTS['controller'])
    idle = Idle(one)
    idle.hear_reference(messages.reference(0, REST, GROUND))
    idle.hear_command(messages.motor_pwm(0, (200.0,) * 4, True, 1))
    idle.judge()
    assert one.notes['motors off'][0] == KEPT


def test_a_damaged_message_is_left_to_another_rule():
    one = Transcript(CONTRACTS['controller'])
    idle = Idle(one)
    idle.hear_reference(b'1')
    idle.hear_command(messages.motor_pwm(0, ZERO + (0.0,), False, 0)[:20])
    idle.judge()
    assert not one.notes
