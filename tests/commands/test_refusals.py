"""Settings that make no sense are refused by the name of their field."""

from dataclasses import MISSING, fields

import pytest

from sprintlab.commands import (
    AdaptiveSchedule,
    BoxGrid,
    CommandGrid,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    ProgressGrid,
    RampedSchedule,
    SpeedProfile,
    SprintProfile,
    TargetSampling,
)
from sprintlab.core.errors import InvalidValueError

SETTINGS = (
    AdaptiveSchedule, BoxGrid, CommandGrid, CurriculumSchedule, FixedAccelerationSchedule, ProgressGrid,
    RampedSchedule, SpeedProfile, SprintProfile, TargetSampling,
)  # fmt: skip


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("number", [float("nan"), -1e9])
def test_impossible_numbers_are_refused_by_the_name_of_their_field(settings, number):
    needed = {each.name: 3.0 for each in fields(settings) if each.default is MISSING}
    numbers = [each.name for each in fields(settings) if type(each.default) in (int, float)]
    for name in (*needed, *numbers):
        with pytest.raises(InvalidValueError) as caught:
            settings(**needed | {name: number})
        assert name in caught.value.field
