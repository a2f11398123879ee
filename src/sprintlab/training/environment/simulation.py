"""MuJoCo Warp behind PyTorch views: all substeps of a policy step in one CUDA graph."""

from __future__ import annotations

# mujoco and warp ship no type stubs for what is used here.
# pyright: reportArgumentType=false, reportCallIssue=false
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import torch
import warp as wp

from sprintlab.commands.state import GRAVITY
from sprintlab.motors import phase_voltage_limit
from sprintlab.robots import DRAG_AREA, ModelOptions, RobotDescription, build_model
from sprintlab.training.environment.actuation import (
    MODEL_CODES,
    JointDrive,
    air_drag_kernel,
    joint_torque_kernel,
)
from sprintlab.training.environment.actuator_network import (
    network_inputs,
    network_torque_kernel,
    read_networks,
)
from sprintlab.training.environment.loads import LoadMonitor
from sprintlab.training.environment.supply import Supply
from sprintlab.training.graphs import suspended_garbage_collection
from sprintlab.training.settings import SimulationSettings

PAIR_FIELDS = ("pair_friction", "pair_solref", "pair_solreffriction", "pair_solimp")
RANDOMIZED_FIELDS = (*PAIR_FIELDS, "body_mass", "body_subtreemass", "body_ipos")
NOT_NEEDED = (
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
)
"""Parts of a physics step for which the training model has nothing, but which would be launched."""
BLOCK_SIZES = {"update_gradient_cholesky": 32, "update_gradient_JTDAJ_dense": 32}
"""Threads that share one robot's matrices: a warp is enough for 22 rows, and saves 6 % of the physics of 8192
robots on an H200."""


def training_model(robot: RobotDescription, settings: SimulationSettings) -> mujoco.MjModel:
    """The robot's MuJoCo model with what training needs and nothing else: feet on a floor."""
    options = ModelOptions(
        timestep=settings.timestep,
        collisions="feet",
        contact_time_constant=2.0 * settings.timestep,
        integrator="euler",
        dry_friction=False,
        joint_limits=False,
        knee_spring=settings.knee_spring,
    )
    model = build_model(robot, options)
    model.opt.iterations = settings.solver_iterations
    model.opt.ls_iterations = settings.line_search_iterations
    for part in NOT_NEEDED:
        model.opt.disableflags |= part
    return model


def _joint_drives(robot: RobotDescription, model: mujoco.MjModel) -> np.ndarray:
    """One ``JointDrive`` a joint, as Warp's structured array."""
    drives = np.zeros(len(robot.joint_names), dtype=JointDrive.numpy_dtype())
    motors, zone = robot.motors, robot.soft_stop.zone
    columns = {
        "pole_pairs": motors.pole_pairs,
        "resistance": motors.stator_resistance,
        "inductance": motors.q_axis_inductance,
        "flux": motors.flux_linkage,
        "peak_torque": motors.peak_torque,
        "saturation": motors.saturation,
        "ratio": robot.gear.ratio,
        "efficiency": robot.gear.efficiency,
        "dry_friction": robot.dry_friction,
        "stop_lower": robot.position_limits[:, 0] + zone,
        "stop_upper": robot.position_limits[:, 1] - zone,
        "stop_stiffness": robot.soft_stop.stiffness,
        "stop_damping": robot.soft_stop.damping,
        "qpos_index": [model.joint(name).qposadr[0] for name in robot.joint_names],
        "qvel_index": [model.joint(name).dofadr[0] for name in robot.joint_names],
    }
    for name, column in columns.items():
        drives[name] = column
    return drives


