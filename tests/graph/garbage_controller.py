"""A controller that answers every step with garbage, alone or composed with the other nodes."""

import math
import os
from pathlib import Path
import sys

from mambo_bringup import composed_node
from mambo_control.parameters import ControllerNodeParams
from mambo_ros import messages, node, process, topics

FUTURE = 1_795_307_261_000_000_000  # ns
PWM = (200.0,) * 4
KINDS = {
    'future': lambda t: messages.motor_pwm(t + FUTURE, PWM, False, 0),
    'old': lambda t: messages.motor_pwm(0, PWM, False, 0) if t else None,
    'nan': lambda t: messages.motor_pwm(t, (math.nan,) * 4, False, 0),
    'infinite': lambda t: messages.motor_pwm(t, (math.inf,) * 4, False, 0),
    'negative': lambda t: messages.motor_pwm(t, (-1.0,) * 4, False, 0),
    'short': lambda t: messages.motor_pwm(t, PWM, False, 0)[:9],
    'noise': lambda t: b'\xff' * 60,
    'huge': lambda t: b'\x00\x01\x00\x00' + bytes(70_000)}
GOOD = 1_500_000_000  # ns of flight for which a controller that goes wrong later is right


class GarbageController(node.MamboNode):
    """Publishes good commands first if it is told so, then garbage."""

    def __init__(self, **kwargs):
        super().__init__('controller_node', ControllerNodeParams, **kwargs)
        kind, _, late = os.environ['MAMBO_GARBAGE'].partition('-')
        self._make, self._good = KINDS[kind], GOOD if late else -1
        self._pwm = self.advertise(topics.MOTOR_PWM)
        self.advertise(topics.CONTROLLER_STATE)
        self.advertise(topics.DIAGNOSTICS)
        self.accept(topics.REFERENCE, messages.decode_reference, lambda *_: None, timed=False)
        self.accept(topics.ESTIMATE, messages.decode_estimate, self._answer, timed=False)

    def _answer(self, t, *_):
        data = (messages.motor_pwm(t, PWM, False, 0) if t <= self._good else self._make(t))
        if data is not None:
            self._pwm(data)


if Path(sys.argv[0]).name == 'controller_node':
    process.main(GarbageController)
composed_node.NODES = tuple(
    GarbageController if kind.__name__ == 'ControllerNode' else kind
    for kind in composed_node.NODES)
composed_node.main()
