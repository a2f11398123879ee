"""One run of one policy on one plant: a speed profile, or a sprint over a distance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sprintlab.commands import (
    SpeedProfile,
    SprintProfile,
    command_start,
    finish_time,
    heading_command,
    self_paced,
)
from sprintlab.control import Policy, PolicyRuntime
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SimulationError
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.disturbances import Disturbances, PolicyClock
from sprintlab.evaluation.metrics import REST_WINDOW, trial_metrics
from sprintlab.evaluation.recorder import Recorder
from sprintlab.evaluation.results import REST_SPEED, SprintResult, Trajectory, TrialResult
from sprintlab.plant import NOMINAL_TRIAL, BaseState, PlantOptions, TrialSettings, open_plant
from sprintlab.robots import RobotDescription

HIGHEST_SPEED = 50.0
"""Highest speed that a trial asks for [m/s]."""
LONGEST_SPRINT = 3600.0
"""Longest time that a sprint may take; it is kept in memory [s]."""
SLOWEST_SHARE = 0.25
"""A sprint that is slower than this share of its command is given up."""
STALL_TIME, STALL_DISTANCE = 10.0, 1.0
"""A sprint is given up when the robot comes no farther than this distance [m] in this time [s]."""


def check_top_speed(field: str, top_speed: float) -> None:
    """Refuse a speed that no profile can ask for. Raises ``InvalidValueError``."""
    check_positive(field, top_speed, "m/s")
    check_range(field, top_speed, 0.0, HIGHEST_SPEED, "m/s")


def check_sprint(field: str, distance: float, top_speed: float = HIGHEST_SPEED) -> None:
    """Refuse a distance [m] that is not positive, or could be run for longer than ``LONGEST_SPRINT``.

    Raises:
        InvalidValueError: as said.
    """
    check_positive(field, distance, "m")
    check_range(field, distance, 0.0, LONGEST_SPRINT * SLOWEST_SHARE * top_speed, f"m at {top_speed:g} m/s")


@dataclass(frozen=True, kw_only=True)
class TrialRequest:
    """One trial to run; small enough to send to another process.

    Raises:
        InvalidValueError: a speed, distance or duration is not positive, or is beyond ``HIGHEST_SPEED`` or
            ``LONGEST_SPRINT``.
    """

    top_speed: float  # v* of the profile [m/s]
    settings: TrialSettings = NOMINAL_TRIAL
    self_paced: bool = False  # hold the command near the measured speed
    distance: float | None = None  # length of a sprint [m]; None runs the stand-rise-hold-fall-stand profile
    hold: float = 10.0  # duration of the profile's hold [s]
    plant: PlantOptions = field(default_factory=PlantOptions)
    clock: PolicyClock = field(default_factory=PolicyClock)
    keep_trajectory: bool = False  # whether the result carries its arrays

    def __post_init__(self) -> None:
        check_top_speed("trial.top_speed", self.top_speed)
        check_range("trial.hold", self.hold, 0.5, 600.0, "s")
        if self.distance is not None:
            check_sprint("trial.distance", self.distance, self.top_speed)

    def __str__(self) -> str:
        pacing = "self-paced" if self.self_paced else "raw"
        return f"{pacing} trial at {self.top_speed:g} m/s with seed {self.settings.seed}"


class Course:
    """What asks for a speed and a yaw rate, and says when the run is over."""

    longest: float
    """The run lasts no longer [s]."""

    def speed(self, time: float, base: BaseState) -> float | None:
        """Speed asked for [m/s]; ``None`` ends the run. Asked once in every policy step."""
        raise NotImplementedError

    def steer(self, base: BaseState, speed: float) -> float:
        """Yaw-rate command at a commanded speed [rad/s]: straight on along x, the protocol's heading loop."""
        return float(heading_command(base.heading, base.lateral_offset, speed))


class ProfileCourse(Course):
    """Asks for a profile to its end."""

    def __init__(self, profile: SpeedProfile) -> None:
        self._profile, self.longest = profile, profile.duration

    def speed(self, time: float, base: BaseState) -> float | None:
        """The profile's speed [m/s]."""
        return float(self._profile.command(time)) if time < self.longest - 1e-9 else None


