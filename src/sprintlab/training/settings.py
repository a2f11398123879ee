"""Every choice of a training run: frozen, checked, with the default and its reason."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from typing import Any, get_type_hints

from sprintlab.commands import (
    AdaptiveSchedule,
    CurriculumSchedule,
    FixedAccelerationSchedule,
    RampedSchedule,
    TargetSampling,
    UniformSchedule,
)
from sprintlab.control import ObservationLayout
from sprintlab.core.arguments import check_kind
from sprintlab.core.checks import check_choice, check_interval, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, Battery, HousedHeat, MotorModel, WindingHeat
from sprintlab.robots import DRAG_AREA_BAND, RESTITUTION_BAND, STIFFNESS_BAND

Schedule = (
    AdaptiveSchedule | UniformSchedule | FixedAccelerationSchedule | CurriculumSchedule | RampedSchedule
)
TARGETS = TargetSampling(top_share=0.4, zero_share=0.12, backward_share=0.08, turn_share=0.6)
"""What robots are asked for: all that a runner does, and turns that leave friction to run with."""
ACS = AdaptiveSchedule(targets=TARGETS, ramp_share=0.25, keeps_rest=True)
"""ACS as the methods of this package train with it; the preset ``paper`` has it as printed."""
MOST_ENVIRONMENTS = 1 << 17
"""Robots side by side: sixteen times the default; a stranger's file may ask for all memory there is."""
LARGEST_ROLLOUT = 1 << 23
"""Policy steps of all robots in one iteration, which are kept until its end."""
_LARGEST = 1e30
"""Of any number: far beyond all that means something, and below the 3e38 of 32 bits."""
PRECISIONS = ("tf32", "bfloat16")
AGGREGATIONS = ("exponential", "clipped", "sum")
REMOVED = {"PpoSettings": {"mirror_epochs": False}}
"""Settings that are gone, by class, with the value at which they did nothing: older files may still name that
one, and it counts in the hash, so that runs keep theirs."""
NORMALIZER_FLOOR = 1e-2
"""Added to the deviation by which the networks' inputs are divided; a policy file holds their sum."""
ADDED_REWARDS = ("sideways_drift",)
"""Reward terms that came later: without weight they do not count in the hash, so that runs keep theirs."""


