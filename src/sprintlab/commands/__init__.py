"""How the commanded velocity evolves: schedules, range growth, stages."""

from sprintlab.commands.growth import RangeGrowth, StageBlend, fastest_speed
from sprintlab.commands.schedules import (
    AdaptiveSchedule,
    FixedAccelerationSchedule,
    TargetSampling,
    UniformSchedule,
)
from sprintlab.commands.state import CommandState, initial_state, limit_yaw_rate

__all__ = [
    "AdaptiveSchedule",
    "CommandState",
    "FixedAccelerationSchedule",
    "RangeGrowth",
    "StageBlend",
    "TargetSampling",
    "UniformSchedule",
    "fastest_speed",
    "initial_state",
    "limit_yaw_rate",
]
