"""How a robot is simulated, and what is drawn anew for every trial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, Battery, I2tLimit, MotorModel, WindingHeat
from sprintlab.plant.ground import LEVEL, Ground
from sprintlab.robots import NOMINAL_FOOT, FootContact, ModelOptions

ENGINES = ("mujoco", "drake")
"""Physics engines that a robot can be measured in."""


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
class TrialSettings:
    """What differs between the trials of one protocol.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    seed: int = 0  # decides the initial joint noise, >= 0
    joint_noise: float = 0.0  # half-width of the uniform initial joint noise [rad], to 0.3
    friction: float = 0.85  # sliding friction of feet and floor, 0.1 to 2
    payload: float = 0.0  # mass added to the trunk [kg], -5 to 20
    center_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)  # shift forward, left, up [m], to 0.2
    strength: float = 1.0  # torque that the drives deliver over what their currents should give, 0.5 to 1.5
    delay: float = 0.0  # from the policy's reading to the joints' new targets [s], to 0.02
    joint_offset: float = 0.0  # half-width of the errors of the encoders' zeros, drawn once [rad], to 0.2
    sensor_noise: float = 0.0  # uniform noise on each reading, over that of ``SENSOR_NOISE``, to 10
    push_speed: float = 0.0  # by which a push changes the trunk's velocity, any direction [m/s], to 5

    def __post_init__(self) -> None:
        check_range("trial.seed", self.seed, 0, 2**32 - 1)
        check_range("trial.joint_noise", self.joint_noise, 0.0, 0.3, "rad")
        check_range("trial.friction", self.friction, 0.1, 2.0)
        check_range("trial.payload", self.payload, -5.0, 20.0, "kg")
        check_range("trial.center_of_mass", np.asarray(self.center_of_mass), -0.2, 0.2, "m")
        check_range("trial.strength", self.strength, 0.5, 1.5)
        check_range("trial.delay", self.delay, 0.0, 0.02, "s")
        check_range("trial.joint_offset", self.joint_offset, 0.0, 0.2, "rad")
        check_range("trial.sensor_noise", self.sensor_noise, 0.0, 10.0)
        check_range("trial.push_speed", self.push_speed, 0.0, 5.0, "m/s")


JOINT_NOISE = 0.05
"""Half-width of the initial joint noise that every trial carries [rad]: without it a symmetric policy on a
symmetric robot keeps a symmetry that no robot has."""
NOMINAL_TRIAL = TrialSettings(joint_noise=JOINT_NOISE)
"""A trial that is not one of the protocol's draws."""
