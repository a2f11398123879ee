"""How the simulated robot behind the bus differs from a perfect one."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.interface import WATCHDOG_TIMEOUT
from sprintlab.deployment.simulator.link import LinkOptions
from sprintlab.plant import PlantOptions, TrialSettings

STARTS = ("lying", "standing")


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Standard deviations of white noise, drawn anew for every message.

    Attributes:
        joint_position: [rad].
        joint_velocity: [rad/s].
        joint_torque: [N m].
        angular_velocity: [rad/s].
        orientation: rotation about each axis [rad].
        track_position: position fixes [m].
        track_velocity: velocity in the position fixes [m/s].

    Raises:
        InvalidValueError: a field is negative or above 10.
    """

    joint_position: float = 0.0
    joint_velocity: float = 0.0
    joint_torque: float = 0.0
    angular_velocity: float = 0.0
    orientation: float = 0.0
    track_position: float = 0.0
    track_velocity: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            check_range(f"noise.{item.name}", getattr(self, item.name), 0.0, 10.0)

    def scaled(self, factor: float) -> SensorNoise:
        """The same with every deviation multiplied."""
        return replace(self, **{item.name: factor * getattr(self, item.name) for item in fields(self)})


TYPICAL_NOISE = SensorNoise(
    joint_position=0.001,
    joint_velocity=0.05,
    joint_torque=0.5,
    angular_velocity=0.01,
    orientation=0.005,
    track_position=0.01,
    track_velocity=0.03,
)
"""Assumed, of the order of 14-bit encoders, an industrial MEMS inertial unit and an RTK receiver."""


@dataclass(frozen=True, kw_only=True)
class SimulatorOptions:
    """The robot behind the bus.

    Attributes:
        plant: physics and motors.
        trial: friction, payload, initial joint noise.
        to_controller: the link that carries states and position fixes.
        to_robot: the link that carries commands.
        noise: noise of the sensors.
        start: ``"lying"``: sunk to the ground with damped joints; ``"standing"``: in the default pose.
        fix_rate: position fixes a second [Hz], 0 for none.
        watchdog_timeout: without a command for this long, the robot damps its joints by itself [s].
        seed: seed of noise and links.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    plant: PlantOptions = field(default_factory=PlantOptions)
    trial: TrialSettings = field(default_factory=TrialSettings)
    to_controller: LinkOptions = field(default_factory=LinkOptions)
    to_robot: LinkOptions = field(default_factory=LinkOptions)
    noise: SensorNoise = field(default_factory=SensorNoise)
    start: str = "lying"
    fix_rate: float = 10.0
    watchdog_timeout: float = WATCHDOG_TIMEOUT
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("simulator.start", self.start, STARTS)
        if self.plant.ground.slope:
            allowed = "the sensors of the robot behind the bus know level ground only"
            raise InvalidValueError("simulator.plant.ground.slope", self.plant.ground.slope, allowed)
        check_range("simulator.fix_rate", self.fix_rate, 0.0, 1000.0, "Hz")
        check_range("simulator.watchdog_timeout", self.watchdog_timeout, 0.001, 10.0, "s")
        check_range("simulator.seed", self.seed, 0, 2**32 - 1)
