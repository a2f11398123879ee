"""How the commanded velocity evolves: schedules, range growth, stages, evaluation profiles."""

from sprintlab.commands.clock import command_start, race_clock
from sprintlab.commands.comparators import CurriculumSchedule, RampedSchedule
from sprintlab.commands.curricula import BoxGrid, Curriculum, PredictionGrid, ProgressGrid
from sprintlab.commands.grid import CommandGrid, GridBins, TargetOutcome
from sprintlab.commands.growth import RangeGrowth, StageBlend, fastest_speed, ranked_speeds
from sprintlab.commands.heading import heading_angle, heading_command, wrap_angle
from sprintlab.commands.profiles import Phase, SpeedProfile, SprintProfile, self_paced
from sprintlab.commands.schedules import (
    AdaptiveSchedule,
    FixedAccelerationSchedule,
    Schedule,
    TargetSampling,
    UniformSchedule,
    check_schedule,
)
from sprintlab.commands.state import CommandState, initial_state, limit_yaw_rate
from sprintlab.commands.track import KERB_DISTANCE, LANE_WIDTH, PathPoint, Track, path_yaw_rate

__all__ = [
    "KERB_DISTANCE",
    "LANE_WIDTH",
    "AdaptiveSchedule",
    "BoxGrid",
    "CommandGrid",
    "CommandState",
    "Curriculum",
    "CurriculumSchedule",
    "FixedAccelerationSchedule",
    "GridBins",
    "PathPoint",
    "Phase",
    "PredictionGrid",
    "ProgressGrid",
    "RampedSchedule",
    "RangeGrowth",
    "Schedule",
    "SpeedProfile",
    "SprintProfile",
    "StageBlend",
    "TargetOutcome",
    "TargetSampling",
    "Track",
    "UniformSchedule",
    "check_schedule",
    "command_start",
    "fastest_speed",
    "heading_angle",
    "heading_command",
    "initial_state",
    "limit_yaw_rate",
    "path_yaw_rate",
    "race_clock",
    "ranked_speeds",
    "self_paced",
    "wrap_angle",
]
