"""The robot that every policy is measured on: MuJoCo C, small steps, true motor limits.

It shares no code with the stepping of any training environment. One motor step (1 kHz) is: controller
torque -> motor envelope, saturation and gear (``sprintlab.motors``) -> physics. End stops,
viscous and dry friction act on the joints themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.commands.state import GRAVITY
from sprintlab.control import Measurement, pd_torque
from sprintlab.control import projected_gravity as gravity_in_body
from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SimulationError
from sprintlab.motors import (
    MOTOR_MODELS,
    Battery,
    DriveOutput,
    I2tLimit,
    MotorModel,
    PreparedDrive,
    WindingHeat,
)
from sprintlab.plant.drive import SuppliedDrive, SupplyState
from sprintlab.plant.ground import LEVEL, Ground, RoughGround
from sprintlab.plant.pad import PadLaw, Pads
from sprintlab.plant.settings import TrialSettings
from sprintlab.robots import (
    NOMINAL_FOOT,
    FootContact,
    ModelOptions,
    RobotDescription,
    air_drag,
    build_model,
    effective_leg_mass,
    set_friction,
    soft_stop_torque,
)

ENGINES = ("mujoco", "drake")
"""Physics engines that a robot can be measured in."""

_LOWEST_UPRIGHT = math.cos(math.radians(60.0))
_FALLS = ("", "trunk contact", "knee contact")


@dataclass(frozen=True, kw_only=True)
class PlantOptions:
    """How the robot is simulated; every published number has the defaults.

    Raises:
        InvalidValueError: a field is out of range, or the rates do not divide.
    """

    engine: str = "mujoco"  # or "drake", the second engine (``on_engine`` sets the time step that suits it)
    timestep: float = 0.00025  # physics step [s], up to 0.5 ms, beyond which the pads' explicit forces ring
    motor_rate: float = 1000.0  # rate of the motor loop [Hz], a whole number of physics steps per motor step
    record_rate: float = 500.0  # rate of the recorded samples [Hz]; divides ``motor_rate``
    ground: Ground = LEVEL  # the second engine has no other
    foot: FootContact = NOMINAL_FOOT  # stiffness and restitution of the feet
    drag_area: float | None = None  # times drag coefficient [m^2]; 0 on a treadmill, None: the robot's
    contact_time_constant: float = 0.0005  # every other contact and joint limits [s], at least 2 steps
    motor_model: MotorModel = "refined"
    bus_voltage: float | None = None  # [V]; None takes the robot's. A battery replaces it.
    battery: Battery | Literal["robot"] | None = None  # "robot" is the robot's own; None: a stiff bus
    state_of_charge: float = 1.0  # charge of the battery at the start [-]
    heat: WindingHeat | None = None  # thermal model of the windings; None: they stay as they are
    winding_temperature: float = 25.0  # at the start, with ``heat`` [degC]
    i2t: I2tLimit | None = None  # how the drives cut overloads back; None: not at all

    def __post_init__(self) -> None:
        check_choice("plant.engine", self.engine, ENGINES)
        check_range("plant.timestep", self.timestep, 1e-5, 0.0005, "s")
        check_range("plant.motor_rate", self.motor_rate, 100.0, 1e5, "Hz")
        if self.engine != "mujoco" and self.ground.remark:
            raise InvalidValueError("plant.ground", self.ground, "the second engine's is level and even")
        if self.drag_area is not None:
            check_range("plant.drag_area", self.drag_area, 0.0, 2.0, "m^2")
        check_choice("plant.motor_model", self.motor_model, MOTOR_MODELS)
        if self.bus_voltage is not None:
            check_positive("plant.bus_voltage", self.bus_voltage, "V")
        check_range("plant.state_of_charge", self.state_of_charge, 0.0, 1.0)
        check_range("plant.winding_temperature", self.winding_temperature, -60.0, 250.0, "degC")
        _check_whole("plant.timestep", self.timestep, 1.0 / (self.motor_rate * self.timestep))
        _check_whole("plant.record_rate", self.record_rate, self.motor_rate / self.record_rate)

    @property
    def remarks(self) -> tuple[str, ...]:
        """One remark for each choice that makes numbers differ from the published ones."""
        area, foot = self.drag_area, self.foot
        air = f"air with a drag area of {area:g} m^2" if area else "treadmill: no air"
        pad = f"feet of {foot.stiffness / 1e3:g} kN/m, restitution {foot.restitution:g}"
        battery = f"a battery behind the bus, {100 * self.state_of_charge:.0f} % charged at the start"
        warm = f"windings that warm up, {self.winding_temperature:g} degC at the start"
        remarks = (
            (self.engine != "mujoco", f"engine: {self.engine}"),
            (self.ground.remark != "", self.ground.remark),
            (area is not None, air),
            (foot != NOMINAL_FOOT, pad),
            (self.motor_model != "refined", f"motor model: {self.motor_model}"),
            (self.battery is not None, battery),
            (self.heat is not None, warm),
            (self.i2t is not None, "drives that cut overloads back to their continuous current (I²t)"),
        )
        return tuple(text for differs, text in remarks if differs)

    @property
    def substeps(self) -> int:
        """Physics steps in one motor step."""
        return round(1.0 / (self.motor_rate * self.timestep))

    @property
    def record_every(self) -> int:
        """Motor steps between two samples."""
        return round(self.motor_rate / self.record_rate)

    def model_options(self) -> ModelOptions:
        """How the robot's model is compiled for this plant."""
        return ModelOptions(
            timestep=self.timestep,
            collisions="full",
            contact_time_constant=self.contact_time_constant,
            dry_friction=True,
            joint_limits=True,
            visuals=False,
            knee_spring=True,
            solver_feet=False,
        )


def _check_whole(name: str, value: float, quotient: float) -> None:
    """Refuse rates that do not divide each other."""
    if quotient < 0.5 or abs(quotient - round(quotient)) > 1e-6:
        raise InvalidValueError(name, value, "the motor step must hold a whole number of them")


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
    voltage = options.bus_voltage or robot.bus_voltage
    followed = options.battery or options.heat or options.i2t
    if followed is None and options.motor_model != "flux-weakening":
        return PreparedDrive(robot.motors, robot.gear, voltage, options.motor_model)
    return SuppliedDrive(
        robot,
        voltage,
        options.motor_model,
        battery=robot.battery if options.battery == "robot" else options.battery,
        state_of_charge=options.state_of_charge,
        heat=options.heat,
        winding_temperature=options.winding_temperature,
        i2t=options.i2t,
        step=1.0 / options.motor_rate,
    )


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
