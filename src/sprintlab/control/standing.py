"""A robot that is asked to stand, and nearly does, is stood still by its joint controllers.

A policy that is trained to run steps on the spot when it is asked to stand: it costs several hundred watts,
and the robot wanders. Its targets are therefore blended into the default pose once the command is rest and
the estimated speed is low, until another command comes or the trunk tips. Training and the robot's runtime
do it by the same function.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from sprintlab.control.arrays import Array, namespace
from sprintlab.control.filters import low_pass, low_pass_coefficient
from sprintlab.core.checks import check_positive, check_range

FloatArray = npt.NDArray[np.floating[Any]]

REST_COMMAND = 0.05
"""A command below this in each of its numbers asks for rest [m/s, rad/s]."""


class StandingContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When a robot that is asked to stand is held in its default pose."""

    hold_speed: float = 0.6  # estimated horizontal speed below which it is held [m/s]
    release_tilt: float = 0.2  # tilt of the trunk above which the policy acts again [rad]
    blend_time: float = 0.3  # time constant with which the pose takes over [s]

    def __post_init__(self) -> None:
        check_positive("standing.hold_speed", self.hold_speed, "m/s")
        check_range("standing.hold_speed", self.hold_speed, 0.0, 100.0, "m/s")
        check_positive("standing.release_tilt", self.release_tilt, "rad")
        check_range("standing.release_tilt", self.release_tilt, 0.0, math.pi / 2, "rad")
        check_range("standing.blend_time", self.blend_time, 1e-6, 3600.0, "s")


def standing_share(
    contract: StandingContract,
    held: Array,
    *,
    command: Array,
    velocity: Array,
    gravity: Array,
    rate_hz: float,
) -> Array:
    """Share of the default pose in a robot's targets one policy step later ``(...)``, 0 to 1.

    Zero wherever the robot is not asked to stand, or tips; else, from a low estimated speed on, it rises to
    one, and a speed that is estimated later does not end it.

    Args:
        contract: what it is held by.
        held: the share now ``(...)``.
        command: forward, sideways speed [m/s], yaw rate [rad/s] ``(..., 3)``.
        velocity: estimated, body frame [m/s] ``(..., 2)`` or more.
        gravity: unit vector, body frame ``(..., 3)``.
        rate_hz: rate of the policy [Hz].
    """
    xp = namespace(command)
    asked = xp.all(xp.abs(command) < REST_COMMAND, axis=-1)
    upright = _squared(gravity) < math.sin(contract.release_tilt) ** 2
    slow = (held > 0.0) | (_squared(velocity) < contract.hold_speed**2)
    coefficient = low_pass_coefficient(1.0 / (2.0 * math.pi * contract.blend_time), rate_hz)
    risen = low_pass(held, 1.0, coefficient)
    return xp.where(asked & upright & slow, risen, xp.zeros_like(risen))


def _squared(vector: Array) -> Array:
    """Squared length of the first two of its numbers ``(...)``."""
    return vector[..., 0] ** 2 + vector[..., 1] ** 2


class StandingHold:
    """Says from step to step which share of the policy's action is used."""

    def __init__(self, contract: StandingContract, rate_hz: float) -> None:
        self._contract, self._rate_hz = contract, rate_hz
        self.reset()

    @property
    def held(self) -> bool:
        """Whether the pose has begun to take over."""
        return bool(self._held > 0.0)

    def reset(self) -> None:
        """Begin anew: a robot that is asked to stand from the start is held at once."""
        self._held: Array = np.asarray(1.0)

    def share(self, command: FloatArray, velocity: FloatArray, gravity: FloatArray) -> float:
        """Share of the action to use, 0 to 1; at once 1 when the command is not rest."""
        self._held = standing_share(
            self._contract,
            self._held,
            command=command,
            velocity=velocity,
            gravity=gravity,
            rate_hz=self._rate_hz,
        )
        return 1.0 - float(self._held)
