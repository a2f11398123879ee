"""Every field of the settings counts in their hash."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.commands import AdaptiveSchedule
from sprintlab.training.settings import RewardWeight, TrainingSettings

HASH_BEFORE_DRIFT = "420212caf1cdd6f4e4cbb3195a93ff84510060e01b78df8e5bddfa4a063a92fc"
"""Of the defaults, as runs had it before the reward ``sideways_drift`` came."""
PPO_FIELDS = {"precision": "bfloat16", "quiet_share": 0.1, "quiet_noise": 0.5}


def as_before() -> TrainingSettings:
    """What was trained before the later fields came."""
    defaults = TrainingSettings()
    return replace(
        defaults,
        heading_hold=False,
        schedule=AdaptiveSchedule(braking_window=1.0),
        ppo=replace(defaults.ppo, quiet_share=0.0),
        stages=replace(defaults.stages, steady_iteration=None),
    )


@pytest.mark.parametrize(("name", "value"), PPO_FIELDS.items())
def test_a_later_field_of_ppo_counts_as_soon_as_it_changes_something(name: str, value: float | str) -> None:
    settings = as_before()
    assert replace(settings, ppo=replace(settings.ppo, **{name: value})).digest() != settings.digest()


def test_other_later_fields_count_as_soon_as_they_change_something() -> None:
    settings = as_before()
    assert replace(settings, heading_hold=True).digest() != settings.digest()
    braking = replace(settings.schedule, braking_window=2.0)
    assert replace(settings, schedule=braking).digest() != settings.digest()
    steady = replace(settings.stages, steady_iteration=0)
    assert replace(settings, stages=steady).digest() != settings.digest()


def test_a_later_reward_counts_only_where_it_has_a_weight() -> None:
    settings = TrainingSettings()
    assert settings.digest() == HASH_BEFORE_DRIFT
    weight = RewardWeight(first=0.0, second=-1.0)
    assert (
        replace(settings, rewards=replace(settings.rewards, sideways_drift=weight)).digest()
        != HASH_BEFORE_DRIFT
    )
