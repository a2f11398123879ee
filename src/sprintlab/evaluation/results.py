"""What an evaluation hands back: trajectories, trials, protocol, race. Plain data, no simulator.

Shapes: ``T`` samples (500 Hz unless ``PlantOptions.record_rate`` says otherwise), joints in policy
order ``FL, FR, RL, RR`` x ``abad, hip, knee``, 4 feet in the order ``FL, FR, RL, RR``. SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from itertools import takewhile
from typing import Any

import numpy as np

from sprintlab.commands import LANE_WIDTH
from sprintlab.core.array_types import Array
from sprintlab.core.errors import SimulationError
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.quantities import shown, shown_fields
from sprintlab.plant import TrialSettings

REST_SPEED = 0.3
"""Below it a robot counts as at rest [m/s]."""

STEADY_RISE = 0.1
"""A held speed that rises by no more than this is steady [m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """What one trial recorded, sample axis first; what was not measured is ``None``.

    "Mean" and "greatest" are over the motor steps since the last sample.
    """

    time: Array  # (T,) [s] since the start of the profile
    qpos: Array  # (T, nq) MuJoCo's: base position 3, quaternion 4 (w first), joints
    qvel: Array  # (T, nv) MuJoCo's: base velocity in the world 3, angular velocity in the body 3, joints
    profile_speed: Array  # (T,) [m/s] that the profile asks for, before self-pacing
    command: Array  # (T, 3) what the policy was given: forward, left [m/s], yaw rate [rad/s]
    velocity: Array  # (T, 2) base velocity in the heading frame: forward, left [m/s]
    angular_velocity: Array  # (T, 3) base, body frame: roll, pitch, yaw rate [rad/s]
    heading: Array  # (T,) yaw angle, unwrapped [rad]
    joint_position: Array  # (T, joints) [rad]
    joint_velocity: Array  # (T, joints) joint side [rad/s]; times the gear ratio = motor speed
    joint_target: Array  # (T, joints) filtered joint targets of the PD loop [rad]
    motor_torque: Array  # (T, joints) motor side, after the envelope's clip, before saturation [N m]
    torque_lower: Array  # (T, joints) lower end of the envelope, motor side [N m]
    torque_upper: Array  # (T, joints) upper end of the envelope, motor side [N m]
    joint_torque: Array  # (T, joints) delivered to the joint, saturation, gear and efficiency in [N m]
    foot_contact: Array  # (T, legs) bool, the ground presses on the foot with more than 1 N
    foot_penetration: Array  # (T, legs) greatest deflection of the foot's pad [m], >= 0
    foot_position: Array  # (T, legs, 3) centre of the foot sphere, world [m]
    foot_slip_speed: Array  # (T, legs) at which the foot slides over the ground, mean [m/s]
    leg_distance: Array  # (T,) smallest surface distance between two legs [m]; negative: they overlap
    foot_force: Array | None = None  # (T, legs) normal force of the ground, mean [N]
    foot_impact: Array | None = None  # (T, legs) greatest mean of that force over 5 ms [N]
    joint_power: Array | None = None  # (T, joints) delivered to the joint, mean [W]
    copper_loss: Array | None = None  # (T, joints) heat in the windings, mean [W]
    bus_power: Array | None = None  # (T,) what all motors draw from the bus, mean [W]
    gear_torque: Array | None = None  # (T, joints) motor's torque minus rotor inertia times acceleration,
    # the mean over one motor step of greatest magnitude [N m]
    estimate: Array | None = None  # (T, 8) velocity in the body frame 3 [m/s], base height 1 [m],
    # probability of foot contact 4; None for a policy without an estimator
    bus_voltage: Array | None = None  # (T,) [V]; None without battery, heat and flux weakening
    winding_temperature: Array | None = None  # (T, joints) [degC]; None without heat
    i2t_level: Array | None = None  # (T, joints) 1 at its limit [-]; None without a limit by I²t

    def arrays(self) -> dict[str, Array]:
        """Every array that there is by its name, for ``numpy.savez_compressed``."""
        named = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: values for name, values in named.items() if values is not None}


