"""Every choice of a training run: frozen, checked, with the default and its reason."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from typing import Any

from sprintlab.commands import (
    AdaptiveSchedule,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    RampedSchedule,
    TargetSampling,
    UniformSchedule,
)
from sprintlab.control import ObservationLayout
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, Battery, HousedHeat, MotorModel, WindingHeat
from sprintlab.training.environment.randomization import default_randomization
from sprintlab.training.reward_tables import default_rewards
from sprintlab.training.settings_text import to_plain
from sprintlab.training.terms import SPEED_HELD, RandomizationTerm, RewardTerm

Schedule = (
    AdaptiveSchedule | UniformSchedule | FixedAccelerationSchedule | CurriculumSchedule | RampedSchedule
)
TARGETS = TargetSampling(
    persistence=(5.0, 12.0),
    top_share=0.36,
    zero_share=0.18,
    backward_share=0.08,
    slow_share=0.12,
    turn_share=0.6,
    scaled_turns=True,
)
"""What robots are asked for: long enough to reach a top speed, many stops, and turns that leave friction to
run with."""
ACS = AdaptiveSchedule(
    targets=TARGETS, ramp_share=0.5, ramp=(2.5, 5.0), ramps_when_steady=True, keeps_rest=True
)
"""ACS as the methods of this package train with it; the preset ``paper`` has it as printed."""
MOST_ENVIRONMENTS = 1 << 17
"""Robots side by side: sixteen times the default; a file may ask for all memory there is."""
PRECISIONS = ("tf32", "float16")
REWARD_SUMS = ("exponential", "clipped")
NORMALIZER_FLOOR = 1e-2
"""Added to the deviation by which the networks' inputs are divided; a policy file holds their sum."""
PHASES = ("hold", "push", "brake")
"""What a command asks for: a speed, more of it, or less."""
CONSTRAINTS = ("foot", "gear", "legs", "joint_speed", "end_stop")
"""Fields of ``ConstraintSettings``, in the order in which the environment stacks them."""


@dataclass(frozen=True, kw_only=True)
class SimulationSettings:
    """Physics in training."""

    environments: int = 8192  # robots that are simulated side by side
    heat: WindingHeat | None = None  # thermal model of the windings; None, as in the paper: they stay cold
    saturation: bool = True  # whether the motors saturate; off, torque stays proportional to current
    battery: Battery | None = None  # full at an episode's start; None, as in the paper: the bus is stiff

    def __post_init__(self) -> None:
        if isinstance(self.heat, HousedHeat):
            raise InvalidValueError("heat", "with a housing", "one thermal node: WindingHeat")
        check_range("environments", self.environments, 1, MOST_ENVIRONMENTS)


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """A limit of the audit in training."""

    limit: float  # value from which the constraint is broken in part
    full: float  # value from which it is broken in full
    aim: float  # mean part by which fast robots may break it [-]
    caps: tuple[float, float, float] = (0.6, 0.6, 0.6)
    """Greatest chance while a robot holds its speed, pushes and brakes [-]."""

    def __post_init__(self) -> None:
        if self.limit == self.full:
            raise InvalidValueError("full", self.full, "another number than limit")
        check_positive("aim", self.aim)
        for cap in self.caps:
            check_range("caps", cap, 1e-3, 1.0)


@dataclass(frozen=True, kw_only=True)
class ConstraintSettings:
    """What ends a share of the future: see ``environment.constraints``."""

    foot: Constraint = Constraint(limit=3.3, full=4.2, aim=0.015, caps=(0.1, 0.2, 0.6))
    """Force of a foot [body weights]; a pad's deflection counts as well, 15 mm as 4 body weights."""
    gear: Constraint = Constraint(limit=2.2, full=3.2, aim=0.0005)  # torque through a gear [peak torques]
    legs: Constraint = Constraint(limit=0.03, full=0.0, aim=0.0005)
    """Distance between the surfaces of two legs [m]."""
    joint_speed: Constraint = Constraint(limit=0.91, full=1.01, aim=0.0005)
    """Joint speed over the no-load speed [-]."""
    end_stop: Constraint = Constraint(limit=0.0, full=1.0, aim=0.0005)
    """Depth in an end stop over its zone [-]."""


