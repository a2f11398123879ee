"""How the simulated robot behind the bus differs from a perfect one, and how its time passes."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.interface import WATCHDOG_TIMEOUT
from sprintlab.plant import PlantOptions, TrialSettings


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """One direction of a link.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    delay: float = 0.0  # every message takes at least this long [s], 0 to 1
    jitter: float = 0.0  # and up to this much longer, drawn evenly for each message [s], 0 to 1
    loss: float = 0.0  # share of messages that never arrive, 0 to 1

    def __post_init__(self) -> None:
        for item in fields(self):
            check_range(f"link.{item.name}", getattr(self, item.name), 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Standard deviations of white noise, drawn anew for every message.

    Raises:
        InvalidValueError: a field is negative or above 10.
    """

    joint_position: float = 0.0  # [rad]
    joint_velocity: float = 0.0  # [rad/s]
    joint_torque: float = 0.0  # [N m]
    angular_velocity: float = 0.0  # [rad/s]
    orientation: float = 0.0  # [rad] about each axis
    track_position: float = 0.0  # [m] of position fixes
    track_velocity: float = 0.0  # [m/s] of position fixes

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

    Raises:
        InvalidValueError: a field is outside its range.
    """

    plant: PlantOptions = field(default_factory=PlantOptions)  # physics and motors
    trial: TrialSettings = field(default_factory=TrialSettings)  # friction, payload, initial joint noise
    # the link that carries states and position fixes
    to_controller: LinkOptions = field(default_factory=LinkOptions)
    to_robot: LinkOptions = field(default_factory=LinkOptions)  # the link that carries commands
    noise: SensorNoise = field(default_factory=SensorNoise)  # noise of the sensors
    # ``"lying"``: sunk to the ground with damped joints; ``"standing"``: in the default pose
    start: str = "lying"
    fix_rate: float = 10.0  # position fixes a second [Hz], 0 for none
    # without a command for this long, the robot damps its joints by itself [s]
    watchdog_timeout: float = WATCHDOG_TIMEOUT
    seed: int = 0  # seed of noise and links

    def __post_init__(self) -> None:
        check_choice("simulator.start", self.start, ("lying", "standing"))
        if self.plant.ground.slope:
            allowed = "the sensors of the robot behind the bus know level ground only"
            raise InvalidValueError("simulator.plant.ground.slope", self.plant.ground.slope, allowed)
        check_range("simulator.fix_rate", self.fix_rate, 0.0, 1000.0, "Hz")
        check_range("simulator.watchdog_timeout", self.watchdog_timeout, 0.001, 10.0, "s")
        check_range("simulator.seed", self.seed, 0, 2**32 - 1)


@dataclass(frozen=True, kw_only=True)
class PaceOptions:
    """How fast simulated time passes, and when it ends.

    Raises:
        InvalidValueError: a field is not positive.
    """

    speed_factor: float = 1.0  # simulated seconds per second of the clock; 1 is real time
    # pass one step for each answer of the controller instead, however long that takes. The result then does
    # not depend on the machine's load
    lock_step: bool = False
    duration: float | None = None  # end after this much simulated time [s]; ``None`` for no end
    end_with_controller: bool = False  # end when a controller that was there has left
    patience: float = 30.0  # in lock-step, give up when no answer has come for this long [s]

    def __post_init__(self) -> None:
        check_range("speed_factor", self.speed_factor, 0.01, 100.0)
        check_positive("patience", self.patience, "s")
        if self.duration is not None:
            check_positive("duration", self.duration, "s")