def require_finite(trajectory: Trajectory) -> None:
    """Refuse a trajectory that holds NaN or infinity.

    Raises:
        SimulationError: names the first array, and the first sample's time where that is known.
    """
    for name, values in trajectory.arrays().items():
        finite = np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if not finite.all():
            sample = int(np.argmin(finite))
            moment = trajectory.time[sample]
            when = f"at {moment:.3f} s" if np.isfinite(moment) else f"in sample {sample}"
            raise SimulationError(f"the trajectory holds a value that is no finite number: {name} {when}")


@dataclass(frozen=True, kw_only=True)
class EstimateBand:
    """Errors of a policy's estimate while the robot really ran at a speed of this band."""

    lower: float  # slowest speed of the band [m/s]
    upper: float  # fastest speed of the band [m/s]
    samples: int  # policy steps that count
    forward_bias: float  # mean of estimated minus true forward velocity [m/s]
    forward_error: float  # its root mean square [m/s]
    velocity_error: float  # root mean square of the length of the velocity error, all three axes [m/s]
    height_error: float  # root mean square [m]
    contact_accuracy: float  # share of feet and steps at which contact or flight was told rightly


@dataclass(frozen=True, kw_only=True)
class TrialMetrics:
    """What one trajectory amounts to; ``nan`` where a number is not defined, as after a fall.

    Powers and gait are those of the last 2 s of the hold. Fields made with ``shown`` stand in tables and
    JSON files, in this order.
    """

    # fmt: off
    held_speed: float = shown("held_speed_m_s", "held speed", 2, "m/s",
        "mean over the last 2 s of the hold, heading frame")
    hold_acceleration: float = shown("hold_acceleration_m_s2", "held speed still rises by", 2, "m/s²",
        "mean of the hold's last second minus the second before; steady up to 0.1")
    peak_speed: float = shown("peak_speed_m_s", "peak speed, 0.5 s mean", 2, "m/s", "best mean over 0.5 s")
    angular_cost: float = shown("J_rad2_s", "J, roll and pitch rates", 2, "rad²/s",
        "integral of roll rate² + pitch rate² over the profile")
    angular_cost_rate: float = shown("J_per_second_rad2_s2", "J per second of the hold", 2, "rad²/s²",
        "mean of roll rate² + pitch rate² over the hold")
    cost_of_transport: float = shown("cost_of_transport", "cost of transport", 2, "",
        "power from the bus / (mass g speed), same time")
    electrical_power: float = shown("electrical_power_W", "power from the bus", 0, "W",
        "all motors, last 2 s of the hold")
    mechanical_power: float = shown("mechanical_power_W", "mechanical power", 0, "W",
        "delivered to the joints, last 2 s of the hold")
    copper_power: float = shown("copper_power_W", "copper loss", 0, "W",
        "heat in the windings, last 2 s of the hold")
    stride_frequency: float = shown("stride_frequency_Hz", "stride frequency", 2, "Hz",
        "last 2 s of the hold")
    stance_time: float = shown("stance_s", "stance, median", 3, "s",
        "from touchdown to lift-off, last 2 s of the hold")
    mean_duty: float = shown("duty", "duty factor, mean foot", 3, "",
        "share of the time on the ground, last 2 s of the hold")
    lateral_deviation: float = shown("lateral_deviation_m", "sideways deviation", 2, "m",
        "largest distance from the straight line")
    over_speed_share: float = shown("over_speed_share", "time beyond no-load speed, all joints", 4, "",
        "share of all joints' time in which the drive can only brake")
    # fmt: on
    distance: float = math.nan  # forward distance of the base [m]
    envelope_share: tuple[float, ...] = ()  # (joints,) share of the time asked to move with torque on a limit
    feet: tuple[str, ...] = ()  # names of the legs
    duty_factor: tuple[float, ...] = ()  # (legs,) share of time on the ground
    load_share: tuple[float, ...] = ()  # (legs,) share of the ground's force that each foot bears
    asked_speed: float = math.nan  # what the profile asks for at the end of the hold, if constant [m/s]
    touchdowns_per_stride: float = math.nan  # per foot, every bounce counted
    foot_force: float = math.nan  # greatest on one foot, mean over 5 ms [body weights, payload included]
    gear_torque_ratio: tuple[float, ...] = ()  # (joints,) greatest mean over 1 ms over the joint's peak
    joint_speed_ratio: tuple[float, ...] = ()  # (joints,) highest motor speed over no-load speed
    pad_deflection: float = math.nan  # deepest that a foot's pad is pressed in [m]
    smallest_leg_distance: float = math.nan  # between surfaces of two legs [m]; negative: they overlap
    slip_per_step: float = math.nan  # mean distance that a foot slides in one stance [m]
    final_speed: float = math.nan  # highest horizontal speed in the last second [m/s]; nan after a fall
    lane_excursion: float = math.nan  # farthest outer edge of a foot from the middle, up to the finish [m]
    line_winding_temperature: float = math.nan  # hottest winding at the finish of a sprint [degC]; from
    # 25 degC and the currents where heat is off
    estimate: tuple[EstimateBand, ...] = ()  # by speed; empty for a policy without an estimator
    lowest_bus_voltage: float | None = None  # [V]; None without battery, heat and flux weakening
    hottest_winding: float | None = None  # [degC]; None without heat
    highest_i2t_level: float | None = None  # highest of all joints [-]; None without a limit by I²t

    @property
    def command_share(self) -> float:
        """Held speed over the constant speed asked for; ``nan`` where the speed asked for varies."""
        return self.held_speed / self.asked_speed if self.asked_speed > 0.0 else math.nan


