"""Thresholds of the safety layer."""

from __future__ import annotations

from dataclasses import dataclass, fields

from sprintlab.core.checks import check_positive


@dataclass(frozen=True, kw_only=True)
class SafetySettings:
    """When something counts as wrong; the times here are those of ``RESPONSES``.

    Attributes:
        state_timeout: without a usable state [s].
        frozen_time: duration of states or positions that do not change [s].
        stuck_velocity: joint speed at which an unchanging position is a fault [rad/s].
        limit_margin: way beyond a joint's limits that elastic end stops may give [rad].
        limit_time: beyond that margin, or above the highest speed [s].
        overspeed_ratio: joint speed over no-load speed.
        overtorque_ratio: joint torque over the peak torque.
        overtorque_time: above it [s].
        bus_low: bus voltage over nominal at which it is too low.
        bus_low_time: below it [s].
        bus_high: bus voltage over nominal at which it is too high.
        bus_high_time: above it [s].
        fall_tilt: tilt of the trunk [degrees].
        fall_time: above it [s].
        collapse_height: leg extension over standing extension below which a leg carries nothing.
        collapse_time: duration without a carrying leg [s].
        tumble_rate: angular speed of the trunk [rad/s].
        tumble_time: above it [s].
        answer_timeout: without a newly accepted command [s].
        late_step: delay of a policy step that counts as late [s].
        late_steps: late ones among the last fifty.
        stall_time: between two steps of the loop [s].
        source_timeout: without a sign of life from the command source [s].
        fix_timeout: age at which a position fix is no longer used [s].
        start_tilt: greatest tilt at which the robot may stand up [degrees].
        start_speed: greatest joint speed at which a mode at rest may be left [rad/s].
        rest_time: for which no joint of a stopped robot may have been faster before its drives are switched
            off [s]: in a gallop, too, there are moments at which all joints are slow.

    Raises:
        InvalidValueError: a field is not positive.
    """

    state_timeout: float = 0.030
    frozen_time: float = 0.020
    stuck_velocity: float = 2.0
    limit_margin: float = 0.30
    limit_time: float = 0.005
    overspeed_ratio: float = 1.3
    overtorque_ratio: float = 1.3
    overtorque_time: float = 0.010
    bus_low: float = 0.6
    bus_low_time: float = 0.050
    bus_high: float = 1.25
    bus_high_time: float = 0.010
    fall_tilt: float = 60.0
    fall_time: float = 0.002
    collapse_height: float = 0.5
    collapse_time: float = 0.300
    tumble_rate: float = 15.0
    tumble_time: float = 0.020
    answer_timeout: float = 0.100
    late_step: float = 0.005
    late_steps: int = 10
    stall_time: float = 0.040
    source_timeout: float = 0.200
    fix_timeout: float = 0.500
    start_tilt: float = 30.0
    start_speed: float = 2.0
    rest_time: float = 0.200

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive(f"safety.{field.name}", getattr(self, field.name))
