"""The paper's six methods, one switch apart; other papers' methods; two presets of everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.commands import (
    AdaptiveSchedule,
    BoxGrid,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    ProgressGrid,
    RampedSchedule,
    TargetSampling,
    UniformSchedule,
)
from sprintlab.core.checks import check_choice
from sprintlab.motors import Battery, MotorModel
from sprintlab.training.reward_tables import Rewards, hound_rewards, paper_rewards
from sprintlab.training.scaling import scaled_settings
from sprintlab.training.settings import ACS, TARGETS, Schedule, TrainingSettings


@dataclass(frozen=True, kw_only=True)
class Method:
    """What sets a method apart."""

    actuator_model: MotorModel = "refined"  # motor model in training
    schedule: Schedule = ACS  # how commands evolve
    rewards: Rewards | None = None  # rewards in place of the preset's; None: the preset's
    reward_sum: str = "exponential"  # how rewards are added up
    saturation: bool = True  # whether the motors saturate in training
    battery: Battery | None = None  # behind the bus in training; None: the bus is stiff


UNIFORM = UniformSchedule(targets=replace(TARGETS, top_share=0.0, grid=None))
METHODS = {
    "baseline": Method(actuator_model="square", schedule=UNIFORM),
    "no-envelope": Method(actuator_model="square"),
    "simplified-dc": Method(actuator_model="simplified-dc"),
    "fixed-acceleration": Method(schedule=FixedAccelerationSchedule(targets=TARGETS)),
    "uniform-commands": Method(schedule=UNIFORM),
    "acs": Method(),
}
"""The paper's six."""
ALL_METHODS = METHODS | {
    # The paper's Eq. of ACS as it stands, with no target that the commands move toward.
    "literal-acs": Method(schedule=AdaptiveSchedule(biased_share=0.0)),
    # The envelope as it is, but motors that do not saturate; the paper does not ablate it.
    "no-saturation": Method(saturation=False),
    # Margolis et al. 2022, Rapid Locomotion via RL: box-adaptive grid.
    "rlvrl": Method(
        schedule=CurriculumSchedule(
            targets=TargetSampling(top_share=0.0, grid=BoxGrid(), persistence=(10.0, 10.0))
        )
    ),
    # LP-ACRL (2601.17428): bins by learning progress.
    "lp-acrl": Method(
        schedule=CurriculumSchedule(targets=TargetSampling(top_share=0.0, grid=ProgressGrid()))
    ),
    # Hound (2312.17507): v_d = 0 operating region, gait and foot rewards.
    "hound": Method(
        actuator_model="simplified-dc",
        schedule=RampedSchedule(),
        rewards=hound_rewards(),
        reward_sum="clipped",
    ),
    # Spot (2504.17857): a battery in the loop.
    "spot-battery": Method(battery=Battery()),
    # The paper's future work: drives that weaken the flux.
    "flux-weakening": Method(actuator_model="flux-weakening"),
}
"""Further ones and those of other papers, on the same robot, recipe and budget."""
DEFAULT_METHOD = "acs"
PRESETS = ("sprintlab", "paper")
"""``"sprintlab"``: our reward and practice, the defaults; ``"paper"``: the paper's table to the letter."""


def as_printed(schedule: Schedule) -> Schedule:
    """One of the paper's schedules without what this package adds: ramps, and other targets."""
    if isinstance(schedule, AdaptiveSchedule):
        return replace(schedule, targets=TargetSampling(), ramp_share=0.0, ramps_when_steady=False)
    if isinstance(schedule, (UniformSchedule, FixedAccelerationSchedule)):
        return type(schedule)()
    return schedule


def preset_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with what a preset decides.

    ``"sprintlab"`` leaves it as it is. ``"paper"`` replaces the rewards, has no constraints and no symmetric
    networks, copies no states, starts no robot fast, lets every robot act with the same noise, asks none for
    less than another, and ends the range at 12 m/s.
    """
    check_choice("preset", name, PRESETS)
    base = base or TrainingSettings()
    if name == "sprintlab":
        return base
    return replace(
        base,
        reward=paper_rewards(),
        constraints=None,
        episodes=replace(base.episodes, clone_share=0.0, fast_start_share=0.0),
        stages=replace(base.stages, second_top=12.0, record_margin=None),
        ppo=replace(base.ppo, low_noise_fraction=0.0, symmetric=False),
    )


def method_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with what sets method ``name`` apart."""
    check_choice("method", name, tuple(ALL_METHODS))
    method, base = ALL_METHODS[name], base or TrainingSettings()
    printed = base.reward == paper_rewards()
    return replace(
        base,
        method=name,
        actuator_model=method.actuator_model,
        schedule=as_printed(method.schedule) if printed else method.schedule,
        reward=method.rewards or base.reward,
        reward_sum=method.reward_sum,
        simulation=replace(
            base.simulation,
            saturation=base.simulation.saturation and method.saturation,
            battery=method.battery or base.simulation.battery,
        ),
    )


def method(
    name: str = DEFAULT_METHOD, *, robot: str = "bp2", preset: str = "sprintlab", seed: int = 0
) -> TrainingSettings:
    """The settings of a run.

    Args:
        robot: name, folder or table of the robot; lengths, speeds and masses are scaled to it.
    """
    return replace(scaled_settings(robot, method_settings(name, preset_settings(preset))), seed=seed)
