"""The paper's six methods, one switch apart; other papers' methods; two presets of everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from sprintlab.commands import (
    AdaptiveSchedule,
    BoxGrid,
    Curriculum,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    PredictionGrid,
    ProgressGrid,
    RampedSchedule,
    TargetSampling,
    UniformSchedule,
)
from sprintlab.core.checks import check_choice
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MotorModel
from sprintlab.training.scaling import scaled_settings
from sprintlab.training.settings import ACS, TARGETS, RewardSettings, RewardWeight, Schedule, TrainingSettings


@dataclass(frozen=True, kw_only=True)
class Method:
    """What sets a method apart.

    Attributes:
        actuator_model: motor model in training.
        schedule: how commands evolve.
        rewards: instead of the preset's; None: the preset's.
        saturation: whether the motors saturate in training.
        prior: whether computed strides are rewarded at the start, their file from the settings.
        load_balance: weight of the reward term of this name, in both stages.
        source: paper that the method follows; empty: the paper of this package.
    """

    actuator_model: MotorModel
    schedule: Schedule
    rewards: RewardSettings | None = None
    saturation: bool = True
    prior: bool = False
    load_balance: float = 0.0
    source: str = ""


UNIFORM = UniformSchedule(targets=replace(TARGETS, top_share=0.0, grid=None))

METHODS = {
    "baseline": Method(actuator_model="square", schedule=UNIFORM),
    "no-envelope": Method(actuator_model="square", schedule=ACS),
    "simplified-dc": Method(actuator_model="simplified-dc", schedule=ACS),
    "fixed-acceleration": Method(
        actuator_model="refined", schedule=FixedAccelerationSchedule(targets=TARGETS)
    ),
    "uniform-commands": Method(actuator_model="refined", schedule=UNIFORM),
    "sprint": Method(actuator_model="refined", schedule=ACS),
}
"""The paper's six, in no order."""

LITERAL_ACS = "literal-acs"
"""A seventh method: the paper's Eq. of ACS as it stands, with no target that the commands move toward."""


_NONE = RewardWeight(first=0.0, second=0.0)
_WITHOUT_GAIT_TERMS: dict[str, Any] = {
    "tied": False,
    "fine_speed_tracking": 0.0,
    "fine_yaw_tracking": 0.0,
    "joint_limit": RewardWeight(first=-10.0, second=-10.0),
    "electrical_power": _NONE,
    "hasty_touchdowns": _NONE,
    "short_stances": _NONE,
    "motion_at_zero_command": _NONE,
    "sideways_drift": _NONE,
}
"""What makes gaits believable is this package's own: no paper's table has it."""


def hound_rewards() -> RewardSettings:
    """Hound's rewards (2312.17507): its gait and foot terms, base and torque terms, tracking kernels.

    All weights are the paper's divided by six, which makes linear tracking one as in the other presets. Its
    contact velocity is our ``touchdown``: the squared downward speed of a foot that is about to touch. Terms
    that it does not print are zero, and those that keep a simulated robot possible stay (end stops, legs,
    knees, no-load speed). The sum is clipped at zero; how Hound adds its terms we could not read.
    """

    def weight(printed: float) -> RewardWeight:
        return RewardWeight(first=printed / 6.0, second=printed / 6.0)

    return RewardSettings(
        **_WITHOUT_GAIT_TERMS,
        linear_tracking=1.0,
        angular_tracking=0.5,
        angular_sharpness=1.5,
        progress=0.0,
        diagonal_contact=weight(1.2),
        touchdown=weight(-6.0),
        foot_slip=weight(-0.16),
        torque=weight(-2e-4),
        vertical_velocity=weight(-4.0 * 0.8),
        tilt_rate=weight(-4.0 * 0.2),
        joint_power=_NONE,
        action_rate=_NONE,
        smoothness=_NONE,
        roll_pitch_rate=_NONE,
        orientation=_NONE,
        base_height=_NONE,
        joint_acceleration=_NONE,
        abduction=_NONE,
        yaw_rate=_NONE,
        foot_clearance=_NONE,
        abduction_mirror=_NONE,
        grounded=_NONE,
        over_speed=weight(-60.0),
        leg_distance=weight(-12.0),
        aggregation="clipped",
    )


def _curriculum(grid: Curriculum, persistence: tuple[float, float] = (3.0, 7.0)) -> CurriculumSchedule:
    return CurriculumSchedule(targets=TargetSampling(top_share=0.0, grid=grid, persistence=persistence))


