"""The state that every command schedule advances, and the limit that every command obeys."""

from __future__ import annotations

from typing import NamedTuple

from sprintlab.control.arrays import Array, clip, filled, namespace
from sprintlab.core.constants import GRAVITY


class CommandState(NamedTuple):
    """Commands of ``n`` environments and the timers that renew them."""

    command: Array  # forward speed, sideways speed [m/s], yaw rate [rad/s] (n, 3)
    target_speed: Array  # persistent target v* [m/s] (n,)
    target_yaw_rate: Array  # persistent target [rad/s] (n,)
    time_to_target: Array  # until the targets are redrawn [s] (n,)
    time_to_update: Array  # until the command is redrawn [s] (n,)
    acceleration: Array  # acceleration of the command (FixedAccelerationSchedule only) [m/s^2] (n,)


def initial_state(n: int, like: Array) -> CommandState:
    """All zeros for ``n`` environments, in the array type, floating type and device of ``like``.

    The first ``advance`` redraws everything, whether or not the environments are marked fresh.
    """
    xp = namespace(like)

    def zeros(*shape: int) -> Array:
        return xp.zeros(shape, dtype=like.dtype, device=like.device)

    return CommandState(zeros(n, 3), zeros(n), zeros(n), zeros(n), zeros(n), zeros(n))


def limit_yaw_rate(yaw_rate: Array, speed: Array, friction: Array | float) -> Array:
    """Yaw rate [rad/s] reduced so that ``|speed yaw_rate| <= friction g``: a turn the feet can hold.

    Args:
        yaw_rate: wanted [rad/s] ``(n,)``.
        speed: commanded forward speed [m/s] ``(n,)``.
        friction: ground friction coefficient, scalar or ``(n,)``.
    """
    xp = namespace(yaw_rate, speed)
    magnitude = xp.abs(speed)
    limit = friction * GRAVITY / xp.maximum(magnitude, filled(1e-3, magnitude))
    return clip(yaw_rate, -limit, limit)