QUANTITIES = shown_fields(TrialMetrics)
"""What tables show of a trial, in their order."""


def quantity_numbers(value_of: Callable[[str], Any]) -> dict[str, Any]:
    """Every quantity under its JSON key; ``value_of`` gives the value of a field of ``TrialMetrics``."""
    return {quantity.key: value_of(quantity.field) for quantity in QUANTITIES}


@dataclass(frozen=True, kw_only=True)
class AuditItem:
    """One measured exploit."""

    name: str  # e.g. "gear torque"
    value: float  # median over the trials of each trial's worst
    unit: str  # the one of value and threshold, empty for a ratio
    threshold: float
    passed: bool
    note: str  # what was measured, and why it is asked
    source: str = ""  # where the limit comes from
    bound: str = "at most"  # or "at least": from which side the limit bounds
    worst: float = math.nan  # the worst trial's, which may miss the limit a little: see audit_trials
    detail: str = ""  # what the worst trial did, in words


@dataclass(frozen=True, kw_only=True)
class AuditReport:
    """The exploit audit of one or more trials."""

    items: tuple[AuditItem, ...]

    @property
    def passed(self) -> bool:
        """True when every item passed."""
        return not self.failed

    @property
    def failed(self) -> tuple[AuditItem, ...]:
        """The items that did not pass."""
        return tuple(item for item in self.items if not item.passed)

    def to_dict(self) -> dict[str, Any]:
        """JSON form: ``passed`` and ``items``; undefined values become null."""
        return {"passed": self.passed, "items": [json_ready(asdict(item)) for item in self.items]}


@dataclass(frozen=True, kw_only=True)
class TrialResult:
    """One run of one profile."""

    settings: TrialSettings  # what was drawn for this trial
    top_speed: float  # v* of the profile [m/s]
    self_paced: bool  # whether the command was held near the measured speed
    completed: bool  # no fall from start to end, and at rest in the last second
    fall_time: float | None  # [s]
    fall_reason: str  # "tilt", "trunk contact", "knee contact"; empty without a fall
    hold_interval: tuple[float, float]  # start and end of the hold [s]
    metrics: TrialMetrics
    audit: AuditReport
    trajectory: Trajectory | None = None  # None when only the summary was kept