class SprintCourse(Course):
    """Rise and hold until the distance [m] is run, then brake and stand for the time ``rest`` [s].

    A robot slower than ``slowest_share`` of the command is given up.
    """

    def __init__(
        self,
        profile: SprintProfile,
        distance: float,
        *,
        rest: float = 2.0,
        slowest_share: float = SLOWEST_SHARE,
    ) -> None:
        self.profile, self.distance, self._rest, self._slowest = profile, distance, rest, slowest_share
        self.finish_time: float | None = None
        """When the distance was run [s]."""
        self.stalled = False
        """Whether the robot got nowhere."""
        self._mark = (0.0, 0.0)  # time [s] and distance [m] of progress

    @property
    def latest_finish(self) -> float:
        """A sprint that has not covered the distance by now has failed [s]."""
        profile, slowest = self.profile, self._slowest * self.profile.top_speed
        return profile.stand + profile.top_speed / profile.acceleration + self.distance / slowest

    @property
    def longest(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The run lasts no longer [s]."""
        return self.profile.end_time(self.latest_finish) + self._rest

    def run_distance(self, base: BaseState) -> float:
        """How much of the distance is run [m]; asked once in every policy step."""
        return base.distance

    def speed(self, time: float, base: BaseState) -> float | None:
        """Commanded speed [m/s]; ``None`` at the end."""
        run, end = self.run_distance(base), self.latest_finish
        self.stalled = self.stalled or self._stands(time, run)
        if self.stalled:
            return None
        if self.finish_time is None and run >= self.distance:
            self.finish_time = time
        if self.finish_time is not None:
            end = self.profile.end_time(self.finish_time) + self._rest
        return float(self.profile.command(time, self.finish_time)) if time < end - 1e-9 else None

    def _stands(self, time: float, run: float) -> bool:
        """Whether the robot has got nowhere for too long."""
        since, reached = self._mark
        if time <= self.profile.stand or run >= reached + STALL_DISTANCE or self.finish_time is not None:
            self._mark = time, run
            return False
        return time - since > STALL_TIME


def run_trial(policy: Policy, robot: RobotDescription, request: TrialRequest) -> TrialResult:
    """Run the profile ``P(v*)`` once.

    Raises:
        SimulationError: the simulation left the realm of finite numbers; names trial, moment and quantity.
        ContractMismatchError: the policy was made for another robot.
    """
    profile = SpeedProfile(top_speed=request.top_speed, hold=request.hold)
    run = _simulate(policy, robot, request, ProfileCourse(profile))
    return _trial_result(run, robot, request, profile.hold_interval)


def run_course(policy: Policy, robot: RobotDescription, request: TrialRequest, course: Course) -> TrialResult:
    """Run commands of one's own to their end or to a fall; errors as in ``run_trial``.

    The whole run counts as the hold.
    """
    run = _simulate(policy, robot, request, course)
    return _trial_result(run, robot, request, (0.0, float(run.trajectory.time[-1])))


def run_sprint(policy: Policy, robot: RobotDescription, request: TrialRequest) -> SprintResult:
    """Run ``request.distance`` once; errors as in ``run_trial``.

    The time counts from the first non-zero command to the moment the base has covered the distance along x.
    """
    distance = request.distance or 100.0
    profile = SprintProfile(top_speed=request.top_speed)
    course = SprintCourse(profile, distance)
    run = _simulate(policy, robot, request, course)
    moved = run.trajectory
    start = command_start(moved.time, moved.profile_speed)
    finish = finish_time(moved.time, moved.qpos[:, 0] - moved.qpos[0, 0], distance)
    full_speed = profile.stand + profile.top_speed / profile.acceleration
    end = finish if np.isfinite(finish) else float(moved.time[-1])
    trial = _trial_result(run, robot, request, (min(full_speed, end), end), finish)
    return SprintResult(distance=distance, time=finish - start, trial=trial, stalled=course.stalled)


@dataclass(frozen=True, kw_only=True)
class _Run:
    trajectory: Trajectory
    fall_reason: str
    fall_time: float | None


def _simulate(policy: Policy, robot: RobotDescription, request: TrialRequest, course: Course) -> _Run:
    try:
        return _drive(policy, robot, request, course)
    except SimulationError as error:
        raise SimulationError(f"{request}: {error}") from error


def _drive(policy: Policy, robot: RobotDescription, request: TrialRequest, course: Course) -> _Run:
    plant = open_plant(robot, request.plant, request.settings)
    runtime = PolicyRuntime(policy, robot)
    runtime.reset()
    # The last action's period, drawn long, may reach past the end.
    longest = course.longest + 2.0 / request.clock.rate
    recorder = Recorder(plant, math.ceil(longest * request.plant.record_rate), estimates=policy.estimates)
    periods = request.clock.periods(request.plant.motor_rate, request.settings.seed)
    disturbances = Disturbances(robot, request.settings, request.plant.motor_rate)
    upright = True
    while upright:
        base = plant.base_state()
        asked = course.speed(plant.time, base)
        if asked is None:
            break
        recorder.profile_speed = asked
        speed = float(self_paced(asked, base.forward_speed)) if request.self_paced else asked
        recorder.command = np.array([speed, 0.0, course.steer(base, speed)])
        targets = runtime.step(disturbances.measured(plant.measurement()), recorder.command)
        recorder.estimate = runtime.last_estimate
        period = next(periods)
        disturbances.push(plant, period)
        for held, steps in disturbances.delivered(np.asarray(targets, dtype=float), period):
            upright = upright and plant.advance(held, steps, recorder)
    fall_time = None if upright else plant.time
    return _Run(trajectory=recorder.trajectory(), fall_reason=plant.fall_reason, fall_time=fall_time)


def _trial_result(
    run: _Run,
    robot: RobotDescription,
    request: TrialRequest,
    hold_interval: tuple[float, float],
    finish: float | None = None,
) -> TrialResult:
    metrics = trial_metrics(
        run.trajectory,
        robot,
        hold_interval,
        payload=request.settings.payload,
        plant=request.plant,
        finish=finish,
        fell=bool(run.fall_reason),
    )
    end = float(run.trajectory.time[-1])
    stopped = end < hold_interval[1] + REST_WINDOW or metrics.final_speed < REST_SPEED
    return TrialResult(
        settings=request.settings,
        top_speed=request.top_speed,
        self_paced=request.self_paced,
        completed=stopped and not run.fall_reason,
        fall_time=run.fall_time,
        fall_reason=run.fall_reason,
        hold_interval=hold_interval,
        metrics=metrics,
        audit=audit_trials([metrics], request.clock.rate),
        trajectory=run.trajectory if request.keep_trajectory else None,
    )