def without_removed(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a file without those ``REMOVED`` ones that did nothing."""
    gone = REMOVED.get(kind.__name__, {})
    return {name: value for name, value in values.items() if name not in gone or value != gone[name]}


@dataclass(frozen=True, kw_only=True)
class SimulationSettings:
    """Physics in training.

    Attributes:
        environments: simulated side by side.
        timestep: physics step [s]; the knee spring rings at 36 Hz and wants 2.5 ms or less. These defaults
            are the cheapest whose running agrees with finer physics: docs/evaluation.md.
        substeps: physics steps in one policy step; ``timestep * substeps`` is 0.02 s.
        solver_iterations: Newton iterations a step.
        line_search_iterations: of the solver's line search.
        max_constraints: rows allocated an environment: four feet, three rows each; the solver works in
            blocks of 16, full or not.
        max_contacts: contacts allocated an environment.
        knee_spring: whether the passive knee springs are there.
        battery: behind the bus that a robot's joints share; ``None``, as in the paper: the bus is stiff.
        heat: of the windings; ``None``, as in the paper: they stay cold.
        actuator_network: file of networks that give the joints' torques instead of the motor model, made by
            ``python -m studies.paper network``; ``None``: the motor model does.
        saturation: whether the motors saturate, as the robot's do; off, torque stays proportional to current.
        state_of_charge: of a battery at an episode's start, drawn once an environment [-].
        winding_temperature: with heat, at an episode's start, drawn once an environment and joint [degC].

    Raises:
        InvalidValueError: a value out of range, a policy rate other than 50 Hz, or an actuator network beside
            a battery or heat, which it does not know.
    """

    environments: int = 8192
    timestep: float = 0.0025
    substeps: int = 8
    solver_iterations: int = 3
    line_search_iterations: int = 12
    max_constraints: int = 16
    max_contacts: int = 4
    knee_spring: bool = True
    battery: Battery | None = None
    heat: WindingHeat | None = None
    actuator_network: str | None = None
    saturation: bool = True
    state_of_charge: tuple[float, float] = (0.3, 1.0)
    winding_temperature: tuple[float, float] = (25.0, 90.0)

    def __post_init__(self) -> None:
        check_interval("state_of_charge", self.state_of_charge, 0.0, 1.0)
        check_interval("winding_temperature", self.winding_temperature, -60.0, 200.0, "degC")
        if isinstance(self.heat, HousedHeat):
            raise InvalidValueError("heat", "with a housing", "one thermal node: WindingHeat")
        if self.actuator_network is not None and (self.battery or self.heat):
            raise InvalidValueError("actuator_network", self.actuator_network, "without battery and heat")
        check_range("environments", self.environments, 1, MOST_ENVIRONMENTS)
        for name in ("substeps", "solver_iterations", "line_search_iterations"):
            check_range(name, getattr(self, name), 1, 10**7)
        check_range("timestep * substeps", self.timestep * self.substeps, 0.02 - 1e-9, 0.02 + 1e-9, "s")
        check_range("max_constraints", self.max_constraints, 16, 1000)
        check_range("max_contacts", self.max_contacts, 4, 1000)


@dataclass(frozen=True, kw_only=True)
class RewardWeight:
    """Weight of one reward term in stage I and in stage II; zero where the paper writes N/A."""

    first: float
    second: float


def _constant(weight: float) -> RewardWeight:
    return RewardWeight(first=weight, second=weight)


REWARDED = ("linear_tracking", "angular_tracking", "progress", "fine_speed_tracking", "fine_yaw_tracking")
"""Weights of what is rewarded; all other plain numbers of ``RewardSettings`` are thresholds and scales."""


@dataclass(frozen=True, kw_only=True)
class RewardSettings:
    """The paper's reward table (Part A: constant weights; Part B: by stage), and how the terms are added.

    Attributes:
        linear_tracking: of ``exp(-|v_xy - command|^2)``.
        angular_tracking: of ``exp(-angular_sharpness (yaw rate - command)^2)``.
        angular_sharpness: one in the paper.
        progress: of the speed in the commanded direction over 10 m/s, up to the commanded speed and to the
            target; not in the paper. Under ACS the command follows the robot, so that tracking alone pays no
            more at 12 m/s than at 8.
        fine_speed_tracking, fine_yaw_tracking: of ``exp(-|error| / width)`` with narrow widths and the mean
            speed and yaw rate of about a stride; not in the paper, whose kernels are flat below 0.3.
        vertical_velocity: and so on: penalties, named like the functions of ``rewards``.
        leg_distance: pairs of legs closer than ``leg_distance_limit``; not in the paper. Without it legs
            pass through each other, which the simulator's feet-only contacts would allow.
        grounded: mean foot contact times forward speed [m/s]; not in the paper: draws the policy from a
            grounded run, a local optimum, into one with flight phases.
        touchdown: squared downward speed of feet that are about to touch; not in the paper: feet that are
            rammed into the ground sink deeper than a real surface allows.
        over_speed: squared share by which a joint exceeds its motor's no-load speed, where the drive can only
            brake; not in the paper.
        electrical_power: drawn from the bus, over the weight times (speed + 2 m/s): about the cost of
            transport. Not in the paper, whose mechanical power misses the copper loss.
        gear_torque: squared excess of the torque through a gear, rotor inertia included, over
            ``gear_torque_limit``; foot_force: the same of a foot's force over ``foot_force_limit``. Not in
            the paper: shocks are free in a simulation.
        hasty_touchdowns, short_stances: touchdowns sooner than ``shortest_stride`` after the last and
            stances shorter than ``shortest_stance``; not in the paper: else a gait becomes a tap.
        restlessness: feet in the air and speed while the robot is asked to stand; not in the paper.
        collision: knees near the ground. The paper drops it in stage II; kept, since it prevents crawling.
        action_rate, smoothness, joint_acceleration: the paper's weights in stage I. In stage II the paper has
            -0.01, -0.005 and -1e-7; these grow with the swing speed and held the speed near 9.4 m/s.
        diagonal_contact: steps in which one diagonal pair of feet stands and the other swings; a reward, with
            a positive weight. This and the next two are Hound's, not the paper's, and off by default.
        tilt_rate: sum of the roll and pitch rates' magnitudes.
        torque: squared joint torques.
        load_balance: variance over the joints of the share of its peak torque that each gives; likewise off.
        sideways_drift: magnitude of the speed to the side, averaged over about a stride, while no turn is
            commanded; off by default. A robot whose heading is held still leaves its lane where it moves a
            few degrees to the side of it.
        bare_squares: yaw rate, tilt and foot clearance as the paper prints them: the squared yaw rate, which
            fights every commanded turn, the squared tilt, which fights the lean into it, and the squared
            height error, which punishes feet for standing. By default the first is the error of the yaw rate,
            the second leaves out the lean, and the third is weighted by the foot's speed.
        aggregation: ``"exponential"`` tracking * exp(penalties / 2), ``"clipped"`` max(0, sum), ``"sum"``.
            The exponential keeps a gradient where penalties are large and never rewards an early end.
        penalty_scale: factor of the penalties inside the exponential.
        leg_distance_limit: below it a pair counts [m].
        foot_clearance_target: height of a foot's middle in swing [m]; the default is radius + 8 cm.
        touchdown_height: a foot's middle lower than this is about to touch [m]: radius + 2 cm.
        fine_speed: width of the fine speed kernel [m/s].
        fine_yaw_rate: width of the fine yaw-rate kernel [rad/s].
        gear_torque_limit: torque through a gear, mean over a physics step, that costs nothing [peak torques].
        foot_force_limit: force on a foot, mean over two physics steps, that costs nothing [body weights].
        shortest_stride: period that costs nothing [s].
        shortest_stance: duration that costs nothing [s].

    Raises:
        InvalidValueError: unknown ``aggregation`` or a scale that is not positive.
    """

    linear_tracking: float = 1.0
    angular_tracking: float = 0.5
    angular_sharpness: float = 1.0
    progress: float = 1.5
    fine_speed_tracking: float = 1.0
    fine_yaw_tracking: float = 3.0
    vertical_velocity: RewardWeight = _constant(-2.0)
    joint_power: RewardWeight = _constant(-1e-6)
    action_rate: RewardWeight = RewardWeight(first=-0.01, second=-0.005)
    smoothness: RewardWeight = RewardWeight(first=-0.005, second=-0.0025)
    joint_limit: RewardWeight = _constant(-10.0)
    roll_pitch_rate: RewardWeight = RewardWeight(first=-0.02, second=-0.3)
    orientation: RewardWeight = RewardWeight(first=-5.0, second=-100.0)
    base_height: RewardWeight = RewardWeight(first=-10.0, second=-20.0)
    joint_acceleration: RewardWeight = RewardWeight(first=-2.5e-7, second=-3e-8)
    abduction: RewardWeight = RewardWeight(first=-1.0, second=0.0)
    collision: RewardWeight = RewardWeight(first=-1.0, second=-1.0)
    foot_slip: RewardWeight = RewardWeight(first=0.0, second=-0.01)
    yaw_rate: RewardWeight = RewardWeight(first=0.0, second=-0.5)
    foot_clearance: RewardWeight = RewardWeight(first=-0.2, second=0.0)
    abduction_mirror: RewardWeight = RewardWeight(first=0.0, second=-0.5)
    grounded: RewardWeight = RewardWeight(first=-0.03, second=0.0)
    touchdown: RewardWeight = RewardWeight(first=0.0, second=-0.03)
    over_speed: RewardWeight = _constant(-10.0)
    leg_distance: RewardWeight = _constant(-2.0)
    electrical_power: RewardWeight = RewardWeight(first=-0.2, second=-0.5)
    gear_torque: RewardWeight = RewardWeight(first=-0.05, second=-0.2)
    foot_force: RewardWeight = RewardWeight(first=-0.5, second=-4.0)
    hasty_touchdowns: RewardWeight = RewardWeight(first=-2.0, second=-10.0)
    short_stances: RewardWeight = RewardWeight(first=-1.0, second=-6.0)
    restlessness: RewardWeight = RewardWeight(first=-0.5, second=-1.0)
    diagonal_contact: RewardWeight = _constant(0.0)
    tilt_rate: RewardWeight = _constant(0.0)
    torque: RewardWeight = _constant(0.0)
    load_balance: RewardWeight = _constant(0.0)
    sideways_drift: RewardWeight = _constant(0.0)
    bare_squares: bool = False
    aggregation: str = "exponential"
    penalty_scale: float = 0.5
    leg_distance_limit: float = 0.10
    foot_clearance_target: float = 0.11
    touchdown_height: float = 0.05
    fine_speed: float = 0.5
    fine_yaw_rate: float = 0.1
    gear_torque_limit: float = 1.5
    foot_force_limit: float = 2.8
    shortest_stride: float = 0.195
    shortest_stance: float = 0.036

    def __post_init__(self) -> None:
        check_choice("aggregation", self.aggregation, AGGREGATIONS)
        for name, value in vars(self).items():
            if isinstance(value, float) and name not in REWARDED:
                check_positive(name, value)

    def penalties(self) -> dict[str, RewardWeight]:
        """Name of each penalty and its weights, in the order in which the environment stacks them."""
        return {name: value for name, value in vars(self).items() if isinstance(value, RewardWeight)}


Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class RandomizationSettings:
    """What differs from environment to environment, drawn once, and the noise drawn at each step.

    Attributes:
        friction: foot friction coefficient.
        foot_stiffness: of the pads [N/m], drawn with a uniform logarithm.
        foot_restitution: of the pads in a drop of the leg's effective mass [-].
        drag_area: drag coefficient times frontal area of the robot in still air [m^2].
        slope: greatest rise over run of the ground along x, up and down; gravity turns, the ground stays.
        payload: mass added to the trunk [kg].
        center_of_mass: shift of the trunk's centre of mass along each axis [m], symmetric.
        gain: relative change of stiffness and damping, symmetric.
        strength: relative change of the torque that the motor delivers, symmetric.
        bus_voltage: relative change of the bus.
        resistance: relative change of the stator resistance (a warm winding has more).
        dry_friction: factor of the joints' dry friction.
        delay: time from the policy's reading to the joints' new targets [s], in whole physics steps.
        delay_jitter: by which that time changes from one policy step to the next, either way [s]: gaits must
            not live on the policy's clock.
        clock: factor of the policy's period, drawn once an environment: gaits that count policy steps do not
            fit all of them.
        angular_velocity_noise: uniform, symmetric [rad/s].
        gravity_noise: on the unit vector.
        joint_position_noise: [rad].
        joint_offset: by which an encoder's zero is off, either way, drawn once a joint [rad].
        joint_velocity_noise: [rad/s].
        push_interval: mean time between pushes [s].
        push_speed: greatest change of the base velocity by a push [m/s].

    Raises:
        InvalidValueError: an interval out of order or an amplitude out of range.
    """

    friction: Interval = (0.5, 1.2)
    foot_stiffness: Interval = STIFFNESS_BAND
    foot_restitution: Interval = RESTITUTION_BAND
    drag_area: Interval = DRAG_AREA_BAND
    slope: float = 0.05
    payload: Interval = (-1.0, 4.0)
    center_of_mass: float = 0.03
    gain: float = 0.08
    strength: float = 0.05
    bus_voltage: Interval = (0.9, 1.0)
    resistance: Interval = (1.0, 1.25)
    dry_friction: Interval = (0.7, 1.3)
    delay: Interval = (0.0, 0.01)
    delay_jitter: float = 0.0025
    clock: Interval = (0.9, 1.1)
    angular_velocity_noise: float = 0.15
    gravity_noise: float = 0.02
    joint_position_noise: float = 0.01
    joint_offset: float = 0.02
    joint_velocity_noise: float = 0.8
    push_interval: float = 6.0
    push_speed: float = 0.5

    def __post_init__(self) -> None:
        factors = ("friction", "bus_voltage", "resistance", "dry_friction", "clock")
        for name in (*factors, "foot_stiffness", "foot_restitution"):
            check_interval(name, getattr(self, name), 0.05)
        check_interval("drag_area", self.drag_area, 0.0, unit="m^2")
        check_range("slope", self.slope, 0.0, 0.3)
        check_interval("payload", self.payload, -15.0, unit="kg")
        for name in ("gain", "strength", "center_of_mass"):
            check_range(name, getattr(self, name), 0.0, 0.5)
        check_positive("push_interval", self.push_interval, "s")
        check_interval("delay", self.delay, 0.0, 0.02, "s")
        check_range("delay_jitter", self.delay_jitter, 0.0, 0.02, "s")

    def without(self) -> RandomizationSettings:
        """The same robot everywhere, no noise, no pushes: for tests and benchmarks."""
        return replace(
            self, friction=(0.9, 0.9), foot_stiffness=(80e3, 80e3), foot_restitution=(0.4, 0.4),
            drag_area=(0.15, 0.15), slope=0.0, payload=(0.0, 0.0), center_of_mass=0.0, gain=0.0, strength=0.0,
            bus_voltage=(1.0, 1.0), resistance=(1.0, 1.0), dry_friction=(1.0, 1.0), delay=(0.0, 0.0),
            delay_jitter=0.0, clock=(1.0, 1.0), joint_offset=0.0, angular_velocity_noise=0.0,
            gravity_noise=0.0, joint_position_noise=0.0, joint_velocity_noise=0.0, push_speed=0.0,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """How episodes begin and end.

    Attributes:
        duration: least and greatest length [s]; drawn an environment, so that ends do not synchronise.
        clone_share: share of the resets that copy the state of a running environment, of two drawn the
            faster: high speed is reached rarely, so it must be practised when it is.
        fast_start_share: share of the other resets that start at a forward speed in the commanded range.
        tilt_limit: end beyond this angle between trunk and gravity [deg].
        leg_distance_limit: end when two legs' axes come closer [m].
        knee_clearance: end when a knee comes closer to the ground [m].

    Raises:
        InvalidValueError: a share outside [0, 1] or a limit that is not positive.
    """

    duration: Interval = (10.0, 20.0)
    clone_share: float = 0.3
    fast_start_share: float = 0.25
    tilt_limit: float = 50.0
    leg_distance_limit: float = 0.03
    knee_clearance: float = 0.05

    def __post_init__(self) -> None:
        check_interval("duration", self.duration, 0.1, unit="s")
        for name in ("clone_share", "fast_start_share"):
            check_range(name, getattr(self, name), 0.0, 1.0)
        for name in ("tilt_limit", "leg_distance_limit", "knee_clearance"):
            check_positive(name, getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """The two stages.

    Attributes:
        first_top: top of the range in stage I [m/s].
        second_top: top of the range in stage II [m/s]; the paper stops at 12 and reports 12.4.
        growth: range growth an iteration [m/s].
        growth_margin: grow while the fastest 0.1 % are within this of the top [m/s].
        growth_share: and while they are within this share of the top. With 0.2 the range runs ahead of them
            by a quarter of their speed, and most robots are asked for all they can, not for what is easy.
        earliest_iteration: stage II starts no sooner.
        ramp_iterations: over which the weights blend.
        steady_iteration: from here on robots practise what an evaluation asks of them and the stages before
            do not: ``ppo.quiet_share`` of them act with less noise, and ACS may brake by its
            ``braking_window``. Not in the paper. None: from the start.

    Raises:
        InvalidValueError: tops in the wrong order or not positive, or a share outside [0, 0.9].
    """

    first_top: float = 6.0
    second_top: float = 14.0
    growth: float = 0.1
    growth_margin: float = 0.75
    growth_share: float = 0.0
    earliest_iteration: int = 200
    ramp_iterations: int = 150
    steady_iteration: int | None = 850

    def __post_init__(self) -> None:
        check_positive("first_top", self.first_top, "m/s")
        check_range("second_top", self.second_top, self.first_top, 40.0, "m/s")
        check_positive("growth", self.growth, "m/s")
        check_range("growth_share", self.growth_share, 0.0, 0.9)
        if self.steady_iteration is not None:
            check_range("steady_iteration", self.steady_iteration, 0, 10**9)

    def is_steady(self, iteration: int) -> bool:
        """Whether robots act quietly and brake in an iteration of the run."""
        return self.steady_iteration is None or iteration >= self.steady_iteration


@dataclass(frozen=True, kw_only=True)
class StridePrior:
    """A reward for running like computed strides, which fades: a start for the search, not its end.

    Attributes:
        file: of strides, made by ``python -m studies.paper stride``.
        weight: of ``exp(-d^2)``, d the distance of a leg's state from the nearest point of the stride.
        fade: iterations between which the weight sinks to zero.
        position_scale: distance of a joint angle that counts as one [rad].
        velocity_scale: the same of a joint velocity [rad/s].

    Raises:
        InvalidValueError: a number that is not positive, or an unordered interval.
    """

    file: str = "studies/paper/strides.npz"
    weight: float = 0.5
    fade: tuple[int, int] = (800, 1600)
    position_scale: float = 0.4
    velocity_scale: float = 10.0

    def __post_init__(self) -> None:
        for name in ("weight", "position_scale", "velocity_scale"):
            check_positive(name, getattr(self, name))
        check_range("fade[0]", self.fade[0], 0, self.fade[1] - 1)

    def weight_at(self, iteration: int) -> float:
        """The weight in an iteration of the run."""
        first, last = self.fade
        return self.weight * min(max((last - iteration) / (last - first), 0.0), 1.0)


def _check_widths(name: str, widths: tuple[int, ...]) -> None:
    """Layers that fit into a robot's computer. Raises ``InvalidValueError``."""
    check_range(f"layers of {name}", len(widths), 1, 20)
    for width in widths:
        check_range(name, width, 1, 4096)


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """PPO.

    Attributes:
        steps: environment steps an iteration; fewer mean more updates in the same time, and updates count.
        epochs: passes over the rollout.
        mini_batches: a pass.
        learning_rate: at the start; adapted to ``desired_kl``.
        desired_kl: Kullback-Leibler divergence of an update aimed at.
        discount: of future rewards.
        gae: lambda of the generalized advantage estimate.
        clip: of the likelihood ratio.
        entropy: weight of the entropy bonus.
        value_weight: of the value loss.
        initial_std: of the action noise.
        least_std: floor of the action noise; without it the noise collapses to 0.1 and the gait freezes.
        calm_iterations: between these two iterations the floor sinks from ``least_std`` to ``calm_std``: a
            policy runs without noise, and what it is to run like should be practised and estimated. None: it
            stays.
        calm_std: floor at the end [-].
        most_std: ceiling in the first of those iterations, which sinks to ``calm_std`` with the floor; the
            entropy bonus may keep the noise twice as high as its floor. None: there is no ceiling.
        quiet_share: of the robots, spread evenly: from ``stages.steady_iteration`` on they act with
            ``quiet_noise`` of the others' action noise.
            A policy runs without noise, and what it does then must have been practised: with noise
            everywhere, policies stood that fell over without it. Not in the paper.
        quiet_noise: share of the action noise that those robots have.
        hidden: widths of actor and critic.
        precision: of the matrix products of policy and critic, in rollout and update: ``"tf32"`` or
            ``"bfloat16"`` (faster; an exported policy always computes in single precision).

    Raises:
        InvalidValueError: a count below one, a number out of range, or an unknown precision.
    """

    steps: int = 8
    epochs: int = 5
    mini_batches: int = 4
    learning_rate: float = 1e-3
    desired_kl: float = 0.01
    discount: float = 0.99
    gae: float = 0.95
    clip: float = 0.2
    entropy: float = 0.005
    value_weight: float = 1.0
    initial_std: float = 0.8
    least_std: float = 0.3
    calm_iterations: tuple[int, int] | None = (850, 1500)
    calm_std: float = 0.13
    most_std: float | None = 0.45
    quiet_share: float = 0.4
    quiet_noise: float = 0.25
    hidden: tuple[int, ...] = (512, 256, 128)
    precision: str = "tf32"

    def __post_init__(self) -> None:
        check_choice("precision", self.precision, PRECISIONS)
        _check_widths("hidden", self.hidden)
        for name in ("steps", "epochs", "mini_batches"):
            check_range(name, getattr(self, name), 1, 10000)
        for name in ("learning_rate", "desired_kl", "clip", "initial_std", "least_std"):
            check_positive(name, getattr(self, name))
        check_range("discount", self.discount, 0.0, 1.0)
        check_range("gae", self.gae, 0.0, 1.0)
        check_range("least_std", self.least_std, 1e-6, self.initial_std)
        check_range("quiet_share", self.quiet_share, 0.0, 1.0)
        check_range("quiet_noise", self.quiet_noise, 1e-3, 1.0)
        if self.calm_iterations is not None:
            check_range("calm_std", self.calm_std, 1e-6, self.least_std)
            if self.most_std is not None:
                check_range("most_std", self.most_std, self.least_std, math.inf)
            check_range("calm_iterations[0]", self.calm_iterations[0], 0, self.calm_iterations[1] - 1)

    def calm_share(self, iteration: int) -> float:
        """How far an iteration of the run lies between ``calm_iterations``: 0 before them, 1 after."""
        if self.calm_iterations is None:
            return 0.0
        first, last = self.calm_iterations
        return min(max((iteration - first) / (last - first), 0.0), 1.0)

    def noise_floor(self, iteration: int) -> float:
        """The least deviation of the action noise in an iteration of the run."""
        return self.least_std + self.calm_share(iteration) * (self.calm_std - self.least_std)

    def noise_ceiling(self, iteration: int) -> float:
        """The greatest deviation of the action noise in an iteration of the run."""
        calm = self.calm_share(iteration)
        if self.most_std is None or calm == 0.0:
            return math.inf
        return self.most_std + calm * (self.calm_std - self.most_std)


@dataclass(frozen=True, kw_only=True)
class EstimatorSettings:
    """The VAE estimator; what the paper leaves open follows DreamWaQ's open implementations.

    Attributes:
        latent: size of ``z`` (the paper's 16).
        encoder: widths of the encoder's layers.
        decoder: widths of the decoder's layers.
        learning_rate: of its own optimizer, which the policy's adaptive rate does not touch.
        calm_learning_rate: to which that sinks over ``ppo.calm_iterations``: the exported estimate shall not
            depend on its last few steps.
        epochs: passes over the rollout; one is enough, and the update is the dearest part of an iteration.
        sees_command: whether the encoder reads the command. Under ACS the command follows the speed: an
            estimator that sees it learns to read the speed off it, and errs by metres a second as soon as
            the command is given by somebody else.
        contact_weight: of the contacts' cross-entropy.
        latent_weight: beta, of the latent's divergence from a standard normal. With the reconstruction a mean
            over 45 numbers, more than a few thousandths makes the latent collapse.
        velocity_scale: of the velocity's squared error, per m/s; unscaled, 12 m/s would drown all else.
        height_scale: of the height's squared error, per metre.

    Raises:
        InvalidValueError: a size below one or a number that is not positive.
    """

    latent: int = 16
    encoder: tuple[int, ...] = (256, 128)
    decoder: tuple[int, ...] = (64, 128)
    learning_rate: float = 1e-3
    calm_learning_rate: float = 1e-4
    epochs: int = 1
    sees_command: bool = False
    contact_weight: float = 0.2
    latent_weight: float = 1e-3
    velocity_scale: float = 0.5
    height_scale: float = 10.0

    def __post_init__(self) -> None:
        for name in ("latent", "epochs"):
            check_range(name, getattr(self, name), 1, 1000)
        for name in ("learning_rate", "calm_learning_rate", "velocity_scale", "height_scale"):
            check_positive(name, getattr(self, name))
        for name in ("contact_weight", "latent_weight"):
            check_range(name, getattr(self, name), 0.0, 1000.0)
        for name in ("encoder", "decoder"):
            _check_widths(name, getattr(self, name))

    def rate(self, calm: float) -> float:
        """The learning rate after a share of the calm iterations, along a straight line of its logarithm."""
        return self.learning_rate * (self.calm_learning_rate / self.learning_rate) ** calm


@functools.cache
def _kinds(kind: type) -> dict[str, Any]:
    """Type hints of the fields that a class has from this package; none for one that has nothing of it."""
    ours = (each for each in kind.__mro__ if each.__module__.startswith("sprintlab.") and is_dataclass(each))
    found = next(ours, None)
    return {} if found is None else get_type_hints(found)


def _check_kinds(settings: Any, place: str = "") -> None:
    """Refuse what would end the first iteration; parts of one's own classes know themselves what they hold.

    Args:
        settings: a part of the settings, or all of them.
        place: dotted name of the part, with a dot at its end.

    Raises:
        InvalidValueError: names the setting.
    """
    for name, hint in _kinds(type(settings)).items():
        value = getattr(settings, name)
        if is_dataclass(value):
            _check_kinds(value, f"{place}{name}.")
        else:
            check_kind(f"{place}{name}", value, hint)
            _check_sizes(f"{place}{name}", value)


def _check_sizes(name: str, value: Any) -> None:
    """Refuse numbers near the end of 32 bits, which PyTorch takes into no comparison."""
    for number in value if isinstance(value, list | tuple) else (value,):
        if isinstance(number, int | float) and not isinstance(number, bool):
            check_range(name, number, -_LARGEST, _LARGEST)


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """One training run, whole: its hash names it.

    Attributes:
        method: name of the method, see ``methods``.
        robot: name of the robot.
        actuator_model: motor model in training.
        schedule: how commands evolve.
        heading_hold: while no turn is wanted, the commanded yaw rate holds the heading, by the loop that the
            evaluation closes; without it nothing teaches the robot to run straight.
        standing_hold: robots that are asked to stand, and nearly do, are held in their default pose, as
            ``PolicyRuntime`` does it: the estimator sees robots that stand, and runs begin from there.
        prior: strides that are rewarded at the start; none in the paper.
        seed: of every random generator.

    Raises:
        InvalidValueError: a motor model that is unknown, or a setting, also one of a part, of another kind
            than its own or beyond 1e30: a checkpoint of a stranger may hold half an epoch, or a text as a
            weight.
    """

    method: str = "sprint"
    robot: str = "bp2"
    actuator_model: MotorModel = "refined"
    schedule: Schedule = ACS
    heading_hold: bool = True
    standing_hold: bool = True
    simulation: SimulationSettings = SimulationSettings()
    rewards: RewardSettings = RewardSettings()
    randomization: RandomizationSettings = RandomizationSettings()
    episodes: EpisodeSettings = EpisodeSettings()
    stages: StageSettings = StageSettings()
    prior: StridePrior | None = None
    ppo: PpoSettings = PpoSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    observation: ObservationLayout = field(default_factory=lambda: ObservationLayout(history_length=10))
    seed: int = 0

    def __post_init__(self) -> None:
        _check_kinds(self)
        check_choice("actuator_model", self.actuator_model, MOTOR_MODELS)
        rollout = self.simulation.environments * self.ppo.steps
        check_range("simulation.environments * ppo.steps", rollout, 1, LARGEST_ROLLOUT)

    def as_dict(self) -> dict[str, object]:
        """Nested plain values, for the hash and for loggers."""
        return {**asdict(self), "schedule_kind": type(self.schedule).__name__}

    def digest(self) -> str:
        """SHA-256 of all settings."""
        values: dict[str, Any] = self.as_dict()
        values["ppo"] |= REMOVED["PpoSettings"]
        for name in ADDED_REWARDS:
            if getattr(self.rewards, name) == _constant(0.0):
                del values["rewards"][name]
        text = json.dumps(values, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
