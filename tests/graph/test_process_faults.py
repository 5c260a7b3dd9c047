"""
A signal to any process of ``./run``, in any mode, at any time: over soon, said, nothing left.

A seeded few of the faults that ``./chaos processes`` injects, and those that once went wrong.
"""

from pathlib import Path
import random
import sys

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import chaos  # noqa: E402 (a script of tools/, not a package)

ONCE_WRONG = [
    ('SIGINT', 'composed_node', 'composed', 'start'),  # taken for a success
    ('SIGSTOP', 'recorder_node', 'realtime', 'flight')]  # left shared memory
FEW = [fault for fault in sorted(chaos.every()) if fault.mode != 'drones']  # which take long
CHOSEN = list(dict.fromkeys([*ONCE_WRONG, *map(tuple, random.Random(5).sample(FEW, 3))]))


@pytest.mark.parametrize('number, target, mode, phase', CHOSEN)
def test_a_signal_ends_the_flight_and_leaves_nothing(
        tmp_path, number, target, mode, phase):
    verdict = chaos.try_fault(
        chaos.Fault(number, target, mode, phase), ROOT / 'bags/circle_short', folder=tmp_path)
    if verdict.missed:
        pytest.skip('it was over before')
    assert not verdict.lost


def test_every_node_signal_mode_and_phase_is_among_the_faults():
    faults = list(chaos.every())
    assert {fault.signal for fault in faults} == set(chaos.SIGNALS)
    assert {fault.mode for fault in faults} == {*chaos.MODES, 'replay'}
    assert {fault.phase for fault in faults} == set(chaos.PHASES)
    assert {fault.target for fault in faults} == {
        'runner', 'watchdog', 'composed_node', chaos.HALL_CAPTURE[1], *chaos.NODES,
        *chaos.REPLAYED}
    assert len(faults) == len(set(faults)) > 300
