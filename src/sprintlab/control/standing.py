"""A robot that is asked to stand, and nearly does, is stood still by its joint controllers.

A policy that is trained to run steps on the spot when it is asked to stand: it costs several hundred watts,
and the robot wanders. Its targets are therefore blended into the default pose while the command is rest and
the estimated speed is low; a robot that is pushed out of it is the policy's again.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from sprintlab.core.checks import check_positive, check_range

FloatArray = npt.NDArray[np.floating[Any]]

REST_COMMAND = 0.05
"""A command below this in each of its numbers asks for rest [m/s, rad/s]."""


class StandingContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When a robot that is asked to stand is held in its default pose.

    Attributes:
        hold_speed: it is held from an estimated horizontal speed below this on [m/s].
        release_speed: it is the policy's again above this [m/s].
        blend_time: time constant with which the pose takes over [s].

    Raises:
        InvalidValueError: a number is not positive, or the release lies below the hold.
    """

    hold_speed: float = 0.4
    release_speed: float = 0.8
    blend_time: float = 0.1

    def __post_init__(self) -> None:
        check_positive("standing.hold_speed", self.hold_speed, "m/s")
        check_range("standing.release_speed", self.release_speed, self.hold_speed, 100.0, "m/s")
        check_positive("standing.blend_time", self.blend_time, "s")


class StandingHold:
    """Says from step to step which share of the policy's action is used.

    Args:
        contract: the speeds and the time constant.
        rate_hz: of the policy [Hz].
    """

    def __init__(self, contract: StandingContract, rate_hz: float) -> None:
        self._contract = contract
        self._step = 1.0 - float(np.exp(-1.0 / (rate_hz * contract.blend_time)))
        self._held = 0.0

    def reset(self) -> None:
        """Begin with the policy."""
        self._held = 0.0

    def share(self, command: FloatArray, velocity: FloatArray) -> float:
        """Share of the action to use, 0 to 1; at once 1 when the command is not rest.

        Args:
            command: forward, sideways speed [m/s], yaw rate [rad/s] ``(3,)``.
            velocity: estimated, body frame [m/s] ``(3,)``.
        """
        bounds = self._contract.release_speed if self._held > 0.0 else self._contract.hold_speed
        resting = bool((np.abs(command) < REST_COMMAND).all())
        if not (resting and float(np.hypot(velocity[0], velocity[1])) < bounds):
            self._held = 0.0
            return 1.0
        self._held += self._step * (1.0 - self._held)
        return 1.0 - self._held