@dataclass(frozen=True, kw_only=True)
class DisturbanceSettings:
    """What disturbs robots at each step: noise of their sensors, uniform and symmetric, and pushes."""

    angular_velocity: float = 0.15  # noise of the gyroscope [rad/s]
    projected_gravity: float = 0.02  # noise on the unit vector [-]
    joint_position: float = 0.01  # noise of the encoders [rad]
    joint_velocity: float = 0.8  # noise of the joint velocities [rad/s]
    push_interval: float = 6.0  # mean time between pushes [s]
    push_speed: float = 0.5  # greatest change of the base velocity by a push [m/s]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_range(name, value, 0.0, 1e3)
        check_positive("push_interval", self.push_interval, "s")


UNDISTURBED = DisturbanceSettings(
    angular_velocity=0.0, projected_gravity=0.0, joint_position=0.0, joint_velocity=0.0, push_speed=0.0
)


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """How episodes begin."""

    clone_share: float = 0.3
    """Share of the resets that copy a running environment, the faster of two drawn: high speed is reached
    rarely, so it must be practised when it is."""
    fast_start_share: float = 0.25
    """Share of the other resets that start at a forward speed in the commanded range."""

    def __post_init__(self) -> None:
        for name in ("clone_share", "fast_start_share"):
            check_range(name, getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """The two stages."""

    first_top: float = 6.0  # top of the range in stage I [m/s]
    second_top: float = 14.5  # top of the range in stage II [m/s]; the paper stops at 12 and reports 12.4
    steady_share: float = 0.4
    """Share of the run after which the fine-tuning phase begins: some robots act with less noise
    (``ppo.low_noise_fraction``), ACS may brake by its ``braking_window`` and, with ``ramps_when_steady``, all
    commands ramp. Not in the paper."""
    record_margin: float | None = 1.5
    """In the fine-tuning phase a target is at most what the robot itself has lately run and this much more
    [m/s]: robots differ by 2 m/s in what they can. None: no such limit."""

    def __post_init__(self) -> None:
        check_positive("first_top", self.first_top, "m/s")
        check_range("second_top", self.second_top, self.first_top, 40.0, "m/s")
        check_range("steady_share", self.steady_share, 0.0, 1.0)
        if self.record_margin is not None:
            check_positive("record_margin", self.record_margin, "m/s")

    def is_steady(self, share: float) -> bool:
        """Whether the fine-tuning phase has begun after this share of the run."""
        return share >= self.steady_share


def _check_widths(name: str, widths: tuple[int, ...]) -> None:
    """Layers that fit into a robot's computer. Raises ``InvalidValueError``."""
    check_range(f"layers of {name}", len(widths), 1, 20)
    for width in widths:
        check_range(name, width, 1, 4096)


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """PPO."""

    steps: int = 16  # environment steps per iteration; with 8 small batches do not start
    epochs: int = 4  # passes over the rollout
    mini_batches: int = 4  # mini-batches per pass
    learning_rate: float = 1e-3  # learning rate at the start; it is adapted to the divergence of the updates
    discount: float = 0.99  # discount of future rewards
    low_noise_fraction: float = 0.4
    """Fraction of the robots, spread evenly, that act with less noise in the fine-tuning phase. With noise
    everywhere, policies stood that fell over without it. Not in the paper."""
    symmetric: bool = True  # whether the mirrored observation gives exactly the mirrored action
    hidden: tuple[int, ...] = (512, 256, 128)  # widths of the layers of actor and critic
    precision: str = "float16"
    """``"tf32"`` or ``"float16"`` (faster on a GPU) for the matrix products in rollout and update; an
    exported policy computes in single precision. With bfloat16 a long training came apart at its end."""

    def __post_init__(self) -> None:
        check_choice("precision", self.precision, PRECISIONS)
        _check_widths("hidden", self.hidden)
        for name in ("steps", "epochs", "mini_batches"):
            check_range(name, getattr(self, name), 1, 10000)
        check_positive("learning_rate", self.learning_rate)
        check_range("discount", self.discount, 0.0, 1.0)
        check_range("low_noise_fraction", self.low_noise_fraction, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class EstimatorSettings:
    """The VAE estimator."""

    encoder: tuple[int, ...] = (256, 128)  # widths of the encoder's layers

    def __post_init__(self) -> None:
        _check_widths("encoder", self.encoder)


@dataclass(frozen=True, kw_only=True)
class ExamSettings:
    """When the policy is examined in the training (``training.exam``); the best exam's policy is exported."""

    interval: int = 600
    """Iterations between two exams; a shorter run has none, a longer one also ends with one."""

    def __post_init__(self) -> None:
        check_range("interval", self.interval, 1, 1_000_000)


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """One training run, whole: its hash names it."""

    method: str = "acs"  # name of the method, see methods
    robot: str = "bp2"  # name, folder or table of the robot
    actuator_model: MotorModel = "refined"  # motor model in training
    schedule: Schedule = ACS  # how commands evolve
    simulation: SimulationSettings = SimulationSettings()  # physics, and how many robots
    reward: dict[str, RewardTerm] = field(default_factory=default_rewards)
    """Terms of the reward by name: ``reward_tables``."""
    reward_sum: str = "exponential"  # "exponential": rewards * exp(penalties / 2), or "clipped": max(0, sum)
    randomization: dict[str, RandomizationTerm] = field(default_factory=default_randomization)
    """What differs from robot to robot, by name: ``environment.randomization``."""
    disturbances: DisturbanceSettings = DisturbanceSettings()  # noise of the sensors, and pushes
    episodes: EpisodeSettings = EpisodeSettings()  # how episodes begin
    constraints: ConstraintSettings | None = ConstraintSettings()
    """What the audit limits, as shares of the future that end; None: only rewards."""
    stages: StageSettings = StageSettings()  # how the range of speeds grows, and the phases of the run
    exam: ExamSettings | None = ExamSettings()
    """When the policy is examined; None: the last policy is exported."""
    ppo: PpoSettings = PpoSettings()  # policy and value learning
    estimator: EstimatorSettings = EstimatorSettings()  # the VAE estimator
    observation: ObservationLayout = field(default_factory=lambda: ObservationLayout(history_length=10))
    """What a policy sees; it travels in its contract."""
    seed: int = 0  # seed of every random generator

    def __post_init__(self) -> None:
        check_choice("actuator_model", self.actuator_model, MOTOR_MODELS)
        check_choice("reward_sum", self.reward_sum, REWARD_SUMS)
        check_range("seed", self.seed, 0, 2**32 - 1)
        tied = [name for name, term in self.reward.items() if term.tied]
        if tied and SPEED_HELD not in self.reward:
            allowed = f"false without the term {SPEED_HELD}"
            raise InvalidValueError(f"reward.{tied[0]}.tied", True, allowed)

    def as_dict(self) -> dict[str, Any]:
        """Nested plain values, for the hash and for loggers."""
        return to_plain(self)

    def nominal(self) -> TrainingSettings:
        """The same robot everywhere, no noise, no pushes."""
        return replace(self, randomization={}, disturbances=UNDISTURBED)

    def digest(self) -> str:
        """SHA-256 of all settings."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()


CPU_ENVIRONMENTS, CPU_HIDDEN = 2048, (128, 64)
"""Robots and widths of all networks with which a CPU learns quickest."""
CPU_EXAM_INTERVAL = 80
"""Iterations between two exams on a CPU, whose iterations are longer."""


def settings_for_cpu(settings: TrainingSettings) -> TrainingSettings:
    """Settings whose size is the default at one that a CPU trains, and in single precision."""
    defaults = TrainingSettings()
    simulation, ppo, estimator = settings.simulation, settings.ppo, settings.estimator
    if simulation.environments == defaults.simulation.environments:
        simulation = replace(simulation, environments=CPU_ENVIRONMENTS)
    if ppo.hidden == defaults.ppo.hidden:
        ppo = replace(ppo, hidden=CPU_HIDDEN)
    if estimator.encoder == defaults.estimator.encoder:
        estimator = replace(estimator, encoder=CPU_HIDDEN)
    ppo = replace(ppo, precision="tf32")
    exam = ExamSettings(interval=CPU_EXAM_INTERVAL) if settings.exam == defaults.exam else settings.exam
    return replace(settings, simulation=simulation, ppo=ppo, estimator=estimator, exam=exam)
