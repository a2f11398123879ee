"""The paper's six methods: the same reward, range, budget and evaluation, one switch apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.commands import AdaptiveSchedule, FixedAccelerationSchedule, UniformSchedule
from sprintlab.core.checks import check_choice
from sprintlab.motors import MotorModel
from sprintlab.training.settings import Schedule, TrainingSettings


@dataclass(frozen=True, kw_only=True)
class Method:
    """What sets a method apart: the motor model in training, and how commands evolve."""

    actuator_model: MotorModel
    schedule: Schedule


METHODS = {
    "baseline": Method(actuator_model="square", schedule=UniformSchedule()),
    "no-envelope": Method(actuator_model="square", schedule=AdaptiveSchedule()),
    "simplified-dc": Method(actuator_model="simplified-dc", schedule=AdaptiveSchedule()),
    "fixed-acceleration": Method(actuator_model="refined", schedule=FixedAccelerationSchedule()),
    "uniform-commands": Method(actuator_model="refined", schedule=UniformSchedule()),
    "sprint": Method(actuator_model="refined", schedule=AdaptiveSchedule()),
}


def method_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with the switch of method ``name``.

    Raises:
        InvalidValueError: the method is unknown; the message lists those that are known.
    """
    check_choice("method", name, tuple(METHODS))
    method = METHODS[name]
    return replace(
        base or TrainingSettings(),
        method=name,
        actuator_model=method.actuator_model,
        schedule=method.schedule,
    )
