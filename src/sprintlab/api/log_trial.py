"""A log of a run, as the evaluation's figures and metrics read it.

What a robot cannot know about itself (foot contacts, penetration, slip, distances between its legs) is zero
in the trajectory made here; nothing that is drawn or printed from a log uses it.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.commands import heading_angle, in_heading_frame, wrap_angle
from sprintlab.core.array_types import FloatArray
from sprintlab.deployment.log import LogError, RunRecord
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.figures import ON_LIMIT_MARGIN
from sprintlab.evaluation.metrics import envelope_share, trial_metrics
from sprintlab.evaluation.results import Trajectory, TrialResult
from sprintlab.evaluation.run_report import TrackRun
from sprintlab.motors import desaturate, shaft_torque, torque_limits
from sprintlab.plant import TrialSettings
from sprintlab.robots import RobotDescription

RATE = 500.0
"""Samples a second of the trajectory [Hz], as the evaluation's."""

_SHORTEST = 0.5  # run that is drawn [s]
_SPARSEST = 100.0  # control steps a second of a log that is drawn; a controller makes a thousand

FALLS = {"fall", "tumble", "collapse"}
_FULL_SHARE = 0.95  # share of the highest command: from there on it counts as held


def logged_run(record: RunRecord, robot: RobotDescription, distance: float = 100.0) -> TrackRun:
    """The part of a log in which the policy drove; its time starts with the policy.

    Args:
        distance: to be timed [m].

    Raises:
        LogError: the policy never drove, the log holds fewer than two position fixes of that time or gaps in
            place of its control steps, or it is of a robot with other joints.
    """
    joints = record.column("states", "joint_position").shape[1]
    if joints != len(robot.joint_names):
        found = f"{joints} joints, {robot.name} has {len(robot.joint_names)}"
        raise LogError(f"the log is of a robot with {found}")
    running = record.column("ticks", "mode") == "run"
    tick_time = record.column("ticks", "time")
    begin, end = _span(record, running, tick_time)
    time = np.arange(0.0, end - begin, 1.0 / RATE)
    course = _Course(record, begin, end)
    trajectory = _trajectory(record, robot, course, time, begin)
    steps = running & record.column("ticks", "policy_step")
    command = record.column("ticks", "velocity")[steps]
    command_time = tick_time[steps] - begin
    faults = Counter(fault for noted in record.column("ticks", "faults") for fault in noted)
    return TrackRun(
        trial=_trial(trajectory, robot, _hold(command_time, command), not faults.keys() & FALLS),
        fix_time=course.time - begin,
        fix_speed=course.velocity[:, 0],
        fix_distance=course.position[:, 0],
        command_time=command_time,
        command=command,
        distance=distance,
        faults=dict(faults),
    )


def _span(record: RunRecord, running: NDArray[np.bool_], tick_time: FloatArray) -> tuple[float, float]:
    """When the policy began and ceased to drive [s]. Raises ``LogError``."""
    begin, end = tick_time[running][[0, -1]].tolist() if running.any() else (0.0, 0.0)
    if end - begin < _SHORTEST:
        raise LogError("the log holds less than half a second of running: there is nothing to draw")
    if not (running & record.column("ticks", "policy_step")).any() or len(record.states.time) < 2:
        raise LogError("the log holds no policy step of the run, or a single state: there is nothing to draw")
    inside = (tick_time >= begin) & (tick_time <= end)
    if inside.sum() < _SPARSEST * (end - begin):
        raise LogError(f"the log has gaps: fewer than {_SPARSEST:g} control steps a second of the run")
    return begin, end