class BatchSimulation:
    """``n`` copies of a robot, stepped together.

    Attributes (torch views on the simulator's own memory, ``n`` environments):
        qpos, qvel: state ``(n, nq)``, ``(n, nv)``.
        target: joint targets [rad] ``(n, joints)``: write here, then ``step``.
        previous_target: in force during the first ``delay`` substeps ``(n, joints)``.
        delay: substeps before the target takes effect ``(n,)``.
        mean_delay: about which it varies ``(n,)``.
        drive_torque: torque delivered by the motors in the last substep [N m] ``(n, joints)``.
        on_limit: 1 where the motor was on its envelope in the last substep ``(n, joints)``.
        power: drawn from the bus, mean over the policy step [W] ``(n, joints)``.
        slope: angle by which the ground rises along x [rad] ``(n,)``; ``None``: level. ``tilt`` sets it.
        timestep: of the physics; ``substeps`` of them are the policy's period [s] ``(n,)``.
        monitor: loads between the policy steps.
        stiffness, damping, strength, resistance_factor, friction_factor, voltage,
            drag_area: randomized, writable.
    """

    def __init__(
        self, robot: RobotDescription, settings: SimulationSettings, actuator_model: str, device: str
    ) -> None:
        self.robot, self.settings, self.device = robot, settings, device
        self.environments = settings.environments
        self.mj_model = training_model(robot, settings)
        self._warp_device = wp.get_device(device)
        self._allocate_physics()
        self._allocate_actuation(actuator_model)
        self.monitor = LoadMonitor(robot, self)
        self._recorded_physics: Any = None
        self._graph = self._capture()

    def _allocate_physics(self) -> None:
        data = mujoco.MjData(self.mj_model)
        mujoco.mj_resetDataKeyframe(self.mj_model, data, 0)
        mujoco.mj_forward(self.mj_model, data)
        with wp.ScopedDevice(self._warp_device):
            self.model: Any = self._put_model()
            self.data: Any = mujoco_warp.put_data(
                self.mj_model,
                data,
                nworld=self.environments,
                nconmax=self.settings.max_contacts,
                njmax=self.settings.max_constraints,
            )
            self.fields = {name: self._expand(name) for name in RANDOMIZED_FIELDS}
            self.friction_ratio_invsqrt = self._expand_option("impratio_invsqrt")
            self.timestep = self._expand_option("timestep")
            self._gravity = self._expand_option("gravity")
        self.slope: torch.Tensor | None = None
        views = ("qpos", "qvel", "ctrl", "qacc_warmstart", "geom_xpos", "xpos", "cvel", "subtree_com")
        for name in views:
            setattr(self, name, wp.to_torch(getattr(self.data, name)))

    def _put_model(self) -> Any:
        """The model on the device, with every solver iteration launched.

        A loop that ends where all robots have converged asks the device after each iteration, which takes
        longer than the iterations that it saves.
        """
        model = mujoco_warp.put_model(self.mj_model)
        model.opt.graph_conditional = False
        for kernel, threads in BLOCK_SIZES.items():
            setattr(model.block_dim, kernel, threads)
        return model

    def _expand(self, name: str) -> torch.Tensor:
        """Give a model field one row an environment, and return it as a torch tensor."""
        one = getattr(self.model, name)
        rows = np.repeat(one.numpy()[:1], self.environments, axis=0)
        each = wp.array(rows, dtype=one.dtype, device=self._warp_device)
        setattr(self.model, name, each)
        return wp.to_torch(each)

    def _expand_option(self, name: str) -> torch.Tensor:
        """Give an option of the physics one value an environment, and return it as a torch tensor."""
        one = getattr(self.model.opt, name)
        values = np.repeat(one.numpy()[:1], self.environments, axis=0)
        each = wp.array(values, dtype=one.dtype, device=self._warp_device)
        setattr(self.model.opt, name, each)
        return wp.to_torch(each)

    def _allocate_actuation(self, actuator_model: str) -> None:
        n, robot = self.environments, self.robot
        joints = len(robot.joint_names)

        def rows(values: np.ndarray) -> torch.Tensor:
            return torch.tensor(values, dtype=torch.float32, device=self.device).repeat(n, 1)

        self.stiffness, self.damping = rows(robot.stiffness), rows(robot.damping)
        self.target, self.previous_target = rows(robot.default_pose), rows(robot.default_pose)
        self.delay = torch.zeros(n, dtype=torch.int32, device=self.device)
        self.mean_delay = torch.zeros(n, device=self.device)
        self.strength = torch.ones(n, joints, device=self.device)
        self.drive_torque = torch.zeros(n, joints, device=self.device)
        self.on_limit = torch.zeros(n, joints, device=self.device)
        self.power = torch.zeros(n, joints, device=self.device)
        self.resistance_factor = torch.ones(n, device=self.device)
        self.friction_factor = torch.ones(n, device=self.device)
        limit = float(phase_voltage_limit(robot.bus_voltage))
        self.voltage = torch.full((n,), limit, device=self.device)
        self.drag_area = torch.full((n,), DRAG_AREA, device=self.device)
        constants = _joint_drives(robot, self.mj_model)
        constants["saturation"] *= float(self.settings.saturation)
        drives = wp.array(constants, dtype=JointDrive, device=self._warp_device)

        def arrays(*tensors: torch.Tensor) -> list[Any]:
            return [wp.from_torch(tensor, dtype=wp.float32) for tensor in tensors]

        control = arrays(self.target, self.previous_target)
        control += [wp.from_torch(self.delay, dtype=wp.int32), *arrays(self.stiffness, self.damping)]
        strength, resistance, friction, voltage = arrays(
            self.strength, self.resistance_factor, self.friction_factor, self.voltage
        )
        state, model = [self.data.qpos, self.data.qvel], MODEL_CODES[actuator_model]
        self.supply = Supply(self.settings, joints, self.device)
        self.supply.connect([drives, *control, resistance], state, model, voltage)
        scales = [strength, resistance, friction, voltage]
        self._launch = {
            "kernel": joint_torque_kernel,
            "dim": (n, joints),
            "inputs": [
                drives,
                self.supply.heats,
                *control,
                *scales,
                *state,
                model,
                self.supply.heated,
                1.0 / self.settings.substeps,
            ],
            "outputs": [
                *arrays(self.supply.winding_temperature),
                self.data.ctrl,
                *arrays(self.drive_torque, self.on_limit, self.power),
            ],
            "device": self._warp_device,
        }
        if self.settings.actuator_network is not None:
            self._use_network([drives, *control, strength, friction, *state])

        trunk = int(self.mj_model.body("trunk").id)
        self._air = {
            "kernel": air_drag_kernel,
            "dim": n,
            "inputs": [*arrays(self.drag_area), self.data.qvel, trunk],
            "outputs": [self.data.xfrc_applied],
            "device": self._warp_device,
        }

    def _use_network(self, inputs: list[Any]) -> None:
        """Let actuator networks give the torques; inputs of their kernel without the networks."""
        networks = read_networks(str(self.settings.actuator_network), self.robot)
        drives, *others = inputs
        weights = network_inputs(networks, self._warp_device)
        outputs = self._launch["outputs"][1:]  # without the windings' temperature
        self._launch |= {"kernel": network_torque_kernel, "outputs": outputs}
        self._launch["inputs"] = [drives, *weights, *others, 1.0 / self.settings.substeps]

    def _capture(self) -> Any:
        """The substeps as one CUDA graph; None on the CPU, where ``_step_physics`` records a part of them."""
        if not self._warp_device.is_cuda:
            return None
        with suspended_garbage_collection(), wp.ScopedDevice(self._warp_device):
            self._substeps()  # compiles every kernel, which a capture cannot
            wp.synchronize_device(self._warp_device)
            with wp.ScopedCapture() as capture:
                self._substeps()
        return capture.graph

    def tilt(self, slope: torch.Tensor) -> None:
        """Let the ground of each environment rise along x by an angle ``(n,)`` [rad]: gravity turns."""
        self.slope = slope
        down = torch.stack((-torch.sin(slope), torch.zeros_like(slope), -torch.cos(slope)), 1)
        self._gravity.copy_(GRAVITY * down)

    def actuate(self, substep: int) -> None:
        """Bus voltages, the torque on every joint and the air's force, for one substep of a policy step."""
        self.supply.launch(substep)
        wp.launch(**{**self._launch, "inputs": [*self._launch["inputs"], substep]})
        wp.launch(**self._air)

    def _substeps(self, watch: Callable[[int], None] = lambda _: None) -> None:
        for substep in range(self.settings.substeps):
            self.actuate(substep)
            watch(substep)
            self._step_physics()
            self.monitor.launch(substep)

    def _step_physics(self) -> None:
        """Advance the physics by one of its steps.

        On the CPU the step is recorded and replayed: its hundred launches from Python take several times as
        long as the work on a few robots.
        """
        if self._recorded_physics is not None:
            wp.capture_launch(self._recorded_physics)
            return
        mujoco_warp.step(self.model, self.data)  # also loads every kernel, which a recording cannot
        if self._warp_device.is_cpu:
            with suspended_garbage_collection(), wp.ScopedCapture() as recording:
                mujoco_warp.step(self.model, self.data)  # is noted, not done
            self._recorded_physics = recording.graph

    def step(self, watch: Callable[[int], None] | None = None) -> None:
        """Advance by one policy step; does not wait for the device.

        Args:
            watch: called with the number of every substep once its joint torques are known; the substeps are
                then launched one by one, many times slower than as a graph.
        """
        with wp.ScopedDevice(self._warp_device):
            if watch is not None:
                self._substeps(watch)
            elif self._graph is not None:
                wp.capture_launch(self._graph)
            else:
                self._substeps()

    def state(self) -> dict[str, torch.Tensor]:
        """What a step reads and changes, and what was randomized, by name: the tensors themselves."""
        names = (
            "qpos", "qvel", "qacc_warmstart", "target", "previous_target", "drive_torque", "on_limit",
            "delay", "mean_delay", "stiffness", "damping", "strength", "resistance_factor", "friction_factor",
            "voltage", "drag_area", "friction_ratio_invsqrt", "timestep",
        )  # fmt: skip
        supply = ("state_of_charge", "winding_temperature")
        return {
            **{name: getattr(self, name) for name in names},
            **{name: getattr(self.supply, name) for name in supply},
            **self.monitor.state(),
            **({} if self.slope is None else {"slope": self.slope, "gravity": self._gravity}),
            **self.fields,
        }
