"""Settings at another robot's size: lengths, speeds and masses."""

from dataclasses import replace

import pytest

from sprintlab.robots import load_robot
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.scaling import leg_length, scaled_settings
from sprintlab.training.settings import TrainingSettings


def test_nothing_changes_for_the_robot_that_the_defaults_are_for():
    assert scaled_settings("bp2") == TrainingSettings()


def test_speeds_have_equal_froude_numbers():
    for robot in ("go1", "go2"):
        settings, length = scaled_settings(robot), leg_length(load_robot(robot))
        for name in ("first_top", "second_top"):
            scaled, default = getattr(settings.stages, name), getattr(TrainingSettings().stages, name)
            assert scaled**2 / length == pytest.approx(default**2 / 0.63)


def test_the_sole_swings_at_the_same_share_of_the_leg():
    robot, rewards = load_robot("go2"), scaled_settings("go2").rewards
    assert (rewards.foot_clearance_target - robot.foot_radius) / 0.426 == pytest.approx(0.08 / 0.63)
    assert (rewards.touchdown_height - robot.foot_radius) / 0.426 == pytest.approx(0.02 / 0.63)


def test_payload_goes_with_mass():
    light, heavy = scaled_settings("go2").randomization.payload, TrainingSettings().randomization.payload
    share = load_robot("go2").total_mass / load_robot("bp2").total_mass
    assert light == pytest.approx([share * end for end in heavy])


def test_what_was_changed_is_left_alone():
    base = TrainingSettings()
    chosen = replace(
        base,
        stages=replace(base.stages, second_top=7.0),
        episodes=replace(base.episodes, knee_clearance=0.02),
    )
    scaled = scaled_settings("go2", chosen)
    assert (scaled.stages.second_top, scaled.episodes.knee_clearance) == (7.0, 0.02)
    assert scaled.stages.first_top == pytest.approx(6.0 * (0.426 / 0.63) ** 0.5)


def test_the_option_scales_and_the_setting_does_not():
    scaled = TrainOptions(robot="go2", environments=64, seed=3).full_settings()
    plain = TrainOptions(settings=TrainingSettings(robot="go2")).full_settings()
    assert scaled.robot == plain.robot == "go2"
    assert (scaled.seed, scaled.simulation.environments) == (3, 64)
    assert scaled.stages.second_top < plain.stages.second_top == 14.5


def test_the_papers_preset_is_scaled_too():
    paper = TrainOptions(robot="go2", preset="paper").full_settings()
    assert paper.stages.second_top == pytest.approx(12.0 * (0.426 / 0.63) ** 0.5)
    assert paper.rewards.progress == 0.0 and paper.episodes.clone_share == 0.0


def test_constraints_and_kernels_scale_with_the_robot():
    settings, default = scaled_settings("go2"), TrainingSettings()
    length = leg_length(load_robot("go2")) / 0.63
    assert settings.constraints.legs.limit == pytest.approx(length * default.constraints.legs.limit)
    assert settings.constraints.foot == default.constraints.foot
    assert settings.rewards.held_width == pytest.approx((0.5 * length**0.5, 0.05))
    assert settings.stages.record_margin == pytest.approx(1.5 * length**0.5)
