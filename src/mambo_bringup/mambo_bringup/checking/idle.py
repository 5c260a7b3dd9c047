"""Whether a controller that is checked lets the motors stand still on the floor."""

from __future__ import annotations

from contextlib import suppress

from mambo_interfaces.msg import Reference
from mambo_ros import messages

from .contract import MOTORS_STOP
from .transcript import Transcript

_NAMES = {Reference.PHASE_GROUND: 'GROUND', Reference.PHASE_LANDED: 'LANDED'}


class Idle:
    """
    Hears references and motor commands; judges those of the same stamp.

    A command of which no reference has the stamp is not judged: the rule ``stamps`` names it. So
    is a message that cannot be read, which breaks the rule ``values``.

    Parameters
    ----------
    transcript
        Of the controller.

    """

    def __init__(self, transcript: Transcript) -> None:
        self._transcript = transcript
        self._phases: dict[int, int] = {}  # by stamp, ns
        self._turning: dict[int, float] = {}  # largest PWM, by stamp, ns

    def hear_reference(self, data: bytes) -> None:
        """Take a reference."""
        with suppress(Exception):  # of a message that is damaged
            t, _, phase = messages.decode_reference(data)
            self._phases[t] = phase

    def hear_command(self, data: bytes) -> None:
        """Take a motor command."""
        with suppress(Exception):  # of a message that is damaged
            t, pwm, shutdown = messages.decode_motor_pwm(data)
            self._turning[t] = 0.0 if shutdown else max(pwm)

    def judge(self) -> None:
        """Note whether the motors stood still in the phases GROUND and LANDED."""
        asked = [t for t in sorted(self._phases.keys() & self._turning.keys())
                 if self._phases[t] in MOTORS_STOP]
        if not asked:
            return
        wrong = [t for t in asked if self._turning[t] > 0.0]
        if not wrong:
            self._transcript.note('motors off', True, (
                f'PWM 0 in all of {len(asked)} steps of phase GROUND or LANDED'))
            return
        first = wrong[0]
        self._transcript.note('motors off', False, (
            f'the motors turn in {len(wrong)} of {len(asked)} steps of phase GROUND or LANDED, '
            f'first at {first * 1e-9:.3f} s in {_NAMES[self._phases[first]]} with PWM '
            f'{self._turning[first]:.4g}, wanted 0'))
