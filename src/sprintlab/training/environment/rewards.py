"""Reward terms: functions of one step, ``(RewardInput, parameters by name) -> (n,)``, unweighted.

A run names those that it uses, with weights and parameters: ``training.reward_tables``. Adding one is a
function, here or in a module of one's own, and a line in a run's table. PyTorch is not imported here, so that
settings, which name these functions, can be read at once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sprintlab.control.standing import REST_COMMAND
from sprintlab.core.constants import GRAVITY

if TYPE_CHECKING:
    import torch

    from sprintlab.training.environment.kinematics import BodyState

STRAIGHT_ON = 0.1
"""Below this yaw rate a command asks for no turn [rad/s]."""


class Loads(NamedTuple):
    """What happened inside of the policy step."""

    power: torch.Tensor  # drawn from the bus, mean of each millisecond's, which is never negative [W] (n,)
    stance: torch.Tensor  # share of the step that a foot stood (n, legs)
    hasty_touchdowns: torch.Tensor  # cost of touchdowns sooner than a stride after the last (n, legs)
    short_stances: torch.Tensor  # cost of stances that were too short (n, legs)


class RewardInput(NamedTuple):
    """Everything a term may look at, for ``n`` environments."""

    body: BodyState  # state after the step
    command: torch.Tensor  # forward, sideways speed [m/s], yaw rate [rad/s] (n, 3), in force during the step
    target_speed: torch.Tensor  # where the commanded forward speed is on its way to [m/s] (n,)
    action: torch.Tensor  # action of this step (n, joints)
    previous_action: torch.Tensor  # action of the step before (n, joints)
    earlier_action: torch.Tensor  # action of two steps before (n, joints)
    joint_acceleration: torch.Tensor  # finite difference over the policy step [rad/s^2] (n, joints)
    torque: torch.Tensor  # delivered by the motors [N m] (n, joints)
    limit_excess: torch.Tensor  # beyond the beginning of the end stops [rad] (n, joints)
    base_height_target: float  # [m]
    loads: Loads  # what happened inside of this policy step
    running_speed: torch.Tensor  # forward speed, averaged over about a stride [m/s] (n,)
    running_yaw_rate: torch.Tensor  # averaged alike [rad/s] (n,)
    running_side_speed: torch.Tensor  # to the left, averaged alike [m/s] (n,)
    running_command: torch.Tensor  # the command, averaged alike (n, 3)
    weight: torch.Tensor | float  # weight of the robot [N] (n,)
    no_load_speed: torch.Tensor | float = math.inf
    """No-load speed of each joint on the robot's own bus [rad/s] ``(joints,)``."""


# --- what is rewarded ------------------------------------------------------------------------------------


def linear_tracking(x: RewardInput, *, speed: float) -> torch.Tensor:
    """``exp(-|v_xy - command|^2 / speed^2)``, ``speed`` in m/s."""
    error = (x.command[:, :2] - x.body.velocity[:, :2]) / speed
    return (-error.square().sum(1)).exp()


def angular_tracking(x: RewardInput, *, sharpness: float) -> torch.Tensor:
    """``exp(-sharpness (yaw rate - command)^2)``, ``sharpness`` in s^2/rad^2."""
    return (-sharpness * (x.command[:, 2] - x.body.angular_velocity[:, 2]).square()).exp()


def progress(x: RewardInput, *, speed: float) -> torch.Tensor:
    """Speed in the commanded direction over ``speed`` [m/s], up to the commanded one and to the target.

    Under ACS the command follows the robot, so that tracking alone pays no more at 12 m/s than at 8. A
    command that follows a robot which brakes would pay for not braking: hence the target.
    """
    direction = x.command[:, 0].sign()
    wanted = x.command[:, 0].abs().minimum((x.target_speed * direction).clamp(min=0.0))
    along = x.body.velocity[:, 0] * direction
    return along.clamp(min=0.0).minimum(wanted) / speed