@dataclass(frozen=True, kw_only=True)
class SpeedResult:
    """All trials of one profile speed."""

    top_speed: float  # v* [m/s]
    self_paced: bool
    trials: tuple[TrialResult, ...]  # in the order of their seeds
    required: int  # how many must complete

    @property
    def completed(self) -> tuple[TrialResult, ...]:
        """The trials without a fall that came to rest."""
        return tuple(trial for trial in self.trials if trial.completed)

    @property
    def falls(self) -> int:
        """Number of trials that fell."""
        return sum(bool(trial.fall_reason) for trial in self.trials)

    @property
    def not_stopped(self) -> int:
        """Number of trials that did not fall and were not at rest in the last second."""
        return len(self.trials) - len(self.completed) - self.falls

    @property
    def passed(self) -> bool:
        """Whether enough trials completed."""
        return len(self.completed) >= self.required

    @property
    def ran(self) -> bool:
        """Whether enough trials ran without a fall, at rest at the end or not."""
        return len(self.trials) - self.falls >= self.required

    @property
    def running_speed(self) -> float:
        """Mean held speed of the trials without a fall [m/s]; ``nan`` where all fell."""
        held = [trial.metrics.held_speed for trial in self.trials if not trial.fall_reason]
        return float(np.mean(held)) if held else math.nan

    def mean(self, name: str) -> Any:
        """Mean of one field of ``TrialMetrics`` over the completed trials; ``nan`` when none completed.

        Returns:
            A float, or an array ``(joints,)`` or ``(legs,)`` for the per-joint and per-foot fields.
        """
        values = np.array([getattr(trial.metrics, name) for trial in self.completed], dtype=float)
        mean = values.mean(axis=0) if values.size else math.nan
        return float(mean) if np.ndim(mean) == 0 else mean

    @property
    def held_steady(self) -> bool | None:
        """Whether the held speed, mean of the completed trials, had stopped rising; ``None`` without one."""
        rise = self.mean("hold_acceleration")
        return None if math.isnan(rise) else rise <= STEADY_RISE

    def to_dict(self) -> dict[str, Any]:
        """The numbers, keys with units."""
        own = {name: getattr(self, name) for name in ("falls", "not_stopped", "held_steady")}
        means = {name: self.mean(name) for name in ("envelope_share", "duty_factor")}
        return {**quantity_numbers(self.mean), **own, "trials": len(self.trials), **means}


@dataclass(frozen=True, kw_only=True)
class ProtocolResult:
    """The search for the highest speed, one way of giving the command."""

    self_paced: bool
    speeds: tuple[SpeedResult, ...]  # every v* tried, rising

    @property
    def _ran(self) -> tuple[SpeedResult, ...]:
        """Every v* before the first at which too many trials fell, rising."""
        return tuple(takewhile(lambda speed: speed.ran, self.speeds))

    @property
    def passed(self) -> tuple[SpeedResult, ...]:
        """Every v* at which enough trials completed, before the first at which too many fell, rising."""
        return tuple(speed for speed in self._ran if speed.passed)

    @property
    def running(self) -> SpeedResult | None:
        """The highest v* before the first at which too many trials fell; stopping is not asked for."""
        return self._ran[-1] if self._ran else None

    @property
    def best(self) -> SpeedResult | None:
        """The highest v* of ``passed``; ``None`` if no speed passed."""
        return self.passed[-1] if self.passed else None

    @property
    def fastest(self) -> SpeedResult | None:
        """The v* up to the best one at which most speed was held; asked for more, a policy may give less."""
        return max(self.passed, key=lambda speed: speed.mean("held_speed"), default=None)

    def mean(self, name: str) -> Any:
        """``SpeedResult.mean`` at the best v*; ``nan`` when nothing completed."""
        return math.nan if self.best is None else self.best.mean(name)


