"""What rewards and terminations need to know of a batch of robots, computed once a step."""

from __future__ import annotations

from typing import NamedTuple

import torch

from sprintlab.control import projected_gravity
from sprintlab.engine import Engine
from sprintlab.robots import RobotDescription

CONTACT_MARGIN = 0.004
"""A foot counts as touching when it is this close to the ground [m]."""


class BodyState(NamedTuple):
    """State of ``n`` robots."""

    gravity: torch.Tensor
    """Unit vector along the true vertical, body frame ``(n, 3)``; the other fields are measured along the
    ground, which may slope."""
    angular_velocity: torch.Tensor  # body frame [rad/s] (n, 3)
    velocity: torch.Tensor  # velocity of the trunk in the heading frame (forward, left, up) [m/s] (n, 3)
    height: torch.Tensor  # height of the trunk's middle [m] (n,)
    trunk_clearance: torch.Tensor  # height of the trunk's lowest corner over the ground [m] (n,)
    joint_position: torch.Tensor  # [rad] (n, joints)
    joint_velocity: torch.Tensor  # [rad/s] (n, joints)
    abduction: torch.Tensor  # angles of the abduction joints [rad] (n, legs)
    foot_height: torch.Tensor  # height of the feet's centres [m] (n, legs)
    foot_speed: torch.Tensor  # horizontal speed of the feet [m/s] (n, legs)
    foot_descent: torch.Tensor  # downward speed of the feet, zero while they rise [m/s] (n, legs)
    contact: torch.Tensor  # 1 where a foot touches (n, legs)
    knee_height: torch.Tensor  # height of the knee axes [m] (n, legs)
    leg_distance: torch.Tensor  # least distance between the surfaces of two legs in the step [m] (n, pairs)


def heading_velocity(quaternion: torch.Tensor, velocity: torch.Tensor) -> torch.Tensor:
    """World velocity ``(n, 3)`` in the heading frame, for quaternions w, x, y, z ``(n, 4)``."""
    w, x, y, z = quaternion.unbind(1)
    cosine, sine = 1 - 2 * (y * y + z * z), 2 * (w * z + x * y)
    scale = torch.rsqrt((cosine * cosine + sine * sine).clamp(min=1e-6))
    cosine, sine = cosine * scale, sine * scale
    forward = cosine * velocity[:, 0] + sine * velocity[:, 1]
    left = cosine * velocity[:, 1] - sine * velocity[:, 0]
    return torch.stack((forward, left, velocity[:, 2]), 1)


class Kinematics:
    """Reads a ``BodyState`` off the engine; holds the addresses, so that nothing is looked up in a step."""

    def __init__(self, robot: RobotDescription, engine: Engine, slope: torch.Tensor) -> None:
        self._engine, self._slope, self._foot_radius = engine, slope, robot.foot_radius
        model, device = engine.mj_model, engine.device

        def index(values: list[int]) -> torch.Tensor:
            return torch.tensor(values, device=device)

        self.joint_qpos = index([int(model.joint(name).qposadr[0]) for name in robot.joint_names])
        self.joint_qvel = index([int(model.joint(name).dofadr[0]) for name in robot.joint_names])
        self._half_size = torch.tensor(robot.mechanics.trunk_half_size, device=device, dtype=torch.float32)
        self._abduction = index(robot.leg_joints[:, 0].tolist())
        self._waist = robot.waist

    def read(self) -> BodyState:
        """The present state; what is known of the legs is that of the last step's end."""
        engine = self._engine
        quaternion, height = engine.qpos[:, 3:7], engine.qpos[:, 2]
        down = projected_gravity(quaternion)  # into the ground
        joints, foot_height = engine.qpos[:, self.joint_qpos], engine.foot_position[..., 2]
        return BodyState(
            gravity=projected_gravity(quaternion, self._slope),
            angular_velocity=engine.qvel[:, 3:6],
            velocity=heading_velocity(quaternion, engine.qvel[:, :3]),
            height=height,
            trunk_clearance=height - self._trunk_reach(down, joints),
            joint_position=joints,
            joint_velocity=engine.qvel[:, self.joint_qvel],
            abduction=joints[:, self._abduction],
            foot_height=foot_height,
            foot_speed=engine.foot_velocity[..., :2].norm(dim=-1),
            foot_descent=-engine.foot_velocity[..., 2].clamp(max=0.0),
            contact=(foot_height < self._foot_radius + CONTACT_MARGIN).float(),
            knee_height=engine.knee_position[..., 2],
            leg_distance=engine.leg_distance,
        )

    def _trunk_reach(self, down: torch.Tensor, joints: torch.Tensor) -> torch.Tensor:
        """How far the trunk's corners reach below its middle [m] ``(n,)``; each half of it as a whole box."""
        reach = (down.abs() * self._half_size).sum(1)
        if self._waist is None:
            return reach
        x, y, z = down.unbind(1)
        cosine, sine = torch.cos(joints[:, self._waist]), torch.sin(joints[:, self._waist])
        rear = torch.stack((cosine * x - sine * z, y, sine * x + cosine * z), 1)
        return torch.maximum(reach, (rear.abs() * self._half_size).sum(1))
