"""Thresholds of the safety layer."""

from __future__ import annotations

from dataclasses import dataclass, fields

from sprintlab.core.checks import check_positive


@dataclass(frozen=True, kw_only=True)
class SafetySettings:
    """When something counts as wrong; the times here are those of ``RESPONSES``.

    Raises:
        InvalidValueError: a field is not positive.
    """

    state_timeout: float = 0.030  # [s] without a usable state
    frozen_time: float = 0.020  # [s] in which states or positions do not change
    stuck_velocity: float = 2.0  # [rad/s] of a joint at which an unchanging position is a fault
    limit_margin: float = 0.30  # [rad] beyond a joint's limits that elastic end stops may give
    limit_time: float = 0.005  # [s] beyond that margin, or above the highest speed
    overspeed_ratio: float = 1.3  # joint speed over no-load speed
    overtorque_ratio: float = 1.3  # joint torque over peak torque
    overtorque_time: float = 0.010  # [s]
    bus_low: float = 0.6  # bus voltage over nominal below which it is too low
    bus_low_time: float = 0.050  # [s]
    bus_high: float = 1.25  # bus voltage over nominal above which it is too high
    bus_high_time: float = 0.010  # [s]
    fall_tilt: float = 60.0  # [degrees] of the trunk
    fall_time: float = 0.002  # [s]
    collapse_height: float = 0.5  # leg extension over standing extension below which a leg carries nothing
    collapse_time: float = 0.300  # [s] without a carrying leg
    tumble_rate: float = 15.0  # [rad/s] of the trunk
    tumble_time: float = 0.020  # [s]
    answer_timeout: float = 0.100  # [s] without a newly accepted command
    late_step: float = 0.005  # [s] of delay from which a policy step counts as late
    late_steps: int = 10  # late ones among the last fifty
    stall_time: float = 0.040  # [s] between two steps of the loop
    source_timeout: float = 0.200  # [s] without a sign of life from the command source
    fix_timeout: float = 0.500  # [s] after which a position fix is no longer used
    start_tilt: float = 30.0  # [degrees] up to which the robot may stand up
    start_speed: float = 2.0  # [rad/s] up to which a joint counts as at rest
    rest_time: float = 0.200  # [s] of rest before the drives of a stopped robot are switched off

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive(f"safety.{field.name}", getattr(self, field.name))
