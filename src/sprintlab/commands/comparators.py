"""How other papers' commands move: at once to a curriculum's targets, or along a ramp of fixed length."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.commands.curricula import BoxGrid
from sprintlab.commands.schedules import CommandStep, TargetSampling, TargetSchedule, ramped
from sprintlab.commands.state import CommandState
from sprintlab.control.arrays import Array, namespace
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError

_FROM_BOX = TargetSampling(top_share=0.0, grid=BoxGrid())
_UNIFORM = TargetSampling(top_share=0.0, grid=None)


@dataclass(frozen=True, kw_only=True)
class CurriculumSchedule(TargetSchedule):
    """Targets of a curriculum over its whole range, commanded at once: RLvRL and LP-ACRL.

    The curriculum alone decides how fast a target may be; the growing range of ``advance`` is not looked at.
    """

    targets: TargetSampling = _FROM_BOX  # how targets are drawn; the grid is the curriculum
    straight_share: float = 0.5
    """Share of the targets whose yaw rate is zero, so that running straight is practised as much as under the
    other schedules."""

    def __post_init__(self) -> None:
        check_range("straight_share", self.straight_share, 0.0, 1.0)
        if self.targets.grid is None:
            raise InvalidValueError("targets.grid", None, "a curriculum")

    def _range(self, lower: Array | float, upper: Array | float) -> tuple[Array | float, Array | float]:
        assert self.targets.grid is not None
        return self.targets.grid.speed

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        xp = namespace(step.random)
        straight = renewed & (step.random[:, 5] < self.straight_share)
        yaw_rate = xp.where(straight, xp.zeros_like(state.target_yaw_rate), state.target_yaw_rate)
        state = state._replace(target_yaw_rate=yaw_rate)
        return self._commanded(state, state.target_speed, step, time_to_update=state.time_to_target)


@dataclass(frozen=True, kw_only=True)
class RampedSchedule(TargetSchedule):
    """Uniform targets over the growing range, reached along a ramp of fixed length (Hound)."""

    targets: TargetSampling = _UNIFORM
    ramp: float = 1.0  # time from one target to the next [s]

    def __post_init__(self) -> None:
        check_positive("ramp", self.ramp, "s")

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        xp = namespace(step.random)
        start = xp.where(step.reset_mask, step.speed, state.command[:, 0])
        rate = xp.where(renewed, xp.abs(state.target_speed - start) / self.ramp, state.acceleration)
        speed = ramped(state, rate, step)
        return self._commanded(state, speed, step, time_to_update=xp.zeros_like(speed), acceleration=rate)
