"""A robot that is asked to stand, and nearly does, is stood still by its joint controllers.

A policy that is trained to run steps on the spot when it is asked to stand: it costs several hundred watts,
and the robot wanders. Its targets are therefore blended into the default pose once the command is rest and
the estimated speed is low, until another command comes or the trunk tips. (The estimate cannot say when to
let go: the estimator was never trained on a robot that stands, and says up to 1.1 m/s of one.)
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from sprintlab.control.filters import low_pass, low_pass_coefficient
from sprintlab.core.checks import check_positive, check_range

FloatArray = npt.NDArray[np.floating[Any]]

REST_COMMAND = 0.05
"""A command below this in each of its numbers asks for rest [m/s, rad/s]."""


class StandingContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When a robot that is asked to stand is held in its default pose.

    Attributes:
        hold_speed: it is held from an estimated horizontal speed below this on [m/s].
        release_tilt: of the trunk, above which it is the policy's again [rad].
        blend_time: time constant with which the pose takes over [s].

    Raises:
        InvalidValueError: a number is not positive, or the tilt above a right angle.
    """

    hold_speed: float = 0.6
    release_tilt: float = 0.2
    blend_time: float = 0.3

    def __post_init__(self) -> None:
        check_positive("standing.hold_speed", self.hold_speed, "m/s")
        check_positive("standing.release_tilt", self.release_tilt, "rad")
        check_range("standing.release_tilt", self.release_tilt, 0.0, math.pi / 2, "rad")
        check_positive("standing.blend_time", self.blend_time, "s")


class StandingHold:
    """Says from step to step which share of the policy's action is used.

    Args:
        contract: speed, tilt and time constant.
        rate_hz: of the policy [Hz].
    """

    def __init__(self, contract: StandingContract, rate_hz: float) -> None:
        self._contract = contract
        self._step = low_pass_coefficient(1.0 / (2.0 * math.pi * contract.blend_time), rate_hz)
        self.reset()

    @property
    def held(self) -> bool:
        """Whether the pose has begun to take over."""
        return self._held > 0.0

    def reset(self) -> None:
        """Begin anew: a robot that is asked to stand from the start is held at once."""
        self._held = 1.0

    def share(self, command: FloatArray, velocity: FloatArray, gravity: FloatArray) -> float:
        """Share of the action to use, 0 to 1; at once 1 when the command is not rest.

        Args:
            command: forward, sideways speed [m/s], yaw rate [rad/s] ``(3,)``.
            velocity: estimated, body frame [m/s] ``(3,)``.
            gravity: unit vector, body frame ``(3,)``.
        """
        resting = bool((np.abs(command) < REST_COMMAND).all())
        upright = math.hypot(gravity[0], gravity[1]) < math.sin(self._contract.release_tilt)
        slow = self.held or math.hypot(velocity[0], velocity[1]) < self._contract.hold_speed
        if not (resting and upright and slow):
            self._held = 0.0
            return 1.0
        self._held = float(low_pass(self._held, 1.0, self._step))
        return 1.0 - self._held
