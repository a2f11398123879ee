"""The engine: buffers of PyTorch, and one launch per policy step."""

from __future__ import annotations

import ctypes

import numpy as np
import torch

from sprintlab.core.constants import GRAVITY
from sprintlab.core.errors import SimulationError
from sprintlab.engine.cpu import CpuKernel
from sprintlab.engine.cuda import CudaKernel
from sprintlab.engine.options import EngineOptions
from sprintlab.engine.source import (
    BUFFERS,
    FOOT_OUTPUTS,
    JOINT_OUTPUTS,
    PAIRS,
    PARAMETERS,
    PLACE_OUTPUTS,
    engine_model,
    source,
)
from sprintlab.motors import phase_voltage_limit
from sprintlab.robots import DRAG_AREA, NOMINAL_FOOT, FootContact, RobotDescription

_LONG_AGO = 1.0
"""Time since its last touchdown of a foot that has not touched down yet [s]."""
_RESTITUTIONS = np.linspace(0.15, 0.95, 161)


class Engine:
    """``n`` robots with ``J`` joints and ``L`` legs in policy order, stepped together.

    All attributes below are tensors that are allocated once; ``step`` reads and writes them in place.

    Attributes (inputs):
        target, previous_target: joint targets, and those in force during the first ``delay`` substeps [rad]
            ``(n, J)``.
        delay: [substeps] ``(n,)``, whole numbers.
        stiffness, damping: gains [N m/rad], [N m s/rad] ``(n, J)``.
        strength: factor of the motors' torque ``(n, J)``.
        parameters: what differs from robot to robot ``(n, P)``, with views on its columns:
            pad_stiffness [N/m], pad_damping [N s/m], friction, voltage (greatest phase voltage) [V],
            resistance_factor, friction_factor (of dry friction), drag_area [m^2], trunk_mass [kg],
            trunk_center ``(n, 3)`` [m], gravity ``(n, 3)`` [m/s^2], weight [N], timestep [s].
        shortest: stride period and stance below which touchdowns and lift-offs cost [s] ``(2,)``.

    Attributes (state):
        qpos, qvel: MuJoCo's layout ``(n, nq)``, ``(n, nv)``. Velocities are those of the last step's middle.
        bristle: deflection of the pads along the ground [m] ``(n, L, 2)``.
        winding_temperature: [degC] ``(n, J)``; constant without heat.
        i2t_level: 1 where only the continuous current is left ``(n, J)``; constant without a limit.
        state_of_charge, bus_voltage: of the battery, [-] and [V] ``(n,)``; constant without one. A battery
            takes the place of the parameter ``voltage``.
        recent_force, loaded, since_touchdown, carried: what the monitors of feet leave to the next step.

    Attributes (outputs, of the last policy step):
        torque: delivered by the motors in the last substep [N m] ``(n, J)``.
        power: drawn from the bus by all joints together, mean [W] ``(n,)``. What one feeds back others use;
            a surplus of all in a millisecond counts as zero, as in the audit.
        limit_share: share of the substeps with the motor at a limit ``(n, J)``.
        stop_depth: greatest depth in an end stop's zone [rad] ``(n, J)``.
        joint_speed: greatest, over no-load speed ``(n, J)``.
        gear_torque: greatest 1 ms mean through the gear, over the joint's peak torque ``(n, J)``.
        foot_force: greatest 5 ms mean [body weights] ``(n, L)``.
        pad_deflection: greatest [m] ``(n, L)``.
        stance: share of the substeps with more than 1 N ``(n, L)``; touchdowns: how many ``(n, L)``.
        hasty_touchdowns, short_stances: cost of each foot's touchdowns, ``shortest[0] / period - 1``, and of
            its lift-offs, ``shortest[1] / stance - 1``, each at most 2 ``(n, L)``.
        leg_distance: least surface distance of each of ``PAIRS`` of legs: thighs (but for their hips), shanks
            and feet, every 2 ms and at the end [m] ``(n, 6)``.
        foot_position, foot_velocity, knee_position: at the step's end [m], [m/s] ``(n, L, 3)``.
        contact_force: contact force of the ground on each foot in the last substep [N] ``(n, L, 3)``.

    Args:
        robot: any robot of the package, or an imported one.
        options: numbers and physics.
        device: ``cpu`` or ``cuda:0`` and so on.
        double: compute in double precision, on the CPU only: the reference of the tests.
        given_torque: take all joint torques from ``given_torque`` ``(n, nv)`` and give ``qacc``, for tests.

    Raises:
        RobotModelError: the robot cannot be expressed; nothing is compiled.
        SimulationError: there is no compiler, or the device cannot hold the robots.
    """

    def __init__(
        self,
        robot: RobotDescription,
        options: EngineOptions,
        device: str,
        *,
        double: bool = False,
        given_torque: bool = False,
    ) -> None:
        self.robot, self.options, self.device = robot, options, device
        self.model = engine_model(robot, options)
        self.mj_model = self.model.model
        self.robots = options.robots
        self._dtype = torch.float64 if double else torch.float32
        try:
            self._allocate()
        except torch.OutOfMemoryError as error:
            raise SimulationError(
                f"{device} has no memory for {options.robots} robots: take fewer"
            ) from error
        self._reset_parameters()
        self.kernel = self._make_kernel(double, given_torque)
        self._bind()

    def _make_kernel(self, double: bool, given_torque: bool) -> CpuKernel | CudaKernel:
        if torch.device(self.device).type == "cuda":
            return CudaKernel(source(self.model, "cuda", given_torque), self.device)
        return CpuKernel(source(self.model, "cpu", given_torque), double)

    def _zeros(self, *columns: int) -> torch.Tensor:
        return torch.zeros(self.robots, *columns, device=self.device, dtype=self._dtype)

    def _rows(self, values: object) -> torch.Tensor:
        """One row per robot of a value per joint."""
        row = np.broadcast_to(np.asarray(values, dtype=float), (len(self.robot.joint_names),)).copy()
        return torch.tensor(row, device=self.device, dtype=self._dtype).repeat(self.robots, 1)

    def _allocate(self) -> None:
        robot, model = self.robot, self.mj_model
        joints, legs = len(robot.joint_names), len(robot.leg_names)
        start = torch.tensor(model.key("stand").qpos, device=self.device, dtype=self._dtype)
        self.qpos, self.qvel = start.repeat(self.robots, 1), self._zeros(model.nv)
        self.target, self.previous_target = self._rows(robot.default_pose), self._rows(robot.default_pose)
        self.stiffness, self.damping = self._rows(robot.stiffness), self._rows(robot.damping)
        self.strength = self._rows(1.0)
        self.delay = torch.zeros(self.robots, device=self.device, dtype=torch.int32)
        self.bristle, self.loaded, self.carried = self._zeros(legs, 2), self._zeros(legs), self._zeros(legs)
        self.recent_force = self._zeros(legs, self.options.window - 1)
        self.since_touchdown = self._zeros(legs) + _LONG_AGO
        heat = self.options.heat
        self.winding_temperature = self._rows(25.0 if heat is None else heat.ambient_temperature)
        self.i2t_level, self.state_of_charge = self._zeros(joints), self._zeros() + 1.0
        self.bus_voltage = self._zeros() + float(robot.bus_voltage)
        self.shortest = torch.zeros(2, device=self.device, dtype=self._dtype)
        for name in JOINT_OUTPUTS:
            setattr(self, name, self._zeros(joints))
        for name in FOOT_OUTPUTS:
            setattr(self, name, self._zeros(legs))
        for name in PLACE_OUTPUTS:
            setattr(self, name, self._zeros(legs, 3))
        self.leg_distance, self.power = self._zeros(len(PAIRS)), self._zeros()
        self.given_torque, self.qacc = self._zeros(model.nv), self._zeros(model.nv)

    def _reset_parameters(self) -> None:
        """The nominal robot in every row, and a view on each column."""
        self.parameters = self._zeros(len(PARAMETERS))
        for column, name in enumerate(PARAMETERS):
            setattr(self, name, self.parameters[:, column])
        columns = {name: PARAMETERS.index(f"{name}_x") for name in ("trunk_center", "gravity")}
        self.trunk_center, self.gravity = (self.parameters[:, k : k + 3] for k in columns.values())
        trunk, robot = self.model.tree.trunk, self.robot
        self.set_pads(NOMINAL_FOOT)
        values = {
            "friction": robot.foot_friction,
            "voltage": float(phase_voltage_limit(robot.bus_voltage)),
            "resistance_factor": 1.0,
            "friction_factor": 1.0,
            "drag_area": DRAG_AREA,
            "trunk_mass": trunk.mass,
            "gravity_z": -GRAVITY,
            "weight": float(self.mj_model.body_subtreemass[0]) * GRAVITY,
            "timestep": self.options.timestep,
        }
        for name, value in values.items():
            getattr(self, name).fill_(value)
        self.trunk_center.copy_(torch.tensor(trunk.center))

    def set_pads(self, foot: FootContact) -> None:
        """Give all robots one pad."""
        self.pad_stiffness.fill_(foot.stiffness)
        self.pad_damping.fill_(foot.damping(self.model.leg_mass))

    def draw_pads(self, stiffness: torch.Tensor, restitution: torch.Tensor) -> None:
        """Give every robot a pad: stiffness [N/m] and restitution, each ``(n,)``; ``FootContact.damping``."""
        ratios = [FootContact(restitution=float(e)).damping_ratio for e in _RESTITUTIONS]
        ratio = np.interp(restitution.double().cpu().numpy(), _RESTITUTIONS, ratios)
        damping = 2.0 * torch.as_tensor(ratio) * (stiffness.double().cpu() * self.model.leg_mass).sqrt()
        self.pad_stiffness.copy_(stiffness)
        self.pad_damping.copy_(damping)

    def tilt(self, slope: torch.Tensor) -> None:
        """Let the ground rise along x by an angle ``(n,)`` [rad]: gravity turns."""
        down = torch.stack((-torch.sin(slope), torch.zeros_like(slope), -torch.cos(slope)), 1)
        self.gravity.copy_(GRAVITY * down)

    def _bind(self) -> None:
        fields = [(name, ctypes.c_void_p) for name in (*BUFFERS, "delay")]
        structure = type("Buffers", (ctypes.Structure,), {"_fields_": fields})
        self._buffers = structure(**{name: getattr(self, name).data_ptr() for name, _ in fields})
        self.kernel.bind(self._buffers, self.robots)

    def step(self) -> None:
        """Advance by one policy step; on a GPU on PyTorch's current stream, without waiting; capturable."""
        self.kernel.launch()
