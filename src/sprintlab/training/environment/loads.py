"""What happens between two policy steps: gear and foot loads, electrical power, touchdowns and lift-offs.

A stance of 25 ms and a shock of 2 ms are invisible at 50 Hz. These Warp kernels look at every physics substep
and leave one number per joint or foot for the rewards.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportOperatorIssue=false
from typing import Any, NamedTuple

import numpy as np
import torch
import warp as wp

from sprintlab.commands.state import GRAVITY
from sprintlab.motors import joint_torque, saturate
from sprintlab.robots import RobotDescription

wp.set_module_options({"enable_backward": False})

_LONG_AGO = 1.0
"""Time since its last touchdown of a foot that has not touched down yet [s]."""
_WORST = 2.0
"""Greatest cost of one touchdown or lift-off."""


class Loads(NamedTuple):
    """Loads of ``n`` robots since the policy step began.

    Attributes:
        power: drawn from the bus by each joint, mean [W] ``(n, joints)``.
        gear_torque: greatest torque through each gear in a physics step, rotor inertia times acceleration
            included, over the joint's peak torque ``(n, joints)``.
        foot_force: greatest normal force on each foot, mean over two physics steps, in body weights
            ``(n, 4)``.
        hasty_touchdowns: cost of each foot's touchdowns: ``shortest_stride / period - 1``, at most 2
            ``(n, 4)``.
        short_stances: cost of each foot's lift-offs: ``shortest_stance / stance - 1``, at most 2 ``(n, 4)``.
        stance: share of the physics steps in which each foot carried ``(n, 4)``.
    """

    power: torch.Tensor
    gear_torque: torch.Tensor
    foot_force: torch.Tensor
    hasty_touchdowns: torch.Tensor
    short_stances: torch.Tensor
    stance: torch.Tensor


@wp.kernel
def gear_torque_kernel(
    drive_torque: wp.array2d(dtype=float),
    acceleration: wp.array2d(dtype=float),
    addresses: wp.array(dtype=int),
    rotor_inertia: wp.array(dtype=float),
    peak_torque: wp.array(dtype=float),
    substep: int,
    gear_torque: wp.array2d(dtype=float),
):
    """Greatest torque through each gear since the policy step began, over the joint's peak torque.

    What the motor delivers at the joint, less what turns its rotor: ``tau - G^2 J a``.
    """
    robot, joint = wp.tid()
    inertial = rotor_inertia[joint] * acceleration[robot, addresses[joint]]
    load = wp.abs(drive_torque[robot, joint] - inertial) / peak_torque[joint]
    if substep > 0:
        load = wp.max(load, gear_torque[robot, joint])
    gear_torque[robot, joint] = load


@wp.kernel
def contact_force_kernel(
    contacts: wp.array(dtype=int),
    geoms: wp.array(dtype=wp.vec2i),
    worlds: wp.array(dtype=int),
    rows: wp.array2d(dtype=int),
    forces: wp.array2d(dtype=float),
    foot_of_geom: wp.array(dtype=int),
    normal_force: wp.array2d(dtype=float),
):
    """Normal force of every contact, written to its robot's foot [N]; elliptic cones: the first row."""
    contact = wp.tid()
    if contact >= contacts[0]:
        return
    row = rows[contact, 0]
    pair = geoms[contact]
    foot = wp.max(foot_of_geom[pair[0]], foot_of_geom[pair[1]])
    if row < 0 or foot < 0:
        return
    normal_force[worlds[contact], foot] = forces[worlds[contact], row]


@wp.kernel
def gait_kernel(
    weight: wp.array(dtype=float),
    shortest: wp.array(dtype=float),
    timestep: float,
    share_of_step: float,
    substep: int,
    normal_force: wp.array2d(dtype=float),
    last_force: wp.array2d(dtype=float),
    since_touchdown: wp.array2d(dtype=float),
    carried: wp.array2d(dtype=float),
    foot_force: wp.array2d(dtype=float),
    hasty_touchdowns: wp.array2d(dtype=float),
    short_stances: wp.array2d(dtype=float),
    stance: wp.array2d(dtype=float),
):
    """Force, touchdowns and lift-offs of one foot in one physics step; clears the force for the next."""
    robot, foot = wp.tid()
    force = normal_force[robot, foot] / weight[robot]
    before = last_force[robot, foot]
    peak = 0.5 * (force + before)
    hasty = float(0.0)
    short = float(0.0)
    share = float(0.0)
    if substep > 0:
        peak = wp.max(peak, foot_force[robot, foot])
        hasty = hasty_touchdowns[robot, foot]
        short = short_stances[robot, foot]
        share = stance[robot, foot]
    elapsed = since_touchdown[robot, foot] + timestep
    stood = carried[robot, foot]
    if force > 0.0:
        if before <= 0.0:
            hasty += wp.clamp(shortest[0] / elapsed - 1.0, 0.0, wp.static(_WORST))
            elapsed = float(0.0)
            stood = float(0.0)
        stood += timestep
        share += share_of_step
    elif before > 0.0:
        short += wp.clamp(shortest[1] / stood - 1.0, 0.0, wp.static(_WORST))
    last_force[robot, foot] = force
    since_touchdown[robot, foot] = wp.min(elapsed, wp.static(_LONG_AGO))
    carried[robot, foot] = stood
    foot_force[robot, foot] = peak
    hasty_touchdowns[robot, foot] = hasty
    short_stances[robot, foot] = short
    stance[robot, foot] = share
    normal_force[robot, foot] = 0.0