class _Course:
    """Position fixes in the frame of the run: x along the heading at its start."""

    def __init__(self, record: RunRecord, begin: float, end: float) -> None:
        inside = (record.fixes.time >= begin - 0.5) & (record.fixes.time <= end)
        if inside.sum() < 2:
            raise LogError("the log holds no position fixes of the run: speed and distance are not known")
        self.time = record.fixes.time[inside]
        first = int(np.searchsorted(record.states.time, begin, side="right")) - 1
        self.heading = float(heading_angle(record.column("states", "quaternion")[max(first, 0)]))
        c, s = np.cos(self.heading), np.sin(self.heading)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        position = record.column("fixes", "position")[inside]
        origin = position[max(int(np.searchsorted(self.time, begin, side="right")) - 1, 0)]
        self.position = (position - origin * [1.0, 1.0, 0.0]) @ turn.T
        self.velocity = record.column("fixes", "velocity")[inside] @ turn.T

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and velocity ``(T, 3)`` at controller times, straight between the fixes."""
        return _between(time, self.time, self.position), _between(time, self.time, self.velocity)


def _between(time: FloatArray, known: FloatArray, values: FloatArray) -> FloatArray:
    return np.stack([np.interp(time, known, column) for column in values.T], axis=-1)


def _trajectory(
    record: RunRecord, robot: RobotDescription, course: _Course, time: FloatArray, begin: float
) -> Trajectory:
    index = np.clip(np.searchsorted(record.states.time, time + begin, side="right") - 1, 1, None)
    tick = np.searchsorted(record.column("ticks", "time"), time + begin, side="right") - 1
    tick = np.clip(tick, 0, None)
    command = record.column("ticks", "velocity")[tick]
    position, velocity = course.at(time + begin)
    quaternion, angular_velocity, joint_position, joint_torque, bus_voltage = (
        record.column("states", name)[index]
        for name in ("quaternion", "angular_velocity", "joint_position", "joint_torque", "bus_voltage")
    )
    speeds = record.column("states", "joint_velocity")
    # A drive sets its torque by the speed of the state before; speed and torque belong together.
    feet, joint_velocity = (len(time), len(robot.leg_names)), speeds[index - 1]
    heading = np.unwrap(wrap_angle(heading_angle(quaternion) - course.heading))
    return Trajectory(
        time=time,
        qpos=np.concatenate((position, quaternion, joint_position), axis=1),
        qvel=np.concatenate((velocity, angular_velocity, speeds[index]), axis=1),
        profile_speed=command[:, 0],
        command=command,
        velocity=in_heading_frame(velocity, heading),
        angular_velocity=angular_velocity,
        heading=heading,
        joint_position=joint_position,
        joint_velocity=joint_velocity,
        joint_target=record.column("ticks", "targets")[tick],
        joint_torque=joint_torque,
        **_motor_side(robot, joint_velocity, joint_torque, bus_voltage),
        foot_contact=np.zeros(feet, dtype=bool),
        foot_penetration=np.zeros(feet),
        foot_position=np.zeros((*feet, 3)),
        foot_slip_speed=np.zeros(feet),
        leg_distance=np.zeros(len(time)),
    )


def _motor_side(
    robot: RobotDescription, velocity: FloatArray, torque: FloatArray, voltage: FloatArray
) -> dict[str, FloatArray]:
    """Torques of the motors and their limits ``(T, joints)``, from what the drives report of the joints."""
    lower, upper = torque_limits(robot.motors, velocity * np.asarray(robot.gear.ratio), voltage[:, None])
    delivered = shaft_torque(robot.gear, torque, velocity)
    return {
        "motor_torque": np.asarray(desaturate(robot.motors, delivered)),
        "torque_lower": np.asarray(lower),
        "torque_upper": np.asarray(upper),
    }


def _trial(
    trajectory: Trajectory, robot: RobotDescription, hold: tuple[float, float], completed: bool
) -> TrialResult:
    margin = ON_LIMIT_MARGIN * np.asarray(robot.motors.peak_torque)
    shares = tuple(envelope_share(trajectory, margin).tolist())
    unknown = ("pad_deflection", "smallest_leg_distance", "slip_per_step", "foot_force", "mean_duty")
    nothing: dict[str, Any] = dict.fromkeys(unknown, math.nan)
    nothing |= dict.fromkeys(("duty_factor", "load_share"), (math.nan,) * len(robot.leg_names))
    metrics = replace(trial_metrics(trajectory, robot, hold), envelope_share=shares, **nothing)
    return TrialResult(
        settings=TrialSettings(),
        top_speed=float(trajectory.command[:, 0].max()),
        self_paced=False,
        completed=completed,
        fall_time=None,
        fall_reason="",
        hold_interval=hold,
        metrics=metrics,
        audit=audit_trials([metrics]),
        trajectory=trajectory,
    )


def _hold(time: FloatArray, command: FloatArray) -> tuple[float, float]:
    """From the first to the last command near the highest one [s]."""
    full = np.flatnonzero(command[:, 0] >= _FULL_SHARE * max(command[:, 0].max(), 1e-9))
    return (float(time[full[0]]), float(time[full[-1]])) if len(full) else (0.0, float(time[-1]))