@dataclass(frozen=True, kw_only=True)
class SprintResult:
    """One run over a distance."""

    distance: float  # to run [m]
    time: float  # from the first non-zero command to the base's last metre [s]; nan when not reached
    trial: TrialResult
    stalled: bool = False  # given up because the robot got nowhere

    @property
    def finished(self) -> bool:
        """Whether the distance was reached without a fall."""
        return math.isfinite(self.time)

    @property
    def left_lane(self) -> bool:
        """Whether a foot left the lane before the finish."""
        return self.trial.metrics.lane_excursion > LANE_WIDTH / 2.0


@dataclass(frozen=True, kw_only=True)
class EngineResult:
    """The sprint and the raw trials of a race in one of ``sprintlab.plant.ENGINES``."""

    engine: str
    sprint: SprintResult
    raw: SpeedResult

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON-ready values, under the keys of ``result.json``."""
        means = {"sprint_time_s": self.sprint.time, **quantity_numbers(self.raw.mean)}
        return json_ready(
            {"engine": self.engine, **means, "falls": self.raw.falls, "trials": len(self.raw.trials)}
        )


@dataclass(frozen=True, kw_only=True)
class RaceResult:
    """The 100 m and the protocol at the policy's top speed."""

    robot: str
    policy: str
    top_speed: float  # v* of the profile [m/s]
    sprint: SprintResult  # raw command
    sprint_self_paced: SprintResult
    raw: SpeedResult  # the seeded trials at top_speed, raw command
    self_paced: SpeedResult
    audit: AuditReport  # covers every trial
    mass: float  # total mass of the robot [kg]
    wall_time: float  # how long the race took to compute [s]
    battery: TrialResult | None = None  # one raw trial on a battery and with warm windings; None where
    # every trial has both
    notes: tuple[str, ...] = ()  # what differs from the published numbers' plant, and other remarks
    engine: str = "mujoco"  # one of sprintlab.plant.ENGINES
    second_engine: EngineResult | None = None
    policy_facts: Mapping[str, str] = field(default_factory=dict[str, str])  # hash and training of the policy

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON-ready values (``nan`` becomes null), for ``result.json``.

        Means are over the trials that completed; ``sprint_time_s`` is raw, over ``distance_m``;
        ``time_100m_s`` is the same where that is 100 m, else null.
        """
        raw, paced = self.sprint, self.sprint_self_paced
        hundred = 1.0 if raw.distance == 100.0 else math.nan
        return json_ready(
            {
                "robot": self.robot,
                "policy": self.policy,
                "top_speed_command_m_s": self.top_speed,
                "distance_m": raw.distance,
                "sprint_time_s": raw.time,
                "sprint_time_self_paced_s": paced.time,
                "time_100m_s": hundred * raw.time,
                "time_100m_self_paced_s": hundred * paced.time,
                "left_lane": raw.left_lane,
                "left_lane_self_paced": paced.left_lane,
                **self.raw.to_dict(),
                "self_paced": self.self_paced.to_dict(),
                "audit": self.audit.to_dict(),
                "battery": self.battery and supply_numbers(self.battery),
                "engine": self.engine,
                "second_engine": self.second_engine and self.second_engine.to_dict(),
                "mass_kg": self.mass,
                "wall_time_s": self.wall_time,
                "notes": self.notes,
            }
        )


def supply_numbers(trial: TrialResult) -> dict[str, Any]:
    """What battery and heat leave of a speed, keys with units; undefined values are ``nan`` or ``None``."""
    return {
        "top_speed_m_s": trial.top_speed,
        "held_speed_m_s": trial.metrics.held_speed,
        "completed": trial.completed,
        "fall_reason": trial.fall_reason,
        "lowest_bus_voltage_V": trial.metrics.lowest_bus_voltage,
        "hottest_winding_degC": trial.metrics.hottest_winding,
    }
