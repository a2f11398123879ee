"""Every choice of a training run: frozen, checked, with the default and its reason."""

from __future__ import annotations

import hashlib
import json
import math
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
from sprintlab.core.checks import check_choice, check_interval, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import HousedHeat, MotorModel, WindingHeat
from sprintlab.training.environment.randomization import default_randomization
from sprintlab.training.reward_tables import default_rewards
from sprintlab.training.settings_text import to_plain
from sprintlab.training.terms import SPEED_HELD, RandomizationTerm, RewardTerm

Schedule = (
    AdaptiveSchedule | UniformSchedule | FixedAccelerationSchedule | CurriculumSchedule | RampedSchedule
)
TARGETS = TargetSampling(
    persistence=(5.0, 12.0),
    top_share=0.38,
    zero_share=0.16,
    backward_share=0.08,
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
TRAINED_MODELS = ("refined", "simplified-dc", "square")
"""Motor models that the engine knows."""
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
    """Physics in training.

    Attributes:
        environments: Robots that are simulated side by side.
        heat: Thermal model of the windings; None, as in the paper: they stay cold.
        saturation: Whether the motors saturate; off, torque stays proportional to current.
        shortest_stride: A foot that touches down sooner after its last touchdown is hasty [s].
        shortest_stance: A foot that lifts off sooner after its touchdown is hasty [s].

    Raises:
        InvalidValueError: a value out of range.
    """

    environments: int = 32768
    heat: WindingHeat | None = None
    saturation: bool = True
    shortest_stride: float = 0.194
    shortest_stance: float = 0.036

    def __post_init__(self) -> None:
        if isinstance(self.heat, HousedHeat):
            raise InvalidValueError("heat", "with a housing", "one thermal node: WindingHeat")
        check_range("environments", self.environments, 1, MOST_ENVIRONMENTS)
        check_positive("shortest_stride", self.shortest_stride, "s")
        check_positive("shortest_stance", self.shortest_stance, "s")


Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """A limit of the audit in training.

    Attributes:
        limit: Value from which the constraint is broken in part.
        full: Value from which it is broken in full.
        aim: Mean part by which fast robots may break it [-].
        caps: Greatest chance while a robot holds its speed, pushes and brakes [-].

    Raises:
        InvalidValueError: limit equals full, the aim is not positive, or a cap lies outside [0.001, 1].
    """

    limit: float
    full: float
    aim: float
    caps: tuple[float, float, float] = (0.6, 0.6, 0.6)

    def __post_init__(self) -> None:
        if self.limit == self.full:
            raise InvalidValueError("full", self.full, "another number than limit")
        check_positive("aim", self.aim)
        for cap in self.caps:
            check_range("caps", cap, 1e-3, 1.0)


@dataclass(frozen=True, kw_only=True)
class ConstraintSettings:
    """What ends a share of the future: see ``environment.constraints``.

    Attributes:
        foot: Force of a foot [body weights]; a pad's deflection counts as well, 15 mm as 4 body weights.
        gear: Torque through a gear [peak torques].
        legs: Distance between the surfaces of two legs [m].
        joint_speed: Joint speed over the no-load speed [-].
        end_stop: Depth in an end stop over its zone [-].
    """

    foot: Constraint = Constraint(limit=3.3, full=4.0, aim=0.015, caps=(0.1, 0.2, 0.2))
    gear: Constraint = Constraint(limit=2.2, full=3.2, aim=0.0005)
    legs: Constraint = Constraint(limit=0.03, full=0.0, aim=0.0005)
    joint_speed: Constraint = Constraint(limit=0.93, full=1.03, aim=0.0005)
    end_stop: Constraint = Constraint(limit=0.0, full=1.0, aim=0.0005)


@dataclass(frozen=True, kw_only=True)
class DisturbanceSettings:
    """What disturbs robots at each step: noise of their sensors, uniform and symmetric, and pushes.

    Attributes:
        angular_velocity: Noise of the gyroscope [rad/s].
        projected_gravity: Noise on the unit vector [-].
        joint_position: Noise of the encoders [rad].
        joint_velocity: Noise of the joint velocities [rad/s].
        push_interval: Mean time between pushes [s].
        push_speed: Greatest change of the base velocity by a push [m/s].

    Raises:
        InvalidValueError: a number out of range.
    """

    angular_velocity: float = 0.15
    projected_gravity: float = 0.02
    joint_position: float = 0.01
    joint_velocity: float = 0.8
    push_interval: float = 6.0
    push_speed: float = 0.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_range(name, value, 0.0, 1e3)
        check_positive("push_interval", self.push_interval, "s")


UNDISTURBED = DisturbanceSettings(
    angular_velocity=0.0, projected_gravity=0.0, joint_position=0.0, joint_velocity=0.0, push_speed=0.0
)


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """How episodes begin and end.

    Attributes:
        duration: Least and greatest length [s], drawn per environment, so that ends do not synchronise.
        clone_share: Share of the resets that copy a running environment, the faster of two drawn: high speed
            is reached rarely, so it must be practised when it is.
        fast_start_share: Share of the other resets that start at a forward speed in the commanded range.
        leg_distance_limit: The episode ends when the surfaces of two legs come closer [m].
        knee_clearance: The episode ends when a knee comes closer to the ground [m].

    Raises:
        InvalidValueError: a share outside [0, 1] or a limit that is not positive.
    """

    duration: Interval = (14.0, 24.0)
    clone_share: float = 0.3
    fast_start_share: float = 0.25
    leg_distance_limit: float = 0.0
    knee_clearance: float = 0.05

    def __post_init__(self) -> None:
        check_interval("duration", self.duration, 0.1, unit="s")
        for name in ("clone_share", "fast_start_share"):
            check_range(name, getattr(self, name), 0.0, 1.0)
        check_positive("knee_clearance", self.knee_clearance, "m")


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """The two stages.

    Attributes:
        first_top: Top of the range in stage I [m/s].
        second_top: Top of the range in stage II [m/s]; the paper stops at 12 and reports 12.4.
        growth: Growth of the range per iteration [m/s].
        growth_margin: The range grows while the fastest 0.1 % are within this of its top [m/s].
        earliest_iteration: Stage II starts no sooner.
        ramp_iterations: Iterations over which the weights blend from stage I to stage II.
        gated_top: Beyond this speed the range opens only while feet and gears hold [m/s].
        steady_share: Share of the run after which the fine-tuning phase begins: some robots act with less
            noise (``ppo.low_noise_fraction``), ACS may brake by its ``braking_window`` and, with
            ``ramps_when_steady``, all commands ramp. Not in the paper.
        record_margin: In the fine-tuning phase a target is at most what the robot itself has lately run and
            this much more [m/s]: robots differ by 2 m/s in what they can. None: no such limit.

    Raises:
        InvalidValueError: tops in the wrong order or not positive, or a share out of range.
    """

    first_top: float = 6.0
    second_top: float = 14.5
    growth: float = 0.1
    growth_margin: float = 1.0
    earliest_iteration: int = 250
    ramp_iterations: int = 250
    gated_top: float = 12.0
    steady_share: float = 0.4
    record_margin: float | None = 1.5

    def __post_init__(self) -> None:
        check_positive("first_top", self.first_top, "m/s")
        check_range("second_top", self.second_top, self.first_top, 40.0, "m/s")
        check_positive("growth", self.growth, "m/s")
        check_positive("gated_top", self.gated_top, "m/s")
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
    """PPO.

    Attributes:
        steps: Environment steps per iteration; with 8 small batches do not start.
        epochs: Passes over the rollout.
        mini_batches: Mini-batches per pass.
        learning_rate: Learning rate at the start; it is adapted to ``desired_kl``.
        desired_kl: Kullback-Leibler divergence that an update aims at.
        final_kl: The divergence sinks to this over ``std_anneal``, together with the noise.
        discount: Discount of future rewards.
        gae: Lambda of the generalized advantage estimate.
        clip: Clip range of the likelihood ratio.
        entropy: Weight of the entropy bonus.
        initial_std: Standard deviation of the action noise at the start.
        least_std: Floor of the action noise; without it the noise collapses to 0.1 and the gait freezes.
        most_std: Ceiling of the action noise at the beginning of ``std_anneal``.
        std_anneal: Shares of the run between which floor and ceiling sink to ``final_std``: a policy runs
            without noise, so that should be practised and estimated. None: they stay.
        final_std: Standard deviation of the action noise at the end.
        low_noise_fraction: Fraction of the robots, spread evenly, that act with less noise in the fine-tuning
            phase. With noise everywhere, policies stood that fell over without it. Not in the paper.
        low_noise_scale: Factor of the action noise of those robots.
        averaging_iterations: The exported policy is the mean of the weights over about so many iterations.
        symmetric: Whether the mirrored observation gives exactly the mirrored action.
        hidden: Widths of the layers of actor and critic.
        precision: ``"tf32"`` or ``"float16"`` (faster on a GPU) for the matrix products in rollout and
            update; an exported policy computes in single precision. With bfloat16 a long training came apart
            at its end.

    Raises:
        InvalidValueError: a count below one, a number out of range, or an unknown precision.
    """

    steps: int = 16
    epochs: int = 4
    mini_batches: int = 4
    learning_rate: float = 1e-3
    desired_kl: float = 0.01
    final_kl: float = 0.002
    discount: float = 0.99
    gae: float = 0.95
    clip: float = 0.2
    entropy: float = 0.005
    initial_std: float = 0.8
    least_std: float = 0.25
    most_std: float = 0.42
    std_anneal: tuple[float, float] | None = (0.5, 0.92)
    final_std: float = 0.12
    low_noise_fraction: float = 0.4
    low_noise_scale: float = 0.25
    averaging_iterations: int = 250
    symmetric: bool = True
    hidden: tuple[int, ...] = (512, 256, 128)
    precision: str = "float16"

    def __post_init__(self) -> None:
        check_choice("precision", self.precision, PRECISIONS)
        _check_widths("hidden", self.hidden)
        for name in ("steps", "epochs", "mini_batches", "averaging_iterations"):
            check_range(name, getattr(self, name), 1, 10000)
        for name in ("learning_rate", "desired_kl", "final_kl", "clip", "initial_std", "least_std"):
            check_positive(name, getattr(self, name))
        check_range("discount", self.discount, 0.0, 1.0)
        check_range("gae", self.gae, 0.0, 1.0)
        check_range("least_std", self.least_std, 1e-6, self.initial_std)
        check_range("low_noise_fraction", self.low_noise_fraction, 0.0, 1.0)
        check_range("low_noise_scale", self.low_noise_scale, 1e-3, 1.0)
        check_range("final_std", self.final_std, 1e-6, self.least_std)
        check_range("most_std", self.most_std, self.least_std, 1e3)
        if self.std_anneal is not None:
            check_interval("std_anneal", self.std_anneal, 0.0, 1.0)

    def annealed(self, share: float) -> float:
        """How far this share of the run lies between the ends of ``std_anneal``: 0 before them, 1 after."""
        if self.std_anneal is None:
            return 0.0
        first, last = self.std_anneal
        return min(max((share - first) / max(last - first, 1e-9), 0.0), 1.0)

    def std_floor(self, share: float) -> float:
        """Least deviation of the action noise after this share of the run."""
        return self.least_std + self.annealed(share) * (self.final_std - self.least_std)

    def std_ceiling(self, share: float) -> float:
        """Greatest deviation of the action noise after this share of the run."""
        annealed = self.annealed(share)
        return math.inf if annealed == 0.0 else self.most_std + annealed * (self.final_std - self.most_std)

    def divergence_aim(self, share: float) -> float:
        """Divergence that an update aims at after this share of the run."""
        return self.desired_kl * (self.final_kl / self.desired_kl) ** self.annealed(share)


@dataclass(frozen=True, kw_only=True)
class EstimatorSettings:
    """The VAE estimator; what the paper leaves open follows DreamWaQ's open implementations.

    Attributes:
        latent: Size of ``z`` (the paper's 16).
        encoder: Widths of the encoder's layers.
        decoder: Widths of the decoder's layers.
        learning_rate: Learning rate of its own optimizer, which is not adapted.
        final_learning_rate: The rate sinks to this over ``ppo.std_anneal``: the exported estimate shall not
            depend on its last few steps.
        epochs: Passes over the rollout; one is enough.
        sees_command: Whether the encoder reads the command. Under ACS the command follows the speed: an
            estimator that sees it reads the speed off it, and errs by metres a second under other commands.

    Raises:
        InvalidValueError: a size below one or a number that is not positive.
    """

    latent: int = 16
    encoder: tuple[int, ...] = (256, 128)
    decoder: tuple[int, ...] = (64, 128)
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-4
    epochs: int = 1
    sees_command: bool = False

    def __post_init__(self) -> None:
        for name in ("latent", "epochs"):
            check_range(name, getattr(self, name), 1, 1000)
        for name in ("learning_rate", "final_learning_rate"):
            check_positive(name, getattr(self, name))
        for name in ("encoder", "decoder"):
            _check_widths(name, getattr(self, name))

    def rate(self, annealed: float) -> float:
        """The learning rate, along a straight line of its logarithm; ``annealed`` from 0 to 1."""
        return self.learning_rate * (self.final_learning_rate / self.learning_rate) ** annealed


@dataclass(frozen=True, kw_only=True)
class ExamSettings:
    """When the policy is examined in the training: see ``training.exam``. The best exam's policy is exported.

    Attributes:
        interval: Iterations between two exams; a shorter run has none, a longer one also ends with one.
        hopeless: The run ends in its second half when no exam has held this speed within the audit's limits
            [m/s]; None: it goes on.

    Raises:
        InvalidValueError: a number that is not positive.
    """

    interval: int = 600
    hopeless: float | None = None

    def __post_init__(self) -> None:
        check_range("interval", self.interval, 1, 1_000_000)
        if self.hopeless is not None:
            check_positive("hopeless", self.hopeless, "m/s")


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """One training run, whole: its hash names it.

    Attributes:
        method: Name of the method, see ``methods``.
        robot: Name, folder or table of the robot.
        actuator_model: Motor model in training.
        schedule: How commands evolve.
        simulation: Physics, and how many robots.
        reward: Terms of the reward by name: ``reward_tables``.
        reward_sum: ``"exponential"``: rewards * exp(penalties / 2), or ``"clipped"``: max(0, sum).
        randomization: What differs from robot to robot, by name: ``environment.randomization``.
        disturbances: Noise of the sensors, and pushes.
        episodes: How episodes begin and end.
        constraints: What the audit limits, as shares of the future that end; None: only rewards.
        stages: How the range of speeds grows, and the phases of the run.
        exam: When the policy is examined; None: the last policy is exported.
        ppo: Policy and value learning.
        estimator: The VAE estimator.
        observation: What a policy sees; it travels in its contract.
        seed: Seed of every random generator.

    Raises:
        InvalidValueError: a value that is not allowed.
    """

    method: str = "acs"
    robot: str = "bp2"
    actuator_model: MotorModel = "refined"
    schedule: Schedule = ACS
    simulation: SimulationSettings = SimulationSettings()
    reward: dict[str, RewardTerm] = field(default_factory=default_rewards)
    reward_sum: str = "exponential"
    randomization: dict[str, RandomizationTerm] = field(default_factory=default_randomization)
    disturbances: DisturbanceSettings = DisturbanceSettings()
    episodes: EpisodeSettings = EpisodeSettings()
    constraints: ConstraintSettings | None = ConstraintSettings()
    stages: StageSettings = StageSettings()
    exam: ExamSettings | None = ExamSettings()
    ppo: PpoSettings = PpoSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    observation: ObservationLayout = field(default_factory=lambda: ObservationLayout(history_length=10))
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("actuator_model", self.actuator_model, TRAINED_MODELS)
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
