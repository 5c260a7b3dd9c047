"""Parameters of the motion capture as the joint filter uses it, with unit, range and source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from mambo_model.schema import flag, quantity
from mambo_model.values import Parameters, values_type


@dataclass(frozen=True)
class PoseParams(Parameters):
    """What the joint filter believes of ``optitrack/pose``."""

    enabled: bool = flag(False, 'whether poses of the motion capture correct the estimate')
    latency: float = quantity(
        0.0, 's', 0.0, 0.25,
        'from exposure to stamp; 0: poses are stamped with their exposure, as optitrack_node does')
    position_noise: float = quantity(
        0.002, 'm', 1e-5, 1.0,
        'each axis: error up to 1 mm, thesis sec. 5.2, of which four successive frames share most')
    attitude_noise: float = quantity(
        0.005, 'rad', 1e-5, 1.0,
        'each axis: 0.001 in Crazyflie flights under Optitrack, and axes of the body that are set '
        'by eye')
    gate: float = quantity(
        5.0, 'sigma', 1.0, 100.0, 'refuses 3e-4 of good poses (chi-square of six numbers)')
    tilt_gate: float = quantity(
        0.2, 'rad', 0.01, 3.2,
        'a pose tilted further from the estimate is that of no body of ours, whatever it agrees '
        'with (judgement)')
    acquire_time: float = quantity(
        0.1, 's', 0.0, 100.0,
        'the first poses must agree with each other for so long (12 frames at 120 Hz)')
    recovery_time: float = quantity(
        2.0, 's', 0.0, 1e4,
        'refused poses that agree with each other for so long mean that the filter is wrong')
    recovery_distance: float = quantity(
        0.5, 'm', 0.0, 100.0,
        'the furthest that a recovery moves the position; the drift without cameras stays below '
        'for minutes')
    recovery_turn: float = quantity(
        0.5, 'rad', 0.0, 3.2, 'the furthest that a recovery turns the yaw; a flip turns 3.1')
    agreement: float = quantity(
        0.03, 'm', 1e-4, 10.0, 'how near to each other successive poses must be to agree')
    agreement_turn: float = quantity(0.1, 'rad', 1e-3, 3.2, 'likewise, the yaw')
    max_age: float = quantity(
        0.25, 's', 0.01, 1e4, 'unhealthy without a used pose for longer (30 frames at 120 Hz)')


PoseValues = values_type(PoseParams, without=('enabled',))


class AidedValues(NamedTuple):
    """Parameters of the joint filter with motion capture."""

    joint: Any        # JointValues
    pose: PoseValues  # of the motion capture
