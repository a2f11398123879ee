"""Settings at another robot's size: lengths, speeds and masses."""

import pytest

from sprintlab.robots import load_robot
from sprintlab.training.methods import method
from sprintlab.training.scaling import leg_length, scaled_settings
from sprintlab.training.settings import TrainingSettings


def test_nothing_changes_for_the_robot_that_the_defaults_are_for():
    assert scaled_settings("bp2", TrainingSettings()) == TrainingSettings()


@pytest.mark.parametrize("preset", ["sprintlab", "paper"])
@pytest.mark.parametrize("name", ["go1", "go2"])
def test_lengths_go_with_the_leg_speeds_with_its_root_and_payload_with_the_mass(name, preset):
    robot, large = load_robot(name), load_robot("bp2")
    settings, default = method(robot=name, preset=preset), method(preset=preset)
    length = leg_length(robot) / leg_length(large)
    speed, mass = length**0.5, robot.total_mass / large.total_mass  # equal Froude numbers

    def numbers(found):
        height = found.reward["foot_clearance"].parameters["height"] - load_robot(found.robot).foot_radius
        lengths, speeds = [height], [found.stages.first_top, found.stages.second_top]
        rates, payload = [], found.randomization["payload"].parameters["mass"]
        if preset == "sprintlab":
            lengths.append(found.constraints.legs.limit)
            speeds += [found.stages.record_margin, found.reward["speed_held"].parameters["speed"]]
            rates = found.reward["yaw_rate_held"].parameters["yaw_rates"]
        return lengths, speeds, rates, payload

    for scaled, base, factor in zip(
        numbers(settings), numbers(default), (length, speed, 1 / speed, mass), strict=True
    ):
        assert scaled == pytest.approx([factor * value for value in base])
    assert settings.constraints is None or settings.constraints.foot == default.constraints.foot
