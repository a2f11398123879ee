"""Terms of a run: a function with its weight and parameters side by side."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sprintlab.core.checks import check_finite, check_interval
from sprintlab.core.errors import InvalidValueError

Parameter = bool | float | tuple[float, ...]
SPEED_HELD, YAW_RATE_HELD = "speed_held", "yaw_rate_held"
"""Rewards that say how well a command is held, and multiply all that is tied: the speed always, the yaw rate
in the fine-tuning phase. From the start it would keep robots from learning to run."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """A function of a run and its parameters."""

    function: Callable[..., Any]
    """One of ``environment.rewards`` or ``environment.randomization``, or one's own."""
    parameters: Mapping[str, Parameter] = field(default_factory=dict[str, Parameter])
    """Its arguments but the first. Those named as in ``scaling.scales`` are scaled to the robot's size."""

    def __post_init__(self) -> None:
        signature = inspect.signature(self.function)
        try:
            signature.bind(None, **self.parameters)
        except TypeError as error:
            name, taken = getattr(self.function, "__name__", "the function"), [*signature.parameters][1:]
            allowed = f"{name} takes {', '.join(taken) or 'no parameters'}"
            raise InvalidValueError("parameters", dict(self.parameters), allowed) from error


@dataclass(frozen=True, kw_only=True)
class RewardTerm(Term):
    """One term of the reward: its function is ``(RewardInput, parameters) -> (n,)``."""

    weight: float | tuple[float, float]
    """One number, or one of stage I and one of stage II; negative for a penalty."""
    tied: bool = False
    """Whether the term, a reward, is multiplied by how well the command is held. Without it slow robots earn
    more than fast ones, since penalties take most of what a runner earns, and fast robots do not turn, since
    turning costs speed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for weight in self.weights:
            check_finite("weight", weight)
        if min(self.weights) < 0.0 and (max(self.weights) > 0.0 or self.tied):
            allowed = "one sign in both stages, and positive where the term is tied"
            raise InvalidValueError("weight", self.weight, allowed)

    @property
    def weights(self) -> tuple[float, float]:
        """In stage I and in stage II."""
        return self.weight if isinstance(self.weight, tuple) else (self.weight, self.weight)

    @property
    def rewards(self) -> bool:
        """Whether it adds to what is paid; penalties are added up for themselves."""
        return max(self.weights) > 0.0


def term(
    function: Callable[..., Any],
    weight: float | tuple[float, float],
    *,
    tied: bool = False,
    **parameters: Parameter,
) -> RewardTerm:
    """A reward term in one line."""
    return RewardTerm(function=function, weight=weight, parameters=parameters, tied=tied)


@dataclass(frozen=True, kw_only=True)
class RandomizationTerm(Term):
    """One thing that differs from robot to robot, drawn by ``(Fleet, parameters)``; a pair is an interval."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in self.parameters.items():
            if isinstance(value, tuple):
                check_interval(name, value, -1e9, 1e9)


def drawn(function: Callable[..., Any], **parameters: Parameter) -> RandomizationTerm:
    """A randomization term in one line."""
    return RandomizationTerm(function=function, parameters=parameters)
