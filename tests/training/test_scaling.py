"""Settings at another robot's size: lengths, speeds and masses."""

import pytest

from sprintlab.robots import load_robot
from sprintlab.training.methods import method
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
    robot, reward = load_robot("go2"), scaled_settings("go2").reward
    for name, over_sole in (("foot_clearance", 0.08), ("touchdown", 0.02)):
        height = reward[name].parameters["height"]
        assert (height - robot.foot_radius) / 0.426 == pytest.approx(over_sole / 0.63)


def test_payload_goes_with_mass():
    light, heavy = (
        settings.randomization["payload"].parameters["mass"]
        for settings in (scaled_settings("go2"), TrainingSettings())
    )
    share = load_robot("go2").total_mass / load_robot("bp2").total_mass
    assert light == pytest.approx([share * end for end in heavy])


def test_the_papers_preset_is_scaled_too():
    paper = method(robot="go2", preset="paper")
    assert paper.stages.second_top == pytest.approx(12.0 * (0.426 / 0.63) ** 0.5)
    assert "progress" not in paper.reward and paper.episodes.clone_share == 0.0


def test_constraints_and_kernels_scale_with_the_robot():
    settings, default = scaled_settings("go2"), TrainingSettings()
    length = leg_length(load_robot("go2")) / 0.63
    assert settings.constraints.legs.limit == pytest.approx(length * default.constraints.legs.limit)
    assert settings.constraints.foot == default.constraints.foot
    held = settings.reward["speed_held"].parameters
    assert (held["speed"], held["share"]) == (pytest.approx(0.5 * length**0.5), 0.05)
    yaw_rates = settings.reward["yaw_rate_held"].parameters["yaw_rates"]
    assert yaw_rates == pytest.approx((0.1 / length**0.5, 0.4 / length**0.5))
    assert settings.stages.record_margin == pytest.approx(1.5 * length**0.5)