class LoadMonitor:
    """Measures gear torque, foot force and foot timing in every physics step; ``launch`` after each of them.

    Args:
        robot: whose gears, feet and mass count.
        simulation: the batch: model, data and drive torques must exist.

    Attributes:
        loads: of the present policy step; its tensors are written over by every step.
        shortest: stride period below which a touchdown costs, and stance below which a lift-off does [s]
            ``(2,)``, writable.
        weight: of each robot [N] ``(n,)``, writable.
    """

    def __init__(self, robot: RobotDescription, simulation: Any) -> None:
        self._simulation, n, device = simulation, simulation.environments, simulation.device
        joints, feet = len(robot.joint_names), len(robot.leg_names)

        def zeros(columns: int) -> torch.Tensor:
            return torch.zeros(n, columns, device=device)

        self.loads = Loads(simulation.power, zeros(joints), *(zeros(feet) for _ in range(4)))
        self.last_force, self.carried, self._normal_force = (zeros(feet) for _ in range(3))
        self.since_touchdown = torch.full((n, feet), _LONG_AGO, device=device)
        self.shortest = torch.zeros(2, device=device)
        weight = float(simulation.mj_model.body_subtreemass[0]) * GRAVITY
        self.weight = torch.full((n,), weight, device=device)
        self._gear = self._gear_launch(robot)
        self._contacts = self._contact_launch(robot)
        self._gait = self._gait_launch()

    def _array(self, values: Any, dtype: Any = float) -> Any:
        return wp.array(np.asarray(values), dtype=dtype, device=wp.get_device(self._simulation.device))

    def _gear_launch(self, robot: RobotDescription) -> dict[str, Any]:
        model, simulation = self._simulation.mj_model, self._simulation
        peak = joint_torque(robot.gear, saturate(robot.motors, np.asarray(robot.motors.peak_torque)))
        addresses = [model.joint(name).dofadr[0] for name in robot.joint_names]
        torque = wp.from_torch(simulation.drive_torque, dtype=wp.float32)
        return {
            "kernel": gear_torque_kernel,
            "dim": self.loads.gear_torque.shape,
            "inputs": [
                torque,
                simulation.data.qacc,
                self._array(addresses, int),
                self._array(model.dof_armature[addresses]),
                self._array(np.broadcast_to(peak, len(addresses))),
            ],
            "outputs": [wp.from_torch(self.loads.gear_torque, dtype=wp.float32)],
        }

    def _contact_launch(self, robot: RobotDescription) -> dict[str, Any]:
        model, data = self._simulation.mj_model, self._simulation.data
        foot_of_geom = np.full(model.ngeom, -1)
        for foot, leg in enumerate(robot.leg_names):
            foot_of_geom[model.geom(f"{leg}_foot").id] = foot
        contact = data.contact
        return {
            "kernel": contact_force_kernel,
            "dim": contact.worldid.shape[0],
            "inputs": [
                data.nacon,
                contact.geom,
                contact.worldid,
                contact.efc_address,
                data.efc.force,
                self._array(foot_of_geom, int),
            ],
            "outputs": [wp.from_torch(self._normal_force, dtype=wp.float32)],
        }

    def _gait_launch(self) -> dict[str, Any]:
        loads, settings = self.loads, self._simulation.settings
        feet = (self._normal_force, self.last_force, self.since_touchdown, self.carried)
        feet += (loads.foot_force, loads.hasty_touchdowns, loads.short_stances, loads.stance)
        constants = [wp.from_torch(values, dtype=wp.float32) for values in (self.weight, self.shortest)]
        constants += [settings.timestep, 1.0 / settings.substeps]
        return {
            "kernel": gait_kernel,
            "dim": loads.foot_force.shape,
            "inputs": constants,
            "outputs": [wp.from_torch(tensor, dtype=wp.float32) for tensor in feet],
        }

    def launch(self, substep: int) -> None:
        """Look at the physics step that has just been taken."""
        device = wp.get_device(self._simulation.device)
        wp.launch(**{**self._gear, "inputs": [*self._gear["inputs"], substep]}, device=device)
        wp.launch(**self._contacts, device=device)
        wp.launch(**{**self._gait, "inputs": [*self._gait["inputs"], substep]}, device=device)

    def state(self) -> dict[str, torch.Tensor]:
        """What one step leaves to the next, by name: the tensors themselves."""
        return {
            "last_force": self.last_force,
            "since_touchdown": self.since_touchdown,
            "carried": self.carried,
        }
