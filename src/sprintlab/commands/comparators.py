"""How other papers' commands move: at once to a curriculum's targets, or along a ramp of fixed length."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.commands.curricula import BoxGrid
from sprintlab.commands.schedules import TargetSampling, approach, start_speed
from sprintlab.commands.state import CommandState
from sprintlab.control.arrays import Array, clip, namespace
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError

_FROM_BOX = TargetSampling(top_share=0.0, grid=BoxGrid())
_UNIFORM = TargetSampling(top_share=0.0, grid=None)


@dataclass(frozen=True, kw_only=True)
class CurriculumSchedule:
    """Targets of a curriculum over its whole range, commanded at once: RLvRL, LP-ACRL, after HACL.

    The curriculum alone decides how fast a target may be; the growing range of ``advance`` is not looked at.

    Attributes:
        targets: how targets are drawn; the grid is the curriculum.
        straight_share: share of the targets whose yaw rate is zero, so that running straight is practised as
            much as under the other schedules.

    Raises:
        InvalidValueError: the targets have no grid, or a share outside [0, 1].
    """

    targets: TargetSampling = _FROM_BOX
    straight_share: float = 0.5

    def __post_init__(self) -> None:
        check_range("straight_share", self.straight_share, 0.0, 1.0)
        if self.targets.grid is None:
            raise InvalidValueError("targets.grid", None, "a curriculum")

    def advance(
        self,
        state: CommandState,
        *,
        speed: Array,
        dt: float,
        lower: Array | float,
        upper: Array | float,
        friction: Array | float,
        fresh: Array,
        random: Array,
        weights: Array | None = None,
        steady: Array | float = 1.0,
    ) -> CommandState:
        """The state one policy step later; arguments as in ``AdaptiveSchedule.advance``."""
        xp = namespace(random)
        assert self.targets.grid is not None
        slowest, fastest = self.targets.grid.speed
        state, renewed = self.targets.advance(
            state, dt=dt, lower=slowest, upper=fastest, fresh=fresh, random=random, weights=weights
        )
        straight = renewed & (random[:, 5] < self.straight_share)
        yaw_rate = xp.where(straight, xp.zeros_like(state.target_yaw_rate), state.target_yaw_rate)
        return state._replace(
            command=self.targets.command(clip(state.target_speed, slowest, fastest), yaw_rate, friction),
            target_yaw_rate=yaw_rate,
            time_to_update=state.time_to_target,
        )


@dataclass(frozen=True, kw_only=True)
class RampedSchedule:
    """Uniform targets over the growing range, which the command reaches along a ramp of fixed length (Hound).

    A fresh environment's ramp begins at its present speed.

    Attributes:
        targets: how targets are drawn.
        ramp: time from one target to the next [s].

    Raises:
        InvalidValueError: a ramp that is not positive.
    """

    targets: TargetSampling = _UNIFORM
    ramp: float = 1.0

    def __post_init__(self) -> None:
        check_positive("ramp", self.ramp, "s")

    def advance(
        self,
        state: CommandState,
        *,
        speed: Array,
        dt: float,
        lower: Array | float,
        upper: Array | float,
        friction: Array | float,
        fresh: Array,
        random: Array,
        weights: Array | None = None,
        steady: Array | float = 1.0,
    ) -> CommandState:
        """The state one policy step later; arguments as in ``AdaptiveSchedule.advance``."""
        xp = namespace(random)
        state, renewed = self.targets.advance(
            state, dt=dt, lower=lower, upper=upper, fresh=fresh, random=random, weights=weights
        )
        start = start_speed(state, speed, fresh)
        rate = xp.where(renewed, xp.abs(state.target_speed - start) / self.ramp, state.acceleration)
        moved = approach(state, start, rate * dt)
        return state._replace(
            command=self.targets.command(clip(moved, lower, upper), state.target_yaw_rate, friction),
            time_to_update=xp.zeros_like(moved),
            acceleration=rate,
        )
