"""A training recipe at another robot's size: BP2's lengths, speeds and masses, scaled.

Two legged robots move alike where their Froude numbers ``v^2 / (g l)`` are equal: at equal gravity speeds go
with the square root of the leg's length (Alexander and Jayes, J. Zool. 201, 1983), and so do times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

from sprintlab.robots import RobotDescription, load_robot
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.terms import Parameter, RewardTerm, Term

AnyTerm = TypeVar("AnyTerm", bound=Term)
REFERENCE_ROBOT = "bp2"
"""The robot that the default settings are for."""
DIMENSIONS = {
    "action_rate": (0, 0, -2), "smoothness": (0, 0, -4), "joint_acceleration": (0, 0, -4),
    "roll_pitch_rate": (0, 0, -2), "tilt_rate": (0, 0, -1), "yaw_rate": (0, 0, -2),
    "yaw_rate_error": (0, 0, -2),
    "vertical_velocity": (0, 2, -2), "touchdown": (0, 2, -2), "foot_slip": (0, 1, -1), "grounded": (0, 1, -1),
    "sideways_drift": (0, 1, -1), "base_height": (0, 2, 0), "foot_clearance": (0, 2, 0),
    "swing_clearance": (0, 3, -1), "joint_power": (1, 2, -3), "torque": (2, 4, -4),
    "hasty_touchdowns": (0, 0, -1), "short_stances": (0, 0, -1),  # each touchdown and stance costs once
}  # fmt: skip
"""Powers of mass, length and time in what a penalty measures, by the name of its function; none where it is
not here. Divided by them, a small robot's penalties weigh as much as those of a large one that moves alike:
unscaled, the Go1 would pay twice as much for its joints' accelerations. Alike means with equal actions, which
ask for equal shares of weight times leg."""


def leg_length(robot: RobotDescription) -> float:
    """Thigh and shank, from the hip's axis to the middle of the foot [m]."""
    return robot.mechanics.thigh_length + robot.mechanics.shank_length


def length_scale(robot: RobotDescription) -> float:
    """Lengths of the robot over BP2's."""
    return leg_length(robot) / leg_length(load_robot(REFERENCE_ROBOT))


def speed_scale(robot: RobotDescription) -> float:
    """Speeds and times of the robot over BP2's at equal Froude numbers."""
    return length_scale(robot) ** 0.5


def scaled_settings(robot: str, base: TrainingSettings) -> TrainingSettings:
    """``base``, which is for BP2, for ``robot``: lengths by leg length, speeds and times by Froude number.

    The payload goes with the mass; weights of penalties as in ``DIMENSIONS``. For BP2 nothing changes.
    """
    small, large = load_robot(robot), load_robot(REFERENCE_ROBOT)
    length, speed, mass = length_scale(small), speed_scale(small), small.total_mass / large.total_mass
    scales: dict[str, Callable[[float], float]] = {
        "height": lambda height: small.foot_radius + length * (height - large.foot_radius),
        "distance": lambda distance: length * distance,
        "speed": lambda value: speed * value,
        "brake_lag": lambda value: speed * value,
        "yaw_rates": lambda rate: rate / speed,
        "sharpness": lambda value: speed**2 * value,
        "mass": lambda value: mass * value,
    }
    stages, margin = base.stages, base.stages.record_margin
    if (constraints := base.constraints) is not None:
        legs = constraints.legs
        legs = replace(legs, limit=length * legs.limit, full=length * legs.full)
        constraints = replace(constraints, legs=legs)
    return replace(
        base,
        robot=robot,
        reward={
            name: _scaled_weight(_scaled_term(each, scales), mass, length)
            for name, each in base.reward.items()
        },
        randomization={name: _scaled_term(term, scales) for name, term in base.randomization.items()},
        constraints=constraints,
        stages=replace(
            stages,
            first_top=speed * stages.first_top,
            second_top=speed * stages.second_top,
            record_margin=None if margin is None else speed * margin,
        ),
    )


def _scaled_weight(term: RewardTerm, mass: float, length: float) -> RewardTerm:
    """A term whose weight makes up for the size of what it measures; times go with the root of lengths."""
    masses, lengths, times = DIMENSIONS.get(getattr(term.function, "__name__", ""), (0, 0, 0))
    size = mass**masses * length ** (lengths + 0.5 * times)
    first, second = term.weights
    weight = (first / size, second / size) if isinstance(term.weight, tuple) else first / size
    return replace(term, weight=weight)


def _scaled_term(term: AnyTerm, scales: Mapping[str, Callable[[float], float]]) -> AnyTerm:
    """A term whose parameters of a known name are scaled."""

    def scaled(name: str, value: Parameter) -> Parameter:
        if name not in scales:
            return value
        return tuple(map(scales[name], value)) if isinstance(value, tuple) else scales[name](value)

    return replace(term, parameters={name: scaled(name, value) for name, value in term.parameters.items()})
