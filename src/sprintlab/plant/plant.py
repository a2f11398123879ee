"""The robot that every policy is measured on: MuJoCo C, small steps, true motor limits.

It shares no code with the stepping of any training environment. One motor step (1 kHz) is: controller
torque -> motor envelope, saturation and gear (``sprintlab.motors``) -> physics. End stops,
viscous and dry friction act on the joints themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.control import Measurement, pd_torque
from sprintlab.control import projected_gravity as gravity_in_body
from sprintlab.core.array_types import FloatArray
from sprintlab.core.constants import GRAVITY
from sprintlab.core.errors import SimulationError
from sprintlab.motors import (
    DriveOutput,
    PreparedDrive,
)
from sprintlab.plant.drive import SuppliedDrive, SupplyState
from sprintlab.plant.ground import RoughGround
from sprintlab.plant.pad import PadLaw, Pads
from sprintlab.plant.settings import PlantOptions, TrialSettings
from sprintlab.robots import (
    RobotDescription,
    air_drag,
    build_model,
    effective_leg_mass,
    set_friction,
    soft_stop_torque,
)

_LOWEST_UPRIGHT = math.cos(math.radians(60.0))
_FALLS = ("", "trunk contact", "knee contact")


@dataclass(frozen=True, kw_only=True)
class BaseState:
    """The trunk, as the command loop sees it; on a slope, along the ground."""

    forward_speed: float  # in the heading frame [m/s]
    heading: float  # yaw angle [rad], in (-pi, pi]
    lateral_offset: float  # distance to the left of the line through the start along x [m]
    distance: float  # distance along x since the start [m]


class MotionRecorder:
    """Looks at the simulation while it runs; this one keeps nothing."""

    def sample(self, data: mujoco.MjData, drive: DriveOutput, targets: FloatArray) -> None:
        """Take one sample; ``data`` holds the kinematics of its present state (after ``mj_step1``)."""

    def watch_step(self, data: mujoco.MjData) -> None:
        """Look on after each physics step; velocities are new, kinematics and forces those of the step."""


JointDrive = Callable[[FloatArray, FloatArray], DriveOutput]
"""What all motors give of joint torques [N m] at joint velocities [rad/s], both ``(joints,)``."""
_UNWATCHED = MotionRecorder()


class Plant:
    """One robot in one simulation.

    It takes friction, payload, centre of mass, strength and initial joint noise of a trial; whoever
    steps the plant sees to the other fields.

    Raises:
        RobotModelError: the robot's model does not compile.
    """

    def __init__(self, robot: RobotDescription, options: PlantOptions, settings: TrialSettings) -> None:
        self.robot = robot
        self.options = options
        self.fall_reason = ""
        self._strength = settings.strength
        self._drag_area = robot.drag_area if options.drag_area is None else options.drag_area
        self.rough = RoughGround(options.ground) if options.ground.roughness else None
        amend = None if self.rough is None else self.rough.replace_floor
        self.model = build_model(robot, options.model_options(), amend)
        self.turn_gravity(options.ground.angle)
        law = PadLaw.of(options.foot, effective_leg_mass(self.model))
        self._apply_settings(settings)
        self.data = mujoco.MjData(self.model)
        self._drive: JointDrive = _drive(robot, options)
        self._bind()
        feet = [f"{leg}_foot" for leg in robot.leg_names]
        self.pads = Pads(self.model, self.data, feet, law, settings.friction, self.rough)
        self._place(settings)

    @property
    def supply(self) -> SupplyState | None:
        """Battery, windings, I²t now; ``None`` on a stiff bus with cold windings and plain drives."""
        return self._drive.state if isinstance(self._drive, SuppliedDrive) else None

    def use_drive(self, drive: JointDrive) -> None:
        """Go on with another motor law."""
        self._drive = drive

    @property
    def joint_addresses(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the joints stand in ``data.qpos`` and in ``data.qvel``, both ``(joints,)``."""
        return self._joint_position, self._joint_velocity

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    def turn_gravity(self, slope: float) -> None:
        """Let the ground rise along x by an angle [rad]: gravity turns, the ground stays."""
        self._slope = np.array(slope) if slope else None
        self.model.opt.gravity[:] = 0.0 - GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope)

    def push(self, change: FloatArray) -> None:
        """Change the trunk's velocity at once by ``(2,)`` along the world's x and y [m/s]."""
        self._velocity[:2] += change

    def measurement(self) -> Measurement:
        """What the robot's own sensors say now: gyro, gravity direction, encoders on the motor side.

        Raises:
            SimulationError: the simulated state is no longer finite.
        """
        if not (np.isfinite(self._position).all() and np.isfinite(self._velocity).all()):
            raise SimulationError(f"the simulated state is no longer finite at {self.time:.2f} s")
        position, velocity = self.joint_state()
        return Measurement(
            angular_velocity=self._velocity[3:6].copy(),
            projected_gravity=np.asarray(gravity_in_body(self._position[3:7], self._slope)),
            joint_position=position,
            joint_velocity=velocity,
        )

    def joint_state(self) -> tuple[FloatArray, FloatArray]:
        """Positions [rad] and velocities [rad/s] that the encoders on the motor side see ``(joints,)``."""
        return self._position[self._joint_position], self._velocity[self._joint_velocity]

    def base_state(self) -> BaseState:
        """Speed, heading and place of the trunk, from the simulator's state."""
        w, x, y, z = self._position[3:7].tolist()
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        vx, vy = self._velocity[:2].tolist()
        return BaseState(
            forward_speed=vx * math.cos(heading) + vy * math.sin(heading),
            heading=heading,
            lateral_offset=float(self._position[1]),
            distance=float(self._position[0]),
        )

    def advance(self, targets: FloatArray, motor_steps: int, recorder: MotionRecorder = _UNWATCHED) -> bool:
        """Hold joint targets ``(joints,)`` [rad] for some motor steps.

        Returns:
            False once the robot has fallen; ``fall_reason`` tells why.

        Raises:
            SimulationError: the targets are not finite numbers.
        """
        if not np.isfinite(targets).all():
            raise SimulationError(f"the policy's joint targets are not finite at {self.time:.2f} s")
        for _ in range(motor_steps):
            position, velocity = self.joint_state()
            wanted = pd_torque(self.robot.stiffness, self.robot.damping, targets, position, velocity)
            self.drive_joints(wanted, targets, recorder)
            if self.fall_reason:
                return False
        return True

    def drive_joints(
        self, desired_torque: FloatArray, targets: FloatArray, recorder: MotionRecorder = _UNWATCHED
    ) -> DriveOutput:
        """One motor step: ask the motors for torques, and go on whether the robot has fallen or not.

        The desired torques ``(joints,)`` are on the joint side, before the motors' limits [N m]; the targets
        [rad] are only recorded, every ``options.record_every`` motor steps.
        """
        drive = self._drive(desired_torque, self._velocity[self._joint_velocity])
        if self._strength != 1.0:
            drive = drive._replace(torque=self._strength * drive.torque)
        self.drive_output = drive
        self.data.ctrl[:] = drive.torque
        self.data.xfrc_applied[self._trunk, :3] = air_drag(self._velocity[:3], self._drag_area)
        for substep in range(self.options.substeps):
            mujoco.mj_step1(self.model, self.data)
            self.pads.press()
            if substep == 0:
                if self._motor_steps % self.options.record_every == 0:
                    recorder.sample(self.data, drive, targets)
                self.fall_reason = self._find_fall()
            self._apply_stops()
            self._finish_step()
            recorder.watch_step(self.data)
        self._motor_steps += 1
        return drive

    def _finish_step(self) -> None:
        """Go on to the next state."""
        mujoco.mj_step2(self.model, self.data)

    def _apply_stops(self) -> None:
        """Elastic end stops, outside the motor; skipped where no joint is in its zone."""
        within = (self._position > self._free_lower) & (self._position < self._free_upper)
        free = np.count_nonzero(within) == len(within)  # a third of the time that ``all`` takes
        if not free:
            self.data.qfrc_applied[self._joint_velocity] = soft_stop_torque(
                *self.joint_state(), self.robot.position_limits, self.robot.soft_stop
            )
        elif self._stopping:
            self.data.qfrc_applied[self._joint_velocity] = 0.0
        self._stopping = not free

    def _find_fall(self) -> str:
        x, y = self._position[4:6].tolist()
        if 1.0 - 2.0 * (x * x + y * y) < _LOWEST_UPRIGHT:
            return "tilt"
        if self.rough is not None and not self.rough.holds(*self._position[:2].tolist()):
            return "left the rough ground"
        if self.data.ncon == 0:
            return ""
        pairs = self.data.contact.geom.tolist()
        return _FALLS[max(self._fall_table.item(first, second) for first, second in pairs)]

    def _apply_settings(self, settings: TrialSettings) -> None:
        model = self.model
        # A diverging state must raise an error, not silently start anew.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        set_friction(model, settings.friction)
        # The payload sits at the trunk's centre of mass, so its moments of inertia stay.
        trunk = model.body("trunk").id
        model.body_mass[trunk] += settings.payload
        model.body_ipos[trunk] += settings.center_of_mass
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def _bind(self) -> None:
        """Views into the simulator's state and the index tables of this robot."""
        model, robot = self.model, self.robot
        self._position, self._velocity = self.data.qpos, self.data.qvel
        joints = [model.joint(name) for name in robot.joint_names]
        self._joint_position = np.array([joint.qposadr[0] for joint in joints])
        self._joint_velocity = np.array([joint.dofadr[0] for joint in joints])
        lower, upper = robot.position_limits.T
        self._free_lower, self._free_upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self._free_lower[self._joint_position] = lower + robot.soft_stop.zone
        self._free_upper[self._joint_position] = upper - robot.soft_stop.zone
        self._fall_table = _fall_table(model, robot)
        self._trunk = int(model.body("trunk").id)
        self._motor_steps = 0
        self._stopping = False  # whether an end stop acted in the last step

    def _place(self, settings: TrialSettings) -> None:
        """Stand in the default pose, joints displaced by the trial's noise, feet on the ground."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("stand").id)
        self.pads.lift()
        random = np.random.default_rng(settings.seed)
        noise = random.uniform(-settings.joint_noise, settings.joint_noise, len(self.robot.joint_names))
        self._position[self._joint_position] += noise
        mujoco.mj_kinematics(self.model, self.data)
        feet = [self.data.geom(f"{leg}_foot").xpos[2] for leg in self.robot.leg_names]
        self._position[2] += self.robot.foot_radius - min(feet)


def _drive(robot: RobotDescription, options: PlantOptions) -> PreparedDrive | SuppliedDrive:
    """The drives that the options ask for; the plain ones where nothing has to be kept track of."""
    followed = options.battery or options.heat or options.i2t
    if followed is None and options.motor_model != "flux-weakening":
        voltage = options.bus_voltage or robot.bus_voltage
        return PreparedDrive(robot.motors, robot.gear, voltage, options.motor_model)
    return SuppliedDrive(robot, options)


def _fall_table(model: mujoco.MjModel, robot: RobotDescription) -> NDArray[np.int8]:
    """Index into ``_FALLS`` for each pair of geoms: trunk or thigh on the floor is a fall.

    The lower end of a thigh's capsule is the knee.
    """
    table = np.zeros((model.ngeom, model.ngeom), dtype=np.int8)
    floor = model.geom("floor").id
    fatal = dict.fromkeys(robot.trunk_bodies, 1) | {f"{leg}_thigh": 2 for leg in robot.leg_names}
    for name, code in fatal.items():
        geom = model.geom(name).id
        table[floor, geom] = table[geom, floor] = code
    return table
