"""A training recipe at another robot's size: BP2's lengths, speeds and masses, scaled.

Two legged robots move alike where their Froude numbers ``v^2 / (g l)`` are equal: at equal gravity speeds go
with the square root of the leg's length (Alexander and Jayes, J. Zool. 201, 1983), and so do times.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from sprintlab.robots import RobotDescription, load_robot
from sprintlab.training.settings import ConstraintSettings, TrainingSettings

REFERENCE_ROBOT = "bp2"
"""The robot that the default settings are for."""

Group = TypeVar("Group")


def leg_length(robot: RobotDescription) -> float:
    """Thigh and shank, from the hip's axis to the middle of the foot [m]."""
    return robot.mechanics.thigh_length + robot.mechanics.shank_length


def speed_scale(robot: RobotDescription) -> float:
    """Speeds and times of the robot over BP2's at equal Froude numbers."""
    return (leg_length(robot) / leg_length(load_robot(REFERENCE_ROBOT))) ** 0.5


def scaled_settings(
    robot: str, base: TrainingSettings | None = None, defaults: TrainingSettings | None = None
) -> TrainingSettings:
    """``base`` for ``robot``: lengths by leg length, speeds and times by Froude number, payload by mass.

    What was changed is left alone: only values that ``base`` shares with ``defaults`` are scaled. For the
    robot that the defaults are for, nothing changes but the name.

    Args:
        robot: name, folder or table.
        base: settings to scale; all defaults when left out.
        defaults: the settings that are for BP2; all defaults when left out.

    Raises:
        SprintlabError: the robot is not known, or its table is refused.
    """
    defaults = defaults or TrainingSettings()
    base = base or defaults
    small, large = load_robot(robot), load_robot(REFERENCE_ROBOT)
    speed, mass = speed_scale(small), small.total_mass / large.total_mass
    length = leg_length(small) / leg_length(large)
    rewards, episodes, stages = defaults.rewards, defaults.episodes, defaults.stages
    payload, held_width = defaults.randomization.payload, defaults.rewards.held_width
    narrow, wide = rewards.fine_yaw_rates

    def above_ground(height: float) -> float:
        """Height of a foot's middle whose sole is as high, scaled."""
        return small.foot_radius + length * (height - large.foot_radius)

    return replace(
        base,
        robot=robot,
        rewards=_where_default(
            base.rewards,
            rewards,
            foot_clearance_target=above_ground(rewards.foot_clearance_target),
            touchdown_height=above_ground(rewards.touchdown_height),
            leg_distance_limit=length * rewards.leg_distance_limit,
            shortest_stride=speed * rewards.shortest_stride,
            shortest_stance=speed * rewards.shortest_stance,
            progress=rewards.progress / speed,
            held_width=(speed * held_width[0], held_width[1]),
            fine_yaw_rates=(narrow / speed, wide / speed),
        ),
        randomization=_where_default(
            base.randomization,
            defaults.randomization,
            payload=(mass * payload[0], mass * payload[1]),
            center_of_mass=length * defaults.randomization.center_of_mass,
        ),
        episodes=_where_default(
            base.episodes,
            episodes,
            leg_distance_limit=length * episodes.leg_distance_limit,
            knee_clearance=length * episodes.knee_clearance,
        ),
        stages=_where_default(
            base.stages,
            stages,
            first_top=speed * stages.first_top,
            second_top=speed * stages.second_top,
            growth=speed * stages.growth,
            growth_margin=speed * stages.growth_margin,
            gated_top=speed * stages.gated_top,
            **({} if stages.record_margin is None else {"record_margin": speed * stages.record_margin}),
        ),
        constraints=_scaled_constraints(base.constraints, defaults.constraints, length),
    )


def _scaled_constraints(
    constraints: ConstraintSettings | None, defaults: ConstraintSettings | None, length: float
) -> ConstraintSettings | None:
    """The distance between legs by leg length; the other limits are shares of the robot's own."""
    if constraints is None or defaults is None or constraints.legs != defaults.legs:
        return constraints
    legs = replace(defaults.legs, limit=length * defaults.legs.limit, full=length * defaults.legs.full)
    return replace(constraints, legs=legs)


def _where_default(group: Group, defaults: Group, **scaled: Any) -> Group:
    """``group`` with the scaled values in place of those that it shares with ``defaults``."""
    kept = {name: value for name, value in scaled.items() if getattr(group, name) == getattr(defaults, name)}
    return replace(group, **kept)  # type: ignore[type-var]
