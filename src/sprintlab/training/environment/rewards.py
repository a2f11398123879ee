"""The paper's reward table, term by term: pure functions of one step.

Each penalty is a function ``(RewardInput, RewardSettings) -> (n,)``, found by its name in ``RewardSettings``;
adding one is a function here and a weight there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch

from sprintlab.commands.state import GRAVITY
from sprintlab.control.standing import REST_COMMAND
from sprintlab.core.errors import InvalidValueError
from sprintlab.training.environment.kinematics import BodyState
from sprintlab.training.settings import RewardSettings

PROGRESS_SPEED = 10.0
"""Speed at which the progress term is one [m/s]."""
STRAIGHT_ON = 0.1
"""Below this yaw rate a command asks for no turn [rad/s]."""
POWER_SPEED = 2.0
"""Added to the speed by which electrical power is divided [m/s], so that standing has a cost. With 0.5 m/s,
and the power that action noise takes in training, walking on was cheaper than standing when asked to."""
KNEE_CONTACT_HEIGHT = 0.10
"""A knee axis lower than this counts as a collision [m]."""


class Loads(NamedTuple):
    """What happened inside of the policy step.

    Attributes:
        power: drawn from the bus, mean of each millisecond's, which is never negative [W] ``(n,)``.
        stance: share of the step that a foot stood ``(n, legs)``.
        hasty_touchdowns: cost of touchdowns sooner than a stride after the last ``(n, legs)``.
        short_stances: cost of stances that were too short ``(n, legs)``.
    """

    power: torch.Tensor
    stance: torch.Tensor
    hasty_touchdowns: torch.Tensor
    short_stances: torch.Tensor


class RewardInput(NamedTuple):
    """Everything a term may look at, for ``n`` environments.

    Attributes:
        body: state after the step.
        command: forward, sideways speed [m/s], yaw rate [rad/s] ``(n, 3)``, in force during the step.
        target_speed: where the commanded forward speed is on its way to [m/s] ``(n,)``.
        action: of this step ``(n, joints)``.
        previous_action: of the step before ``(n, joints)``.
        earlier_action: of two steps before ``(n, joints)``.
        joint_acceleration: finite difference over the policy step [rad/s^2] ``(n, joints)``.
        torque: delivered by the motors [N m] ``(n, joints)``.
        limit_excess: beyond the beginning of the end stops [rad] ``(n, joints)``.
        base_height_target: [m].
        loads: what happened inside of this policy step.
        running_speed: forward speed, averaged over about a stride [m/s] ``(n,)``.
        running_yaw_rate: averaged alike [rad/s] ``(n,)``.
        running_side_speed: to the left, averaged alike [m/s] ``(n,)``.
        weight: of the robot [N] ``(n,)``.
        peak_torque: of each joint near standstill [N m] ``(joints,)``.
        no_load_speed: of each joint on the robot's own bus [rad/s] ``(joints,)``.
    """

    body: BodyState
    command: torch.Tensor
    target_speed: torch.Tensor
    action: torch.Tensor
    previous_action: torch.Tensor
    earlier_action: torch.Tensor
    joint_acceleration: torch.Tensor
    torque: torch.Tensor
    limit_excess: torch.Tensor
    base_height_target: float
    loads: Loads
    running_speed: torch.Tensor
    running_yaw_rate: torch.Tensor
    running_side_speed: torch.Tensor
    weight: torch.Tensor | float
    no_load_speed: torch.Tensor | float = math.inf
    peak_torque: torch.Tensor | float = 1.0


Penalty = Callable[[RewardInput, RewardSettings], torch.Tensor]

PENALTIES: dict[str, Penalty] = {
    "vertical_velocity": lambda x, s: x.body.velocity[:, 2].square(),
    "joint_power": lambda x, s: (x.torque * x.body.joint_velocity).abs().sum(1),
    "action_rate": lambda x, s: (x.action - x.previous_action).square().sum(1),
    "smoothness": lambda x, s: (x.action - 2 * x.previous_action + x.earlier_action).square().sum(1),
    "joint_limit": lambda x, s: x.limit_excess.square().sum(1),
    "roll_pitch_rate": lambda x, s: x.body.angular_velocity[:, :2].square().sum(1),
    "orientation": lambda x, s: _unwanted_tilt(x, s),
    "base_height": lambda x, s: (x.body.height - x.base_height_target).square(),
    "joint_acceleration": lambda x, s: x.joint_acceleration.square().sum(1),
    "abduction": lambda x, s: x.body.abduction.square().sum(1),
    "collision": lambda x, s: (x.body.knee_height < KNEE_CONTACT_HEIGHT).float().sum(1),
    "foot_slip": lambda x, s: (x.body.foot_speed * x.body.contact).sum(1),
    "yaw_rate": lambda x, s: _unwanted_yaw_rate(x, s).square(),
    "foot_clearance": lambda x, s: _clearance_error(x, s).sum(1),
    "abduction_mirror": lambda x, s: (
        (x.body.abduction[:, 0::2] + x.body.abduction[:, 1::2]).square().sum(1)  # left and right
    ),
    "grounded": lambda x, s: x.body.contact.mean(1) * x.body.velocity[:, 0].clamp(min=0.0),
    "touchdown": lambda x, s: (
        x.body.foot_descent.square() * (x.body.foot_height < s.touchdown_height).float()
    ).sum(1),
    "over_speed": lambda x, s: (
        (x.body.joint_velocity.abs() / x.no_load_speed - 1.0).clamp(min=0.0).square().sum(1)
    ),
    "electrical_power": lambda x, s: (
        x.loads.power / (x.weight * (x.body.velocity[:, 0].abs() + POWER_SPEED))
    ),
    "hasty_touchdowns": lambda x, s: x.loads.hasty_touchdowns.sum(1),
    "short_stances": lambda x, s: x.loads.short_stances.sum(1),
    "motion_at_zero_command": lambda x, s: (
        _asked_to_stand(x) * ((1.0 - x.loads.stance).sum(1) + 2.0 * x.running_speed.abs().clamp(max=1.0))
    ),
    "leg_distance": lambda x, s: (x.body.leg_distance < s.leg_distance_limit).float().sum(1),
    "diagonal_contact": lambda x, s: _diagonal_contact(x.body.contact),
    "tilt_rate": lambda x, s: x.body.angular_velocity[:, :2].abs().sum(1),
    "torque": lambda x, s: x.torque.square().sum(1),
    "load_balance": lambda x, s: (x.torque.abs() / x.peak_torque).var(1, correction=0),
    "sideways_drift": lambda x, s: _asked_straight_on(x) * x.running_side_speed.abs(),
}


def _asked_to_stand(x: RewardInput) -> torch.Tensor:
    """1 where the command is rest."""
    return (x.command.abs() < REST_COMMAND).all(1).float()


def _asked_straight_on(x: RewardInput) -> torch.Tensor:
    """1 where no turn is commanded: a robot that turns may move to the side of where it points."""
    return (x.command[:, 2].abs() < STRAIGHT_ON).float()


def _unwanted_tilt(x: RewardInput, s: RewardSettings) -> torch.Tensor:
    """Squared tilt of the trunk; a lean into the turn, up to ``tan(lean) = v w / g``, is free."""
    pitch, roll = x.body.gravity[:, 0], x.body.gravity[:, 1]
    if not s.bare_squares:
        lateral = x.running_speed * x.command[:, 2] / GRAVITY
        lean = lateral * torch.rsqrt(1.0 + lateral.square())
        roll = roll - torch.minimum(torch.maximum(roll, lean.clamp(max=0.0)), lean.clamp(min=0.0))
    return pitch.square() + roll.square()


def _unwanted_yaw_rate(x: RewardInput, s: RewardSettings) -> torch.Tensor:
    """Yaw rate beyond the commanded one: the paper's bare square would fight the command."""
    turn = x.body.angular_velocity[:, 2]
    return turn if s.bare_squares else turn - x.command[:, 2]


