"""How an episode ends and how the next one begins: masks over all robots, no loops, no host."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from sprintlab.training.environment.draws import Draws
from sprintlab.training.environment.kinematics import BodyState
from sprintlab.training.settings import EpisodeSettings

TILT_LIMIT = 50.0
"""Angle between trunk and gravity beyond which a robot has fallen [deg]."""
IMPOSSIBLE_JOINT_SPEED = 150.0
"""Faster joints are a broken simulation [rad/s]."""
_DONOR_STEPS = 50
"""A robot must have run this many policy steps before its state is copied."""


class Ends(NamedTuple):
    """Why episodes ended in this step, ``(n,)`` each."""

    failed: torch.Tensor  # fallen, legs through each other, or broken
    broken: torch.Tensor  # numbers that no robot has
    timed_out: torch.Tensor  # at its full length

    @property
    def any(self) -> torch.Tensor:
        """Whether the episode is over."""
        return self.failed | self.timed_out


def find_ends(
    body: BodyState,
    qvel: torch.Tensor,
    length: torch.Tensor,
    limit: torch.Tensor,
    knee_clearance: float,
    leg_distance: float = 0.0,
) -> Ends:
    """Which robots' episodes are over.

    Args:
        qvel: all generalized velocities ``(n, nv)``.
        length: policy steps done ``(n,)``.
        limit: policy steps allowed ``(n,)``.
        knee_clearance: a knee that is closer to the ground ends the episode [m].
        leg_distance: surfaces of two legs that are closer end it [m].
    """
    tilt = body.gravity[:, 2] > -math.cos(math.radians(TILT_LIMIT))
    touching = (body.trunk_clearance < 0.0) | (body.knee_height.amin(1) < knee_clearance)
    crossed = body.leg_distance.amin(1) < leg_distance
    fastest = body.joint_velocity.abs().amax(1)
    broken = ~torch.isfinite(qvel.sum(1)) | ~(fastest <= IMPOSSIBLE_JOINT_SPEED)
    failed = tilt | touching | crossed | broken
    return Ends(failed, broken, (length >= limit) & ~failed)


class Starts(NamedTuple):
    """How the robots in a mask start again."""

    donors: torch.Tensor  # whose state each would copy (n,)
    copied: torch.Tensor  # which of the mask copy a running robot (n,)
    restarted: torch.Tensor  # which of the mask start from standing (n,)


def choose_starts(
    ended: torch.Tensor,
    running_speed: torch.Tensor,
    length: torch.Tensor,
    draws: Draws,
    settings: EpisodeSettings,
) -> Starts:
    """Copies of running robots (of two drawn at random the faster), and fresh starts."""
    candidates = (draws["donor"] * running_speed.shape[0]).long()
    first, second = candidates[:, 0], candidates[:, 1]
    donors = torch.where(running_speed[first] > running_speed[second], first, second)
    eligible = ~ended[donors] & (length[donors] > _DONOR_STEPS)
    copied = ended & eligible & (draws["clone"][:, 0] < settings.clone_share)
    return Starts(donors, copied, ended & ~copied)


def standing_starts(
    standing: torch.Tensor,
    joints: torch.Tensor,
    velocities: int,
    top_speed: torch.Tensor,
    draws: Draws,
    settings: EpisodeSettings,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Standing robots with noise in pose and heading, some already moving forward: positions and velocities.

    Args:
        standing: the pose to start from ``(nq,)``.
        joints: addresses of the joints in it ``(joints,)``.
        velocities: generalized velocities a robot.
        top_speed: top speed of the commanded range [m/s] ``()``.
    """
    restart, n = draws["restart"], draws["restart"].shape[0]
    yaw = (2 * restart[:, 0] - 1) * math.pi
    qpos = standing.repeat(n, 1)
    qpos[:, 2] += 0.01 + 0.02 * restart[:, 1]
    qpos[:, 3], qpos[:, 6] = torch.cos(yaw / 2), torch.sin(yaw / 2)
    qpos[:, joints] += 0.2 * (draws["joint"] - 0.5)
    moving = restart[:, 2] < settings.fast_start_share
    speed = torch.where(moving, draws["start"][:, 0] * top_speed, 0.5 * draws["start"][:, 1])
    qvel = qpos.new_zeros(n, velocities)
    qvel[:, 0], qvel[:, 1] = speed * torch.cos(yaw), speed * torch.sin(yaw)
    qvel[:, 3:6] = 0.4 * (draws["spin"] - 0.5)
    return qpos, qvel
