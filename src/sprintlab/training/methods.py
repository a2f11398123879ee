"""The paper's six methods, one switch apart, and two presets of everything else that they share."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.commands import AdaptiveSchedule, FixedAccelerationSchedule, UniformSchedule
from sprintlab.core.checks import check_choice
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MotorModel
from sprintlab.training.settings import RewardSettings, RewardWeight, Schedule, TrainingSettings


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

"""The paper's six, in no order."""

LITERAL_ACS = "literal-acs"
"""A seventh method: the paper's Eq. of ACS as it stands, with no target that the commands move toward."""

ALL_METHODS = METHODS | {
    LITERAL_ACS: Method(actuator_model="refined", schedule=AdaptiveSchedule(biased_share=0.0))
}

PRESETS = ("sprintlab", "paper")
"""``"sprintlab"``: our reward and practice, the defaults; ``"paper"``: the paper's table to the letter."""


def paper_rewards() -> RewardSettings:
    """The paper's Table I, every weight as printed, and no term that it does not have.

    How the terms are added the paper does not say: they are added as by default, tracking times
    exp(penalties / 2), since a plain sum rewards an early end at an orientation weight of -100.
    """
    none = RewardWeight(first=0.0, second=0.0)
    return RewardSettings(
        progress=0.0,
        fine_speed_tracking=0.0,
        fine_yaw_tracking=0.0,
        bare_squares=True,
        action_rate=RewardWeight(first=-0.01, second=-0.01),
        smoothness=RewardWeight(first=-0.005, second=-0.005),
        joint_acceleration=RewardWeight(first=-2.5e-7, second=-1e-7),
        collision=RewardWeight(first=-1.0, second=0.0),
        grounded=none,
        over_speed=none,
        touchdown=none,
        leg_distance=none,
        electrical_power=none,
        gear_torque=none,
        foot_force=none,
        hasty_touchdowns=none,
        short_stances=none,
        restlessness=none,
    )


def preset_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with what a preset decides.

    ``"sprintlab"`` leaves it as it is. ``"paper"`` replaces the rewards, copies no states, starts nobody
    fast, lets every robot act with the same noise, and ends the range at 12 m/s.

    Raises:
        InvalidValueError: the preset is unknown, or the rewards were changed that it decides.
    """
    check_choice("preset", name, PRESETS)
    base = base or TrainingSettings()
    if name == "sprintlab":
        return base
    if base.rewards not in (RewardSettings(), paper_rewards()):
        raise InvalidValueError("settings.rewards", "changed", "left alone: preset paper decides the rewards")
    return replace(
        base,
        rewards=paper_rewards(),
        episodes=replace(base.episodes, clone_share=0.0, fast_start_share=0.0),
        stages=replace(base.stages, second_top=12.0),
        ppo=replace(base.ppo, quiet_share=0.0),
    )


def method_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with the switch of method ``name``.

    Raises:
        InvalidValueError: the method is unknown; the message lists those that are known.
    """
    check_choice("method", name, tuple(ALL_METHODS))
    method = ALL_METHODS[name]
    return replace(
        base or TrainingSettings(),
        method=name,
        actuator_model=method.actuator_model,
        schedule=method.schedule,
    )
