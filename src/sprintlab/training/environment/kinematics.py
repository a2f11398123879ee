"""What rewards and terminations need to know of a batch of robots, computed once a step."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import torch

from sprintlab.control import projected_gravity
from sprintlab.robots import RobotDescription, neighbouring_legs
from sprintlab.training.environment.simulation import BatchSimulation

CONTACT_MARGIN = 0.004
"""A foot counts as touching when it is this close to the ground [m]."""
_POINTS_ON_SHANK = 6


class BodyState(NamedTuple):
    """State of ``n`` robots.

    Attributes:
        gravity: unit vector along the true vertical, body frame ``(n, 3)``; the other fields are measured
            along the ground, which may slope.
        angular_velocity: body frame [rad/s] ``(n, 3)``.
        velocity: of the trunk in the heading frame (forward, left, up) [m/s] ``(n, 3)``.
        height: of the trunk's middle [m] ``(n,)``.
        trunk_clearance: of the trunk's lowest corner over the ground [m] ``(n,)``.
        joint_position: [rad] ``(n, joints)``.
        joint_velocity: [rad/s] ``(n, joints)``.
        abduction: angles of the abduction joints [rad] ``(n, legs)``.
        foot_height: of the feet's middles [m] ``(n, legs)``.
        foot_speed: horizontal speed of the feet [m/s] ``(n, legs)``.
        foot_descent: downward speed of the feet, zero while they rise [m/s] ``(n, legs)``.
        contact: 1 where a foot touches ``(n, legs)``.
        knee_height: of the knee axes [m] ``(n, legs)``.
        leg_distance: least distance between the shanks of neighbouring legs [m] ``(n, pairs)``.
    """

    gravity: torch.Tensor
    angular_velocity: torch.Tensor
    velocity: torch.Tensor
    height: torch.Tensor
    trunk_clearance: torch.Tensor
    joint_position: torch.Tensor
    joint_velocity: torch.Tensor
    abduction: torch.Tensor
    foot_height: torch.Tensor
    foot_speed: torch.Tensor
    foot_descent: torch.Tensor
    contact: torch.Tensor
    knee_height: torch.Tensor
    leg_distance: torch.Tensor


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
    """Reads a ``BodyState`` off a simulation; holds the addresses, so that nothing is looked up in a step."""

    def __init__(self, robot: RobotDescription, simulation: BatchSimulation) -> None:
        self._simulation, self._foot_radius = simulation, robot.foot_radius
        model, device = simulation.mj_model, simulation.device

        def index(values: list[int]) -> torch.Tensor:
            return torch.tensor(values, device=device)

        self.joint_qpos = index([int(model.joint(name).qposadr[0]) for name in robot.joint_names])
        self.joint_qvel = index([int(model.joint(name).dofadr[0]) for name in robot.joint_names])
        self._shanks = index([self._body(model, f"{leg}_shank") for leg in robot.leg_names])
        self._feet = index([int(model.geom(f"{leg}_foot").id) for leg in robot.leg_names])
        self._trunk = self._body(model, "trunk")
        self._half_size = torch.tensor(robot.mechanics.trunk_half_size, device=device, dtype=torch.float32)
        self._abduction = index(robot.leg_joints[:, 0].tolist())
        self._waist = robot.waist
        first, second = zip(*neighbouring_legs(robot), strict=True)
        self._first, self._second = index(list(first)), index(list(second))
        steps = torch.linspace(0.0, 1.0, _POINTS_ON_SHANK, device=device)
        self._along = steps[None, None, :, None]

    @staticmethod
    def _body(model: mujoco.MjModel, name: str) -> int:
        return int(model.body(name).id)

    def read(self) -> BodyState:
        """The present state; the positions of the legs are those at the last substep's start."""
        simulation = self._simulation
        quaternion = simulation.qpos[:, 3:7]
        down = projected_gravity(quaternion)  # into the ground
        height = simulation.qpos[:, 2]
        foot = simulation.geom_xpos[:, self._feet]
        knee = simulation.xpos[:, self._shanks]
        foot_velocity = self._foot_velocity(foot)
        joints = simulation.qpos[:, self.joint_qpos]
        return BodyState(
            gravity=down if simulation.slope is None else projected_gravity(quaternion, simulation.slope),
            angular_velocity=simulation.qvel[:, 3:6],
            velocity=heading_velocity(quaternion, simulation.qvel[:, :3]),
            height=height,
            trunk_clearance=height - self._trunk_reach(down, joints),
            joint_position=joints,
            joint_velocity=simulation.qvel[:, self.joint_qvel],
            abduction=joints[:, self._abduction],
            foot_height=foot[..., 2],
            foot_speed=foot_velocity[..., :2].norm(dim=-1),
            foot_descent=-foot_velocity[..., 2].clamp(max=0.0),
            contact=(foot[..., 2] < self._foot_radius + CONTACT_MARGIN).float(),
            knee_height=knee[..., 2],
            leg_distance=self._leg_distance(knee, foot),
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

    def _foot_velocity(self, foot: torch.Tensor) -> torch.Tensor:
        """Velocity of the feet ``(n, legs, 3)``, from spatial velocities about the robot's centre."""
        spatial = self._simulation.cvel[:, self._shanks]
        lever = foot - self._simulation.subtree_com[:, self._trunk : self._trunk + 1]
        return spatial[..., 3:] + torch.linalg.cross(spatial[..., :3], lever, dim=-1)

    def _leg_distance(self, knee: torch.Tensor, foot: torch.Tensor) -> torch.Tensor:
        """Least distance between points on the shanks of each neighbouring pair ``(n, pairs)``."""
        points = knee[:, :, None] + self._along * (foot - knee)[:, :, None]
        first, second = points[:, self._first], points[:, self._second]
        squared = (first[:, :, :, None] - second[:, :, None]).square().sum(-1)
        return squared.flatten(2).amin(2).sqrt()
