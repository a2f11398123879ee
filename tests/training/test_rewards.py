"""Reward terms against values computed by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from sprintlab.core.errors import InvalidValueError
from sprintlab.robots import load_robot
from sprintlab.training.environment import rewards
from sprintlab.training.environment.kinematics import BodyState
from sprintlab.training.environment.reward_sum import RewardTerms, aggregate
from sprintlab.training.environment.rewards import Loads, RewardInput
from sprintlab.training.methods import method
from sprintlab.training.reward_tables import default_rewards
from sprintlab.training.scaling import leg_length
from sprintlab.training.terms import RewardTerm, term

TABLE = default_rewards()
OTHERS = {
    "leg_distance": {"distance": 0.04},
    "angular_tracking": {"sharpness": 1.5},
    "swing_clearance": {"height": 0.11},
}
"""Parameters that the default table does not have."""
WIDTHS = {
    "gravity": 3, "angular_velocity": 3, "velocity": 3, "joint_position": 12, "joint_velocity": 12,
    "foot_height": 4, "foot_speed": 4, "foot_descent": 4, "contact": 4, "knee_height": 4, "leg_distance": 4,
    "abduction": 4,
}  # fmt: skip
NO_LOADS = Loads(torch.zeros(1), *(torch.zeros(1, 4) for _ in range(3)))


def still(**body: torch.Tensor) -> RewardInput:
    """One robot of zeros, but for some parts of its body."""
    zeros = {
        name: torch.zeros(1, WIDTHS[name]) if name in WIDTHS else torch.zeros(1) for name in BodyState._fields
    }
    joints = torch.zeros(1, 12)
    return RewardInput(
        body=BodyState(**{**zeros, **body}),
        command=torch.zeros(1, 3),
        target_speed=torch.full((1,), 20.0),
        action=joints,
        previous_action=joints,
        earlier_action=joints,
        joint_acceleration=joints,
        torque=joints,
        limit_excess=joints,
        base_height_target=0.3,
        loads=NO_LOADS,
        running_speed=torch.zeros(1),
        running_yaw_rate=torch.zeros(1),
        running_side_speed=torch.zeros(1),
        running_command=torch.zeros(1, 3),
        weight=torch.tensor([400.0]),
    )


def asked(*command: float, target: float = 20.0, **body: torch.Tensor) -> RewardInput:
    """One robot with a command, of which the forward part moves toward a target."""
    inputs = still(**body)._replace(command=row(*command), running_command=row(*command))
    return inputs._replace(target_speed=torch.tensor([target]))


def loaded(**loads: torch.Tensor) -> RewardInput:
    """One robot at rest with some loads."""
    return still()._replace(loads=NO_LOADS._replace(**loads))


def row(*values: float) -> torch.Tensor:
    return torch.tensor([values], dtype=torch.float32)


def moving(size: float, mass: float, foot_radius: float, asked_for: float) -> RewardInput:
    """A robot that moves in a random way; one of another size and mass, with equal Froude numbers, alike."""

    def height(*values: float) -> torch.Tensor:
        return foot_radius + size * (row(*values) - load_robot("bp2").foot_radius)

    torch.manual_seed(0)
    time = speed = size**0.5
    step, jerk, joints = torch.randn(3, 1, 12)
    body = {
        "gravity": row(0.3, 0.4, -0.8), "angular_velocity": row(1, 2, 3) / time,
        "velocity": speed * row(3, 0.5, -1), "height": size * torch.tensor([0.5]),
        "joint_velocity": joints / time, "abduction": row(0.1, 0.2, 0.3, 0.5), "contact": row(1, 0, 0, 1),
        "foot_height": height(0.04, 0.06, 0.1, 0.2), "foot_speed": speed * row(1, 2, 3, 4),
        "foot_descent": speed * row(2, 3, 0, 0), "knee_height": height(0.09, 0.11, 0.2, 0.3),
        "leg_distance": size * row(0.03, 0.12, 0.01, 0.2),
    }  # fmt: skip
    command = speed * row(asked_for, 0, 0)
    action = step / time
    return still(**body)._replace(
        command=command,
        running_command=command,
        target_speed=speed * torch.tensor([4.0]),
        action=action,
        earlier_action=jerk / time**2 - action,
        joint_acceleration=joints / time**2,
        torque=mass * size * joints,
        limit_excess=0.1 * joints,
        base_height_target=size * 0.45,
        loads=NO_LOADS._replace(
            power=mass * speed * torch.tensor([900.0]),
            hasty_touchdowns=row(0.1, 0.2, 0, 0) / time,
            short_stances=row(0, 0.3, 0, 0) / time,
        ),
        running_speed=speed * torch.tensor([0.5]),
        running_yaw_rate=torch.tensor([0.2]) / time,
        running_side_speed=speed * torch.tensor([0.3]),
        weight=mass * torch.tensor([400.0]),
        no_load_speed=0.5 / time,
    )


@pytest.mark.parametrize(("preset", "name"), [("sprintlab", "acs"), ("paper", "acs"), ("sprintlab", "hound")])
@pytest.mark.parametrize("asked_for", [0.0, 2.0])
def test_a_small_robot_that_moves_alike_earns_alike(preset, name, asked_for):
    small, large = load_robot("go1"), load_robot("bp2")
    length, mass = leg_length(small) / leg_length(large), small.total_mass / large.total_mass
    inputs = (
        moving(length, mass, small.foot_radius, asked_for),
        moving(1.0, 1.0, large.foot_radius, asked_for),
    )
    settings = [method(name, robot=robot, preset=preset) for robot in ("go1", "bp2")]
    for term_name in settings[0].reward:
        weighed = [
            value(each.reward[term_name], x) * torch.tensor(each.reward[term_name].weights)
            for each, x in zip(settings, inputs, strict=True)
        ]
        torch.testing.assert_close(*weighed, rtol=1e-4, atol=1e-7, msg=term_name)


def value(each: RewardTerm, inputs: RewardInput) -> float:
    return RewardTerms({"it": each}, "cpu").values(inputs).item()


@pytest.mark.parametrize(
    ("name", "inputs", "expected"),
    [
        ("vertical_velocity", still(velocity=row(3, 2, -2)), 4.0),
        ("orientation", still(gravity=row(0.3, 0.4, -0.8)), 0.25),
        ("roll_pitch_rate", still(angular_velocity=row(1, 2, 9)), 5.0),
        ("yaw_rate", still(angular_velocity=row(1, 2, 3)), 9.0),
        ("base_height", still(height=torch.tensor([0.5])), 0.04),
        ("foot_slip", still(foot_speed=row(1, 2, 3, 4), contact=row(1, 0, 1, 0)), 4.0),
        ("collision", still(knee_height=row(0.05, 0.2, 0.09, 0.3)), 2.0),
        ("leg_distance", still(leg_distance=row(0.03, 0.12, 0.01, 0.2)), 2.0),
        ("electrical_power", loaded(power=row(1200.0)[0]), 1200.0 / (400.0 * 2.0)),
        ("hasty_touchdowns", loaded(hasty_touchdowns=row(0.5, 0.0, 2.0, 0.0)), 2.5),
        ("short_stances", loaded(short_stances=row(0.5, 0.0, 1.0, 0.0)), 1.5),
        (
            "motion_at_zero_command",
            loaded(stance=row(1, 1, 0.5, 0))._replace(running_speed=row(-0.5)[0]),
            2.5,
        ),
        ("motion_at_zero_command", loaded(stance=row(0, 0, 0, 0))._replace(command=row(0.5, 0, 0)), 0.0),
        ("grounded", still(contact=row(1, 1, 0, 0), velocity=row(4, 0, 0)), 2.0),
        ("over_speed", still(joint_velocity=row(*[-1.5] + [0.5] * 11))._replace(no_load_speed=1.0), 0.25),
        ("touchdown", still(foot_height=row(0.04, 0.06, 0.1, 0.1), foot_descent=row(2, 3, 0, 0)), 4.0),
        ("foot_clearance", still(foot_height=row(0.21, 0.11, 0.11, 0.11), foot_speed=row(2, 5, 5, 5)), 0.02),
        ("abduction", still(abduction=row(0.0, 3.0, 6.0, 9.0)), 9 + 36 + 81),
        ("abduction_mirror", still(abduction=row(0.0, 3.0, 6.0, 9.0)), 9 + 225),
        ("joint_power", still(joint_velocity=row(*[-2.0] * 12))._replace(torque=torch.ones(1, 12)), 24),
        ("diagonal_contact", still(contact=row(1, 0, 0, 1)), 1.0),
        ("diagonal_contact", still(contact=row(1, 1, 0, 1)), 0.0),
        ("tilt_rate", still(angular_velocity=row(-1, 2, 9)), 3.0),
        ("torque", still()._replace(torque=torch.full((1, 12), 2.0)), 48.0),
        ("action_rate", still()._replace(action=torch.full((1, 12), 0.5)), 3.0),
        ("smoothness", still()._replace(previous_action=torch.full((1, 12), 0.5)), 12.0),
        ("sideways_drift", still()._replace(running_side_speed=row(-0.3)[0]), 0.3),
        ("sideways_drift", asked(8, 0, 0.3)._replace(running_side_speed=row(0.3)[0]), 0.0),
        ("progress", asked(-2, 0, 0, target=-3.0, velocity=row(-1.5, 0, 0)), 0.15),
        ("progress", asked(2, 0, 0, target=-3.0, velocity=row(-1.5, 0, 0)), 0.0),
        ("progress", asked(7, 0, 0, target=9.0, velocity=row(8, 0, 0)), 0.7),
        ("progress", asked(7, 0, 0, target=3.0, velocity=row(8, 0, 0)), 0.3),
        ("progress", asked(7, 0, 0, target=-1.0, velocity=row(8, 0, 0)), 0.0),
        ("linear_tracking", asked(3, 1, 0, velocity=row(3, 1, 5)), 1.0),
        ("linear_tracking", asked(2, 0, 0, velocity=row(3, 1, 5)), math.exp(-2)),
        ("angular_tracking", asked(0, 0, 2, angular_velocity=row(0, 0, 2)), 1.0),
        ("angular_tracking", asked(0, 0, 1, angular_velocity=row(0, 0, 2)), math.exp(-1.5)),
        ("yaw_rate_error", asked(0, 0, 1, angular_velocity=row(0, 0, 3)), 4.0),
        ("swing_clearance", still(foot_height=row(0.21, 0.11, 0.11, 0.11)), 0.0),
    ],
)
def test_a_term_has_its_value(name: str, inputs: RewardInput, expected: float) -> None:
    table = name in TABLE and name not in OTHERS
    each = TABLE[name] if table else term(getattr(rewards, name), 1.0, **OTHERS.get(name, {}))
    assert value(each, inputs) == pytest.approx(expected, rel=1e-5)


def test_a_lean_into_the_turn_is_free_and_no_other_tilt() -> None:
    turning = {"command": row(10, 0, 0.4), "running_speed": torch.tensor([10.0])}
    lean = 4.0 / math.hypot(4.0, 9.81)
    for sideways, expected in ((lean, 0.0), (0.5 * lean, 0.0), (-0.1, 0.01), (lean + 0.1, 0.01)):
        inputs = still(gravity=row(0.0, sideways, -0.9))._replace(**turning)
        assert value(TABLE["orientation"], inputs) == pytest.approx(expected, abs=1e-6)
        assert rewards.tilt(inputs).item() == pytest.approx(sideways**2, abs=1e-6)


def test_fine_tracking_has_a_slope_everywhere() -> None:
    inputs = asked(10, 0, 0)._replace(running_speed=torch.tensor([1.0]), running_yaw_rate=torch.tensor([0.2]))
    assert value(TABLE["speed_held"], inputs) == pytest.approx(math.exp(-9.0 / (0.3 + 0.065 * 10.0)))
    turn = 0.5 * (math.exp(-0.2 / 0.1) + math.exp(-0.2 / 0.4))
    assert value(TABLE["yaw_rate_held"], inputs) == pytest.approx(turn)


@pytest.mark.parametrize(("speed", "error"), [(10.5, 0.0), (9.5, 0.0), (11.8, 1.0)])
def test_a_brake_may_lag_behind_its_command(speed: float, error: float) -> None:
    braking = asked(10, 0, 0, target=0.0)._replace(running_speed=torch.tensor([speed]))
    assert value(TABLE["speed_held"], braking) == pytest.approx(math.exp(-error / 0.95), rel=1e-5)


@pytest.mark.parametrize(("tied", "steady"), [(True, False), (True, True), (False, False)])
def test_what_is_tied_is_paid_by_how_well_the_command_is_held(tied: bool, steady: bool) -> None:
    """Progress, too, which pays robots that dawdle; the turn counts in the fine-tuning phase."""
    table = {name: replace(each, tied=each.tied and tied) for name, each in TABLE.items()}
    running = asked(10, 0, 0.1, target=10.0, velocity=row(9, 0, 0))
    running = running._replace(running_speed=torch.tensor([9.0]))
    turn = 0.5 * (math.exp(-0.1 / 0.1) + math.exp(-0.1 / 0.4))
    held = math.exp(-1.0 / 0.95) * (turn if steady else 1.0)
    others = 1.0 * math.exp(-1.0) + 0.5 * math.exp(-0.01) + 1.5 * 0.9 + 3.5 * turn
    terms = RewardTerms(table, "cpu")
    terms.set_stage(0.0, steady)
    earned = terms.earned(running)
    assert earned.paid.item() == pytest.approx(4.0 * held + (held if tied else 1.0) * others, rel=1e-5)
    assert (earned.paid + earned.penalties).item() == pytest.approx(earned.parts.sum().item(), rel=1e-5)


def test_weights_blend_from_stage_to_stage() -> None:
    terms = RewardTerms({"orientation": TABLE["orientation"], "progress": TABLE["progress"]}, "cpu")
    for share, weight in ((0.0, -5.0), (0.25, -28.75), (1.0, -100.0)):
        terms.set_stage(share)
        assert terms.weights.tolist() == [weight, 1.5]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"weight": (-1.0, 2.0)}, "one sign"),
        ({"weight": -1.0, "tied": True}, "positive where the term is tied"),
        ({"weight": 1.0, "height": 2.0}, "progress takes speed"),
    ],
)
def test_a_term_that_makes_no_sense_is_refused(arguments, words) -> None:
    with pytest.raises(InvalidValueError, match=words):
        term(rewards.progress, **{"speed": 10.0, **arguments})
    with pytest.raises(InvalidValueError, match="progress takes speed"):
        term(rewards.progress, 1.0)


def test_penalties_of_a_broken_robot_are_finite() -> None:
    inputs = still(velocity=row(0, 0, math.nan), angular_velocity=row(math.inf, 0, 0))
    assert torch.isfinite(RewardTerms(TABLE, "cpu").values(inputs)).all()


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("exponential", [1.5 * math.exp(-0.5), 1.5 * math.exp(-2)]),
        ("clipped", [0.5, 0.0]),
    ],
)
def test_aggregation(mode: str, expected: list[float]) -> None:
    rate = aggregate(torch.full((2,), 1.5), torch.tensor([-1.0, -4.0]), mode)
    assert rate.tolist() == pytest.approx(expected)
