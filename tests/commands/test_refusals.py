"""Settings that make no sense are refused by the name of their field."""

import pytest

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandGrid,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    RampedSchedule,
    RangeGrowth,
    SpeedProfile,
    SprintProfile,
    StageBlend,
    TargetSampling,
    Track,
)
from sprintlab.core.errors import InvalidValueError

WRONG = [
    (AdaptiveSchedule, {"window": 0.0}),
    (AdaptiveSchedule, {"braking_window": -1.0}),
    (AdaptiveSchedule, {"hold": (1.0, 0.4)}),
    (AdaptiveSchedule, {"biased_share": 1.1}),
    (TargetSampling, {"persistence": (-1.0, 2.0)}),
    (TargetSampling, {"top_share": 0.99}),
    (TargetSampling, {"yaw_limit": float("nan")}),
    (FixedAccelerationSchedule, {"acceleration": (4.0, 2.0)}),
    (RampedSchedule, {"ramp": 0.0}),
    (CommandGrid, {"speed": (3.0, 2.0)}),
    (CommandGrid, {"speed_bin": 2e-6}),  # eight million rows take all memory
    (CommandGrid, {"yaw_bins": 0}),
    (CommandGrid, {"gain": 1.5}),
    (CommandGrid, {"linear_success": -0.1}),
    (RangeGrowth, {"upper": 0.0}),
    (RangeGrowth, {"increment": -0.1}),
    (StageBlend, {"second_top": 5.0}),
    (StageBlend, {"ramp_iterations": 0}),
    (StageBlend, {"earliest_iteration": -1}),
    (SpeedProfile, {"top_speed": 0.0}),
    (SpeedProfile, {"acceleration": -4.0, "top_speed": 3.0}),
    (SpeedProfile, {"hold": -1.0, "top_speed": 3.0}),
    (SprintProfile, {"top_speed": -1.0}),
    (SprintProfile, {"stand": -1.0, "top_speed": 1.0}),
    (Track, {"radius": 0.0}),
    (Track, {"straight": -1.0}),
]


@pytest.mark.parametrize(("settings", "wrong"), WRONG)
def test_impossible_settings_are_refused(settings, wrong):
    with pytest.raises(InvalidValueError) as caught:
        settings(**wrong)
    assert next(iter(wrong)) in caught.value.field


def test_a_curriculum_needs_a_grid():
    with pytest.raises(InvalidValueError, match="grid"):
        CurriculumSchedule(targets=TargetSampling(grid=None))
