"""What is chosen when an engine is generated: all of it is constant in its code."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, Battery, HousedHeat, I2tLimit, MotorModel, WindingHeat

WINDOW = 0.005
"""Length of a foot's mean force [s], as in the audit."""
DISTANCE_INTERVAL = 0.002
"""Between two looks at the legs' distances [s], as in the audit."""
BIN = 0.001
"""Period of the motor loop, and length of a gear's mean torque [s]."""


@dataclass(frozen=True, kw_only=True)
class EngineOptions:
    """How many robots, in which steps, with which physics.

    Raises:
        InvalidValueError: a value out of range, or what the engine does not know.
    """

    robots: int  # simulated side by side
    timestep: float = 0.0005  # physics step [s], nominal: each robot's own one is the parameter ``timestep``
    substeps: int = 40  # physics steps in one policy step
    motor_model: MotorModel = "refined"  # envelope of the motors
    saturation: bool = True  # whether the motors saturate
    knee_spring: bool = True  # whether the shanks hang on their springs, where the robot has any
    heat: WindingHeat | None = None  # thermal model of the windings; None: they stay cold
    battery: Battery | None = None  # behind the bus that all joints share; None: the bus is stiff
    i2t: I2tLimit | None = None  # how the drives cut overloads back; None: not at all

    def __post_init__(self) -> None:
        check_range("robots", self.robots, 1, 1 << 20)
        check_range("timestep", self.timestep, 1e-5, 0.0025, "s")
        check_range("substeps", self.substeps, 1, 10_000)
        check_choice("motor_model", self.motor_model, MOTOR_MODELS)
        if isinstance(self.heat, HousedHeat):
            raise InvalidValueError("heat", "with a housing", "one thermal node: WindingHeat")

    @property
    def bin(self) -> int:
        """Substeps per period of the motor loop: 1 ms, or one where a step is longer."""
        wanted = max(round(BIN / self.timestep), 1)
        return max(count for count in range(1, wanted + 1) if self.substeps % count == 0)

    @property
    def distance_period(self) -> int:
        """Substeps between two looks at the legs' distances; whole periods of the motor loop."""
        return max(round(DISTANCE_INTERVAL / (self.bin * self.timestep)), 1) * self.bin

    @property
    def loop_period(self) -> float:
        """Period of the motor loop [s]."""
        return self.bin * self.timestep

    @property
    def window(self) -> int:
        """Bins over which a foot's force is averaged: 5 ms."""
        return max(round(WINDOW / (self.bin * self.timestep)), 2)