def speed_held(x: RewardInput, *, speed: float, share: float, brake_lag: float) -> torch.Tensor:
    """``exp(-|command - speed| / (speed + share |command|))``, both averaged over about a stride.

    The paper's kernel, 1 m/s wide, is flat where a good runner is; this one has a slope everywhere. An
    average is late: held against the command of the moment, it would ask a robot that brakes to be slower
    than its command, and to brake harder than the command until it is. A robot needs a stride before it can
    brake at all: while its command falls, an error of up to ``brake_lag`` [m/s] is free.
    """
    command = x.running_command[:, 0]
    braking = (x.command[:, 0].abs() > x.target_speed.abs()).float()
    error = ((command - x.running_speed).abs() - brake_lag * braking).clamp(min=0.0)
    return (-error / (speed + share * command.abs())).exp()


def yaw_rate_held(x: RewardInput, *, yaw_rates: tuple[float, float]) -> torch.Tensor:
    """Mean of ``exp(-|error| / width)`` over two widths [rad/s]: a narrow one, and one for large errors.

    Command and yaw rate are averaged over about a stride.
    """
    error = (x.running_command[:, 2] - x.running_yaw_rate).abs()
    narrow, wide = ((-error / width).exp() for width in yaw_rates)
    return 0.5 * (narrow + wide)


def diagonal_contact(x: RewardInput) -> torch.Tensor:
    """1 where exactly one diagonal pair of feet (FL and RR, or FR and RL) touches."""
    contact = x.body.contact
    first, second = contact[:, 0] * contact[:, 3], contact[:, 1] * contact[:, 2]
    return (first + second) * (contact.sum(1) == 2.0).float()


# --- penalties: the paper's ------------------------------------------------------------------------------


def vertical_velocity(x: RewardInput) -> torch.Tensor:
    """Squared vertical speed of the trunk."""
    return x.body.velocity[:, 2].square()


def joint_power(x: RewardInput) -> torch.Tensor:
    """Sum of the magnitudes of the joints' mechanical power [W]."""
    return (x.torque * x.body.joint_velocity).abs().sum(1)


def action_rate(x: RewardInput) -> torch.Tensor:
    """Squared change of the action."""
    return (x.action - x.previous_action).square().sum(1)


def smoothness(x: RewardInput) -> torch.Tensor:
    """Squared second difference of the action."""
    return (x.action - 2 * x.previous_action + x.earlier_action).square().sum(1)


def joint_limit(x: RewardInput) -> torch.Tensor:
    """Squared depth in the end stops [rad^2]."""
    return x.limit_excess.square().sum(1)


def roll_pitch_rate(x: RewardInput) -> torch.Tensor:
    """Squared roll and pitch rates."""
    return x.body.angular_velocity[:, :2].square().sum(1)


def tilt(x: RewardInput) -> torch.Tensor:
    """Squared tilt of the trunk, which fights the lean into a turn."""
    return x.body.gravity[:, 0].square() + x.body.gravity[:, 1].square()


def base_height(x: RewardInput) -> torch.Tensor:
    """Squared error of the trunk's height."""
    return (x.body.height - x.base_height_target).square()


def joint_acceleration(x: RewardInput) -> torch.Tensor:
    """Squared joint accelerations."""
    return x.joint_acceleration.square().sum(1)


def abduction(x: RewardInput) -> torch.Tensor:
    """Squared angles of the abduction joints."""
    return x.body.abduction.square().sum(1)


def collision(x: RewardInput, *, height: float) -> torch.Tensor:
    """Knees whose axes are lower than ``height`` [m]."""
    return (x.body.knee_height < height).float().sum(1)


def foot_slip(x: RewardInput) -> torch.Tensor:
    """Horizontal speed of the feet that touch."""
    return (x.body.foot_speed * x.body.contact).sum(1)


def yaw_rate(x: RewardInput) -> torch.Tensor:
    """Squared yaw rate, which fights every commanded turn."""
    return x.body.angular_velocity[:, 2].square()


def foot_clearance(x: RewardInput, *, height: float) -> torch.Tensor:
    """Squared error of the height of each foot's middle, target ``height`` [m], which punishes standing."""
    return (x.body.foot_height - height).square().sum(1)


def abduction_mirror(x: RewardInput) -> torch.Tensor:
    """Squared sum of left and right abduction."""
    return (x.body.abduction[:, 0::2] + x.body.abduction[:, 1::2]).square().sum(1)