def _clearance_error(x: RewardInput, s: RewardSettings) -> torch.Tensor:
    """Squared height error of each foot, weighted by its speed as in DreamWaQ: bare, it punishes standing."""
    error = (x.body.foot_height - s.foot_clearance_target).square()
    return error if s.bare_squares else error * x.body.foot_speed


def _diagonal_contact(contact: torch.Tensor) -> torch.Tensor:
    """1 where exactly one diagonal pair of feet (FL and RR, or FR and RL) touches ``(n,)``."""
    first, second = contact[:, 0] * contact[:, 3], contact[:, 1] * contact[:, 2]
    return (first + second) * (contact.sum(1) == 2.0).float()


def tracking(
    x: RewardInput, angular_sharpness: float = 1.0
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """What is rewarded, unweighted, each ``(n,)``.

    ``exp(-|v_xy - command|^2)``, ``exp(-angular_sharpness (yaw rate - command)^2)``, and the speed in the
    commanded direction, up to the commanded one and to the target, over 10 m/s. A command that follows a
    robot which brakes would pay for not braking.
    """
    error = (x.command[:, :2] - x.body.velocity[:, :2]).square().sum(1)
    turn = (x.command[:, 2] - x.body.angular_velocity[:, 2]).square()
    direction = torch.sign(x.command[:, 0])
    wanted = torch.minimum(x.command[:, 0].abs(), (x.target_speed * direction).clamp(min=0.0))
    along = x.body.velocity[:, 0] * direction
    onward = torch.minimum(along.clamp(min=0.0), wanted) / PROGRESS_SPEED
    return torch.exp(-error), torch.exp(-angular_sharpness * turn), onward


def fine_tracking(x: RewardInput, settings: RewardSettings) -> tuple[torch.Tensor, torch.Tensor]:
    """Accuracy over a stride, unweighted, each ``(n,)``: of the forward speed and of the yaw rate.

    ``exp(-|error| / width)``: the paper's kernels, 1 m/s and 1 rad/s wide, are flat where a good runner is;
    these have a slope everywhere. The width of the first grows with the command.
    """
    standing, growing = settings.held_width
    command = x.command[:, 0]
    held = torch.exp(-(command - x.running_speed).abs() / (standing + growing * command.abs()))
    error = (x.command[:, 2] - x.running_yaw_rate).abs()
    narrow, wide = (torch.exp(-error / width) for width in settings.fine_yaw_rates)
    return held, 0.5 * (narrow + wide)


def rewarded(x: RewardInput, settings: RewardSettings) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Everything paid, weighted; and the speed and yaw kernels of the paper, unweighted; ``(n,)`` each."""
    follow, turn, onward = tracking(x, settings.angular_sharpness)
    held, fine_turn = fine_tracking(x, settings)
    others = (
        settings.linear_tracking * follow
        + settings.angular_tracking * turn
        + settings.progress * onward
        + settings.fine_yaw_tracking * fine_turn
    )
    return settings.fine_speed_tracking * held + (held * others if settings.tied else others), follow, turn


def penalty_terms(settings: RewardSettings) -> tuple[Penalty, ...]:
    """The functions behind ``settings.penalties()``, in its order.

    Raises:
        InvalidValueError: a weight belongs to no function in ``PENALTIES``.
    """
    for name in settings.penalties():
        if name not in PENALTIES:
            raise InvalidValueError(f"rewards.{name}", name, "its function must be put into PENALTIES")
    return tuple(PENALTIES[name] for name in settings.penalties())


def penalties(x: RewardInput, settings: RewardSettings, terms: Sequence[Penalty]) -> torch.Tensor:
    """All penalties, unweighted, in the order of ``terms``: ``(n, terms)``.

    Infinities and NaN of a broken environment become zero: it ends, and must not poison the batch.
    """
    values = torch.stack([term(x, settings) for term in terms], 1)
    return torch.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def aggregate(positive: torch.Tensor, negative: torch.Tensor, settings: RewardSettings) -> torch.Tensor:
    """Reward rate ``(n,)`` from the weighted tracking sum and the (negative) weighted penalty sum."""
    if settings.aggregation == "exponential":
        return positive * torch.exp(settings.penalty_scale * negative.clamp(min=-20.0))
    total = positive + negative
    return total.clamp(min=0.0) if settings.aggregation == "clipped" else total
