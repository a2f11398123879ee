"""The six methods and what sets them apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sprintlab.commands import CommandStep, initial_state
from sprintlab.core.errors import InvalidValueError
from sprintlab.training.methods import METHODS, method_settings, preset_settings
from sprintlab.training.reward_tables import paper_rewards
from sprintlab.training.settings import PpoSettings, TrainingSettings

BASE = TrainingSettings(ppo=PpoSettings(steps=7), seed=11)


def changed(name: str, other: str) -> set[str]:
    """Fields of the two methods' settings that differ."""
    first, second = vars(method_settings(name, BASE)), vars(method_settings(other, BASE))
    return {field for field in first if first[field] != second[field]} - {"method"}


@pytest.mark.parametrize(
    ("name", "other", "switch"),
    [
        ("no-envelope", "acs", "actuator_model"),
        ("simplified-dc", "acs", "actuator_model"),
        ("fixed-acceleration", "acs", "schedule"),
        ("uniform-commands", "acs", "schedule"),
        ("baseline", "no-envelope", "schedule"),
        ("baseline", "uniform-commands", "actuator_model"),
    ],
)
def test_neighbours_of_the_six_are_one_switch_apart(name: str, other: str, switch: str) -> None:
    assert len(METHODS) == len({method_settings(each).digest() for each in METHODS}) == 6
    assert changed(name, other) == {switch}


@pytest.mark.parametrize(
    ("work", "words"), [(method_settings, r"gallop.*acs"), (preset_settings, r"preset.*sprintlab.*paper")]
)
def test_an_unknown_name_is_refused_with_those_that_are_known(
    work: Callable[[str], object], words: str
) -> None:
    with pytest.raises(InvalidValueError, match=words):
        work("gallop")


PRINTED = {
    "linear_tracking": (1.0, 1.0), "angular_tracking": (0.5, 0.5), "vertical_velocity": (-2.0, -2.0),
    "joint_power": (-1e-6, -1e-6), "action_rate": (-0.01, -0.01), "smoothness": (-0.005, -0.005),
    "joint_limit": (-10.0, -10.0), "roll_pitch_rate": (-0.02, -0.5), "orientation": (-5.0, -100.0),
    "base_height": (-10.0, -20.0), "joint_acceleration": (-2.5e-7, -1e-7), "abduction": (-1.0, 0.0),
    "collision": (-1.0, 0.0), "foot_slip": (0.0, -0.01), "yaw_rate": (0.0, -0.5),
    "foot_clearance": (-0.2, 0.0), "abduction_mirror": (0.0, -0.5),
}  # fmt: skip
"""The paper's Table I: stage I and stage II, zero where it prints N/A."""


def test_the_papers_rewards_are_those_of_its_table_and_no_others() -> None:
    assert {name: each.weights for name, each in paper_rewards().items()} == PRINTED


def test_the_papers_preset_changes_rewards_and_practice_and_composes_with_every_method() -> None:
    for name in METHODS:
        settings = method_settings(name, preset_settings("paper"))
        assert settings.reward == paper_rewards() and settings.ppo.low_noise_fraction == 0.0
        assert settings.constraints is None and not settings.ppo.symmetric
        assert settings.stages.record_margin is None
        assert settings.episodes.clone_share == settings.episodes.fast_start_share == 0.0
        assert settings.stages.second_top == 12.0
    assert preset_settings("sprintlab", BASE) == BASE


def test_literal_commands_follow_the_robot_and_move_toward_nothing() -> None:
    schedule = method_settings("literal-acs").schedule
    random = np.random.default_rng(0)
    count = 64
    state = initial_state(count, random.random(count))
    speed = np.full(count, 3.0)
    commands = []
    for _ in range(400):
        step = CommandStep(
            speed, 0.02, -2.0, 12.0, friction=0.8,
            reset_mask=np.zeros(count, dtype=bool), random=random.random((count, 8)),
        )  # fmt: skip
        state = schedule.advance(state, step)
        commands.append(np.asarray(state.command[:, 0]))
    given = np.concatenate(commands[20:])
    assert given.min() >= 2.0 and given.max() <= 4.0 and abs(given.mean() - 3.0) < 0.05
    assert np.ptp(np.asarray(state.target_speed)) > 3.0  # targets exist, and no command moves toward them
