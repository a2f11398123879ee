"""What comes between a policy and its robot: the clock, noise, encoder offsets, delay, pushes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sprintlab.control import POLICY_RATE_HZ, Measurement
from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_range
from sprintlab.plant import Plant, TrialSettings
from sprintlab.robots import RobotDescription

SENSOR_NOISE = Measurement(
    angular_velocity=np.array(0.15),
    projected_gravity=np.array(0.02),
    joint_position=np.array(0.01),
    joint_velocity=np.array(0.8),
)
"""Half-widths of the uniform noise of a ``sensor_noise`` of 1 [rad/s, -, rad, rad/s]: those of training."""

PUSH_INTERVAL = 3.0
"""Mean time between two pushes [s]."""

_FIRST_PUSH = 1.0  # not before the robot is asked to run [s]


@dataclass(frozen=True, kw_only=True)
class PolicyClock:
    """When the policy is asked for its next action.

    The policy does not know: its filters and its history go on as if every period were 20 ms.

    Raises:
        InvalidValueError: a field is out of range.
    """

    rate: float = POLICY_RATE_HZ  # mean [Hz]
    jitter: float = 0.0  # half-width of the uniform draw of each period, as a share of the period, to 0.5

    def __post_init__(self) -> None:
        check_range("clock.rate", self.rate, 10.0, 250.0, "Hz")
        check_range("clock.jitter", self.jitter, 0.0, 0.5)

    def __str__(self) -> str:
        return f"{self.rate:g} Hz" + (f" ± {100 * self.jitter:g} % each period" if self.jitter else "")

    def periods(self, motor_rate: float, seed: int) -> Iterator[int]:
        """Motor steps, at ``motor_rate`` [Hz], from each action to the next, without end.

        Ticks fall on motor steps; what is rounded away at one tick is made up for at the next.
        """
        random = np.random.default_rng((seed, 2))
        due, passed = 0.0, 0
        while True:
            due += motor_rate / self.rate * (1.0 + self.jitter * random.uniform(-1.0, 1.0))
            steps = max(1, round(due) - passed)
            passed += steps
            yield steps


class Disturbances:
    """The disturbances of one trial at a motor rate [Hz]; without any, everything passes unchanged."""

    def __init__(self, robot: RobotDescription, settings: TrialSettings, motor_rate: float) -> None:
        self._settings, self._motor_rate = settings, motor_rate
        self._delay = round(settings.delay * motor_rate)
        draws = np.random.SeedSequence((settings.seed, 3)).spawn(3)
        offsets, self._noise, self._pushes = (np.random.default_rng(draw) for draw in draws)
        width = settings.joint_offset
        self._offset = offsets.uniform(-width, width, len(robot.joint_names)) if width else 0.0
        self._held: FloatArray | None = None

    def measured(self, measurement: Measurement) -> Measurement:
        """What the policy is told: encoders off by their offsets, noise on everything."""
        measurement = measurement._replace(joint_position=measurement.joint_position + self._offset)
        scale = self._settings.sensor_noise
        if not scale:
            return measurement
        pairs = zip(measurement, SENSOR_NOISE, strict=True)
        noise = self._noise
        return Measurement(*(a + noise.uniform(-scale, scale, np.shape(a)) * width for a, width in pairs))

    def delivered(self, targets: FloatArray, steps: int) -> Iterator[tuple[FloatArray, int]]:
        """Joint targets and for how many motor steps the drives follow them, over one policy period.

        The drives close their loops on the same encoders, so that an offset shifts every target
        ``(joints,)`` [rad].
        """
        shifted = targets - self._offset
        late = 0
        if self._held is not None and (late := min(self._delay, steps)):
            yield self._held, late
        if steps > late:
            yield shifted, steps - late
        self._held = shifted

    def push(self, plant: Plant, steps: int) -> None:
        """Perhaps push the trunk, at the start of a policy period of ``steps`` motor steps."""
        settings = self._settings
        if not settings.push_speed or plant.time < _FIRST_PUSH:
            return
        chance, angle = self._pushes.uniform(0.0, 1.0, 2)
        if chance < steps / (self._motor_rate * PUSH_INTERVAL):
            direction = 2.0 * np.pi * angle
            plant.push(settings.push_speed * np.array([np.cos(direction), np.sin(direction)]))
