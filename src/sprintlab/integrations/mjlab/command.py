"""The command schedules as an mjlab command term: forward speed and yaw rate, ``(environments, 3)``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from mjlab.managers.command_manager import CommandTerm, CommandTermCfg

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandStep,
    FixedAccelerationSchedule,
    RangeGrowth,
    UniformSchedule,
    initial_state,
    ranked_speeds,
)
from sprintlab.core.checks import check_finite, check_positive, check_range

_NEVER = 1e9  # seconds until mjlab redraws by itself: the schedule keeps its own time


@dataclass(kw_only=True)
class AdaptiveVelocityCommandCfg(CommandTermCfg):
    """Adaptive command scheduling: the commanded speed stays near the robot's, and moves toward a target.

    With ``growth`` above 0 the top of the range rises by it whenever a twentieth of the robots are faster
    than ``growth_share`` of it, looked at every ``growth_period``.
    """

    entity_name: str = "robot"
    """The entity that is commanded."""
    schedule: AdaptiveSchedule | UniformSchedule | FixedAccelerationSchedule = field(
        default_factory=lambda: AdaptiveSchedule(braking_window=1.0)
    )
    """How commands evolve; by default as in the paper, within 1 m/s of the robot's speed either way."""
    lower: float = -1.0
    """Bottom of the speed range [m/s]."""
    upper: float = 2.0
    """Top of the speed range at the start [m/s]."""
    top: float = 2.0
    """Where the range stops to grow [m/s]."""
    growth: float = 0.0
    """Step by which the top rises [m/s]; 0 keeps the range."""
    growth_share: float = 0.7
    """Share of the top that a twentieth of the robots must exceed [-]."""
    growth_period: float = 0.5
    """Time between two looks at the fastest [s]."""
    friction: float = 0.8
    """Ground friction that a turn may rely on: the yaw rate keeps ``|v w| <= friction g``."""
    resampling_time_range: tuple[float, float] = (_NEVER, _NEVER)
    """mjlab's own redraws, which the schedule does without."""

    def __post_init__(self) -> None:
        check_finite("lower", self.lower)
        check_range("upper", self.upper, self.lower, math.inf, "m/s")
        check_range("top", self.top, self.upper, math.inf, "m/s")
        check_range("growth", self.growth, 0.0, math.inf, "m/s")
        for name in ("growth_share", "growth_period", "friction"):
            check_positive(name, getattr(self, name))

    def build(self, env: Any) -> AdaptiveVelocityCommand:
        """The term of an environment."""
        return AdaptiveVelocityCommand(self, env)


class AdaptiveVelocityCommand(CommandTerm):
    """The state of the schedule for all environments, advanced once a policy step."""

    cfg: AdaptiveVelocityCommandCfg

    def __init__(self, cfg: AdaptiveVelocityCommandCfg, env: Any) -> None:
        super().__init__(cfg, env)
        self.robot = env.scene[cfg.entity_name]
        self.range = RangeGrowth(upper=cfg.upper, increment=cfg.growth, share=cfg.growth_share)
        """The speed range now; part of a curriculum's state, so keep its ``upper`` [m/s] with checkpoints."""
        self._state = initial_state(self.num_envs, torch.zeros((), device=self.device))
        self._reset_mask = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)
        self._since_growth = 0.0
        for name in ("error_vel_x", "error_vel_yaw"):
            self.metrics[name] = torch.zeros(self.num_envs, device=self.device)

    @property
    def command(self) -> torch.Tensor:
        """Forward speed, sideways speed [m/s] and yaw rate [rad/s], ``(environments, 3)``."""
        return self._state.command

    def _update_metrics(self) -> None:
        command, data = self.command, self.robot.data
        share = self._env.step_dt / self._env.max_episode_length_s
        speed_error = torch.abs(command[:, 0] - data.root_link_lin_vel_b[:, 0])
        self.metrics["error_vel_x"] += share * speed_error
        self.metrics["error_vel_yaw"] += share * torch.abs(command[:, 2] - data.root_link_ang_vel_b[:, 2])

    def _resample_command(self, env_ids: torch.Tensor) -> None:
        self._reset_mask[env_ids] = True

    def _update_command(self, env_ids: torch.Tensor | None) -> None:
        """Advance every environment by a policy step, or only draw anew for those just reset."""
        step = CommandStep(
            speed=self.robot.data.root_link_lin_vel_b[:, 0],
            dt=self._env.step_dt if env_ids is None else 0.0,
            lower=self.cfg.lower,
            upper=self.range.upper,
            friction=self.cfg.friction,
            reset_mask=self._reset_mask,
            random=torch.rand(self.num_envs, 8, device=self.device),
        )
        advanced = self.cfg.schedule.advance(self._state, step)
        if env_ids is None:
            self._state = advanced
            self._reset_mask = torch.zeros_like(self._reset_mask)
            self._grow()
            return
        for kept, drawn in zip(self._state, advanced, strict=True):
            kept[env_ids] = drawn[env_ids]
        self._reset_mask[env_ids] = False

    def _grow(self) -> None:
        """Look at the fastest robots from time to time: reading a number makes the host wait."""
        self._since_growth += self._env.step_dt
        if self.cfg.growth == 0.0 or self._since_growth < self.cfg.growth_period:
            return
        self._since_growth = 0.0
        fast = float(ranked_speeds(self.robot.data.root_link_lin_vel_b[:, 0], (0.95,))[0])
        self.range.update(fast, self.cfg.top)