COMPARATORS = {
    "rlvrl": Method(
        actuator_model="refined",
        schedule=_curriculum(BoxGrid(), (10.0, 10.0)),
        source="Margolis et al. 2022, Rapid Locomotion via RL: box-adaptive grid",
    ),
    "lp-acrl": Method(
        actuator_model="refined",
        schedule=_curriculum(ProgressGrid()),
        source="LP-ACRL (2601.17428): bins by learning progress",
    ),
    "after-hacl": Method(
        actuator_model="refined",
        schedule=_curriculum(PredictionGrid()),
        source="after HACL (2505.18429): bins by a predicted reward",
    ),
    "hound": Method(
        actuator_model="simplified-dc",
        schedule=RampedSchedule(),
        rewards=hound_rewards(),
        source="Hound (2312.17507): v_d = 0 operating region, gait and foot rewards",
    ),
    "stride-prior": Method(
        actuator_model="refined",
        schedule=ACS,
        prior=True,
        load_balance=-2.0,
        source="the paper's future work: a trajectory prior and balanced joint loads",
    ),
}
"""Methods of other papers, and beyond the paper, on the same robot, recipe and budget."""

NO_SATURATION = "no-saturation"
"""An eighth method: the envelope as it is, but motors that do not saturate; the paper does not ablate it."""

ALL_METHODS = (
    METHODS
    | {
        LITERAL_ACS: Method(actuator_model="refined", schedule=AdaptiveSchedule(biased_share=0.0)),
        NO_SATURATION: Method(actuator_model="refined", schedule=ACS, saturation=False),
    }
    | COMPARATORS
)

PRESETS = ("sprintlab", "paper")
"""``"sprintlab"``: our reward and practice, the defaults; ``"paper"``: the paper's table to the letter."""


def paper_rewards() -> RewardSettings:
    """The paper's Table I, every weight as printed, and no term that it does not have.

    How the terms are added the paper does not say: they are added as by default, tracking times
    exp(penalties / 2), since a plain sum rewards an early end at an orientation weight of -100.
    """
    return RewardSettings(
        progress=0.0,
        **_WITHOUT_GAIT_TERMS,
        bare_squares=True,
        roll_pitch_rate=RewardWeight(first=-0.02, second=-0.5),
        action_rate=RewardWeight(first=-0.01, second=-0.01),
        smoothness=RewardWeight(first=-0.005, second=-0.005),
        joint_acceleration=RewardWeight(first=-2.5e-7, second=-1e-7),
        collision=RewardWeight(first=-1.0, second=0.0),
        grounded=_NONE,
        touchdown=_NONE,
    )


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
        constraints=None,
        episodes=replace(base.episodes, clone_share=0.0, fast_start_share=0.0),
        stages=replace(base.stages, second_top=12.0, record_margin=None),
        ppo=replace(base.ppo, low_noise_fraction=0.0, symmetric=False),
    )


def method_settings(name: str, base: TrainingSettings | None = None) -> TrainingSettings:
    """``base`` (default: all defaults) with what sets method ``name`` apart.

    Raises:
        InvalidValueError: the method is unknown, the message lists those that are known; the rewards were
            changed that the method decides; or it needs strides and there are none.
    """
    check_choice("method", name, tuple(ALL_METHODS))
    method, base = ALL_METHODS[name], base or TrainingSettings()
    if method.rewards is not None and base.rewards not in (RewardSettings(), method.rewards):
        raise InvalidValueError("settings.rewards", "changed", f"left alone: method {name} decides them")
    simulation, rewards = base.simulation, method.rewards or base.rewards
    if method.prior and base.prior is None:
        raise InvalidValueError("prior", None, "a file made by python -m studies.paper stride")
    if method.load_balance:
        weight = RewardWeight(first=method.load_balance, second=method.load_balance)
        rewards = replace(rewards, load_balance=weight)
    if not method.saturation:
        simulation = replace(simulation, saturation=False)
    return replace(
        base,
        method=name,
        actuator_model=method.actuator_model,
        schedule=as_printed(method.schedule) if base.rewards == paper_rewards() else method.schedule,
        rewards=rewards,
        simulation=simulation,
    )


DEFAULT_METHOD = "sprint"


def method(
    name: str = DEFAULT_METHOD, *, robot: str = "bp2", preset: str = "sprintlab", seed: int = 0
) -> TrainingSettings:
    """The settings of a run.

    Args:
        name: of the method, one of ``ALL_METHODS``.
        robot: name, folder or table of the robot; lengths, speeds and masses are scaled to it.
        preset: of rewards and practice, one of ``PRESETS``.
        seed: of every random generator.

    Raises:
        InvalidValueError: an unknown method or preset.
        SprintlabError: the robot is not known, or its table is refused.
    """
    base = preset_settings(preset)
    return replace(scaled_settings(robot, method_settings(name, base), base), seed=seed)