# --- penalties: not the paper's --------------------------------------------------------------------------


def unwanted_tilt(x: RewardInput) -> torch.Tensor:
    """Squared tilt of the trunk; a lean into the turn, up to ``tan(lean) = v w / g``, is free."""
    lateral = x.running_speed * x.command[:, 2] / GRAVITY
    lean = lateral * (1.0 + lateral.square()).rsqrt()
    pitch, roll = x.body.gravity[:, 0], x.body.gravity[:, 1]
    roll = roll - roll.maximum(lean.clamp(max=0.0)).minimum(lean.clamp(min=0.0))
    return pitch.square() + roll.square()


def yaw_rate_error(x: RewardInput) -> torch.Tensor:
    """Squared error of the yaw rate."""
    return (x.body.angular_velocity[:, 2] - x.command[:, 2]).square()


def swing_clearance(x: RewardInput, *, height: float) -> torch.Tensor:
    """Squared height error of each foot times its speed, as in DreamWaQ: feet that stand cost nothing."""
    return ((x.body.foot_height - height).square() * x.body.foot_speed).sum(1)


def grounded(x: RewardInput) -> torch.Tensor:
    """Mean foot contact times forward speed [m/s]: draws the policy from a grounded run, a local optimum."""
    return x.body.contact.mean(1) * x.body.velocity[:, 0].clamp(min=0.0)


def touchdown(x: RewardInput, *, height: float) -> torch.Tensor:
    """Squared downward speed of feet whose middles are below ``height`` [m]: about to touch."""
    return (x.body.foot_descent.square() * (x.body.foot_height < height).float()).sum(1)


def over_speed(x: RewardInput) -> torch.Tensor:
    """Squared share by which a joint exceeds its motor's no-load speed, where the drive can only brake."""
    return (x.body.joint_velocity.abs() / x.no_load_speed - 1.0).clamp(min=0.0).square().sum(1)


def electrical_power(x: RewardInput, *, speed: float) -> torch.Tensor:
    """Power drawn from the bus over weight times (own speed + ``speed`` [m/s]): about the cost of transport.

    The paper's mechanical power misses the copper loss. ``speed`` gives standing a cost: with 0.5 m/s, and
    the power that action noise takes in training, walking on was cheaper than standing when asked to.
    """
    return x.loads.power / (x.weight * (x.body.velocity[:, 0].abs() + speed))


def hasty_touchdowns(x: RewardInput) -> torch.Tensor:
    """Touchdowns sooner than ``sprint.SHORTEST_STRIDE`` after the last: else a gait becomes a tap."""
    return x.loads.hasty_touchdowns.sum(1)


def short_stances(x: RewardInput) -> torch.Tensor:
    """Stances shorter than ``sprint.SHORTEST_STANCE``."""
    return x.loads.short_stances.sum(1)


def motion_at_zero_command(x: RewardInput, *, speed: float) -> torch.Tensor:
    """Feet in the air and speed, over ``speed`` [m/s] and at most one, while the robot is asked to stand."""
    asked_to_stand = (x.command.abs() < REST_COMMAND).all(1).float()
    return asked_to_stand * (
        (1.0 - x.loads.stance).sum(1) + 2.0 * (x.running_speed.abs() / speed).clamp(max=1.0)
    )


def leg_distance(x: RewardInput, *, distance: float) -> torch.Tensor:
    """Pairs of legs whose surfaces are closer than ``distance`` [m]."""
    return (x.body.leg_distance < distance).float().sum(1)


def sideways_drift(x: RewardInput) -> torch.Tensor:
    """Speed to the side, averaged over about a stride, while no turn is commanded.

    A robot whose heading is held still leaves its lane where it moves a few degrees to the side of it.
    """
    return (x.command[:, 2].abs() < STRAIGHT_ON).float() * x.running_side_speed.abs()


def tilt_rate(x: RewardInput) -> torch.Tensor:
    """Sum of the roll and pitch rates' magnitudes."""
    return x.body.angular_velocity[:, :2].abs().sum(1)


def torque(x: RewardInput) -> torch.Tensor:
    """Squared joint torques."""
    return x.torque.square().sum(1)
